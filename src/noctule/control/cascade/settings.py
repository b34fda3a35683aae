"""The gains of the cascade, and how late a vehicle may answer it."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from noctule.errors import NoctuleError
from noctule.geometry import Array
from noctule.settings import Settings

Positive = Annotated[float, Field(gt=0.0, le=100.0)]
Four = tuple[Positive, Positive, Positive, Positive]


class DelayTooLongError(NoctuleError):
    """A vehicle that answers later than the cascade was shown to be stable with."""


class CascadeSettings(Settings):
    """Gains by axis: x, y, z, yaw, eqs. (48) and (53)."""

    k1: Four = Field((1.5, 1.5, 1.0, 2.0), description="most that an error adds to the speed [m/s, rad/s]")
    k2: Four = Field((2.5, 2.5, 2.5, 2.0), description="how steeply it rises with the error [1/m, 1/rad]")
    K: Four = Field((8.0, 8.0, 7.0, 8.0), description="with which errors of the velocity fall [1/s]")
    disturbance_rate: float = Field(
        2.0,
        ge=0.0,
        le=10.0,
        description="with which a constant disturbance is learnt; 0: as published [1/s]",
    )
    disturbance_share: float = Field(
        0.3,
        ge=0.0,
        le=1.0,
        description="by which the model may be off: what goes with the wanted speed is learnt too; "
        "0: a constant only",
    )
    most_disturbance: Four = Field(
        (1.0, 1.0, 1.0, 1.0), description="taken for one: forward, left, up [m/s^2], yaw [rad/s^2]"
    )
    longest_delay_s: float = Field(
        0.3, ge=0.0, le=2.0, description="from a command to its effect; refused beyond [s]"
    )

    def check_delay(self, delay: float) -> None:
        """Raise DelayTooLongError for a delay [s] with which these gains were not shown to be stable."""
        if delay > self.longest_delay_s:
            raise DelayTooLongError(
                f"vehicle: its commands take effect after {delay:.2f} s, the cascade was shown to be stable "
                f"up to {self.longest_delay_s:.2f} s; mend the link, or lower K and raise longest_delay_s "
                "after trying it in simulation"
            )

    def arrays(self) -> tuple[Array, Array, Array]:
        """Return k1, k2 and K, (4,) each."""
        return np.array(self.k1), np.array(self.k2), np.array(self.K)
