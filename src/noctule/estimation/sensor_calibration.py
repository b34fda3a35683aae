"""Bias, noise and delay of each sensor, and how its heading depends on the heading, from one flight.

6.3 of "Indoor low-cost localization system", corrected: Table 3's spread of the onboard heading is no white
noise but a bias that depends on the heading. So harmonics of the heading are fitted and taken off, with a
drift over the flight beside them; what neighbours in time differ by is noise, what is left walks slowly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from noctule.errors import NoctuleError
from noctule.estimation.measurements import NavdataNoise
from noctule.estimation.reference import Reference
from noctule.estimation.sensors import HeadingCorrection, OnboardSensors, RoomSensor, harmonics
from noctule.geometry import Array, wrap_angle
from noctule.messages import HeadingMeasurement, PoseMeasurement, VehicleState

ORDER = 5  # harmonics of the heading: ten headings of Table 3 bear no more
SHORTEST = 30.0  # [s]
SECTORS = 12  # of 30 deg, each of which has to be flown
_FEWEST = 5  # headings in a sector
_EARLIEST, _LATEST, _DELAY_STEP = -0.1, 0.4, 0.005  # [s], delays that are looked for
_BLOCK = 2.0  # [s], over which noise averages out and what walks does not


class SensorFlightError(NoctuleError):
    """A flight that a sensor cannot be calibrated from."""


@dataclass(frozen=True, slots=True)
class Reports:
    """What a sensor said; None where it does not say."""

    stamps: Array  # (n,) [s], ascending
    yaw: Array | None = None  # (n,) [rad]
    v_body: Array | None = None  # (n, 3) [m/s], levelled heading frame
    position: Array | None = None  # (n, 3) [m], world
    height: Array | None = None  # (n,) [m]

    @classmethod
    def of_states(cls, states: Sequence[VehicleState]) -> Reports:
        """Return what a vehicle reported, each report once; what not every report says is left out."""
        by_stamp = {state.stamp: state for state in states}
        kept = [by_stamp[stamp] for stamp in sorted(by_stamp)]

        def column(values: Sequence[object], shape: tuple[int, ...]) -> Array | None:
            if not values or any(value is None for value in values):
                return None
            return np.array(values, dtype=np.float64).reshape(shape)

        return cls(
            np.array([state.stamp for state in kept]),
            column([state.yaw for state in kept], (-1,)),
            column([state.v_body for state in kept], (-1, 3)),
            None,
            column([state.height for state in kept], (-1,)),
        )

    @classmethod
    def of_poses(cls, poses: Sequence[PoseMeasurement]) -> Reports:
        """Return where a sensor in the room saw the vehicle."""
        return cls(
            np.array([pose.stamp for pose in poses]),
            np.array([pose.yaw for pose in poses]),
            None,
            np.array([pose.position for pose in poses]).reshape(-1, 3),
        )

    @classmethod
    def of_headings(cls, headings: Sequence[HeadingMeasurement]) -> Reports:
        """Return how a sensor in the room saw the vehicle turned."""
        return cls(np.array([one.stamp for one in headings]), np.array([one.yaw for one in headings]))


@dataclass(frozen=True, slots=True)
class HeadingErrors:
    """What a sensor's headings were off by, before and after the correction."""

    stamps: Array  # (n,) [s], without the delay
    reference: Array  # (n,) [rad], unwrapped
    before: Array  # (n,) [rad]
    after: Array  # (n,) [rad]
    correction: HeadingCorrection
    noise_sd: float  # [rad], what neighbours differ by
    walk: float  # [rad/sqrt(s)], what is left moves by


@dataclass(frozen=True, slots=True)
class Sector:
    """A line of Table 3."""

    heading: float  # [rad], the reference's
    mean: float  # [rad], error
    sd: float  # [rad]
    count: int


def calibrate_onboard(reports: Reports, reference: Reference) -> tuple[OnboardSensors, HeadingErrors]:
    """Return the calibration of a vehicle's reports and its headings' errors; raises SensorFlightError.

    Velocities and heights are judged where the reference knows positions, else believed as by default.
    """
    assert reports.yaw is not None
    kept, delay = _aligned("onboard", reports, reference)
    t = kept.stamps - delay
    assert kept.yaw is not None
    heading = heading_errors("onboard", t, kept.yaw, reference)
    noise = {"heading_sd": _floor(heading.noise_sd, 0.002)}
    velocity_walk = OnboardSensors().velocity_walk
    if kept.v_body is not None and reference.v_world is not None:
        off = kept.v_body - reference.v_heading_at(t)
        white = np.array([_noise(off[:, a]) for a in range(3)])
        noise["velocity_sd"] = _floor(float(np.sqrt(np.mean(white[:2] ** 2))), 0.001)
        # The climb's bias is no state of the filter: over a second it counts as often as there are reports.
        rate = (t.size - 1) / (t[-1] - t[0])
        slow = max(0.0, float(np.mean(off[:, 2] ** 2)) - white[2] ** 2)
        noise["climb_sd"] = _floor(math.sqrt(white[2] ** 2 + rate * slow), 0.001)
        velocity_walk = max(0.001, *(_walk(t, off[:, a], white[a]) for a in range(2)))
    height_bias = 0.0
    if kept.height is not None and reference.position is not None:
        over = kept.height - reference.position_at(t)[:, 2]
        height_bias = float(over.mean())
        noise["height_sd"] = _floor(float(over.std()), 0.001)
    found = OnboardSensors(
        noise=NavdataNoise(**noise),
        delay=delay,
        height_bias=height_bias,
        heading=heading.correction,
        heading_walk=max(0.001, heading.walk),
        velocity_walk=velocity_walk,
    )
    return found, heading


def calibrate_room(
    name: str, reports: Reports, reference: Reference, positions: bool = True
) -> tuple[RoomSensor, HeadingErrors]:
    """Return the calibration of a sensor in the room and its headings' errors; raises SensorFlightError.

    `positions` says whether the reference's positions are of something better than this sensor.
    """
    assert reports.yaw is not None
    kept, delay = _aligned(name, reports, reference)
    t = kept.stamps - delay
    assert kept.yaw is not None
    heading = heading_errors(name, t, kept.yaw, reference)
    bias, sd = np.zeros(3), np.zeros(3)
    if positions and kept.position is not None and reference.position is not None:
        off = kept.position - reference.position_at(t)
        bias, sd = off.mean(axis=0), off.std(axis=0)
    x, y, z = bias.tolist()
    sd_x, sd_y, sd_z = sd.tolist()
    found = RoomSensor(
        delay=delay,
        position_bias=(x, y, z),
        position_sd=(sd_x, sd_y, sd_z),
        heading=heading.correction,
        # All that is left counts: what moves slowly is no state here.
        heading_sd=float(heading.after.std()),
    )
    return found, heading


def heading_errors(name: str, stamps: Array, said: Array, reference: Reference) -> HeadingErrors:
    """Fit harmonics to what the headings `said` (n,) [rad] are off by; raises SensorFlightError.

    A line over time is fitted beside them and left in: a drift of this flight is not the next one's.
    """
    true = reference.yaw_at(stamps)
    before = _wrapped(said - true)
    _check_headings(name, true)
    basis = harmonics(said, ORDER)
    middle = stamps - stamps.mean()
    coefficients, *_ = np.linalg.lstsq(np.column_stack([basis, middle]), before, rcond=None)
    constant, *rest = coefficients[:-1].tolist()
    correction = HeadingCorrection(constant=constant, cosines=tuple(rest[:ORDER]), sines=tuple(rest[ORDER:]))
    after = before - basis @ coefficients[:-1]
    noise = _noise(after)
    return HeadingErrors(stamps, true, before, after, correction, noise, _walk(stamps, after, noise))


def heading_table(errors: HeadingErrors, sectors: int = 10) -> list[Sector]:
    """Return Table 3: the errors before the correction by the reference's heading, empty sectors left out."""
    width = 2.0 * math.pi / sectors
    number = (np.mod(errors.reference, 2.0 * math.pi) / width).astype(int) % sectors
    found = []
    for k in range(sectors):
        of = errors.before[number == k]
        if of.size:
            found.append(Sector((k + 0.5) * width, float(of.mean()), float(of.std()), int(of.size)))
    return found


def _aligned(name: str, reports: Reports, reference: Reference) -> tuple[Reports, float]:
    """Return the reports that the reference covers at any delay, and the delay with the least left over."""
    safe = reference.covers(reports.stamps - _EARLIEST) & reference.covers(reports.stamps - _LATEST)
    kept = _part(reports, safe)
    seconds = float(kept.stamps[-1] - kept.stamps[0]) if kept.stamps.size > 1 else 0.0
    if seconds < SHORTEST:
        raise SensorFlightError(
            f"{name}: measured beside the reference for {seconds:.1f} s, expected at least {SHORTEST:g} s; "
            "fly longer, in sight"
        )
    _check_headings(name, reference.yaw_at(kept.stamps))
    delays = np.arange(_EARLIEST, _LATEST + 1e-9, _DELAY_STEP)
    costs = np.array([_left_over(kept, reference, float(delay)) for delay in delays])
    k = int(costs.argmin())
    if k in (0, delays.size - 1):
        raise SensorFlightError(
            f"{name}: no delay from {_EARLIEST:g} to {_LATEST:g} s makes it follow the reference, expected "
            "one; are the stamps of one clock, and did the drone move?"
        )
    below, least, above = costs[k - 1 : k + 2]
    shift = 0.5 * (below - above) / (below - 2.0 * least + above)
    return kept, float(delays[k] + shift * _DELAY_STEP)


def _left_over(reports: Reports, reference: Reference, delay: float) -> float:
    """Return minus twice the log-likelihood of a delay [s], the sensor's spreads unknown."""
    t = reports.stamps - delay
    left: list[Array] = []
    if reports.yaw is not None:
        off = _wrapped(reports.yaw - reference.yaw_at(t))
        basis = np.column_stack([harmonics(reports.yaw, ORDER), t - t.mean()])
        left.append(off - basis @ np.linalg.lstsq(basis, off, rcond=None)[0])
    if reports.v_body is not None and reference.v_world is not None:
        left.extend((reports.v_body - reference.v_heading_at(t)).T)
    if reports.position is not None and reference.position is not None:
        left.extend((reports.position - reference.position_at(t)).T)
    return sum(t.size * math.log(max(float(off.var()), 1e-12)) for off in left)


def _check_headings(name: str, yaw: Array) -> None:
    width = 360.0 / SECTORS
    number = (np.mod(np.degrees(yaw), 360.0) / width).astype(int) % SECTORS
    missing = np.flatnonzero(np.bincount(number, minlength=SECTORS) < _FEWEST)
    if missing.size:
        said = ", ".join(f"{k * width:.0f} to {(k + 1) * width:.0f}" for k in missing[:3])
        more = ", ..." if missing.size > 3 else ""
        raise SensorFlightError(
            f"{name}: headings of {said}{more} deg are missing ({missing.size} of {SECTORS} sectors), "
            "expected all; turn the drone through them"
        )


def _part(reports: Reports, keep: NDArray[np.bool_]) -> Reports:
    cut: Callable[[Array | None], Array | None] = lambda a: None if a is None else a[keep]  # noqa: E731
    return Reports(
        reports.stamps[keep],
        cut(reports.yaw),
        cut(reports.v_body),
        cut(reports.position),
        cut(reports.height),
    )


def _noise(off: Array) -> float:
    """Return the sd of the part that is new in every measurement, from neighbours."""
    return float(np.diff(off).std() / math.sqrt(2.0))


def _walk(stamps: Array, off: Array, noise: float) -> float:
    """Return how fast the rest walks [1/sqrt(s)]: means over neighbouring blocks differ by 2/3 q T."""
    block = ((stamps - stamps[0]) / _BLOCK).astype(int)
    counts = np.bincount(block)
    full = counts >= 0.5 * counts.max()
    means = np.bincount(block, off)[full] / counts[full]
    steps = np.diff(means)
    spread = float(np.mean(steps**2)) - 2.0 * noise**2 * float(np.mean(1.0 / counts[full]))
    return math.sqrt(max(0.0, 1.5 * spread / _BLOCK))


def _wrapped(angles: Array) -> Array:
    return np.array([wrap_angle(angle) for angle in angles.tolist()])


def _floor(value: float, least: float) -> float:
    return max(value, least)
