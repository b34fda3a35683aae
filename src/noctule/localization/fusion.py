"""The drone's sensors and the network that fuses them, in one process: for pilots, experiments and replay.

Measurements come in as the sensors make them, at the caller's time; the calibration of the site is taken off
here. What is fused goes back to the locator as its prediction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from noctule.estimation.delayed import DEFAULTS, FilterSettings
from noctule.estimation.events import Input
from noctule.estimation.filter_state import Prior, StateEstimate, start_at
from noctule.estimation.measurements import Measurement, of_heading, of_pose, of_vehicle_state
from noctule.estimation.network import Network, Node
from noctule.estimation.sensors import Sensors
from noctule.estimation.vehicle_model import VehicleModel
from noctule.geometry import Array, wrap_angle
from noctule.localization.heading.turns import HALF_TURN, nearest_turn
from noctule.localization.tracker import Prediction
from noctule.messages import HeadingMeasurement, PoseMeasurement, VehicleState

SIZE = 11  # of the state: heading bias and velocity biases
_MOVES = 0.1  # [m/s], slower than this nothing is said of the half turn
_PER_REPORT, _CERTAIN = 2.0, 20.0  # log-likelihood ratios
_START = Prior(position=0.05, yaw=0.1, velocity=0.5, yaw_rate=1.0)


class Fusion:
    """A network that begins with the first pose after the vehicle's first report. Deterministic; no clock.

    Parameters
    ----------
    nodes : "onboard" and "depth", and "markers" where they are a third node
    model : the vehicle's, for predictions by the commands sent
    sensors : the site's calibration
    settings : the filter's; how fast its biases walk is taken from `sensors`
    """

    def __init__(
        self,
        nodes: Sequence[str],
        model: VehicleModel | None,
        sensors: Sensors,
        settings: FilterSettings = DEFAULTS,
    ) -> None:
        self._names = tuple(nodes)
        self._model = model
        self._sensors = sensors
        walks = sensors.onboard.process_noise
        noises = {"noise": settings.noise, "noise_without_commands": settings.noise_without_commands}
        self._settings = settings.model_copy(update={name: walks(noise) for name, noise in noises.items()})
        self._network: Network | None = None
        self._count = 0
        self._heard = False
        self._heading: float | None = None  # [rad], the newest that the vehicle said
        self._turned = False  # its headings are half a turn off
        self._agreement = 0.0  # log-likelihood ratio of the half turn held, by the way it flies
        self.turns = 0
        """How often the half turn held was found wrong by the way the vehicle flies."""

    @property
    def begun(self) -> bool:
        """Whether it knows anything."""
        return self._network is not None

    @property
    def refusals(self) -> dict[str, int]:
        """How often the gates refused what."""
        nodes = () if self._network is None else self._network.nodes.values()
        return {reason: count for node in nodes for reason, count in node.refusals.items()}

    def command(self, stamp: float, u: Array) -> None:
        """Tell a command as it is sent."""
        if self._network is not None:
            self._count += 1
            self._network.command(Input(stamp, u, sequence=self._count), stamp)
            self._network.deliver(stamp)

    def report(self, state: VehicleState, now: float) -> None:
        """Hand the vehicle's report to its node."""
        corrected = self._sensors.onboard.corrected(state)
        if self._turned and corrected.yaw is not None:
            corrected = replace(corrected, yaw=wrap_angle(corrected.yaw + HALF_TURN))
        self._heard, self._heading = True, corrected.yaw
        measured = of_vehicle_state(corrected, self._sensors.onboard.noise, self._next())
        if measured is not None:
            self._measure("onboard", measured, now)
            self._check_half_turn(corrected)

    def faced(self, pose: PoseMeasurement) -> PoseMeasurement:
        """Return the pose or its half turn, whichever is nearer to what is known of the heading: Alg. 1.

        The view from above tells the half turn in most frames, but where it errs it errs for seconds. What
        the vehicle says of its heading, off by up to 30 deg, tells it at the start, later the estimate does.
        """
        known = self._heading if self._network is None else self._known(pose.stamp).yaw
        return pose if known is None else replace(pose, yaw=nearest_turn(pose.yaw, known, HALF_TURN))

    def pose(self, pose: PoseMeasurement, certain: bool, now: float) -> None:
        """Hand a located drone to the node of the depth camera, turned as `faced` has it.

        It begins with the first after a report; where the vehicle says nothing of its heading, with the first
        whose half turn is `certain` from above.
        """
        corrected = self.faced(self._sensors.depth.corrected(pose))
        if self._network is None and self._heard and (certain or self._heading is not None):
            start = start_at(corrected.stamp, corrected.position, corrected.yaw, _START, SIZE)
            self._network = Network([Node(name, start, self._model, self._settings) for name in self._names])
        self._measure("depth", of_pose(corrected, self._next()), now)

    def heading(self, heading: HeadingMeasurement, now: float) -> None:
        """Hand the markers' heading to their node."""
        self._measure(
            "markers", of_heading(self._sensors.markers.corrected_heading(heading), self._next()), now
        )

    def estimate(self, now: float) -> StateEstimate:
        """Return what the depth camera's node knows; all know the same while every message arrives."""
        assert self._network is not None
        return self._network.nodes["depth"].estimate(now)

    def prediction(self, stamp: float) -> Prediction | None:
        """Return where to look for the drone in the frame exposed at `stamp` [s]."""
        if self._network is None:
            return None
        known = self._known(stamp)
        return Prediction(known.pose, known.P[:4, :4])

    def _known(self, stamp: float) -> StateEstimate:
        """Return what is known at `stamp` [s], or at the oldest that is remembered: never raises."""
        assert self._network is not None
        return self.estimate(max(stamp, self._network.nodes["depth"].filter.oldest))

    def _check_half_turn(self, state: VehicleState) -> None:
        """Compare the displacement that the camera sees with the velocity that the vehicle says.

        While they point opposite ways the half turn held is the wrong one: begin anew with the other.
        """
        if self._network is None or state.v_body is None:
            return
        seen = self._known(state.stamp).v_heading[:2]
        if float(np.linalg.norm(seen)) < _MOVES:
            return
        variance = 2.0 * self._sensors.onboard.noise.velocity_sd**2
        ratio = 2.0 * float(seen @ state.v_body[:2]) / variance
        # A report does not say more than so much: its errors last longer than it.
        step = min(max(ratio, -_PER_REPORT), _PER_REPORT)
        self._agreement = min(max(self._agreement + step, -_CERTAIN), _CERTAIN)
        if self._agreement <= -_CERTAIN:
            self._turned, self._network, self._agreement = not self._turned, None, 0.0
            self._heading = None if state.yaw is None else wrap_angle(state.yaw + HALF_TURN)
            self.turns += 1

    def _measure(self, name: str, measurement: Measurement, now: float) -> None:
        if self._network is not None:
            self._network.measure(name, measurement, now)
            self._network.deliver(now)

    def _next(self) -> int:
        self._count += 1
        return self._count
