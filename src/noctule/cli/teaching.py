"""`noctule teach`: a path folder from a simulated flight, a keyboard, a recording, a video or a camera."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from noctule.cli.paths import describe, report_faults
from noctule.cli.show import as_json
from noctule.errors import NoctuleError

if TYPE_CHECKING:
    from noctule.camera import CameraMount, PinholeCamera
    from noctule.flight.teach_video import Taken
    from noctule.vision.key_images import Frame


_SOURCES = ("waypoints", "keyboard", "keys", "recording", "video", "device")
BY_KEY = "keys"
"""`--at` this: key images only where the person says."""


class TeachSourceError(NoctuleError):
    """Options of `noctule teach` that do not go together."""


@dataclass(frozen=True, slots=True)
class Source:
    """What a path is to be taught from, as the options say."""

    waypoints: Path | None = None
    recording: Path | None = None
    video: Path | None = None
    device: int | None = None
    mission: str | None = None
    camera: Path | None = None
    focal: float | None = None
    stabilised: bool = False
    seconds: float = 30.0
    at: str | None = None
    seed: int | None = None
    keyboard: bool = False
    keys: Path | None = None
    preview: bool = True

    def checked(self) -> Source:
        """Return it; raises TeachSourceError unless the options go together."""
        given = [
            name for name in _SOURCES if getattr(self, name) is not None and getattr(self, name) is not False
        ]
        if len(given) != 1:
            found = " and ".join(f"--{name}" for name in given) or "none"
            raise TeachSourceError(f"teach: found {found}, expected exactly one of --{', --'.join(_SOURCES)}")
        (kind,) = given
        filmed, by_hand = kind in ("video", "device"), kind in ("keyboard", "keys")
        simulated = by_hand or kind == "waypoints"
        if filmed and (self.camera is None) == (self.focal is None):
            raise TeachSourceError(
                f"teach: --{kind} needs the intrinsics of its camera, by exactly one of --camera FILE and "
                "--focal PX"
            )
        if self.focal is not None and not 1.0 <= self.focal <= 1e5:
            raise TeachSourceError(f"teach: --focal is {self.focal:g}, expected 1 to 100000 px")
        if self.device is not None and self.device < 0:
            raise TeachSourceError(f"teach: --device is {self.device}, expected 0 or more")
        if not 0.0 < self.seconds <= 3600.0:
            raise TeachSourceError(f"teach: --seconds is {self.seconds:g}, expected above 0, up to 3600")
        if self.stabilised and (not filmed or self.camera is not None):
            raise TeachSourceError("teach: --stabilised goes with --focal; a camera file says it itself")
        wrong = {
            "--camera": self.camera is not None and not filmed,
            "--focal": self.focal is not None and not filmed,
            "--mission": self.mission is not None and not simulated,
            "--seed": self.seed is not None and not simulated,
            "--at": self.at is not None and kind == "waypoints",
            "--no-preview": not self.preview and kind != "keyboard",
        }
        for option, is_wrong in wrong.items():
            if is_wrong:
                raise TeachSourceError(f"teach: {option} does not go with --{kind}; leave it out")
        if by_hand and self.at not in (None, BY_KEY):
            raise TeachSourceError(
                f"teach: --at is {self.at!r}, with --{kind} expected {BY_KEY}: images where space is pressed"
            )
        return self


def teach_path(source: Source, out: Path, json: bool) -> int:
    """Teach a path into the folder `out`, draw it and judge it.

    Returns 0 when it can be repeated, 2 when not, and 130 when Ctrl-C ended a flight by hand: in every case
    the folder stays.
    """
    from noctule.flight.path_check import check_path
    from noctule.flight.path_folder import load_path
    from noctule.flight.teach_video import refuse_existing

    source = source.checked()
    refuse_existing(out)
    interrupted = False
    if source.waypoints is not None:
        taken = _flown(source, out)
    elif source.keyboard or source.keys is not None:
        taken, interrupted = _by_hand(source, out)
    else:
        taken = _filmed(source, out)
    path = load_path(out, refuse=False)
    shown = describe(path, out, out / "contact-sheet.png")
    if json:
        print(as_json({"path": out, "taken": taken, **shown.figures}))
    else:
        print(shown.text)
        for k, one in enumerate(taken):
            print(f"image {k} at {one['stamp_s']:.2f} s: {one['reason']}")
        print(f"sheet: {shown.sheet}\npath: {out}")
    faults = check_path(path)
    report_faults(faults)
    if interrupted:
        return 130
    return 2 if faults else 0


def _flown(source: Source, out: Path) -> list[dict[str, Any]]:
    from noctule.flight.mission import load_mission
    from noctule.flight.teach import take_path
    from noctule.flight.teach_video import read_waypoints

    assert source.waypoints is not None
    mission = read_waypoints(source.waypoints, load_mission(source.mission or "two-columns"))
    take_path(mission, mission.flight.seed if source.seed is None else source.seed, out)
    return []


def _by_hand(source: Source, out: Path) -> tuple[list[dict[str, Any]], bool]:
    from noctule.cli.by_hand import taught_by_hand

    taken, interrupted = taught_by_hand(
        out, source.mission or "two-columns", source.seed, source.keys, source.at is None, source.preview
    )
    return _as_told(taken), interrupted


def _filmed(source: Source, out: Path) -> list[dict[str, Any]]:
    from noctule.flight.teach_video import read_times, teach_frames

    times = None if source.at is None else read_times(source.at)
    frames, camera, mount = _footage(source)
    taken = teach_frames(frames, camera, mount, out, times, _progress)
    if sys.stderr.isatty():
        print("\r\x1b[K", end="", file=sys.stderr)
    return _as_told(taken)


def _as_told(taken: Iterable[Taken]) -> list[dict[str, Any]]:
    return [{"stamp_s": one.stamp, "reason": one.reason} for one in taken]


def _footage(source: Source) -> tuple[Iterable[Frame], PinholeCamera, CameraMount]:
    """Return the frames with the camera that took them."""
    from noctule.camera import CameraMount, PinholeCamera
    from noctule.flight import footage
    from noctule.flight.reader import read_recording

    if source.recording is not None:
        recording = read_recording(source.recording)
        return (footage.recorded_frames(recording), *footage.recorded_camera(recording))
    if source.camera is not None:
        file = footage.read_camera(source.camera)
        camera, mount = file.intrinsics, file.mount
    else:
        size = footage.video_size(source.video) if source.video else footage.device_size(source.device or 0)
        camera = PinholeCamera.centred(*size, source.focal or 0.0)
        mount = CameraMount(stabilised=source.stabilised)
    if source.video is not None:
        return footage.video_frames(source.video, camera), camera, mount
    return footage.device_frames(source.device or 0, camera, source.seconds), camera, mount


def _progress(index: int, stamp: float) -> None:
    if index % 15 == 0 and sys.stderr.isatty():
        print(f"\rlooking at {stamp:.1f} s ...", end="", file=sys.stderr, flush=True)
