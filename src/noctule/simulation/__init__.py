"""A deterministic MuJoCo room that implements the device protocols."""

from noctule.simulation.engine import OpenGLError
from noctule.simulation.layout import Footprint, room_layout
from noctule.simulation.navdata import NavdataSpec
from noctule.simulation.spec import (
    CameraSpec,
    ColumnSpec,
    FurnitureSpec,
    KeepClear,
    LightSpec,
    LimitsSpec,
    PushSpec,
    RoomSpec,
    StartSpec,
    VehicleSpec,
    WorldFileError,
    WorldSpec,
    world_from_toml,
)
from noctule.simulation.world import SimulatedWorld

__all__ = [
    "CameraSpec",
    "ColumnSpec",
    "Footprint",
    "FurnitureSpec",
    "KeepClear",
    "LightSpec",
    "LimitsSpec",
    "NavdataSpec",
    "OpenGLError",
    "PushSpec",
    "RoomSpec",
    "SimulatedWorld",
    "StartSpec",
    "VehicleSpec",
    "WorldFileError",
    "WorldSpec",
    "room_layout",
    "world_from_toml",
]
