"""Where a template's origin and axis are: frames alone do not say, the drone's own symmetry does.

A template that is moved or turned in the body, and all its poses with it the other way, fits the frames as
well as before. A quadrotor is its own mirror image in the plane through nose and tail, and, at its rotors, in
the one across. Laid over its mirror image the template is off by twice what its origin and axis are.
"""

from __future__ import annotations

import numpy as np

from noctule.geometry import Array, Pose, wrap_angle
from noctule.localization.matcher import Matcher


def symmetry_axes(matcher: Matcher) -> Array:
    """Return x, y [m] of the template's middle and its nose's heading [rad] in its present axes, (3,)."""
    t = matcher.template
    p, w = t.probability, t.weight
    left_right, front_back = (
        matcher.refine(np.ascontiguousarray(p[cut]), np.ascontiguousarray(w[cut]), np.zeros(3))[0]
        for cut in (np.s_[:, ::-1], np.s_[::-1, :])
    )
    return np.array([-0.5 * front_back[0], -0.5 * left_right[1], -0.5 * left_right[2]])


def regauged(pose: Pose, axes: Array, up: float) -> Pose:
    """Return a pose with its origin at `axes` (x, y [m], heading [rad], in its own axes), `up` [m] higher."""
    position = pose.position + pose.R_world_body @ np.array([axes[0], axes[1], 0.0])
    position[2] += up
    return Pose(position, wrap_angle(pose.yaw + float(axes[2])), pose.roll, pose.pitch)
