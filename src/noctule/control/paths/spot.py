"""A spot in the air to hover on, on no path: where a vehicle comes to rest that stops now."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from noctule.control.paths.heading import TurnReference, TurnSettings
from noctule.control.paths.plan import PathPlan
from noctule.control.paths.progress import Progress, Reference
from noctule.control.paths.speed import braking_distance
from noctule.geometry import Array, wrap_angle


@dataclass(frozen=True, slots=True)
class Spot:
    """A place and a heading."""

    position: Array  # (3,) [m]
    yaw: float  # [rad]


def spot_ahead(x: Array, progress: Progress, plan: PathPlan) -> Spot:
    """Return where to hover from now on: a stop being held, else as far ahead as it takes to brake.

    `x` (8,) is the state. Likewise the wanted heading comes to rest.
    """
    turn = progress.turn
    yaw = wrap_angle(turn.yaw + turn.rate * abs(turn.rate) / (2.0 * plan.turning.acceleration))
    if progress.holding:
        return Spot(plan.path.at(progress.gate).position.copy(), yaw)
    v = x[4:7]
    speed = float(np.linalg.norm(v))
    # Not farther than a vehicle on its path would need: one that was pushed is to come back.
    reach = min(braking_distance(speed, plan.speed), braking_distance(plan.speed.cruise, plan.speed))
    ahead = v * (reach / speed) if speed > 0.0 else np.zeros(3)
    return Spot(x[:3] + ahead, yaw)


def hold(
    spot: Spot, turn: TurnReference, dt: float, turning: TurnSettings
) -> tuple[TurnReference, Reference]:
    """Return the wanted heading `dt` [s] later and what is wanted on the spot."""
    turn = turn.step(spot.yaw, 0.0, dt, turning)
    rate = np.array([0.0, 0.0, 0.0, turn.rate])
    change = np.array([0.0, 0.0, 0.0, turn.acceleration])
    return turn, Reference(np.append(spot.position, turn.yaw), rate, rate, change)
