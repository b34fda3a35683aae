"""The drone's sensors and the network that fuses them, in one process: for pilots, experiments and replay.

Measurements come in as the sensors make them, at the caller's time; the calibration of the site is taken off
here. What is fused goes back to the locator as its prediction.
"""

from __future__ import annotations

from collections.abc import Sequence

from noctule.estimation.delayed import DEFAULTS, FilterSettings
from noctule.estimation.events import Input
from noctule.estimation.filter_state import Prior, StateEstimate, start_at
from noctule.estimation.measurements import Measurement, of_heading, of_pose, of_vehicle_state
from noctule.estimation.network import Network, Node
from noctule.estimation.sensors import Sensors, tuned
from noctule.estimation.vehicle_model import VehicleModel
from noctule.geometry import Array
from noctule.localization.tracker import Prediction
from noctule.localization.vehicle_heading import VehicleHeading, faced
from noctule.messages import HeadingMeasurement, PoseMeasurement, VehicleState

SIZE = 11  # of the state: heading bias and velocity biases
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
        self._settings = tuned(settings, sensors)
        self._network: Network | None = None
        self._count = 0
        self._vehicle = VehicleHeading(sensors.onboard)

    @property
    def turns(self) -> int:
        """How often the half turn held was found wrong by the way the vehicle flies."""
        return self._vehicle.turns

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
        told = self._vehicle.told(state)
        measured = of_vehicle_state(told, self._sensors.onboard.noise, self._next())
        if measured is None:
            return
        self._measure("onboard", measured, now)
        if self._network is not None and self._vehicle.contradicted(told, self._known(told.stamp)):
            self._network = None  # it begins anew, with the other half turn

    def turn_around(self) -> None:
        """Begin anew with the other half turn: whoever asks knows that the one held is wrong."""
        self._vehicle.turn()
        self._vehicle.turns += 1
        self._network = None

    def faced(self, pose: PoseMeasurement) -> PoseMeasurement:
        """Return the pose or its half turn, whichever is nearer to what is known of the heading.

        At the start that is what the vehicle says, later the estimate; see `vehicle_heading`.
        """
        return faced(pose, self._vehicle.newest if self._network is None else self._known(pose.stamp).yaw)

    def pose(self, pose: PoseMeasurement, certain: bool, now: float) -> None:
        """Hand a located drone to the node of the depth camera, turned as `faced` has it.

        It begins with the first after a report; where the vehicle says nothing of its heading, with the first
        whose half turn is `certain` from above.
        """
        corrected = self.faced(self._sensors.depth.corrected(pose))
        if self._network is None and self._vehicle.heard and (certain or self._vehicle.newest is not None):
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

    def _measure(self, name: str, measurement: Measurement, now: float) -> None:
        if self._network is not None:
            self._network.measure(name, measurement, now)
            self._network.deliver(now)

    def _next(self) -> int:
        self._count += 1
        return self._count
