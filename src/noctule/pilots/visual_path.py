"""A visual path in memory: key images in the order in which they are flown, and what neighbours share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from noctule.camera import CameraMount, PinholeCamera
from noctule.geometry import Array
from noctule.vision.features import Features


@dataclass(frozen=True, slots=True)
class KeyImage:
    """One picture of the path, its features, and the attitude that the vehicle reported when it was taken."""

    name: str
    pixels: NDArray[np.uint8]  # (height, width, 3) RGB
    features: Features
    roll: float = 0.0  # [rad], 0 for a stabilised camera
    pitch: float = 0.0  # [rad]


@dataclass(frozen=True, slots=True)
class KeyLink:
    """Points that a key image shares with the next one."""

    p_ref: Array  # (n, 2) [px] in image k
    p_next: Array  # (n, 2) [px] in image k + 1


@dataclass(frozen=True, slots=True)
class VisualPath:
    """Key images 0 to n-1 and the n-1 links between neighbours. It knows no poses."""

    camera: PinholeCamera
    mount: CameraMount
    images: tuple[KeyImage, ...]
    links: tuple[KeyLink, ...]
