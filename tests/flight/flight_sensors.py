"""A recording of sensors in a made-up flight that turns through all headings."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from noctule.flight.sensor_recording import SensorRecorder
from noctule.geometry import Pose, rot_z, wrap_angle
from noctule.messages import FlightState, HeadingMeasurement, PoseMeasurement, Truth, VehicleState

HEADING_BIAS = 0.2  # [rad], and as much again with the sine of the heading
HEIGHT_BIAS = 0.05
DEPTH_BIAS = np.array([0.004, 0.0, 0.03])
P = np.diag([0.005, 0.005, 0.005, 0.02]) ** 2


def yaw_at(t: float) -> float:
    return 0.4 * t + 0.7 * math.sin(0.6 * t)


def position_at(t: float) -> np.ndarray:
    return np.array([math.cos(0.4 * t), math.sin(0.55 * t), 1.2 + 0.2 * math.sin(0.3 * t)])


def v_world_at(t: float) -> np.ndarray:
    return (position_at(t + 1e-4) - position_at(t - 1e-4)) / 2e-4


def write_sensors(
    path: Path,
    seconds: float = 45.0,
    truth: bool = True,
    reports: bool = True,
    located: bool = True,
    markers: bool = True,
    turning: float = 1.0,
) -> Path:
    rng = np.random.default_rng(0)
    with SensorRecorder(path) as recorder:
        for k in range(int(seconds * 30)):
            t = k / 30.0
            yaw = wrap_angle(turning * yaw_at(t))
            if reports:
                said = yaw + HEADING_BIAS * (1.0 + math.sin(yaw)) + 0.02 * rng.standard_normal()
                v = rot_z(yaw).T @ v_world_at(t) + 0.05 * rng.standard_normal(3)
                height = float(position_at(t)[2] + HEIGHT_BIAS + 0.02 * rng.standard_normal())
                state = VehicleState(
                    t, FlightState.FLYING, 0.0, 0.0, wrap_angle(said), v, height, battery=0.5
                )
                recorder.state(state)
            if located:
                position = position_at(t) + DEPTH_BIAS + 0.003 * rng.standard_normal(3)
                seen = wrap_angle(yaw + 0.01 * rng.standard_normal() + (math.pi if k % 50 < 5 else 0.0))
                recorder.located(t, PoseMeasurement(t, position, seen, P, "registration"), "")
            else:
                recorder.located(t, None, "lost: nothing is there")
            if markers and k % 5 == 0:
                recorder.heading(
                    HeadingMeasurement(t, wrap_angle(yaw + 0.005 * rng.standard_normal()), 0.0001, "markers")
                )
            if truth:
                recorder.truth(Truth(t, Pose(position_at(t), yaw), v_world_at(t), 1.0))
    return path
