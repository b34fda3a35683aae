"""Experiments 5.1 and 5.2 of Toro-Arcila et al. in the simulated room.

Geometry, limits and lag are those of the design; the paper does not print where its columns stood, so each
seed draws their place across the path. Published gains are the paper's (sections 5.1 and 5.2) but for
sigma: the paper's 0.05 begins to avoid a column of 0.05 m a full metre before it, where the flight already
starts, and then circles it at that distance. Sigma here begins at about half a metre.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from noctule.flight.mission import FlightSettings, Mission, PathSettings, StartSettings
from noctule.pilots.settings import PilotSettings, PublishedGains
from noctule.simulation import CameraSpec, ColumnSpec, RoomSpec, VehicleSpec

LawName = Literal["noctule", "published"]

_STREAM = 0x5E4F0  # of the draws below: they do not shift those of the room or the start
_GUSTS = 0.6  # [m/s^2], white at 300 Hz
_TIME_LIMIT = 90.0  # [s]

Poses = tuple[tuple[float, float, float, float], ...]
Scenery = tuple[Poses, tuple[ColumnSpec, ...]]


@dataclass(frozen=True, slots=True)
class Experiment:
    """An experiment of a paper: a mission for every seed."""

    name: str
    title: str
    draw: Callable[
        [np.random.Generator, float], Scenery
    ]  # key poses and columns, from draws and a hue [0, 1)
    published: PublishedGains

    def mission(self, seed: int, law: LawName = "noctule", attitude_sd_deg: float = 0.0) -> Mission:
        """Return the mission of `seed`.

        Parameters
        ----------
        seed
            Draws the pictures on the walls, the furniture, the columns' y and colour, the start (+-0.05 m,
            +-3 deg), noise and gusts.
        law
            Which law flies.
        attitude_sd_deg
            0: a stabilised camera. Above: a camera that rolls and pitches with the body, and an attitude
            known to this sd [deg].
        """
        rng = np.random.default_rng([seed, _STREAM])
        hue = float(rng.uniform(0.0, 1.0))
        poses, columns = self.draw(rng, hue)
        return Mission(
            name=self.name,
            description=self.title,
            room=RoomSpec(seed=seed, columns=columns),
            vehicle=VehicleSpec(gusts=_GUSTS, attitude_sd=math.radians(attitude_sd_deg)),
            camera=CameraSpec(stabilised=attitude_sd_deg == 0.0),
            start=StartSettings(spread_m=0.05, spread_deg=3.0),
            path=PathSettings(poses=poses),
            pilot=PilotSettings(
                law=law,
                published=self.published,
                column_hue_deg=360.0 * hue,
                attitude_sd_deg=attitude_sd_deg,
            ),
            flight=FlightSettings(seed=seed, time_limit_s=_TIME_LIMIT),
        )


def _one_target(rng: np.random.Generator, hue: float) -> Scenery:
    column = ColumnSpec(x=0.95, y=float(rng.uniform(-0.08, 0.08)), width=0.05, depth=0.02, hue=hue)
    return ((1.5, 0.0, 0.5, 0.0),), (column,)


def _four_targets(rng: np.random.Generator, hue: float) -> Scenery:
    y = float(rng.uniform(-0.06, 0.06))
    turn = float(rng.choice([-30.0, 30.0]))
    columns = (
        ColumnSpec(x=0.9, y=y, diameter=0.11, hue=hue),
        ColumnSpec(x=2.9, y=-y, width=0.05, depth=0.02, hue=hue),
    )
    poses = ((1.5, 0.0, 1.0, 0.0), (2.0, 0.0, 1.0, 0.0), (3.5, 0.0, 1.0, 0.0), (4.5, 0.5, 0.5, turn))
    return poses, columns


EXPERIMENTS: dict[str, Experiment] = {
    "servo-5.1": Experiment(
        "servo-5.1",
        "5.1: one target 1.5 m ahead and 0.5 m down, one thin column.",
        _one_target,
        PublishedGains(epsilon_last_px=6.0, sigma=0.09),
    ),
    "servo-5.2": Experiment(
        "servo-5.2",
        "5.2: four targets, two columns, 30 deg at the end.",
        _four_targets,
        PublishedGains(epsilon_intermediate_px=12.0, epsilon_last_px=7.0, sigma=0.1),
    ),
}
"""The experiments by the name that `noctule experiment` takes."""
