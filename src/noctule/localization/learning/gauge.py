"""Where a template's origin and axis are: frames alone do not say, the drone's own symmetry does.

A template that is moved or turned in the body, and all its poses with it the other way, fits the frames as
well as before. A quadrotor is its own mirror image in the plane through nose and tail, and, at its rotors, in
the one across. Laid over its mirror image the template is off by twice what its origin and axis are.
"""

from __future__ import annotations

import numpy as np

from noctule.geometry import Array, Pose, wrap_angle
from noctule.localization.matcher import Matcher

_BODY = 0.06  # [m], half its width; only what lies further aside is alike in front and behind


def symmetry_axes(matcher: Matcher) -> Array:
    """Return x, y [m] of the template's middle and its nose's heading [rad] in its present axes, (3,)."""
    t = matcher.template
    aside = np.abs(np.arange(t.grid.n) - 0.5 * (t.grid.n - 1)) * t.grid.cell
    rotors = np.where(aside > _BODY, t.weight, 0.0).astype(np.float32)
    left_right, front_back = (
        matcher.refine(np.ascontiguousarray(t.probability[cut]), np.ascontiguousarray(w[cut]), np.zeros(3))[0]
        for cut, w in ((np.s_[:, ::-1], t.weight), (np.s_[::-1, :], rotors))
    )
    return np.array([-0.5 * front_back[0], -0.5 * left_right[1], -0.5 * left_right[2]])


def regauged(pose: Pose, axes: Array, up: float) -> Pose:
    """Return a pose with its origin at `axes` (x, y [m], heading [rad], in its own axes), `up` [m] higher."""
    position = pose.position + pose.R_world_body @ np.array([axes[0], axes[1], 0.0])
    position[2] += up
    return Pose(position, wrap_angle(pose.yaw + float(axes[2])), pose.roll, pose.pitch)
