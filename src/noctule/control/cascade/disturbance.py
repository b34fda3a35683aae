"""What accelerates the vehicle beside the model: trim, draught, and a model that is off.

With a wrong model errors persist (the paper's Note 1). This estimates, on body axes, the constant
acceleration that explains why the velocity was not the predicted one; the cascade takes it out. It is told of
commands as they were cut and sent, and it is bounded, so it does not wind up.
"""

from __future__ import annotations

import numpy as np

from noctule.control.compiled import compiled
from noctule.geometry import Array


@compiled
def disturbance_after(d: Array, expected: Array, found: Array, rate: float, bounds: Array) -> Array:
    """Return the estimate (4,) [m/s^2, rad/s^2] after one more state; forward, left, up, yaw.

    `expected` (8,) is what was predicted with the estimate `d` (4,) at work, `found` (8,) what the state then
    was. The difference to a constant disturbance falls with `rate` [1/s]; `bounds` (4,) cut the estimate.
    """
    c, s = np.cos(expected[3]), np.sin(expected[3])
    vx, vy = found[4] - expected[4], found[5] - expected[5]
    off = (c * vx + s * vy, c * vy - s * vx, found[6] - expected[6], found[7] - expected[7])
    after = np.empty(4)
    for i in range(4):
        after[i] = min(max(d[i] + rate * off[i], -bounds[i]), bounds[i])
    return after
