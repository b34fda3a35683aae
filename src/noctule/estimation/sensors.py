"""What a calibration says of each sensor: what to take off its measurements, and how far to believe them."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from noctule.estimation.delayed import FilterSettings
from noctule.estimation.measurements import NavdataNoise
from noctule.estimation.vehicle_model import ProcessNoise
from noctule.geometry import Array, wrap_angle
from noctule.messages import HeadingMeasurement, PoseMeasurement, VehicleState
from noctule.settings import Settings

Part = Annotated[float, Field(ge=-3.2, le=3.2)]
Metres = Annotated[float, Field(ge=-5.0, le=5.0)]
Seconds = Annotated[float, Field(ge=-1.0, le=1.0, description="stamps are this much too late [s]")]


class HeadingCorrection(Settings):
    """What a sensor says too much of a heading: a constant and harmonics of the heading that it says.

    Table 3 and Fig. 17 of "Indoor low-cost localization system" give it for ten headings; the paper took its
    spread for white noise (109 deg^2). By the heading that is said, not the true one, so that it can be taken
    off without solving for anything.
    """

    constant: Part = Field(0.0, description="[rad]")
    cosines: tuple[Part, ...] = Field((), max_length=12, description="of 1, 2, ... times the heading [rad]")
    sines: tuple[Part, ...] = Field((), max_length=12, description="[rad]")

    @model_validator(mode="after")
    def _pairs(self) -> HeadingCorrection:
        if len(self.cosines) != len(self.sines):
            raise ValueError("cosines and sines are not as many; give a pair for each harmonic")
        return self

    def bias(self, said: Array) -> Array:
        """Return what is too much in the headings `said` (n,) [rad], (n,) [rad]."""
        coefficients = np.array([self.constant, *self.cosines, *self.sines])
        bias: Array = harmonics(said, len(self.cosines)) @ coefficients
        return bias

    def corrected(self, said: float) -> float:
        """Return the heading [rad] of a sensor that says `said` [rad], wrapped."""
        return wrap_angle(said - float(self.bias(np.array([said]))[0]))


def harmonics(angle: Array, order: int) -> Array:
    """Return 1, cos k angle, sin k angle for k from 1 to `order`, (n, 1 + 2 order)."""
    multiples = angle[:, None] * np.arange(1, order + 1)
    return np.hstack([np.ones((angle.size, 1)), np.cos(multiples), np.sin(multiples)])


class OnboardSensors(Settings):
    """The vehicle's own reports."""

    noise: NavdataNoise = NavdataNoise()
    delay: Seconds = 0.0
    delay_sd: float = Field(
        0.0, ge=0.0, le=10.0, description="of what was found [s]; 0 where none was looked for"
    )
    height_bias: Metres = Field(0.0, description="[m], subtracted")
    heading: HeadingCorrection = HeadingCorrection()
    # What is left of the biases moves: so much the filter lets them.
    heading_walk: float = Field(0.05, ge=0.0, le=1.0, description="of what is left [rad/sqrt(s)]")
    velocity_walk: float = Field(0.003, ge=0.0, le=1.0, description="of the velocity's bias [m/s/sqrt(s)]")

    def corrected(self, state: VehicleState) -> VehicleState:
        """Return a report without what is known to be wrong with it."""
        return replace(
            state,
            stamp=state.stamp - self.delay,
            yaw=None if state.yaw is None else self.heading.corrected(state.yaw),
            height=None if state.height is None else state.height - self.height_bias,
        )

    def process_noise(self, noise: ProcessNoise) -> ProcessNoise:
        """Return `noise` with the walks of the biases as they were found."""
        walks = {"heading_bias": self.heading_walk, "velocity_bias": self.velocity_walk}
        return noise.model_copy(update=walks)


class RoomSensor(Settings):
    """A sensor in the room: the registered depth, or the markers."""

    delay: Seconds = 0.0
    delay_sd: float = Field(
        0.0, ge=0.0, le=10.0, description="of what was found [s]; 0 where none was looked for"
    )
    position_bias: tuple[Metres, Metres, Metres] = Field((0.0, 0.0, 0.0), description="[m], subtracted")
    position_sd: tuple[float, float, float] = Field((0.0, 0.0, 0.0), description="[m], at least")
    heading: HeadingCorrection = HeadingCorrection()
    heading_sd: float = Field(0.0, ge=0.0, le=3.0, description="[rad], at least")

    def corrected(self, pose: PoseMeasurement) -> PoseMeasurement:
        """Return a pose without what is known to be wrong with it, believed no more than was found."""
        floor = np.square([*self.position_sd, self.heading_sd])
        return replace(
            pose,
            stamp=pose.stamp - self.delay,
            position=pose.position - np.array(self.position_bias),
            yaw=self.heading.corrected(pose.yaw),
            covariance=pose.covariance + np.diag(np.maximum(0.0, floor - np.diag(pose.covariance))),
        )

    def corrected_heading(self, heading: HeadingMeasurement) -> HeadingMeasurement:
        """Return a heading likewise."""
        return replace(
            heading,
            stamp=heading.stamp - self.delay,
            yaw=self.heading.corrected(heading.yaw),
            variance=max(heading.variance, self.heading_sd**2),
        )


class Sensors(Settings):
    """All sensors of a site and its vehicle; the defaults take nothing off."""

    onboard: OnboardSensors = OnboardSensors()
    depth: RoomSensor = RoomSensor()
    markers: RoomSensor = RoomSensor()


def tuned(settings: FilterSettings, sensors: Sensors) -> FilterSettings:
    """Return a filter's settings whose biases walk as a calibration found them to."""
    walks = sensors.onboard.process_noise
    noises = {"noise": settings.noise, "noise_without_commands": settings.noise_without_commands}
    return settings.model_copy(update={name: walks(noise) for name, noise in noises.items()})
