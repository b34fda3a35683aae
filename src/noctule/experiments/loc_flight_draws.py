"""What a seed draws for a flight below the ceiling camera: pushes, the person's walk, a wrong model."""

from __future__ import annotations

import math

import numpy as np

from noctule.estimation.identification import VehicleModelSettings
from noctule.flight.mission_located import PersonSettings
from noctule.simulation.spec import PushSpec

PUSH = 4.5  # [m/s^2]
PUSH_SECONDS = 0.2
PUSH_TURN = 3.0  # [rad/s^2]
_VERTICAL = 0.3  # of a random direction's, before it is made a unit vector again
PASSES = 0.6  # [m], as near as the edge of the person's ellipse comes to the path
_HALF_AXES = (0.9, 0.6)  # [m], of that ellipse, the first along the path's side
_PACE = 0.8  # [m/s], of the person
_PUSHES, _WALK, _MODEL = 0x5083, 0x3A1C, 0x30DE1  # streams: none shifts another's draws


def draw_pushes(seed: int, times: tuple[float, ...]) -> tuple[PushSpec, ...]:
    """Return a push of 4.5 m/s^2 for 0.2 s at each of `times` [s, the flight's clock].

    The direction is uniform on the sphere, its vertical part times 0.3 and made a unit vector again; the yaw
    is turned by 3 rad/s^2 either way.
    """
    rng = np.random.default_rng([seed, _PUSHES])
    pushes = []
    for time in times:
        way = rng.standard_normal(3) * [1.0, 1.0, _VERTICAL]
        x, y, z = (PUSH * way / np.linalg.norm(way)).tolist()
        turn = PUSH_TURN * (1.0 if rng.random() < 0.5 else -1.0)
        pushes.append(
            PushSpec(time_s=time, seconds=PUSH_SECONDS, acceleration_m_s2=(x, y, z), yaw_rad_s2=turn)
        )
    return tuple(pushes)


def draw_walk(seed: int) -> PersonSettings:
    """Return a person who walks round an ellipse whose edge comes to 0.6 m of the path.

    The ellipse is the same for every seed, on the side of world x; a seed draws where on it the walk begins,
    and which way round it goes.
    """
    rng = np.random.default_rng([seed, _WALK])
    speed = _PACE if rng.random() < 0.5 else -_PACE
    around = 2.0 * math.pi * max(_HALF_AXES)  # [m], at least once around
    return PersonSettings(
        passes_m=PASSES, half_axes=_HALF_AXES, speed=speed, start=float(rng.uniform(0.0, around))
    )


def draw_wrong(seed: int, model: VehicleModelSettings, share: float) -> VehicleModelSettings:
    """Return the model with each of k1 to k8 too large or too small by `share` of itself."""
    signs = np.where(np.random.default_rng([seed, _MODEL]).random(8) < 0.5, -1.0, 1.0)
    k = (np.array(model.k) * (1.0 + share * signs)).tolist()
    return model.model_copy(update={"k": tuple(k)})
