"""Experiment 5.3 of Toro-Arcila et al.: the closed oval of 7.7 m, without and with feed-forward.

Two straights of 2 m joined by half circles of radius 0.589 m, 1 m high, flown counterclockwise; the last
image is taken where the flight starts. Without feed-forward there are 30 images: every 0.5 m on the
straights, eleven on each half circle, 16.36 deg apart (the paper's 15 deg do not close the oval). With it
there are 35, "some more images in the linear segment": the half circles keep eleven, the straights have seven
and six, evenly spaced on each. The oval lies in the middle of the room, and no furniture stands on it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from noctule.experiments.servo import Experiment, LawName, Poses, Scenery
from noctule.flight.mission import Mission
from noctule.pilots.settings import PublishedGains
from noctule.settings import Settings
from noctule.simulation import ColumnSpec, KeepClear

STRAIGHT = 2.0  # [m]
RADIUS = 0.589  # [m]
HEIGHT = 1.0  # [m]
CURVE = ((STRAIGHT, 0.0), (math.pi * RADIUS, 1.0 / RADIUS)) * 2
"""Length [m] and curvature [1/m] of the pieces, from the start."""

_PER_TURN = 11  # images on each half circle
_LIMIT_PER_LAP = 300.0  # [s], the paper's flight without feed-forward took 200
_ROOM_TO_PASS = 0.6  # [m] around the oval, for the body and its detours


class OvalOptions(Settings):
    """What may be asked of a flight over the oval."""

    laps: int = Field(1, ge=1, le=100, description="laps to fly")
    latency_s: float = Field(0.0, ge=0.0, le=1.0, description="added to the delivery of every picture [s]")
    columns: bool = Field(False, description="stand two columns on the oval")


def oval_poses(on_first: int, on_second: int) -> Poses:
    """Return x, y, z [m] and heading [deg] of the images, with so many on each straight."""
    turns = [math.pi * (k + 1) / _PER_TURN for k in range(_PER_TURN)]
    poses = [(STRAIGHT * (k + 1) / on_first, 0.0, 0.0) for k in range(on_first)]
    poses += [(STRAIGHT + RADIUS * math.sin(a), RADIUS * (1.0 - math.cos(a)), a) for a in turns]
    poses += [(STRAIGHT * (1.0 - (k + 1) / on_second), 2.0 * RADIUS, math.pi) for k in range(on_second)]
    poses += [(-RADIUS * math.sin(a), RADIUS * (1.0 + math.cos(a)), math.pi + a) for a in turns]
    return tuple((x, y, HEIGHT, math.degrees(math.remainder(a, math.tau))) for x, y, a in poses)


def _columns(rng: np.random.Generator, hue: float) -> tuple[ColumnSpec, ...]:
    across = rng.uniform(-0.05, 0.05, 2)
    return tuple(
        ColumnSpec(x=0.5 * STRAIGHT, y=y + float(off), width=0.05, depth=0.02, hue=hue)
        for y, off in zip((0.0, 2.0 * RADIUS), across, strict=True)
    )


@dataclass(frozen=True, slots=True)
class OvalExperiment(Experiment):
    """The oval: an experiment that takes options."""

    def mission(
        self,
        seed: int,
        law: LawName = "noctule",
        attitude_sd_deg: float = 0.0,
        options: OvalOptions = OvalOptions(),  # noqa: B008  (frozen)
    ) -> Mission:
        """Return the mission of `seed`; see Experiment.mission for the others.

        `options.latency_s` delays the pictures; the pilot knows by how much.
        """
        mission = Experiment.mission(self, seed, law, attitude_sd_deg)
        room, path, pilot, flight = mission.room, mission.path, mission.pilot, mission.flight
        assert path is not None  # the key images drawn above
        corner = (0.5 * STRAIGHT - 0.5 * room.size[0], RADIUS - 0.5 * room.size[1])
        clear = KeepClear(
            x_min=-RADIUS - _ROOM_TO_PASS,
            x_max=STRAIGHT + RADIUS + _ROOM_TO_PASS,
            y_min=-_ROOM_TO_PASS,
            y_max=2.0 * RADIUS + _ROOM_TO_PASS,
        )
        room = room.model_copy(update={"corner": corner, "keep_clear": clear})
        if not options.columns:
            room = room.model_copy(update={"columns": ()})
            pilot = pilot.model_copy(update={"column_hue_deg": None})
        late = mission.camera.latency + options.latency_s
        return mission.model_copy(
            update={
                "room": room,
                "pilot": pilot.model_copy(update={"picture_latency_s": late}),
                "path": path.model_copy(update={"laps": options.laps, "curve": CURVE}),
                "camera": mission.camera.model_copy(update={"latency": late}),
                "flight": flight.model_copy(update={"time_limit_s": _LIMIT_PER_LAP * options.laps}),
            }
        )


def _thirty(rng: np.random.Generator, hue: float) -> Scenery:
    return oval_poses(4, 4), _columns(rng, hue)


def _thirty_five(rng: np.random.Generator, hue: float) -> Scenery:
    return oval_poses(7, 6), _columns(rng, hue)


OVALS: dict[str, OvalExperiment] = {
    "servo-5.3": OvalExperiment(
        "servo-5.3",
        "5.3: a closed oval of 7.7 m, 30 images.",
        _thirty,
        PublishedGains(
            lambda_0=2.1,
            lambda_inf=1.0,
            lambda_slope=5.0,
            lambda_lateral_extra=0.1,
            lambda_yaw_ratio=0.5,
            epsilon_intermediate_px=18.0,
            epsilon_last_px=7.0,
        ),
    ),
    "servo-5.3-ff": OvalExperiment(
        "servo-5.3-ff",
        "5.3: a closed oval of 7.7 m, 35 images, feed-forward.",
        _thirty_five,
        PublishedGains(
            lambda_0=1.5,
            lambda_inf=0.8,
            lambda_slope=5.0,
            lambda_lateral_extra=2.0,
            lambda_yaw_ratio=0.5,
            epsilon_intermediate_px=18.0,
            epsilon_last_px=7.0,
            feed_forward=0.75,
            feed_forward_weight=0.5,
        ),
    ),
}
"""The ovals by the name that `noctule experiment` takes."""
