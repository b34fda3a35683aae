"""Paths in space: their shapes, how fast and with which heading they are flown, and the nearest point."""

from noctule.control.paths.duration import duration
from noctule.control.paths.heading import AlongPath, FacePoint, FixedHeading, GivenHeading, TurnSettings
from noctule.control.paths.nearest import nearest, nearest_anywhere
from noctule.control.paths.plan import PathPlan, Stop, StopError
from noctule.control.paths.planning import loc_1, loc_2, loc_3, plan, with_headings
from noctule.control.paths.shapes import PathJoinError, arc, eight, ellipse, joined, line, polyline
from noctule.control.paths.space_path import (
    PathLengthError,
    PathPoint,
    PathShapeError,
    SpacePath,
    require_length,
)
from noctule.control.paths.speed import PathCurvatureError, PathSpeedError, SpeedSettings
from noctule.control.paths.splines import spline

__all__ = [
    "AlongPath",
    "FacePoint",
    "FixedHeading",
    "GivenHeading",
    "PathCurvatureError",
    "PathJoinError",
    "PathLengthError",
    "PathPlan",
    "PathPoint",
    "PathShapeError",
    "PathSpeedError",
    "SpacePath",
    "SpeedSettings",
    "Stop",
    "StopError",
    "TurnSettings",
    "arc",
    "duration",
    "eight",
    "ellipse",
    "joined",
    "line",
    "loc_1",
    "loc_2",
    "loc_3",
    "nearest",
    "nearest_anywhere",
    "plan",
    "polyline",
    "require_length",
    "spline",
    "with_headings",
]
