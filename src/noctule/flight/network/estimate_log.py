"""What a node knew, written as it flies: a table, and a recording that any Foxglove tool opens."""

from __future__ import annotations

import csv
import math
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

import numpy as np

from noctule.estimation.filter_state import StateEstimate, state_names
from noctule.flight.depth_recording import DepthRecorder
from noctule.flight.network.member import Member
from noctule.flight.recording import RecordingError
from noctule.geometry import wrap_angle
from noctule.messages import PoseMeasurement

TABLE, RECORDING = "estimates.csv", "estimates.mcap"
_FUSED = "fused"


class EstimateLog:
    """Writes estimates.csv and estimates.mcap into a folder; a watcher of a node's process.

    Raises RecordingError when the disk refuses.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.count = 0
        self._open = ExitStack()
        self._file: IO[str]
        self._table: Any = None
        self._recorder: DepthRecorder

    def __enter__(self) -> Self:
        """Begin."""
        try:
            self._file = self._open.enter_context(
                (self.folder / TABLE).open("w", newline="", encoding="utf-8")
            )
        except OSError as error:
            raise RecordingError(
                f"table {self.folder / TABLE}: cannot be written ({error.strerror}); "
                "name another folder with --out"
            ) from error
        self._recorder = self._open.enter_context(DepthRecorder(self.folder / RECORDING))
        return self

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
    text = f"{now - begin:8.2f} s  "
    if now < member.node.filter.oldest:
        text += "not begun"
    else:
        known = member.node.estimate(now)
        x, y, z, heading = (v + 0.0 for v in np.round([*known.position, math.degrees(known.yaw)], 3).tolist())
        sd = float(np.sqrt(np.trace(known.P[:3, :3])))
        near = f"{1e3 * sd:.0f} mm" if sd < 1.0 else f"{sd:.1f} m"
        text += (
            f"x {x:+.3f}  y {y:+.3f}  z {z:.3f} m +- {near}  heading "
            f"{heading:+6.1f} +- {min(180.0, math.degrees(float(known.sd[3]))):.1f} deg"
        )
    return f"{text}  | {roll_text(member, begin)}"


def roll_text(member: Member, begin: float) -> str:
    """Return who is there and who is missing since when."""
    there, missing = [], []
    for name, peer in sorted(member.roll.peers.items()):
        if peer.there:
            reason = peer.beat.reason if peer.beat is not None else ""
            there.append(f"{name} ({reason})" if reason else name)
        else:
            missing.append(f"{name} missing since {peer.since - begin:.1f} s ({peer.why})")
    return ", ".join([*there, *missing]) or "no other node yet"
