"""What of a flight the vehicle's model is identified from: inputs that were sent, velocities measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from noctule.errors import NoctuleError
from noctule.geometry import Array

AXES = ("forward", "left", "up", "yaw")
NOTHING_FLOWN = (
    "identification: no flight moves an axis; expected at least one whose inputs vary: "
    "fly the deformed sinusoid on each axis"
)
_FEWEST_INPUTS, _FEWEST_VELOCITIES = 2, 20


class IdentificationError(NoctuleError):
    """Flights from which no model can be identified."""


class ExcitationError(IdentificationError):
    """An axis that was moved too little to identify its parameters."""


@dataclass(frozen=True, slots=True)
class AxisFlight:
    """One axis of a flight: what was sent and what was measured.

    What is measured as `means` comes from a sensor of its own, which may be later than that of the others.
    """

    command_stamps: Array  # (m,) [s], when each input was sent; it is held until the next
    inputs: Array  # (m,)
    stamps: Array  # (n,) [s], of the measured velocities; (n + 1,) with `means`
    velocities: Array  # (n,) [m/s or rad/s], on the body's axis
    axis: str  # one of AXES
    means: bool = False  # each velocity is how far it went between its two stamps, by the time (yaw's sensor)

    def __post_init__(self) -> None:
        """Refuse what cannot be identified from."""
        _own_arrays(self, "command_stamps", "inputs", "stamps", "velocities")
        if self.axis not in AXES:
            raise IdentificationError(
                f"identification: axis {self.axis!r} is not known; expected one of {', '.join(AXES)}"
            )
        _check_sizes(
            self.axis, self.command_stamps, self.inputs, self.stamps[int(self.means) :], self.velocities
        )
        _check_numbers(self.axis, self.command_stamps, self.inputs, self.stamps, self.velocities)
        if np.ptp(self.inputs) <= 0.0:
            raise not_varied(self.axis, self.inputs)


@dataclass(frozen=True, slots=True)
class PlaneFlight:
    """The two horizontal axes of a flight on which the vehicle may turn."""

    command_stamps: Array  # (m,) [s]
    inputs: Array  # (m, 2), forward and left
    stamps: Array  # (n,) [s]
    velocities: Array  # (n, 2) [m/s], forward and left
    yaw: Array  # (n,) [rad], at the stamps, unwrapped

    def __post_init__(self) -> None:
        """Refuse what cannot be identified from."""
        _own_arrays(self, "command_stamps", "inputs", "stamps", "velocities", "yaw")
        where = "forward and left"
        _check_sizes(where, self.command_stamps, self.inputs, self.stamps, self.velocities)
        _check_sizes(where, self.command_stamps, self.inputs, self.stamps, self.yaw)
        _check_numbers(where, self.command_stamps, self.inputs, self.stamps, self.velocities, self.yaw)
        if np.ptp(self.inputs, axis=0).max() <= 0.0:
            raise not_varied(where, self.inputs[:, 0])


@dataclass(frozen=True, slots=True)
class WholeFlight:
    """All of a flight, on four axes; an axis that was not moved is nothing wrong here."""

    command_stamps: Array  # (m,) [s]
    inputs: Array  # (m, 4), forward, left, up, yaw
    stamps: Array  # (n,) [s]
    velocities: Array  # (n, 3) [m/s], forward, left, up, on the levelled heading frame
    yaw: Array  # (n,) [rad], unwrapped; its drift does no harm

    def __post_init__(self) -> None:
        """Refuse what does not fit together."""
        _own_arrays(self, "command_stamps", "inputs", "stamps", "velocities", "yaw")
        _check_sizes("a flight", self.command_stamps, self.inputs, self.stamps, self.velocities)
        _check_sizes("a flight", self.command_stamps, self.inputs, self.stamps, self.yaw)

    @property
    def moved(self) -> tuple[bool, ...]:
        """Which axes had inputs that varied."""
        return tuple(bool(np.ptp(self.inputs[:, a]) > 0.0) for a in range(4))

    def yaw_flight(self) -> AxisFlight:
        """Return the yaw axis: its mean rates between two reports."""
        rates = np.diff(self.yaw) / np.diff(self.stamps)
        return AxisFlight(self.command_stamps, self.inputs[:, 3], self.stamps, rates, "yaw", means=True)

    def up_flight(self) -> AxisFlight:
        """Return the vertical axis."""
        return AxisFlight(self.command_stamps, self.inputs[:, 2], self.stamps, self.velocities[:, 2], "up")

    def plane_flight(self) -> PlaneFlight:
        """Return the horizontal axes."""
        return PlaneFlight(
            self.command_stamps, self.inputs[:, :2], self.stamps, self.velocities[:, :2], self.yaw
        )

    def parts(self) -> tuple[AxisFlight | PlaneFlight, ...]:
        """Return what of it says something about the model."""
        forward, left, up, yaw = self.moved
        found: list[AxisFlight | PlaneFlight] = []
        if forward or left:
            found.append(self.plane_flight())
        if up:
            found.append(self.up_flight())
        if yaw:
            found.append(self.yaw_flight())
        return tuple(found)


Flight = AxisFlight | PlaneFlight


def not_varied(axis: str, inputs: Array) -> ExcitationError:
    """Return the error for an input that is always the same."""
    return ExcitationError(
        f"identification of {axis}: its input is {inputs[0]:g} throughout; "
        "expected one that varies: fly the deformed sinusoid"
    )


def axes_of(flight: Flight) -> tuple[int, ...]:
    """Return which of AXES a flight measures."""
    return (AXES.index(flight.axis),) if isinstance(flight, AxisFlight) else (0, 1)


def moved_axes(flight: Flight) -> tuple[int, ...]:
    """Return which of AXES a flight has inputs on that vary."""
    columns = flight.inputs.reshape(flight.inputs.shape[0], -1)
    return tuple(a for a, column in zip(axes_of(flight), columns.T, strict=True) if np.ptp(column) > 0.0)


def channels(flight: Flight) -> Array:
    """Return the measured velocities (axes, n)."""
    return np.atleast_2d(flight.velocities.T)


def _own_arrays(flight: object, *names: str) -> None:
    for name in names:
        object.__setattr__(flight, name, np.ascontiguousarray(getattr(flight, name), dtype=np.float64))


def _check_sizes(axis: str, sent: Array, inputs: Array, stamps: Array, measured: Array) -> None:
    m, n = inputs.shape[0], stamps.shape[0]
    if measured.shape[0] != n or sent.shape[0] != m or n < _FEWEST_VELOCITIES or m < _FEWEST_INPUTS:
        raise IdentificationError(
            f"identification of {axis}: {m} inputs at {sent.shape[0]} stamps, {measured.shape[0]} velocities "
            f"at {n} stamps; expected as many of both, at least {_FEWEST_INPUTS} inputs and "
            f"{_FEWEST_VELOCITIES} velocities"
        )


def _check_numbers(axis: str, sent: Array, inputs: Array, stamps: Array, *measured: Array) -> None:
    for what, values in (("inputs", inputs), *(("measurements", one) for one in measured)):
        rows = np.flatnonzero(~np.isfinite(values.reshape(values.shape[0], -1)).all(axis=1))
        if rows.size:
            raise IdentificationError(
                f"identification of {axis}: {rows.size} of {values.shape[0]} {what} are not finite, the "
                f"first is {values[rows[0]]} at number {rows[0]}; expected finite numbers: leave them out"
            )
    for what, times in (("inputs", sent), ("measurements", stamps)):
        back = np.flatnonzero(~(np.diff(times) > 0.0))
        if back.size:
            raise IdentificationError(
                f"identification of {axis}: stamps of {what} do not increase, {times[back[0] + 1]:g} s "
                f"follows {times[back[0]]:g} s at number {back[0] + 1}; expected each later than the one "
                "before: put them in order"
            )
