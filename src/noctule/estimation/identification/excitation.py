"""The deformed sinusoid of Fig. 13: what is sent to a vehicle to identify it.

The paper prints the figure only. Here it is a sinusoid that slows down and quickens, between half and one and
a half times its mean rate, and is the higher the quicker it is: slow parts tell the drag, quick ones the
input's gain and the delay, and the vehicle stays within a metre or so throughout. It begins and ends gently.
"""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from noctule.geometry import Array
from noctule.settings import Settings

SECONDS = 82.0  # [s], an axis
_RAMP = 6.0  # [s], from nothing to full height
_DEPTH = 0.5  # of the mean rate, how far the rate goes up and down
_SLOWNESS = 0.17  # of the mean rate, how fast it does so


class Excitation(Settings):
    """A deformed sinusoid of normalised input."""

    height: float = Field(gt=0.0, le=1.0, description="largest input; 1 is all that the vehicle takes")
    period: float = Field(gt=0.5, le=60.0, description="mean period [s]")

    def inputs(self, t: Array, shift: float = 0.0) -> Array:
        """Return the inputs (n,) at `t` [s]; they last SECONDS. `shift` [rad] makes others of the kind."""
        w = 2.0 * math.pi / self.period
        beat = _SLOWNESS * w * t + shift
        phase = w * t + shift + _DEPTH / _SLOWNESS * (np.sin(beat) - math.sin(shift))
        rate = (1.0 + _DEPTH * np.cos(beat)) / (1.0 + _DEPTH)
        gentle = np.sin(0.5 * math.pi * np.clip(np.minimum(t, SECONDS - t) / _RAMP, 0.0, 1.0)) ** 2
        return np.asarray(self.height * rate**1.5 * gentle * np.cos(phase))


EXCITATIONS = (
    Excitation(height=0.34, period=5.5),
    Excitation(height=0.28, period=5.0),
    Excitation(height=0.9, period=4.0),
    Excitation(height=0.8, period=5.0),
)
"""Of forward, left, up and yaw, for a vehicle like that of Table 1."""


_OTHER = ((0.74, 0.6, 4.1), (1.03, 0.6, 5.2), (0.95, 0.8, 4.9), (0.89, 0.8, 1.9))
"""Period and height against EXCITATIONS, and shift: the vehicle of Table 1 stays within 1.3 m with these."""


def validation_inputs(t: Array) -> Array:
    """Return inputs (n, 4) that move all axes at once, each unlike those that it was identified with."""
    columns = []
    for excitation, (period, height, shift) in zip(EXCITATIONS, _OTHER, strict=True):
        other = Excitation(height=height * excitation.height, period=period * excitation.period)
        columns.append(other.inputs(t, shift))
    return np.column_stack(columns)
