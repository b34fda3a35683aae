"""A flight by hand along the paper's ellipse: what the vehicle did, was told and said of itself.

The hand is a person who stands in the room: it sees the vehicle, a fifth of a second late, and steers it
after a point that goes along the ellipse. It is no pilot of Noctule's and knows nothing of any estimate, so
that sensors and filters of any kind can be tried on the same flight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from noctule.estimation.reference import Reference
from noctule.experiments.loc_identification import FULL_SCALE, RATE, TRUE, table_1_spec
from noctule.geometry import Array, Pose, wrap_angle
from noctule.messages import Command, VehicleState
from noctule.simulation.aircraft import Aircraft
from noctule.simulation.dynamics import STEPS_PER_SECOND, Motion
from noctule.simulation.navdata import NavdataSpec
from noctule.simulation.vehicle import SimulatedVehicle

SECONDS = 82.0
GUSTS = 0.6  # [m/s^2], white at 300 Hz
SPEED = 0.3  # [m/s], along the path
_REACTION = 0.2  # [s], from seeing to steering
_CHASE = np.array([0.7, 0.7, 0.7, 1.0])  # [1/s], of what it is behind
_QUICKEN = np.array([2.0, 2.0, 2.0, 1.5])  # [1/s], of velocities that differ
_VALID = 0.25  # [s], of a command
_COLUMNS = 10  # of the truth


@dataclass(frozen=True, slots=True)
class HandFlight:
    """What happened. Stamps of the truth are multiples of 1/300 s."""

    truth: Array  # (n, 10) x, y, z, yaw (unwrapped), their rates in the world, roll, pitch
    commands: tuple[tuple[float, Array], ...]  # (stamp [s], normalised input (4,))
    reports: tuple[tuple[float, VehicleState], ...]  # (arrival [s], report)

    @property
    def stamps(self) -> Array:
        """Of the truth, (n,) [s]."""
        return np.arange(len(self.truth)) / STEPS_PER_SECOND

    def at(self, stamp: float) -> Array:
        """Return the truth (10,) at `stamp` [s], interpolated."""
        k = min(int(stamp * STEPS_PER_SECOND), len(self.truth) - 2)
        share = stamp * STEPS_PER_SECOND - k
        row: Array = (1.0 - share) * self.truth[k] + share * self.truth[k + 1]
        return row

    def pose(self, stamp: float) -> Pose:
        """Return the true pose at `stamp` [s]."""
        row = self.at(stamp)
        return Pose(row[:3], wrap_angle(float(row[3])), float(row[8]), float(row[9]))

    def reference(self) -> Reference:
        """Return the truth as what sensors are calibrated by."""
        return Reference(self.stamps, self.truth[:, 3], self.truth[:, :3], self.truth[:, 4:7])


def ellipse(distance: float) -> tuple[Array, Array]:
    """Return x, y, z, yaw (4,) and their change per metre (4,) at a distance [m] along the paper's ellipse.

    (0.08 + 0.5 cos, 0.1 + 0.8 sin, 1.2 + 0.12 sin), heading along it; the yaw is unwrapped.
    """
    laps, rest = divmod(distance, float(_LENGTHS[-1]))
    angle = float(np.interp(rest, _LENGTHS, _ANGLES))
    c, s = math.cos(angle), math.sin(angle)
    tangent = np.array([-0.5 * s, 0.8 * c, 0.12 * c])
    per_metre = 1.0 / float(np.linalg.norm(tangent))
    # The heading's own change with the angle: d atan2(0.8 c, -0.5 s) = 0.4 / (0.25 s^2 + 0.64 c^2).
    turn = 0.4 / (0.25 * s * s + 0.64 * c * c)
    yaw = angle + wrap_angle(math.atan2(0.8 * c, -0.5 * s) - angle) + 2.0 * math.pi * laps
    at = np.array([0.08 + 0.5 * c, 0.1 + 0.8 * s, 1.2 + 0.12 * s, yaw])
    return at, np.append(tangent, turn) * per_metre


def _table() -> tuple[Array, Array]:
    angles = np.linspace(0.0, 2.0 * math.pi, 1441)
    tangents = np.column_stack([-0.5 * np.sin(angles), 0.8 * np.cos(angles), 0.12 * np.cos(angles)])
    speeds = np.linalg.norm(tangents, axis=1)
    steps = 0.5 * (speeds[1:] + speeds[:-1]) * np.diff(angles)
    return angles, np.concatenate([[0.0], np.cumsum(steps)])


_ANGLES, _LENGTHS = _table()


def fly_by_hand(seed: int, part: int, seconds: float = SECONDS) -> HandFlight:
    """Fly the vehicle of Table 1, its navdata late and lossy; `part` tells the flights of a seed apart."""
    rng = np.random.SeedSequence([seed, 63, part]).spawn(2)
    begin, _ = ellipse(0.0)
    spec = table_1_spec(0.0, GUSTS).model_copy(update={"navdata": NavdataSpec()})
    aircraft = Aircraft(spec, Pose(begin[:3], float(begin[3])), True, tuple(rng))
    vehicle = SimulatedVehicle(aircraft, connected=True)
    steps = round(seconds * STEPS_PER_SECOND)
    truth = np.empty((steps + 1, _COLUMNS))
    truth[0] = _row(aircraft.motion)
    commands: list[tuple[float, Array]] = []
    reports: list[tuple[float, VehicleState]] = []
    newest = vehicle.state().stamp
    late = round(_REACTION * STEPS_PER_SECOND)
    for k in range(steps):
        if k * RATE >= len(commands) * STEPS_PER_SECOND:
            u = steer(truth[max(0, k - late)], max(0.0, aircraft.now - _REACTION))
            vehicle.send(Command.from_array(u * FULL_SCALE), _VALID)
            commands.append((aircraft.now, u))
        aircraft.step()
        truth[k + 1] = _row(aircraft.motion)
        state = vehicle.state()
        if state.stamp > newest:
            newest = state.stamp
            reports.append((aircraft.now, state))
    return HandFlight(truth, tuple(commands), tuple(reports))


def steer(seen: Array, stamp: float) -> Array:
    """Return the input (4,) by which the hand chases the point of `stamp` [s], `seen` a row of the truth."""
    wanted, per_metre = ellipse(SPEED * stamp)
    rates = SPEED * per_metre + _CHASE * (wanted - seen[:4])
    change = _QUICKEN * (rates - seen[4:8])
    c, s = math.cos(seen[3]), math.sin(seen[3])
    turned = np.array([[c, s], [-s, c]])
    for vector in (rates, change):
        vector[:2] = turned @ vector[:2]
    u: Array = np.clip((TRUE.drags * rates + change) / TRUE.input_gains, -1.0, 1.0)
    return u


def _row(m: Motion) -> tuple[float, ...]:
    return (m.x, m.y, m.z, m.yaw, m.vx, m.vy, m.vz, m.yaw_rate, m.roll, m.pitch)
