"""What is known of a vehicle's model after flights of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from noctule.estimation.identification.flights import AXES, ExcitationError, IdentificationError
from noctule.estimation.vehicle_model import VehicleModel
from noctule.geometry import Array

_GAIN_KNOWN = 0.2  # of k_u, its largest deviation
_DRAG_KNOWN = 0.5  # of k_v
_EARLY, _EARLY_SDS = 0.005, 3.0  # [s], and deviations: a delay below 0 by less is one of 0
_DRAG_SMALL = 0.1  # [1/s], as good as none: known so well is enough


@dataclass(frozen=True, slots=True)
class AxisFit:
    """The parameters of one axis with the deviations of their errors."""

    axis: str
    k_u: float  # acceleration per unit of input
    k_v: float  # [1/s]
    k_u_sd: float
    k_v_sd: float
    residual_sd: float  # [m/s or rad/s], between reports; of (15): of the input
    residual_correlation: float = 0.0  # of neighbours, what is known of the noise taken off; 0: white noise


@dataclass(frozen=True, slots=True)
class Identification:
    """What flights say of the vehicle."""

    axes: tuple[AxisFit, ...]  # those that were moved, in the order of AXES
    delay: float  # [s]
    delay_sd: float  # [s]

    @property
    def k(self) -> Array:
        """k1 to k8 (8,), without those of axes that were not moved."""
        return np.array([k for fit in self.axes for k in (fit.k_u, fit.k_v)])

    @property
    def sd(self) -> Array:
        """Deviations of the same."""
        return np.array([k for fit in self.axes for k in (fit.k_u_sd, fit.k_v_sd)])

    def require_all_axes(self) -> None:
        """Raise ExcitationError unless all four axes were moved."""
        missing = [name for name in AXES if name not in [fit.axis for fit in self.axes]]
        if missing:
            raise ExcitationError(
                f"identification: nothing was sent on {' and '.join(missing)}; expected all of "
                f"{', '.join(AXES)} to be moved: fly the deformed sinusoid on each"
            )

    def model(self) -> VehicleModel:
        """Return what the filter predicts with; its inputs are those that were sent.

        Raises IdentificationError for what is no vehicle: an axis not moved, a gain of 0 or less, a drag or a
        delay below 0.
        """
        self.require_all_axes()
        for fit in self.axes:
            if fit.k_u <= 0.0 or fit.k_v < 0.0:
                raise IdentificationError(
                    f"identification of {fit.axis}: its gain is {fit.k_u:.3g}, its drag {fit.k_v:.3g} 1/s, "
                    "expected a gain above 0 and a drag of 0 or more; are signs and stamps of inputs and "
                    "velocities the same?"
                )
        if self.delay < -max(_EARLY, _EARLY_SDS * self.delay_sd):
            raise IdentificationError(
                f"identification: the delay is {1e3 * self.delay:.1f} ± {1e3 * self.delay_sd:.1f} ms, the "
                "vehicle answers before it is asked; expected 0 or more: the stamps of reports are early, or "
                "those of commands late; stamp both by one clock, reports when they were measured"
            )
        return VehicleModel.identified(self.k, max(0.0, self.delay))


def check_excitation(found: Identification) -> None:
    """Raise ExcitationError when the parameters of an axis are hardly known, or an axis was not moved."""
    found.require_all_axes()
    for a, fit in enumerate(found.axes):
        for name, value, sd, known in (
            (f"k{2 * a + 1}", fit.k_u, fit.k_u_sd, _GAIN_KNOWN * abs(fit.k_u)),
            (f"k{2 * a + 2}", fit.k_v, fit.k_v_sd, _DRAG_KNOWN * max(abs(fit.k_v), _DRAG_SMALL)),
        ):
            if not sd <= known:
                raise ExcitationError(
                    f"identification of {fit.axis}: too little excitation, {name} is {value:.3g} with a "
                    f"deviation of {sd:.2g}, expected at most {known:.2g}; fly the deformed sinusoid longer "
                    "or larger"
                )
