"""An identified vehicle as settings: what a file of it holds, and the model that a filter predicts with."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from noctule.estimation.identification.result import Identification
from noctule.estimation.vehicle_model import TABLE_1, VehicleModel
from noctule.geometry import Array
from noctule.settings import Settings

Positive = Annotated[float, Field(gt=0.0, le=1e4)]
Deviation = Annotated[float, Field(ge=0.0, le=1e4)]
Drag = Annotated[float, Field(ge=0.0, le=1e3)]
Eight = tuple[Positive, Drag, Positive, Drag, Positive, Drag, Positive, Drag]
Eights = tuple[
    Deviation, Deviation, Deviation, Deviation, Deviation, Deviation, Deviation, Deviation
]  # fmt: skip


class VehicleModelSettings(Settings):
    """k1 to k8 and the delay of a vehicle, and in what its inputs are counted."""

    k: Eight = Field(TABLE_1, description="k1 to k8: gain and drag of forward, left, up, yaw")
    sd: Eights = Field((0.0,) * 8, description="their standard deviations")
    delay_s: float = Field(0.0, ge=0.0, le=1.0, description="from sending a command to its effect [s]")
    delay_sd_s: float = Field(0.0, ge=0.0, le=1.0, description="its standard deviation [s]")
    full_scale: tuple[Positive, Positive, Positive, Positive] = Field(
        (1.0, 1.0, 1.0, 1.0),
        description="the command that is input 1: forward, left, up [m/s], yaw rate [rad/s]; "
        "all 1 where k1, k3, k5, k7 are per m/s and rad/s of command",
    )

    @classmethod
    def of(cls, found: Identification, full_scale: Array) -> VehicleModelSettings:
        """Return the settings of what was identified with inputs that are commands / `full_scale` (4,)."""
        found.model()  # refuses what is no vehicle
        return cls(
            k=tuple(found.k.tolist()),
            sd=tuple(found.sd.tolist()),
            delay_s=max(0.0, found.delay),
            delay_sd_s=found.delay_sd,
            full_scale=tuple(np.asarray(full_scale, dtype=np.float64).tolist()),
        )

    def model(self) -> VehicleModel:
        """Return the model whose inputs are commands [m/s, rad/s], as they are sent and recorded."""
        k = np.array(self.k)
        return VehicleModel(k[0::2] / np.array(self.full_scale), k[1::2], self.delay_s)
