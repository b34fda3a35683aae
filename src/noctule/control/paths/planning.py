"""Plans, made and checked: of any path, and those of the paper's experiments."""

from __future__ import annotations

import math

import numpy as np

from noctule.control.paths.duration import duration
from noctule.control.paths.heading import (
    AlongPath,
    FixedHeading,
    GivenHeading,
    HeadingRule,
    TurnSettings,
    turn_per_metre,
)
from noctule.control.paths.plan import PathPlan, Stop, StopError
from noctule.control.paths.shapes import Point, eight, ellipse, line
from noctule.control.paths.space_path import SAME_PLACE, SpacePath, turn
from noctule.control.paths.speed import PathCurvatureError, SpeedSettings, speed_profile
from noctule.geometry import Array
from noctule.messages import Limits

_AT_CORNER = 0.02  # [m]; a stop as near to a corner as this is at the corner


def plan(
    path: SpacePath,
    speed: SpeedSettings | None = None,
    heading: HeadingRule | None = None,
    stops: tuple[Stop, ...] = (),
    laps: int | None = 1,
    *,
    turning: TurnSettings | None = None,
    cruise: Array | None = None,
    limits: Limits | None = None,
) -> PathPlan:
    """Return the plan, checked: speeds within `limits`, a stop at every corner, stops on the path.

    Left out, the heading is along the path. `cruise` (n,) [m/s] is a cruise of its own for every node. Raises
    PathSpeedError, PathCurvatureError and StopError.
    """
    speed = SpeedSettings() if speed is None else speed
    rule: HeadingRule = AlongPath() if heading is None else heading
    turning = TurnSettings(rate=max(1.2, 1.2 * speed.turn_rate)) if turning is None else turning
    if laps is not None and laps < 1:
        raise StopError(f"path: {laps} laps, expected 1 or more")
    if laps != 1 and not path.closed:
        raise StopError("path: laps are flown around a closed path, and this one has two ends")
    turns = None if isinstance(rule, FixedHeading) else turn_per_metre(rule, path)
    profile = speed_profile(path, speed, turns, cruise, limits)
    placed = tuple(sorted((p for p in stops if p.s is not None), key=lambda p: p.s or 0.0))
    timed = tuple(sorted((p for p in stops if p.time is not None), key=lambda p: p.time or 0.0))
    made = PathPlan(path, profile, speed, rule, turning, timed, placed, laps)
    for stop in placed:
        if stop.s is not None and stop.s > made.total:
            raise StopError(
                f"stop: s = {stop.s:.2f} m is beyond the end of the path at {made.total:.2f} m; stop earlier"
            )
    _check_corners(made)
    if timed:
        _check_times(made)
    return made


def _check_times(plan: PathPlan) -> None:
    """Raise StopError for a stop at a time when the end has been reached."""
    seconds = duration(plan)
    for stop in plan.timed:
        if stop.time is not None and stop.time > seconds:
            raise StopError(
                f"stop: time = {stop.time:g} s is after the end of the path, which is reached after about "
                f"{seconds:.1f} s; stop earlier"
            )


def _check_corners(plan: PathPlan) -> None:
    """Raise PathCurvatureError where the direction jumps and no stop is."""
    path, stops = plan.path, [stop.s for stop in plan.placed if stop.s is not None]
    laps = 1 if plan.laps is None else plan.laps
    for lap in range(laps):
        for corner in path.corners.tolist():
            s = lap * path.length + corner
            if (corner == 0.0 and lap == 0) or any(abs(s - stop) < _AT_CORNER for stop in stops):
                continue
            i = int(path.s.searchsorted(corner, side="left"))
            before = path.tangent[-1] if corner == 0.0 else path.tangent[i]
            after = path.tangent[0] if corner == 0.0 else path.tangent[i + 1]
            raise PathCurvatureError(
                f"path: a corner of {math.degrees(turn(before, after)):.0f} deg at "
                f"{path.place(corner)} cannot be flown through; stop there (s = {s:.2f}) or round it"
            )
    if plan.laps is None and path.corners.size:
        raise PathCurvatureError(
            f"path: a corner at {path.place(float(path.corners[0]))} on a path without end would need a stop "
            "in every lap; round it or give a number of laps"
        )


def straight(begin: Point, end: Point, yaw: float, speed: SpeedSettings) -> PathPlan:
    """Return the plan of a straight way with one heading [rad]. Raises PathShapeError."""
    begin, end = np.asarray(begin, dtype=np.float64), np.asarray(end, dtype=np.float64)
    if float(np.linalg.norm(end - begin)) < 2.0 * SAME_PLACE:
        # Too near for a direction: any will do, as all of the way is within reach of its end.
        begin = end - np.array([2.0 * SAME_PLACE, 0.0, 0.0])
    return plan(line(begin, end), speed, FixedHeading(yaw))


def with_headings(path: SpacePath, s: Array, yaw: Array) -> GivenHeading:
    """Return the rule of headings `yaw` (m,) [rad] given at `s` (m,) [m]; around a closed path it closes."""
    if path.closed:
        s, yaw = np.append(s, path.length), np.append(yaw, yaw[0])
    return GivenHeading.of(s, yaw)


LOC_SPEED = SpeedSettings(cruise=0.3)


def loc_1() -> PathPlan:
    """Return the path of the paper's experiment 1 (Fig. 19a, section 6.4), with figures of our own.

    An ellipse with the heading along the path at 0.3 m/s without end, and a stop from 40 to 70 s.
    """
    path = ellipse((0.08, 0.1, 1.2), (0.5, 0.8), rise=0.12)
    return plan(path, LOC_SPEED, AlongPath(), (Stop(30.0, time=40.0),), laps=None)


def loc_2(stop: float = 30.0) -> PathPlan:
    """Return the path of the paper's experiment 2 (Fig. 19b), with figures of our own.

    An eight with heading 0 at 0.3 m/s without end; a stop of `stop` [s] from 40 s on, and 4 s into it the
    heading turns by 180 degrees and stays so.
    """
    path = eight((0.08, 0.1, 1.2), (0.45, 0.8), rise=0.1)
    stops = (Stop(stop, time=40.0, yaw=math.pi, turn_after=4.0),)
    return plan(path, LOC_SPEED, FixedHeading(0.0), stops, laps=None)


def loc_3() -> PathPlan:
    """Return the path of experiment 3: that of experiment 2 with a stop from 40 to 52 s."""
    return loc_2(12.0)
