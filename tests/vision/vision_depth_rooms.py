"""Depth images of a made-up room: a tilted floor, a table, a glossy hole, and things before them."""

import numpy as np

from noctule.camera import PinholeCamera
from noctule.vision.depth import Background

HEIGHT, WIDTH = 192, 256
CAMERA = PinholeCamera.centred(WIDTH, HEIGHT, 210.0)
STEP_AT_1M = 2.85  # [mm]
TABLE = (slice(40, 90), slice(150, 210))
GLOSS = (slice(120, 150), slice(40, 90))  # hardly ever a reading
V, U = np.mgrid[:HEIGHT, :WIDTH]


def room():
    """Exact depths [mm] of the empty room."""
    z = 3400.0 - 600.0 * (V - HEIGHT / 2) / 210.0
    z[TABLE] = 2500.0
    return z


def sensed(z, rng, gloss=0.99):
    """What a structured-light sensor makes of exact depths: noise, steps, holes."""
    noisy = z + rng.normal(0.0, 1.5e-6 * z**2)
    disparity = np.round(1e6 / (STEP_AT_1M * noisy))  # what the sensor counts is whole
    out = np.round(1e6 / (STEP_AT_1M * disparity)).astype(np.uint16)
    out[rng.random(z.shape) < 0.01] = 0
    hole = np.zeros(z.shape, dtype=bool)
    hole[GLOSS] = z[GLOSS] == room()[GLOSS]  # what stands before it can be seen
    out[hole & (rng.random(z.shape) < gloss)] = 0
    return out


def with_box(z, left, top, width, height, depth):
    """The same room with something that covers a rectangle of the picture."""
    z = z.copy()
    z[top : top + height, left : left + width] = depth
    return z


def frames(n, rng, scene=lambda k: room()):
    """Yield n depth images; `scene` gives the exact depths of each."""
    return (sensed(scene(k), rng) for k in range(n))


def plain_background(shape, nearest=65535):
    """A background before which all that has a reading is foreground."""
    return Background(
        mean=np.full(shape, nearest, dtype=np.float32),
        deviation=np.ones(shape, dtype=np.float32),
        count=np.ones(shape, dtype=np.int32),
        nearest=np.full(shape, nearest, dtype=np.uint16),
        frames=1,
        deviations=4.0,
    )
