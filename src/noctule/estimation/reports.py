"""What a sensor said over a flight, as columns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from noctule.estimation.reference import Reference
from noctule.geometry import Array
from noctule.messages import HeadingMeasurement, PoseMeasurement, VehicleState


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

    def faced(self, reference: Reference, period: float = math.pi) -> Reports:
        """Return the reports with each heading turned by the periods [rad] that bring it nearest.

        Half turns, for what sees a shape: a filter chooses them by its prediction, so they are no error of
        the sensor. Full turns make differences of headings small without wrapping each.
        """
        assert self.yaw is not None
        turns = np.rint((reference.yaw_at(self.stamps) - self.yaw) / period)
        return replace(self, yaw=self.yaw + period * turns)

    def part(self, keep: NDArray[np.bool_]) -> Reports:
        """Return the kept reports (n,)."""

        def cut(values: Array | None) -> Array | None:
            return None if values is None else values[keep]

        return Reports(
            self.stamps[keep], cut(self.yaw), cut(self.v_body), cut(self.position), cut(self.height)
        )

    @classmethod
    def of_headings(cls, headings: Sequence[HeadingMeasurement]) -> Reports:
        """Return how a sensor in the room saw the vehicle turned."""
        return cls(np.array([one.stamp for one in headings]), np.array([one.yaw for one in headings]))
