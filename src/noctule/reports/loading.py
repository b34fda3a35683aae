"""From a recording to a `FlightLog`: the only module here that knows how recordings are laid out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from noctule.errors import NoctuleError
from noctule.flight.reader import Recording, Tick, decode_picture, read_recording
from noctule.flight.summary import summary_of
from noctule.geometry import Array
from noctule.messages import FlightState
from noctule.reports.flight_log import FlightLog, Landing, Snapshot, TruthLog
from noctule.reports.located_loading import located_log
from noctule.reports.scene import read_scene

PICTURES = 6
_TASK_ORDER = ("avoidance", "visibility", "servoing")  # the paper's hierarchy, from the top


class EmptyRecordingError(NoctuleError):
    """A recording in which the pilot was never asked."""


def load_flight_log(recording: Path, pictures: int = PICTURES) -> FlightLog:
    """Read a recording for its report, with at most that many pictures of it.

    Raises
    ------
    RecordingFileError
        When the file is missing or no recording of a flight.
    EmptyRecordingError
        When it holds no tick at which the pilot was asked.
    """
    return flight_log(read_recording(Path(recording)), pictures)


def flight_log(recording: Recording, pictures: int = PICTURES) -> FlightLog:
    """Return the flight of a recording that was read already, from the pilot's first tick to its last."""
    flown = recording.flown
    if not flown:
        raise EmptyRecordingError(
            f"recording {recording.path}: holds {len(recording.ticks)} ticks and at none of them a pilot was "
            "asked, expected a flight; did it end before the take-off was over?"
        )
    start = flown[0].stamp
    times = np.array([t.stamp - start for t in flown])
    decisions = [t.decision for t in flown if t.decision is not None]
    seen = [d.diagnostics for d in decisions]
    truth = _truth(flown, start)
    scene = read_scene(recording)
    log = FlightLog(
        times=times,
        asked=np.array([t.asked.as_array() for t in flown]),
        sent=np.array([t.sent.as_array() for t in flown]),
        phases=tuple(d.phase for d in decisions),
        target_index=np.array([d.target_index for d in seen], dtype=np.int64),
        epsilon=np.array([d.epsilon_px for d in seen]),
        errors=np.array([d.error if len(d.error) == 6 else np.full(6, np.nan) for d in seen]),
        activations=_by_task([d.activations for d in seen]),
        task_errors=_by_task([d.task_errors for d in seen]),
        tick_ms=np.array([t.tick_ms for t in flown]),
        truth=truth,
        tick_s=float(np.median(np.diff(times))) if len(times) > 1 else 1.0 / 30.0,
        snapshots=_snapshots(flown, times, pictures),
        located=located_log(flown, start, scene.located),
        landing=_landing([t for t in recording.ticks if t.stamp >= flown[-1].stamp], start),
        clock_start=start if recording.notes.get("flight", {}).get("simulated") == "true" else None,
        **scene.drawn(),
    )
    return replace(
        log,
        summary=summary_of(recording),
        about=scene.about,
        mission_text=scene.text,
        notes=(*_remarks(recording, log), *scene.notes),
    )


def _remarks(recording: Recording, log: FlightLog) -> list[str]:
    remarks = []
    if not recording.complete:
        remarks.append(
            f"This recording was cut short: its last tick is at {log.span[1]:.1f} s, "
            "and the report shows what is there."
        )
    if "summary" not in recording.notes:
        remarks.append("No summary in this recording: the figures were worked out from its ticks.")
    if log.truth is None:
        remarks.append("No truth in this recording: error in metres not available.")
    return remarks


def _truth(flown: Sequence[Tick], start: float) -> TruthLog | None:
    known = [t.truth for t in flown if t.truth is not None]
    if not known:
        return None
    contacts = dict.fromkeys(name for truth in known for name in truth.contacts)
    return TruthLog(
        times=np.array([truth.stamp - start for truth in known]),
        position=np.array([truth.pose.position for truth in known]),
        yaw=np.array([truth.pose.yaw for truth in known]),
        speed=np.array([float(np.linalg.norm(truth.v_world)) for truth in known]),
        clearance=np.array([truth.clearance for truth in known]),
        contacts=tuple(contacts),
        velocity=np.array([truth.v_world for truth in known]),
    )


def _landing(ticks: Sequence[Tick], start: float) -> Landing | None:
    """Return what `ticks`, from the pilot's last on, tell of how the drone came down."""
    true = all(t.truth is not None for t in ticks)
    rows = [
        np.append(t.truth.pose.position, t.truth.pose.yaw)
        if true and t.truth is not None
        else np.array(
            [np.nan, np.nan, t.told.state.height if t.told.state.HasField("height") else np.nan, np.nan]
        )
        for t in ticks
    ]
    said_landed = ticks[-1].told.state.flight_state == FlightState.LANDED
    if not true and not said_landed and not np.isfinite(rows[-1][2]):
        return None
    contacts = [() if t.truth is None else t.truth.contacts for t in ticks]
    later = dict.fromkeys(name for names in contacts[1:] for name in names if name != "floor")
    return Landing(
        times=np.array([t.stamp - start for t in ticks]),
        pose=np.array(rows),
        true=true,
        said_landed=said_landed,
        touching=contacts[-1],
        touched=tuple(later),
    )


def _by_task(rows: Sequence[Mapping[str, float]]) -> dict[str, Array]:
    """Turn one mapping per tick into one series per task, the top task first; NaN where a tick is silent."""
    names = sorted({name for row in rows for name in row}, key=_rank)
    return {name: np.array([row.get(name, np.nan) for row in rows]) for name in names}


def _rank(name: str) -> tuple[int, str]:
    return (_TASK_ORDER.index(name) if name in _TASK_ORDER else len(_TASK_ORDER), name)


def _snapshots(flown: Sequence[Tick], times: Array, wanted: int) -> tuple[Snapshot, ...]:
    """Pick pictures spread over the flight, each where there is most to see: columns first, then points."""
    rows = [i for i, tick in enumerate(flown) if tick.picture is not None]
    if not rows:
        return ()
    chosen = [rows[0]]
    for group in np.array_split(np.array(rows[1:-1], dtype=np.int64), max(wanted - 2, 1)):
        # Away from the group's ends, so that neighbours do not show the same moment.
        middle = group[len(group) // 4 : len(group) - len(group) // 4].tolist()
        if middle:
            chosen.append(max(middle, key=lambda i: _worth(flown[i])))
    chosen += rows[1:][-1:]
    return tuple(_snapshot(flown[i], float(times[i])) for i in chosen)


def _worth(tick: Tick) -> tuple[bool, float]:
    assert tick.decision is not None
    seen = tick.decision.diagnostics
    widest = max((box.right - box.left for box in seen.columns), default=0.0)
    return (len(seen.points_current) > 0, widest)


def _snapshot(tick: Tick, time: float) -> Snapshot:
    assert tick.picture is not None
    assert tick.decision is not None
    seen = tick.decision.diagnostics
    return Snapshot(
        time=time,
        pixels=decode_picture(tick.picture),
        phase=tick.decision.phase,
        target_index=seen.target_index,
        points_current=seen.points_current,
        points_ref=seen.points_ref,
        columns=seen.columns,
    )
