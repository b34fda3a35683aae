"""Where the vehicle will be when a command that is sent now takes effect.

The commands of the last `delay` seconds are on their way and will act before it, so they are applied to the
state with the identified model: eq. (2), corrected (the left side is the world's acceleration resolved on
body axes), solved in closed form for each command on axes held at the yaw of mid-step.
"""

from __future__ import annotations

import numpy as np

from noctule.compiled import compiled
from noctule.geometry import Array

_SOON = 1e-9  # [s]


@compiled
def _axis(drag: float, dt: float) -> tuple[float, float, float]:
    """Return (e, g, h) of dv/dt = a - drag v: v keeps e and gains g a, the position gains g v + h a."""
    u = drag * dt
    if u < 1e-3:  # where the closed forms cancel
        return (
            1.0 - u * (1.0 - 0.5 * u),
            dt * (1.0 - u * (0.5 - u / 6.0)),
            dt * dt * (0.5 - u * (1 - 0.25 * u) / 6.0),
        )
    e = np.exp(-u)
    g = (1.0 - e) / drag
    return e, g, (dt - g) / drag


@compiled
def moved(x: Array, dt: float, u: Array, gains: Array, drags: Array) -> Array:
    """Return the state (8,) `dt` [s] later under the command `u` (4,) in force."""
    ex, gx, hx = _axis(drags[0], dt)
    ey, gy, hy = _axis(drags[1], dt)
    ez, gz, hz = _axis(drags[2], dt)
    ew, gw, hw = _axis(drags[3], dt)
    ax, ay, az, aw = gains[0] * u[0], gains[1] * u[1], gains[2] * u[2], gains[3] * u[3]
    turn = gw * x[7] + hw * aw
    c, s = np.cos(x[3] + 0.5 * turn), np.sin(x[3] + 0.5 * turn)
    forward, left = c * x[4] + s * x[5], c * x[5] - s * x[4]
    ahead, aside = gx * forward + hx * ax, gy * left + hy * ay
    forward, left = ex * forward + gx * ax, ey * left + gy * ay
    return np.array(
        [
            x[0] + c * ahead - s * aside,
            x[1] + s * ahead + c * aside,
            x[2] + gz * x[6] + hz * az,
            x[3] + turn,
            c * forward - s * left,
            s * forward + c * left,
            ez * x[6] + gz * az,
            ew * x[7] + gw * aw,
        ]
    )


@compiled
def predict_over_delay(
    x: Array,
    stamp: float,
    until: float,
    stamps: Array,
    commands: Array,
    push: Array,
    gains: Array,
    drags: Array,
    delay: float,
) -> Array:
    """Return the state (8,) at `until` [s] of what was `x` (8,) at `stamp` [s].

    `x` is x, y, z [m], yaw [rad] and their rates in the world. `commands` (n, 4) were really sent at `stamps`
    (n,) [s], in order, and each is in force from `delay` [s] after it was sent until the next one is; before
    the first it is zero. `push` (4,) is a constant disturbance, as a command. `gains` and `drags` (4,) are
    the model's, in units of the commands.
    """
    now, k = stamp, int(np.searchsorted(stamps, stamp - delay + _SOON, side="right")) - 1
    state = x.copy()
    while now < until - _SOON:
        end = until
        if k + 1 < stamps.size:
            end = min(end, max(stamps[k + 1] + delay, now))
        if end > now:
            state = moved(state, end - now, commands[k] + push if k >= 0 else push, gains, drags)
        now = end
        k = min(k + 1, stamps.size - 1)
    return state


@compiled
def remember(stamps: Array, commands: Array, stamp: float, u: Array) -> None:
    """Let the oldest of the `commands` (n, 4) go for `u` (4,), sent at `stamp` [s], in place."""
    for k in range(stamps.size - 1):
        stamps[k] = stamps[k + 1]
        for i in range(4):
            commands[k, i] = commands[k + 1, i]
    stamps[-1] = stamp
    for i in range(4):
        commands[-1, i] = u[i]
