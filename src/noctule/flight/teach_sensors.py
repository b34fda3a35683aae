"""The vehicle's reports calibrated in simulation, as a user would: from a flight by hand with ground truth.

The hand is a person who sees the vehicle, a fifth of a second late, and steers it around an ellipse with its
nose ahead. It flies in calm air, below no camera: only the reports are calibrated here.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from noctule.estimation.reference import Reference
from noctule.estimation.reports import Reports
from noctule.estimation.sensor_calibration import calibrate_onboard
from noctule.estimation.sensors import Sensors
from noctule.geometry import Array, Pose, rot_z, wrap_angle
from noctule.messages import Command, VehicleState
from noctule.simulation.aircraft import Aircraft
from noctule.simulation.dynamics import STEPS_PER_SECOND
from noctule.simulation.spec import VehicleSpec
from noctule.simulation.vehicle import SimulatedVehicle

SECONDS = 80.0
_EVERY = 10  # steps of 1/300 s between commands
_REACTION = 60  # steps from seeing to steering
_LAP = 18.0  # [s]
_AXES = (0.5, 0.8, 0.12)  # [m], half axes of the ellipse and half of the height that it moves through
_HEIGHT = 1.2  # [m]
_CHASE = np.array([0.8, 0.8, 0.8, 1.2])  # [1/s], of what it is behind
_LOSS = 0.03  # share of the reports that may be lost
_VALID = 0.25  # [s], of a command


@lru_cache(maxsize=8)
def _calibrated(vehicle_json: str, seed: int) -> Sensors:
    states, reference = _fly(VehicleSpec.model_validate_json(vehicle_json), seed)
    onboard, _ = calibrate_onboard(Reports.of_states(states), reference)
    return Sensors(onboard=onboard)


def teach_sensors(vehicle: VehicleSpec, seed: int) -> Sensors:
    """Return the calibration of a simulated vehicle's reports; the defaults where it has no navdata.

    Raises SensorFlightError for a vehicle that cannot be flown by hand.
    """
    if vehicle.navdata is None:
        return Sensors()
    # Late commands and a bad link say nothing of the sensors; with both delays the hand could not hold the
    # vehicle, and of few reports nothing could be learnt in a flight of a minute.
    link = vehicle.navdata.model_copy(update={"loss": min(vehicle.navdata.loss, _LOSS), "silences": ()})
    calm = vehicle.model_copy(update={"pushes": (), "gusts": 0.0, "command_latency": 0.0, "navdata": link})
    return _calibrated(calm.model_dump_json(), seed)


def _fly(vehicle: VehicleSpec, seed: int) -> tuple[list[VehicleState], Reference]:
    begin = _wanted(0.0)[0]
    seeds = np.random.SeedSequence([seed, 0x5E50]).spawn(2)
    aircraft = Aircraft(vehicle, Pose(begin[:3], wrap_angle(float(begin[3]))), True, tuple(seeds))
    flown = SimulatedVehicle(aircraft, connected=True)
    steps = round(SECONDS * STEPS_PER_SECOND)
    truth = np.empty((steps + 1, 7))  # x, y, z, yaw (unwrapped), velocity
    states: list[VehicleState] = []
    for k in range(steps + 1):
        m = aircraft.motion
        truth[k] = (m.x, m.y, m.z, m.yaw, m.vx, m.vy, m.vz)
        state = flown.state()
        if not states or state.stamp > states[-1].stamp:
            states.append(state)
        if k % _EVERY == 0:
            flown.send(_steer(truth[max(0, k - _REACTION)], (k - _REACTION) / STEPS_PER_SECOND), _VALID)
        aircraft.step()
    stamps = np.arange(steps + 1) / STEPS_PER_SECOND
    return states, Reference(stamps, truth[:, 3], truth[:, :3], truth[:, 4:])


def _steer(seen: Array, stamp: float) -> Command:
    """Return the velocity by which the hand chases the point of `stamp` [s]; `seen` is a row of the truth."""
    wanted, rates = _wanted(max(0.0, stamp))
    world = rates + _CHASE * (wanted - seen[:4])
    return Command.from_array(np.append(rot_z(-seen[3]) @ world[:3], world[3]))


def _wanted(stamp: float) -> tuple[Array, Array]:
    """Return x, y, z, yaw (4,) and their rates (4,) of the point that is chased; the yaw is unwrapped."""
    a, b, rise = _AXES
    rate = 2.0 * math.pi / _LAP
    angle = rate * stamp
    c, s = math.cos(angle), math.sin(angle)
    yaw = angle + math.pi / 2.0 + wrap_angle(math.atan2(b * c, -a * s) - angle - math.pi / 2.0)
    turn = a * b / ((a * s) ** 2 + (b * c) ** 2)
    at = np.array([a * c, b * s, _HEIGHT + rise * s, yaw])
    return at, rate * np.array([-a * s, b * c, rise * c, turn])
