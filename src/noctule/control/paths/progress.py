"""Where along its path a vehicle is, tick by tick, and what is wanted of it there."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from noctule.compiled import compiled
from noctule.control.paths.heading import TurnReference, heading_at
from noctule.control.paths.nearest import foot, foot_speed
from noctule.control.paths.plan import PathPlan, Stop
from noctule.control.paths.space_path import PathPoint
from noctule.control.paths.speed import CAPTURE, approach_speed, braking_distance
from noctule.geometry import Array

ARRIVED = 0.06  # [m]; a stop at a place begins this near to it
_AHEAD = 0.15  # [m/s]; how far the allowed speed may rise above what is flown


@dataclass(frozen=True, slots=True)
class Reference:
    """What the controller is asked for: x, y, z [m], yaw [rad] in the world, and how they move."""

    pose: Array  # (4,) the wanted point and heading, eq. (47)'s x_d
    velocity: Array  # (4,) wanted there: v_d along the path; zeros to hover
    motion: Array  # (4,) with which the point itself moves, as the vehicle drives the nearest point on
    acceleration: Array  # (4,) of `velocity` while it is flown: curvature and change of speed


@dataclass(frozen=True, slots=True)
class Begun:
    """A stop that has begun and is not over."""

    stop: Stop
    since: float  # [s]: its time, or when the vehicle arrived at its place
    turned: bool = False  # its change of heading has been made


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a plan has been flown."""

    turn: TurnReference
    s: float = 0.0  # [m], counted on over the laps
    floor: float = 0.0  # [m], the last stop passed: there is no way back beyond it
    allowed: float = 0.0  # [m/s], by the acceleration since the last stop
    speed: float = 0.0  # [m/s], v_d
    gate: float = math.inf  # [m], where it next comes to a stop
    holding: bool = False  # the point at the gate
    begun: tuple[Begun, ...] = ()  # it is held until all of them are over
    arrived: bool = False  # at the end of the plan
    timed: int = 0  # stops at a time that have begun or passed
    placed: int = 0  # stops at a place that are over
    yaw: float | None = None  # [rad], takes the place of the plan's rule


def begin(plan: PathPlan, turn: TurnReference) -> Progress:
    """Return the progress at the beginning of a plan, the wanted heading being as it is."""
    return Progress(turn, gate=_next_gate(plan, 0))


def advance(
    plan: PathPlan, now: Progress, x: Array, t: float, dt: float, pace: float = 1.0
) -> tuple[Progress, Reference]:
    """Return the progress and what is wanted at a tick, `t` [s] after the plan was begun.

    `x` (8,) is the state: x, y, z [m], yaw [rad], their rates in the world; `dt` [s] is since the last tick.
    `pace` (0 to 1) scales the speed of the plan; stops at a time keep their times.
    """
    path = plan.path
    if now.holding:
        now = _release(plan, now, t)
    if now.holding:
        point = path.at(now.gate)
        flown = foot_speed(point.position, point.tangent, point.curvature, x)
    else:
        point, flown = foot(path, x, now.s, now.floor, now.gate)
    now = _begin_timed(plan, now, point.s, flown, t, dt)
    if not now.holding and now.gate - point.s <= CAPTURE:
        now = replace(now, holding=True, s=now.gate, speed=0.0, allowed=0.0)
        point = path.at(now.gate)
    now = _arrival(plan, now, x, point, t)
    if now.holding:
        return _held(plan, now, point, dt)
    return _cruising(plan, now, point, flown, dt, pace)


def _cruising(
    plan: PathPlan, now: Progress, point: PathPoint, flown: float, dt: float, pace: float
) -> tuple[Progress, Reference]:
    settings = plan.speed
    profile, slope = plan.profile.at(plan.path.within(point.s))
    profile, slope = pace * profile, pace * slope
    distance = now.gate - point.s
    stopping = approach_speed(distance, settings) if math.isfinite(distance) else math.inf
    # It may not run ahead of a vehicle that is held back, or it would dash off when let go.
    allowed = min(now.allowed + settings.acceleration * dt, max(flown, 0.0) + _AHEAD)
    speed = min(profile, stopping, allowed)
    if speed == allowed:
        change = settings.acceleration
    elif speed == stopping:
        change = max(-settings.acceleration, -settings.stop_gain * speed)
    else:
        change, allowed = slope * speed, profile
    target = _turned(plan, now, point, speed, dt)
    now = replace(now, s=point.s, turn=target, allowed=allowed, speed=speed)
    wanted = _moving(
        point.position, point.tangent, point.curvature, speed, flown, change,
        target.yaw, target.rate, target.acceleration,
    )  # fmt: skip
    return now, Reference(wanted[0], wanted[1], wanted[2], wanted[3])


@compiled
def _moving(
    position: Array,
    tangent: Array,
    curvature: Array,
    speed: float,
    flown: float,
    change: float,
    yaw: float,
    yaw_rate: float,
    yaw_acceleration: float,
) -> Array:
    """Return pose, velocity, motion and acceleration of a Reference, (4, 4), at a point of the path.

    `speed` and its `change` are wanted, at `flown` the point itself moves [m/s, m/s^2].
    """
    wanted = np.empty((4, 4))
    for k in range(3):
        wanted[0, k] = position[k]
        wanted[1, k], wanted[2, k] = speed * tangent[k], flown * tangent[k]
        wanted[3, k] = change * tangent[k] + speed * flown * curvature[k]
    wanted[0, 3], wanted[1, 3], wanted[2, 3], wanted[3, 3] = yaw, yaw_rate, yaw_rate, yaw_acceleration
    return wanted


def _held(plan: PathPlan, now: Progress, point: PathPoint, dt: float) -> tuple[Progress, Reference]:
    target = _turned(plan, now, point, 0.0, dt)
    now = replace(now, turn=target)
    rate = np.array([0.0, 0.0, 0.0, target.rate])
    return now, Reference(_pose(point, target), rate, rate, np.array([0.0, 0.0, 0.0, target.acceleration]))


def _pose(point: PathPoint, target: TurnReference) -> Array:
    pose = np.empty(4)
    pose[:3], pose[3] = point.position, target.yaw
    return pose


def _turned(plan: PathPlan, now: Progress, point: PathPoint, speed: float, dt: float) -> TurnReference:
    if now.yaw is not None:
        wanted: tuple[float, float] | None = (now.yaw, 0.0)
    else:
        wanted = heading_at(plan.heading, point, plan.path.within(point.s))
    yaw, per_metre = (now.turn.yaw, 0.0) if wanted is None else wanted
    # By the wanted speed, not the flown one, whose noise would be differentiated.
    return now.turn.step(yaw, per_metre * speed, dt, plan.turning)


def _next_gate(plan: PathPlan, placed: int) -> float:
    """Return where [m] the next stop at a place is, or the end, when so many of them are over."""
    return plan.placed[placed].s or 0.0 if placed < len(plan.placed) else plan.total


def _begin_timed(plan: PathPlan, now: Progress, s: float, flown: float, t: float, dt: float) -> Progress:
    """Begin the stops whose time has come: as far ahead as it takes to brake, or where it stops already."""
    while now.timed < len(plan.timed) and t >= (plan.timed[now.timed].time or 0.0):
        stop = plan.timed[now.timed]
        now = replace(now, timed=now.timed + 1)
        since = stop.time or 0.0
        if t - dt >= since + stop.seconds:  # over before the last tick
            continue
        gate = now.gate
        if not now.holding and not now.begun:
            gate = min(gate, s + braking_distance(flown, plan.speed))
        now = replace(now, begun=(*now.begun, Begun(stop, since)), gate=gate)
    return now


def _arrival(plan: PathPlan, now: Progress, x: Array, point: PathPoint, t: float) -> Progress:
    """Note the arrival at a stop or the end, and turn when it is time to."""
    if now.holding and not now.arrived and float(np.linalg.norm(x[:3] - point.position)) <= ARRIVED:
        if now.placed < len(plan.placed) and _next_gate(plan, now.placed) <= now.gate:
            # Those at the same place come one after the other.
            if all(begun.stop.s is None for begun in now.begun):
                now = replace(now, begun=(*now.begun, Begun(plan.placed[now.placed], t)))
        elif now.gate >= plan.total and not now.begun:
            now = replace(now, arrived=True)
    return _at_their_time(now, t) if now.begun else now


def _at_their_time(now: Progress, t: float) -> Progress:
    """Turn for the stops that ask for it by now, and end those that are over."""
    events: list[tuple[float, bool, float | None]] = []  # when, a turn rather than an end, the heading
    left: list[Begun] = []
    placed = now.placed
    for begun in now.begun:
        stop, into = begun.stop, t - begun.since
        if stop.yaw is not None and not begun.turned and into >= stop.turn_after:
            events.append((begun.since + stop.turn_after, True, stop.yaw))
            begun = replace(begun, turned=True)
        if into < stop.seconds:
            left.append(begun)
            continue
        placed += stop.s is not None
        if not stop.keep_yaw:
            events.append((begun.since + stop.seconds, False, None))
    yaw = max(events, key=lambda event: event[:2])[2] if events else now.yaw
    return replace(now, begun=tuple(left), placed=placed, yaw=yaw)


def _release(plan: PathPlan, now: Progress, t: float) -> Progress:
    """Go on when all stops here are over."""
    if now.begun:
        now = _at_their_time(now, t)
    gate = _next_gate(plan, now.placed)
    if now.begun or gate <= now.gate:
        return now
    return replace(now, holding=False, floor=now.gate, allowed=0.0, s=now.gate, gate=gate)
