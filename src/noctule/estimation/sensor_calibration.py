"""Bias, noise and delay of each sensor, and how its heading depends on the heading, from one flight.

6.3 of "Indoor low-cost localization system", corrected: Table 3's spread of the onboard heading is no white
noise but a bias that depends on the heading. So harmonics of the heading are fitted and taken off, with a
drift over the flight beside them; what neighbours in time differ by is noise, what is left walks slowly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from noctule.errors import NoctuleError
from noctule.estimation.measurements import NavdataNoise
from noctule.estimation.reference import Reference
from noctule.estimation.reports import Reports
from noctule.estimation.sensors import HeadingCorrection, OnboardSensors, RoomSensor, harmonics
from noctule.geometry import Array, wrap_angle

ORDER = 5  # harmonics of the heading: ten headings of Table 3 bear no more
SHORTEST = 30.0  # [s]
SECTORS = 12  # of 30 deg, each of which has to be flown
_FEWEST = 5  # headings in a sector
_EARLIEST, _LATEST, _DELAY_STEP = -0.1, 0.4, 0.005  # [s], delays that are looked for
_SIGMAS = 3.0  # a delay is one
_BLOCK = 2.0  # [s], over which noise averages out and what walks does not


class SensorFlightError(NoctuleError):
    """A flight that a sensor cannot be calibrated from."""


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
    kept, delay, delay_sd = _aligned("onboard", reports, reference)
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
        delay_sd=delay_sd,
        height_bias=height_bias,
        heading=heading.correction,
        heading_walk=max(0.001, heading.walk),
        velocity_walk=velocity_walk,
    )
    return found, heading


def calibrate_room(
    name: str, reports: Reports, reference: Reference, same_exposures: bool = False
) -> tuple[RoomSensor, HeadingErrors]:
    """Return the calibration of a sensor in the room and its headings' errors; raises SensorFlightError.

    `same_exposures` says that the reference is of the same frames, so that no delay has to be looked for.
    """
    assert reports.yaw is not None
    kept, delay, delay_sd = _aligned(name, reports, reference, same_exposures)
    t = kept.stamps - delay
    assert kept.yaw is not None
    heading = heading_errors(name, t, kept.yaw, reference)
    bias, sd = np.zeros(3), np.zeros(3)
    if kept.position is not None and reference.position is not None:
        off = kept.position - reference.position_at(t)
        bias, sd = off.mean(axis=0), off.std(axis=0)
    x, y, z = bias.tolist()
    sd_x, sd_y, sd_z = sd.tolist()
    found = RoomSensor(
        delay=delay,
        delay_sd=delay_sd,
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
    before = np.array([wrap_angle(angle) for angle in (said - true).tolist()])
    _check_headings(name, true)
    basis = _basis(said, stamps)
    coefficients, *_ = np.linalg.lstsq(basis, before, rcond=None)
    constant, *rest = coefficients[:-1].tolist()
    correction = HeadingCorrection(constant=constant, cosines=tuple(rest[:ORDER]), sines=tuple(rest[ORDER:]))
    after = before - basis[:, :-1] @ coefficients[:-1]
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


def _aligned(
    name: str, reports: Reports, reference: Reference, same_exposures: bool = False
) -> tuple[Reports, float, float]:
    """Return the reports that the reference covers at any delay, the delay with the least left over, its sd.

    Where the turning is the same at each passing of a heading a delay looks like a bias by the heading; one
    that is not three deviations from 0 is taken for 0.
    """
    safe = reference.covers(reports.stamps - _EARLIEST) & reference.covers(reports.stamps - _LATEST)
    kept = reports.part(safe)
    seconds = float(kept.stamps[-1] - kept.stamps[0]) if kept.stamps.size > 1 else 0.0
    if seconds < SHORTEST:
        raise SensorFlightError(
            f"{name}: measured beside the reference for {seconds:.1f} s, expected at least {SHORTEST:g} s; "
            "fly longer, in sight"
        )
    _check_headings(name, reference.yaw_at(kept.stamps))
    kept = kept.faced(reference, 2.0 * math.pi)
    if same_exposures:
        return kept, 0.0, 0.0
    delays = np.arange(_EARLIEST, _LATEST + 1e-9, _DELAY_STEP)
    assert kept.yaw is not None
    basis, _ = np.linalg.qr(_basis(kept.yaw, kept.stamps))
    costs = np.array([_left_over(kept, reference, float(delay), basis) for delay in delays])
    k = int(costs.argmin())
    if k in (0, delays.size - 1):
        raise SensorFlightError(
            f"{name}: no delay from {_EARLIEST:g} to {_LATEST:g} s makes it follow the reference, expected "
            "one; are the stamps of one clock, and did the drone move?"
        )
    below, least, above = costs[k - 1 : k + 2]
    bend = below - 2.0 * least + above
    delay = float(delays[k] + 0.5 * (below - above) / bend * _DELAY_STEP)
    sd = _DELAY_STEP * math.sqrt(2.0 / bend)
    return kept, delay if abs(delay) > _SIGMAS * sd else 0.0, sd


def _left_over(reports: Reports, reference: Reference, delay: float, basis: Array) -> float:
    """Return minus twice the log-likelihood of a delay [s], the sensor's spreads unknown.

    `basis` (n, m) is that of `_basis`, orthonormal.
    """
    t = reports.stamps - delay
    left: list[Array] = []
    if reports.yaw is not None:
        off = reports.yaw - reference.yaw_at(t)
        left.append(off - basis @ (basis.T @ off))
    if reports.v_body is not None and reference.v_world is not None:
        left.extend((reports.v_body - reference.v_heading_at(t)).T)
    if reports.position is not None and reference.position is not None:
        left.extend((reports.position - reference.position_at(t)).T)
    return sum(t.size * math.log(max(float(off.var()), 1e-12)) for off in left)


def _basis(said: Array, stamps: Array) -> Array:
    """Return the harmonics of the headings `said`, and a line over time, (n, 2 + 2 ORDER)."""
    return np.column_stack([harmonics(said, ORDER), stamps - stamps.mean()])


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


def _floor(value: float, least: float) -> float:
    return max(value, least)
