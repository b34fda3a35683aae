"""A depth camera on the ceiling of the simulated room, and what it sees: a quadrotor, people, things."""

from noctule.simulation.ceiling.flights import manual_flight, spread_poses
from noctule.simulation.ceiling.motions import (
    Hiding,
    Motion,
    Standing,
    Walker,
    things_at,
    walk_past,
    walk_through,
)
from noctule.simulation.ceiling.room import lab_room
from noctule.simulation.ceiling.spec import CeilingSpec, DepthSensorSpec
from noctule.simulation.ceiling.stage import DepthStage
from noctule.simulation.ceiling.things import ThingPose

__all__ = [
    "CeilingSpec",
    "DepthSensorSpec",
    "DepthStage",
    "Hiding",
    "Motion",
    "Standing",
    "ThingPose",
    "Walker",
    "lab_room",
    "manual_flight",
    "spread_poses",
    "things_at",
    "walk_past",
    "walk_through",
]
