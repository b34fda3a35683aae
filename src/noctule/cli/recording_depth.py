"""`noctule calibrate record`: depth frames of any source into a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from noctule.cli.depth_options import SourceOptions, depth_source
from noctule.cli.show import as_json
from noctule.errors import NoctuleError

if TYPE_CHECKING:
    from noctule.flight.depth_scene import Flight

SECONDS = 10.0


class RecordingExistsError(NoctuleError):
    """A recording that would be overwritten."""


def record_depth(options: SourceOptions, out: Path, flight: Flight, json: bool) -> int:
    """Write the frames of a source to the file `out`; 0 when there was at least one."""
    from noctule.flight.depth_recording import DepthRecorder, read_depth_recording
    from noctule.flight.interrupt import interruptible
    from noctule.reports.progress import with_progress

    if out.exists():
        raise RecordingExistsError(
            f"recording {out}: it is there already, and nothing is overwritten; choose another --out or "
            "remove it"
        )
    source = depth_source(options, "calibrate record", flight, SECONDS)
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
