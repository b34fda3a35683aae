"""A depth camera on the ceiling of the simulated room, and what it sees: a quadrotor, people, things."""

from noctule.simulation.ceiling.room import lab_room
from noctule.simulation.ceiling.spec import CeilingSpec, DepthSensorSpec
from noctule.simulation.ceiling.stage import DepthStage
from noctule.simulation.ceiling.things import ThingPose

__all__ = [
    "CeilingSpec",
    "DepthSensorSpec",
    "DepthStage",
    "ThingPose",
    "lab_room",
]
