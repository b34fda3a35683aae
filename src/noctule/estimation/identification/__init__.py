"""k1 to k8 and the delay of a vehicle from flights of it, with their uncertainties."""

from noctule.estimation.identification.bound import cramer_rao
from noctule.estimation.identification.excitation import EXCITATIONS, Excitation, validation_inputs
from noctule.estimation.identification.flights import (
    AXES,
    AxisFlight,
    ExcitationError,
    IdentificationError,
    PlaneFlight,
    WholeFlight,
)
from noctule.estimation.identification.output_error import identify
from noctule.estimation.identification.published import published
from noctule.estimation.identification.result import AxisFit, Identification, check_excitation
from noctule.estimation.identification.validation import Validation, validate
from noctule.estimation.identification.vehicle import VehicleModelSettings

__all__ = [
    "AXES",
    "EXCITATIONS",
    "AxisFit",
    "AxisFlight",
    "Excitation",
    "ExcitationError",
    "Identification",
    "IdentificationError",
    "PlaneFlight",
    "Validation",
    "VehicleModelSettings",
    "WholeFlight",
    "check_excitation",
    "cramer_rao",
    "identify",
    "published",
    "validate",
    "validation_inputs",
]
