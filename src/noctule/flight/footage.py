"""Frames to teach a path from: a video file, a camera of this machine, the recording of a flight."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from pydantic import Field, ValidationError

from noctule.camera import CameraMount, PinholeCamera
from noctule.errors import NoctuleError
from noctule.flight.path_entries import CameraEntry
from noctule.flight.reader import Recording, decode_picture
from noctule.flight.replay import recorded_mission
from noctule.flight.setting_errors import explain
from noctule.vision.key_images import Frame

Open = Callable[[Any], Any]
"""Opens a capture as OpenCV does: by the name of a file or the number of a device."""


class FootageError(NoctuleError):
    """A video, camera or recording that no path can be taught from."""


class CameraFileError(NoctuleError):
    """A camera file with mistakes, one a line."""


class CameraFile(CameraEntry):
    """What camera.toml holds; the same keys as [camera] in path.toml."""

    t_body_camera: tuple[float, float, float] = Field(
        (0.09, 0.0, 0.0), description="place on the body, FLU [m]"
    )
    stabilised: bool = Field(False, description="pictures show neither roll nor pitch")


def read_camera(path: Path) -> CameraFile:
    """Read a camera file; raises CameraFileError."""
    try:
        text = path.read_text("utf-8")
        return CameraFile.model_validate(tomllib.loads(text))
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise CameraFileError(
            f"camera file {path}: cannot be read ({why}); expected a .toml file with width, height, fx, fy, "
            "cx, cy"
        ) from None
    except tomllib.TOMLDecodeError as error:
        raise CameraFileError(f"camera file {path}: this is not TOML: {error}; mend it there") from None
    except ValidationError as error:
        raise CameraFileError(explain(error, CameraFile, text, f"camera file {path}")) from None


@contextmanager
def _capture(source: str | int, name: str, opener: Open) -> Iterator[Any]:
    capture = opener(source)
    try:
        if not capture.isOpened():
            todo = (
                "expected a video that OpenCV can decode"
                if isinstance(source, str)
                else "is it connected, and does no other program use it?"
            )
            raise FootageError(f"{name}: cannot be opened; {todo}")
        yield capture
    finally:
        capture.release()


def video_size(path: Path, opener: Open = cv2.VideoCapture) -> tuple[int, int]:
    """Return width and height [px] of a video; raises FootageError."""
    name = f"video {path}"
    with _capture(str(path), name, opener) as capture:
        return _size(capture, name)


def device_size(number: int, opener: Open = cv2.VideoCapture) -> tuple[int, int]:
    """Return width and height [px] of what a camera of this machine sends; raises FootageError."""
    name = f"camera {number}"
    with _capture(number, name, opener) as capture:
        return _size(capture, name)


def _size(capture: Any, name: str) -> tuple[int, int]:
    ok, bgr = capture.read()
    if not ok:
        raise FootageError(f"{name}: it holds no picture; expected at least two")
    return int(bgr.shape[1]), int(bgr.shape[0])


def video_frames(path: Path, camera: PinholeCamera, opener: Open = cv2.VideoCapture) -> Iterator[Frame]:
    """Yield the frames of a video, stamped from 0 [s] by its frame rate; raises FootageError."""
    name = f"video {path}"
    with _capture(str(path), name, opener) as capture:
        rate = float(capture.get(cv2.CAP_PROP_FPS))
        if not 0.5 <= rate <= 1000.0:
            raise FootageError(f"{name}: its frame rate is {rate:g}, expected 0.5 to 1000; convert it")
        count = 0
        while (frame := _next(capture, count / rate, camera, name)) is not None:
            yield frame
            count += 1


def device_frames(
    number: int,
    camera: PinholeCamera,
    seconds: float,
    opener: Open = cv2.VideoCapture,
    now: Callable[[], float] = time.monotonic,
) -> Iterator[Frame]:
    """Yield what a camera of this machine sees for `seconds`, stamped from 0 [s]; raises FootageError."""
    name = f"camera {number}"
    with _capture(number, name, opener) as capture:
        begin = now()
        while (stamp := now() - begin) < seconds:
            frame = _next(capture, stamp, camera, name)
            if frame is None:
                raise FootageError(f"{name}: it stopped after {stamp:.1f} s; is it still connected?")
            yield frame


def _next(capture: Any, stamp: float, camera: PinholeCamera, name: str) -> Frame | None:
    ok, bgr = capture.read()
    if not ok:
        return None
    _check_size(bgr.shape[1], bgr.shape[0], camera, name)
    return Frame(stamp, np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), dtype=np.uint8))


def _check_size(width: int, height: int, camera: PinholeCamera, name: str) -> None:
    if (width, height) != (camera.width, camera.height):
        raise FootageError(
            f"{name}: its pictures are {width}x{height} px, the camera's {camera.width}x{camera.height} px; "
            "give the intrinsics of the camera that took it, at this size"
        )


def recorded_camera(recording: Recording) -> tuple[PinholeCamera, CameraMount]:
    """Return the camera of a recorded flight; raises RecordingFileError."""
    spec = recorded_mission(recording).camera
    return spec.intrinsics, spec.mount


def recorded_frames(recording: Recording) -> Iterator[Frame]:
    """Yield the pictures of a recording, each with the attitude reported nearest to its exposure.

    Raises FootageError, RecordingFileError.
    """
    camera, mount = recorded_camera(recording)
    name = f"recording {recording.path}"
    begin = next((t.told.picture_stamp for t in recording.ticks if t.picture is not None), None)
    if begin is None:
        raise FootageError(f"{name}: it holds no picture; expected at least two")
    stamps = np.array([tick.told.state.stamp for tick in recording.ticks])
    for tick in recording.ticks:
        if tick.picture is None:
            continue
        exposed = tick.told.picture_stamp
        attitude = (0.0, 0.0)
        if not mount.stabilised:
            state = recording.ticks[int(np.argmin(np.abs(stamps - exposed)))].told.state
            attitude = (state.roll, state.pitch)
        pixels = decode_picture(tick.picture)
        _check_size(pixels.shape[1], pixels.shape[0], camera, name)
        yield Frame(exposed - begin, pixels, attitude)
