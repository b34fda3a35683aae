"""What bounds a command: speeds first, then the change since the last one."""

from __future__ import annotations

import math

import numpy as np

from noctule.errors import NoctuleError
from noctule.geometry import Array
from noctule.messages import Limits

# A step that must be cut is cut to a hair under the limit, and one that is a hair under is left alone. So the
# difference of two commands, rounded anywhere downstream, is still within the limit, and limiting twice is
# limiting once.
_ALLOWED = 1.0 - 1e-9
_CUT_TO = 1.0 - 2e-9
_ROUNDING = 8.0 * float(np.finfo(np.float64).eps)


class LimiterError(NoctuleError):
    """A command or a time step that cannot be bounded."""


def limit_speed(wanted: Array, limits: Limits) -> Array:
    """Return `wanted` (4,) within the speed limits.

    The linear part is scaled as one, so that its direction is kept; yaw is cut on its own. An axis whose
    limit is 0 is dropped before the others are scaled.
    """
    bounds = limits.speeds
    inside = np.where(bounds > 0.0, wanted, 0.0)
    linear, bound = np.abs(inside[:3]), bounds[:3]
    over = linear > bound
    if over.any():
        inside[:3] *= np.min(bound[over] / linear[over])
    return np.clip(inside, -bounds, bounds)


def limit_command(wanted: Array, previous: Array, limits: Limits, dt: float) -> Array:
    """Return the command (4,) nearest to `wanted` that the limits allow `dt` [s] after `previous` (4,).

    Speeds are cut by `limit_speed`; then the change of the linear velocity is cut to a length of
    acceleration * dt and that of the yaw rate to yaw_acceleration * dt. A `previous` outside the speed limits
    is brought back at the full acceleration: the bound on the change holds always, the one on speed as soon
    as it can.

    Raises
    ------
    LimiterError
        For commands that are not (4,) and finite, or a negative time step.
    """
    for name, nu in (("wanted", wanted), ("previous", previous)):
        if np.shape(nu) != (4,) or not np.isfinite(nu).all():
            raise LimiterError(
                f"{name} command: {np.asarray(nu).tolist()}, expected 4 finite numbers; hover instead"
            )
    if not (math.isfinite(dt) and dt >= 0.0):
        raise LimiterError(f"time step is {dt:g} s, expected 0 or more; are the stamps in order?")
    target = limit_speed(wanted, limits)
    limited = np.empty(4)
    limited[:3] = _approach(previous[:3], target[:3], limits.acceleration * dt)
    limited[3:] = _approach(previous[3:], target[3:], limits.yaw_acceleration * dt)
    return limited


def _approach(start: Array, end: Array, reach: float) -> Array:
    """Go from `start` towards `end`, no farther than `reach`."""
    if reach <= 0.0:  # the norm of a denormal change underflows to 0, so it would pass for none
        return start
    change = end - start
    distance = float(np.linalg.norm(change))
    if distance <= reach * _ALLOWED:
        return end
    # Adding to `start` rounds by its own size, which matters where the reach is tiny.
    budget = reach * _CUT_TO - _ROUNDING * float(np.abs(start).max())
    return start + change * (budget / distance) if budget > 0.0 else start
