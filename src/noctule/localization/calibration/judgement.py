"""Whether intrinsics are good enough to fly with, and which pictures to retake where they are not."""

from __future__ import annotations

import math

import numpy as np

from noctule.errors import NoctuleError
from noctule.localization.calibration.intrinsics import LARGEST_RESIDUAL, Intrinsics, coverage

LEAST_COVERAGE = 0.5  # share of the 48 parts of the picture with a corner in them
FOCAL_SD = 0.003  # share of the focal length
CENTRE_SD = 0.006  # share of the picture's width, of the principal point
_SAME_ANGLE = math.radians(15.0)  # boards tilted less against each other tell little of the focal length
_SIDES = {
    "upper left": (slice(0, 3), slice(0, 4)),
    "upper right": (slice(0, 3), slice(4, 8)),
    "lower left": (slice(3, 6), slice(0, 4)),
    "lower right": (slice(3, 6), slice(4, 8)),
}
_LEAST_OF_QUARTER = 4  # of its 12 parts


class PoorIntrinsicsError(NoctuleError):
    """Intrinsics that are not good enough; one line for each fault."""


def require_sound(found: Intrinsics) -> Intrinsics:
    """Return the intrinsics; raises PoorIntrinsicsError unless they are good enough."""
    faults = intrinsics_faults(found)
    if faults:
        raise PoorIntrinsicsError("\n".join([*faults, *map(str, found.left_out)]))
    return found


def intrinsics_faults(found: Intrinsics) -> list[str]:
    """Return one line for each thing that is not good enough: what, how much, what was expected, what to do.

    Judged are the residual; how much of the picture boards covered; the standard deviations of focal length
    and principal point, which tell when all boards were seen at the same angle.
    """
    return [line for line in (_residual(found), *_cover(found), _focal(found), _centre(found)) if line]


def _residual(found: Intrinsics) -> str:
    if found.residual <= LARGEST_RESIDUAL:
        return ""
    worst = sorted(found.used, key=lambda one: -one.residual)[:3]
    names = ", ".join(f"{one.view.name} ({one.residual:.2f} px)" for one in worst)
    return (
        f"calibration: the residual is {found.residual:.2f} px rms, expected {LARGEST_RESIDUAL:g} px or "
        f"less; is the board flat and stiff? the worst to retake: {names}"
    )


def _cover(found: Intrinsics) -> list[str]:
    seen = coverage(found) > 0
    lines = []
    bare = [name for name, part in _SIDES.items() if np.count_nonzero(seen[part]) < _LEAST_OF_QUARTER]
    if bare:
        lines.append(
            f"calibration: the board was hardly ever in the {_listed(bare)} of the picture; take two more "
            "pictures with it there, up to the border"
        )
    share = float(seen.mean())
    if share < LEAST_COVERAGE and not bare:
        lines.append(
            f"calibration: the boards cover {share:.0%} of the picture, expected {LEAST_COVERAGE:.0%} or "
            "more; take more pictures, nearer, and towards the borders"
        )
    return lines


def _focal(found: Intrinsics) -> str:
    share = float((found.sd[:2] / found.camera.focal).max())
    if share <= FOCAL_SD:
        return ""
    known = f"known to {share:.1%} only (sd)" if share < 1.0 else "not known at all"
    said = f"calibration: the focal length is {known}, expected {FOCAL_SD:.1%} or less; "
    normals = np.array([one.R_camera_board[:, 2] for one in found.used])
    mean = normals.mean(axis=0)
    apart = np.arccos(np.clip(normals @ (mean / np.linalg.norm(mean)), -1.0, 1.0))
    if np.percentile(apart, 75.0) > _SAME_ANGLE:
        return said + "take twice as many pictures, with the board nearer and tilted more"
    names = [one.view.name for one in found.used]
    return said + (
        f"the boards were all seen at nearly the same angle; retake every other one ({_some(names[::2])}) "
        "with the board tilted by 30 to 45 degrees, some to the left, some right, up and down"
    )


def _centre(found: Intrinsics) -> str:
    limit = CENTRE_SD * found.camera.width
    worst = float(found.sd[2:].max())
    # Without a focal length there is no principal point either: one line is enough.
    if worst <= limit or _focal(found):
        return ""
    return (
        f"calibration: the principal point is known to {worst:.1f} px only (sd), expected {limit:.1f} px or "
        "less; take more pictures, some with the board turned by 90 degrees, tilted left, right, up and down"
    )


def _some(names: list[str]) -> str:
    return ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]
