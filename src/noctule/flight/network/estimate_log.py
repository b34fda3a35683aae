"""What a node knew, written as it flies: a table, and a recording that any Foxglove tool opens."""

from __future__ import annotations

import csv
import math
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

import numpy as np

from noctule.estimation.filter_state import YAW, StateEstimate, state_names
from noctule.flight.depth_recording import DepthRecorder
from noctule.flight.network.member import Member
from noctule.flight.recording import RecordingError
from noctule.geometry import wrap_angle
from noctule.messages import PoseMeasurement

_NAME, _TABLE, _RECORDING = "estimates", ".csv", ".mcap"
_FUSED = "fused"
_PLACE_KNOWN, _HEADING_KNOWN = 2.0, 1.0  # [m], [rad], deviations from which on there is nothing to show
_MOST_MISSING = 4  # names in the live line


class EstimateLog:
    """Writes estimates.csv and estimates.mcap into a folder; a watcher of a node's process.

    What another run left there is kept: then these are estimates-2.csv and estimates-2.mcap, and so on.
    Raises RecordingError when the disk refuses.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.table, self.recording = folder / f"{_NAME}{_TABLE}", folder / f"{_NAME}{_RECORDING}"
        self.others = 0  # runs that are in the folder already
        self.count = 0
        self._open = ExitStack()
        self._file: IO[str]
        self._table: Any = None
        self._recorder: DepthRecorder

    def __enter__(self) -> Self:
        """Begin."""
        try:
            self._file = self._open.enter_context(self._free_table())
        except OSError as error:
            raise RecordingError(
                f"table {self.table}: cannot be written ({error.strerror}); name another folder with --out"
            ) from error
        self._recorder = self._open.enter_context(DepthRecorder(self.recording))
        return self

    def _free_table(self) -> IO[str]:
        """Open the first table that no other run has; the recording of the same name is free too."""
        while True:
            if not self.recording.exists():
                try:
                    return self.table.open("x", newline="", encoding="utf-8")
                except FileExistsError:
                    pass  # of another run, or another node that began just now
            self.others += 1
            name = f"{_NAME}-{self.others + 1}"
            self.table, self.recording = (self.folder / f"{name}{end}" for end in (_TABLE, _RECORDING))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close both files."""
        self._open.__exit__(kind, error, trace)

    def __call__(self, now: float, member: Member) -> None:
        """Write what a member knows at `now` [s]."""
        if now < member.node.filter.oldest:
            return
        known = member.node.estimate(now)
        if self._table is None:
            self._table = csv.writer(self._file)
            names = state_names(known.x.size)
            self._table.writerow(["stamp", *names, *(f"sd_{name}" for name in names), "there"])
        x = known.x.copy()
        x[3] = wrap_angle(float(x[3]))
        numbers = [f"{value:.6f}" for value in (*x, *known.sd)]
        self._table.writerow([f"{now:.6f}", *numbers, " ".join(member.roll.there)])
        self._recorder.located(now, pose_measurement(known), "")
        self.count += 1


def pose_measurement(known: StateEstimate) -> PoseMeasurement:
    """Return position and yaw of an estimate with their covariance."""
    return PoseMeasurement(known.stamp, known.position.copy(), known.yaw, known.P[:4, :4].copy(), _FUSED)


def status_line(now: float, member: Member, begin: float) -> str:
    """Return where the vehicle is, how well that is known, and who is there, in one line."""
    text = "not begun"
    if now >= member.node.filter.oldest:
        known = member.node.estimate(now)
        text = f"{_place_text(known)}  heading {_heading_text(known)}"
    return f"{now - begin:8.2f} s  {text}  | {roll_text(member, begin)}"


def _place_text(known: StateEstimate) -> str:
    sd = float(np.sqrt(np.trace(known.P[:3, :3])))
    if sd > _PLACE_KNOWN:
        return "position unknown"
    x, y, z = (v + 0.0 for v in np.round(known.position, 3).tolist())
    near = f"{1e3 * sd:.0f} mm" if sd < 1.0 else f"{sd:.1f} m"
    return f"x {x:+.3f}  y {y:+.3f}  z {z:.3f} m +- {near}"


def _heading_text(known: StateEstimate) -> str:
    sd = float(known.sd[YAW])
    if sd > _HEADING_KNOWN:
        return "unknown"
    return f"{round(math.degrees(known.yaw), 3) + 0.0:+6.1f} +- {math.degrees(sd):.1f} deg"


def roll_text(member: Member, begin: float) -> str:
    """Return who is there and who is missing since when, those that went last first."""
    there, missing = [], []
    for name, peer in sorted(member.roll.peers.items()):
        if peer.there:
            reason = peer.beat.reason if peer.beat is not None else ""
            there.append(f"{name} ({reason})" if reason else name)
        else:
            missing.append((peer.since, f"{name} missing since {peer.since - begin:.1f} s ({peer.why})"))
    lost = [text for _, text in sorted(missing, reverse=True)]
    if len(lost) > _MOST_MISSING:
        lost[_MOST_MISSING:] = [f"{len(lost) - _MOST_MISSING} more missing"]
    double = [f"another node calls itself {member.name}"] if member.doubled else []
    return ", ".join([*double, *there, *lost]) or "no other node yet"
