"""Whether a path can be repeated, judged before take-off from its pictures alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from noctule.errors import NoctuleError
from noctule.flight.feature_cache import FEWEST_SHARED
from noctule.flight.mission import Mission
from noctule.flight.path_folder import (
    PathCameraError,
    PathFolderError,
    check_camera,
    check_mount,
    load_path,
    read_path_file,
    read_picture,
)
from noctule.pilots.visual_path import VisualPath
from noctule.vision.features import detect
from noctule.vision.links import PARTS, LinkQuality, measure_link
from noctule.vision.matching import match_robust

FEWEST_PARTS = 5
FARTHEST = 0.7  # [mean depths]
WIDEST = float(np.radians(40.0))
LEAST_SHARE = 0.5
"""Of the features that look alike, and of the points that are shared: fewer agree by chance, or where two
rooms are alike."""
TILT_SD = float(np.radians(2.0))
"""Roll and pitch that may be left between two pictures of a camera that is not stabilised."""
_MANY = 60  # shared points that need no second look


class PathCheckError(NoctuleError):
    """A path that cannot be repeated."""


@dataclass(frozen=True, slots=True)
class Fault:
    """What keeps a path from being repeated."""

    images: tuple[str, ...]
    what: str

    def __str__(self) -> str:
        """Return one line that names the images and the figure that fails."""
        if not self.images:
            return self.what
        return f"image{'s' * (len(self.images) > 1)} {' and '.join(self.images)}: {self.what}"


def attitude_sd(path: VisualPath) -> float:
    """Return the standard deviation [rad] of roll and pitch that are left between two pictures."""
    return 0.0 if path.mount.stabilised else TILT_SD


def measure_path(path: VisualPath) -> tuple[LinkQuality, ...]:
    """Return how well each key image hangs together with the next."""
    return tuple(
        measure_link(
            link.p_ref,
            link.p_next,
            path.camera,
            ((a.roll, a.pitch), (b.roll, b.pitch)),
            attitude_sd(path),
        )
        for link, a, b in zip(path.links, path.images, path.images[1:], strict=False)
    )


def check_path(path: VisualPath) -> list[Fault]:
    """Return what keeps a path from being repeated, in the order of its images; empty for a good one."""
    faults = []
    for k, link in enumerate(measure_path(path)):
        what = link_fault(link) or _chance(path, k, link)
        if what:
            faults.append(Fault((path.images[k].name, path.images[k + 1].name), what))
    return faults


def require_sound(path: VisualPath, where: str) -> None:
    """Raise PathCheckError, with every fault in its one line, unless the path can be repeated."""
    refuse(check_path(path), where)


def require_seen(path: VisualPath, pixels: NDArray[np.uint8], where: str) -> None:
    """Raise PathCheckError unless what the camera sees before the flight shows in one of the key images."""
    seen = detect(pixels, path.images[0].features.kind)
    agree, alike, nearest = -1, -1, ""
    for image in path.images:
        found = match_robust(image.features, seen, path.camera)
        if len(found) > 0 and len(found) >= LEAST_SHARE * found.n_ratio:
            return
        if (len(found), found.n_ratio) > (agree, alike):
            agree, alike, nearest = len(found), found.n_ratio, image.name
    raise PathCheckError(
        f"{where}: none of its {len(path.images)} images shows what the camera sees at the start, nearest is "
        f"{nearest} where {agree} of {alike} features that look alike agree on one scene, at least "
        f"{LEAST_SHARE:.0%} must; is it from this room? start nearer to it or teach the path again"
    )


def refuse(faults: Sequence[Fault], where: str) -> None:
    """Raise PathCheckError where there are faults."""
    if faults:
        raise PathCheckError(f"{where}: {'; '.join(str(fault) for fault in faults)}")


def link_fault(link: LinkQuality) -> str:
    """Return what is wrong with a link and what to do; empty when it can be flown."""
    if link.shared < FEWEST_SHARED:
        return (
            f"they share {link.shared} points, at least {FEWEST_SHARED} are needed to fly from one to the "
            "other; take a picture between them, in the same room"
        )
    if link.share < LEAST_SHARE:
        return (
            f"no geometry, {link.share:.0%} of {link.shared} shared points agree on one motion of a level "
            f"camera, at least {LEAST_SHARE:.0%} must; are both from the same room, the camera level?"
        )
    if link.cells < FEWEST_PARTS:
        return (
            f"badly spread, their {link.shared} shared points lie in {link.cells} of {PARTS} parts of the "
            f"picture, at least {FEWEST_PARTS} are needed; take a picture between them"
        )
    if link.baseline > FARTHEST:
        return (
            f"gap, the camera moves {link.baseline:.2f} mean depths between them, at most {FARTHEST:g} can "
            "be flown; take a picture between them"
        )
    if abs(link.yaw) > WIDEST:
        return (
            f"gap, the camera turns {abs(np.degrees(link.yaw)):.0f} deg between them, at most "
            f"{np.degrees(WIDEST):.0f} can be flown; take a picture between them"
        )
    if not link.conditioned:
        return (
            f"ill-conditioned, their {link.shared} shared points moved by {link.displacement:.0f} px and do "
            "not tell which way the camera went; take the pictures where there is more to see"
        )
    return ""


def _chance(path: VisualPath, k: int, link: LinkQuality) -> str:
    """Return why a link of few points may be chance: rooms alike share corners, though they differ."""
    if link.shared >= _MANY:
        return ""
    found = match_robust(path.images[k].features, path.images[k + 1].features, path.camera)
    if len(found) >= LEAST_SHARE * found.n_ratio:
        return ""
    return (
        f"no geometry, {len(found)} of {found.n_ratio} features that look alike agree on one scene, at least "
        f"{LEAST_SHARE:.0%} must; are both from the same room?"
    )


def check_folder(folder: Path, mission: Mission | None = None) -> list[Fault]:
    """Return what keeps a path folder from being repeated, by the camera of `mission` where one is given."""
    try:
        file = read_path_file(folder)
    except PathFolderError as error:
        return [Fault((), str(error))]
    c, faults, where = file.camera, [], f"path {folder}"
    if mission is not None:
        try:
            check_camera(c.intrinsics, mission.camera.intrinsics, where)
            check_mount(c.mount, mission.camera.mount, where)
        except PathCameraError as error:
            faults.append(Fault((), str(error)))
    for entry in file.images:
        try:
            read_picture(folder, entry, c)
        except (PathFolderError, PathCameraError) as error:
            faults.append(Fault((), str(error)))
    if faults:
        return faults  # links between pictures of which one is wrong say nothing
    return check_path(load_path(folder, refuse=False))
