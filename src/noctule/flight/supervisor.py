"""The supervisor between pilot and vehicle: a pure table, so that every combination can be tested.

`conditions` reads what the vehicle reports, `TABLE` says what follows from them in each state, and
`supervise` turns that into a command. Whatever it decides, a command changes by no more than the
acceleration limit allows in a tick; only an emergency cuts the motors, and that is no command.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum, StrEnum

import numpy as np

from noctule.control.limiter import limit_command
from noctule.flight.fence import Fence, bound_by_fence
from noctule.geometry import Array
from noctule.messages import Command, FlightState, Limits


class State(StrEnum):
    """What the supervisor is about."""

    FLYING = "flying"  # the pilot's commands pass, bounded
    HOVER = "hover"  # braking to, then standing in hover; ends when its cause does
    LANDING = "landing"  # ends on the ground only
    LANDED = "landed"  # ends never: a new take-off is a new flight
    EMERGENCY = "emergency"  # motors cut; ends never


class Action(StrEnum):
    """What the loop has to do besides sending the command."""

    PASS = "pass"  # the pilot's command, unchanged
    BOUND = "bound"  # the pilot's command, bounded
    HOVER = "hover"  # the supervisor's own
    LAND = "land"  # tell the vehicle to land, once it has stopped
    EMERGENCY = "emergency"  # cut the motors
    NOTHING = "nothing"  # on the ground


class Condition(Enum):
    """What can be true at a tick, the gravest first."""

    EMERGENCY = "emergency was asked for or the vehicle is in it"
    ON_GROUND = "the vehicle is on the ground"
    LAND_ASKED = "landing was asked for"
    VEHICLE_LANDING = "the vehicle is landing by itself"
    BATTERY_LOW = "the battery is low"
    BLIND_LONG = "no picture, depth frame, report or command came for too long"
    STATE_STALE = "the vehicle's report is old"
    PICTURE_STALE = "the newest picture is old"
    DEPTH_STALE = "no depth frame came for long"
    COMMAND_EXPIRED = "the pilot's last command has expired"
    HOVER_ASKED = "hover was asked for"


LAND_CONDITIONS = (
    Condition.LAND_ASKED,
    Condition.VEHICLE_LANDING,
    Condition.BATTERY_LOW,
    Condition.BLIND_LONG,
)
HOVER_CONDITIONS = (
    Condition.STATE_STALE,
    Condition.PICTURE_STALE,
    Condition.DEPTH_STALE,
    Condition.COMMAND_EXPIRED,
    Condition.HOVER_ASKED,
)


@dataclass(frozen=True, slots=True)
class Bounds:
    """When the supervisor steps in."""

    limits: Limits = field(default_factory=Limits)
    fence: Fence = field(default_factory=Fence)
    command_age: float = 0.2  # [s], older: hover
    picture_age: float = 0.5  # [s], older: hover
    depth_age: float = 12.0  # [s], older: hover; a located pilot has long done so by itself
    state_age: float = 0.5  # [s], older: hover
    located_state_age: float = 9.0  # [s], instead where the camera above knows where the vehicle is
    land_after: float = 3.0  # [s] that any of these lasts beyond its limit: land
    battery: float = 0.1  # 0 to 1, below: land


@dataclass(frozen=True, slots=True)
class Inputs:
    """All that the supervisor is told at a tick."""

    wanted: Command  # the pilot's last command
    dt: float  # [s] since the last tick
    command_age: float = 0.0  # [s] since the pilot gave it
    picture_age: float = 0.0  # [s] since the newest picture was taken, where it flies by pictures
    depth_age: float = 0.0  # [s] since the newest depth frame was taken, where it flies by those
    state_age: float = 0.0  # [s] since the vehicle's newest report
    located: bool = False  # it flies by the camera above
    flight_state: FlightState = FlightState.FLYING
    battery: float | None = None  # 0 to 1
    position: Array = field(
        default_factory=lambda: np.zeros(3)
    )  # (3,) [m], dead reckoning and reported height
    yaw: float = 0.0  # [rad], as reported
    margin: float = 0.0  # [m], what the dead reckoning may be off by
    emergency_asked: bool = False
    land_asked: bool = False
    hover_asked: bool = False


@dataclass(frozen=True, slots=True)
class Ruling:
    """What the supervisor decided."""

    state: State
    command: Command
    action: Action
    reason: str  # empty when the pilot's command passes unchanged


def conditions(inputs: Inputs, bounds: Bounds) -> frozenset[Condition]:
    """Return what is true now."""
    state_age = bounds.located_state_age if inputs.located else bounds.state_age
    ages = (
        inputs.command_age - bounds.command_age,
        inputs.picture_age - bounds.picture_age,
        inputs.state_age - state_age,
        inputs.depth_age - bounds.depth_age,
    )
    facts = {
        Condition.EMERGENCY: inputs.emergency_asked or inputs.flight_state == FlightState.EMERGENCY,
        Condition.ON_GROUND: inputs.flight_state == FlightState.LANDED,
        Condition.LAND_ASKED: inputs.land_asked,
        Condition.VEHICLE_LANDING: inputs.flight_state == FlightState.LANDING,
        Condition.BATTERY_LOW: inputs.battery is not None and inputs.battery < bounds.battery,
        Condition.BLIND_LONG: max(ages) > bounds.land_after,
        Condition.STATE_STALE: ages[2] > 0.0,
        Condition.PICTURE_STALE: ages[1] > 0.0,
        Condition.DEPTH_STALE: ages[3] > 0.0,
        Condition.COMMAND_EXPIRED: ages[0] > 0.0,
        Condition.HOVER_ASKED: inputs.hover_asked,
    }
    return frozenset(c for c, true in facts.items() if true)


def next_state(state: State, now: frozenset[Condition]) -> tuple[State, Condition | None]:
    """Return the state that follows, and the condition that decided it (None: nothing is wrong)."""
    if state == State.EMERGENCY or Condition.EMERGENCY in now:
        return State.EMERGENCY, Condition.EMERGENCY
    if state == State.LANDED or Condition.ON_GROUND in now:
        return State.LANDED, Condition.ON_GROUND
    for condition in LAND_CONDITIONS:
        if condition in now:
            return State.LANDING, condition
    if state == State.LANDING:
        return State.LANDING, None
    for condition in HOVER_CONDITIONS:
        if condition in now:
            return State.HOVER, condition
    return State.FLYING, None


ACTIONS = {
    State.FLYING: Action.PASS,
    State.HOVER: Action.HOVER,
    State.LANDING: Action.LAND,
    State.LANDED: Action.NOTHING,
    State.EMERGENCY: Action.EMERGENCY,
}


def supervise(state: State, inputs: Inputs, previous: Command, bounds: Bounds) -> Ruling:
    """Decide what is sent after `previous`; a pure function of its arguments."""
    state, decider = next_state(state, conditions(inputs, bounds))
    action = ACTIONS[state]
    reason = "" if decider is None else decider.value
    if action in (Action.NOTHING, Action.EMERGENCY):
        return Ruling(state, Command(), action, reason)
    wanted = inputs.wanted.as_array() if state == State.FLYING else np.zeros(4)
    if not np.isfinite(wanted).all():
        wanted, state, action = np.zeros(4), State.HOVER, Action.HOVER
        reason = "the pilot's command is not finite"
    fenced = bound_by_fence(wanted, inputs.position, inputs.yaw, inputs.margin, bounds.fence, bounds.limits)
    sent = limit_command(fenced, previous.as_array(), bounds.limits, inputs.dt)
    if state == State.FLYING and not np.array_equal(sent, wanted):
        action = Action.BOUND
        reason = (
            "the fence is near"
            if not np.array_equal(fenced, wanted)
            else "beyond speed or acceleration limit"
        )
    return Ruling(state, Command.from_array(sent), action, reason)
