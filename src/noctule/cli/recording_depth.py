"""`noctule calibrate record`: depth frames of any source into a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from noctule.cli.depth_options import Place, SourceOptions, depth_source
from noctule.cli.show import as_json
from noctule.cli.standing_places import PlaceError, simulated_place
from noctule.errors import NoctuleError

if TYPE_CHECKING:
    from noctule.flight.depth_scene import Flight

SECONDS = 10.0


class RecordingExistsError(NoctuleError):
    """A recording that would be overwritten."""


def standing_place(flight: Flight, at: str | None, height: float | None) -> Place | None:
    """Return where the simulated drone stands, None where nothing is said; raises PlaceError."""
    if at is None and height is None:
        return None
    if flight != "stand":
        option = "--height" if at is None else "--at"
        raise PlaceError(f"calibrate record: {option} goes with --flight stand alone; leave it out")
    return simulated_place("calibrate record", at, height)


def record_depth(options: SourceOptions, out: Path, flight: Flight, at: Place | None, json: bool) -> int:
    """Write the frames of a source to the file `out`; 0 when there was at least one.

    `at` is where the simulated drone stands.
    """
    from noctule.flight.depth_recording import DepthRecorder, read_depth_recording
    from noctule.flight.interrupt import interruptible
    from noctule.reports.progress import with_progress

    if out.exists():
        raise RecordingExistsError(
            f"recording {out}: it is there already, and nothing is overwritten; choose another --out or "
            "remove it"
        )
    if at is not None and not options.simulated:
        raise PlaceError("calibrate record: --at and --height go with --simulated alone; leave them out")
    source = depth_source(options, "calibrate record", flight, SECONDS, at)
    with interruptible() as stopped, DepthRecorder(out, source.camera) as recorder:
        for frame in with_progress(source.frames(), "recording", total=source.count):
            recorder.frame(frame)
            if stopped.is_set():
                break
    count = read_depth_recording(out).count or 0
    size = out.stat().st_size
    if json:
        print(as_json({"recording": out, "frames": count, "bytes": size}))
    else:
        print(f"recording: {out}, {count} frames of {source.name}, {size / 1e6:.1f} MB")
    return 0
