"""Pictures as they lie in recordings."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from noctule.flight.mcap_file import RecordingFileError
from noctule.messages import Picture


def encode_picture(picture: Picture, lossless: bool, jpeg_quality: int) -> bytes:
    """Return the picture as PNG (`lossless`) or JPEG."""
    bgr = cv2.cvtColor(picture.pixels, cv2.COLOR_RGB2BGR)
    if lossless:
        _, data = cv2.imencode(".png", bgr, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    else:
        _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality])
    return bytes(data)


def decode_picture(data: bytes) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Return the RGB picture (height, width, 3) of PNG or JPEG data."""
    bgr = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR)
    if bgr is None:
        raise RecordingFileError(
            "recording: a picture cannot be decoded; was the file changed after the flight?"
        )
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), dtype=np.uint8)
