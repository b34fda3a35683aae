"""The flight loop: it polls the devices, asks the pilot, lets the supervisor rule, sends, and records."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

import numpy as np

from noctule.devices.protocols import DeviceError
from noctule.flight.fence import DeadReckoning
from noctule.flight.flown import Aborted, Flown
from noctule.flight.interrupt import interruptible
from noctule.flight.orders import Orders
from noctule.flight.progress import Show
from noctule.flight.recording import FlightRecorder, RecordingError, sent_message
from noctule.flight.rig import Rig, take_off
from noctule.flight.senses import Senses
from noctule.flight.supervisor import Action, Bounds, Inputs, Ruling, State, supervise
from noctule.flight.worker import Matcher, MatchWorker
from noctule.geometry import Pose
from noctule.messages import (
    Command,
    Decision,
    Observation,
    Outcome,
    Pilot,
    Truth,
    VehicleState,
)

_BRAKE_LIMIT = 3.0  # [s] to come to rest after the end
_LAND_LIMIT = 15.0  # [s] to reach the ground
_RESTING = 0.05  # [m/s]


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """How the loop runs."""

    rate_hz: float = 30.0
    time_limit_s: float = 120.0
    match_delay_s: float | None = 0.15  # simulated delay of the matching worker; None: real life
    valid_for_s: float = 0.25  # a command that nothing follows expires after this
    land_at_end: bool = True
    land_when_lost: bool = False  # a pilot that is lost may not know how to stay where it is
    height: float = 1.0  # [m], of the take-off where the vehicle stands on the ground


class _Loop:
    """One flight. `step` is a tick."""

    def __init__(
        self,
        rig: Rig,
        settings: LoopSettings,
        bounds: Bounds,
        worker: MatchWorker | None,
        recorder: FlightRecorder | None,
        start: Pose,
        sent: list[Command],
        orders: Orders,
    ) -> None:
        self.sent, self.orders = sent, orders
        self.rig, self.settings, self.bounds = rig, settings, bounds
        self.worker, self.recorder = worker, recorder
        self.dt = 1.0 / settings.rate_hz
        self.origin = rig.clock.now()
        self.count = 0
        self.stamp = self.origin
        self.supervisor = State.FLYING
        self.previous = Command()
        self.reckoning = DeadReckoning(np.array(start.position, dtype=np.float64), start.yaw)
        self.senses = Senses(rig, self.origin, bounds.picture_age)
        self.landing = False

    def wait(self) -> None:
        """Sleep to the next tick; ticks that were missed are left out."""
        now = self.rig.clock.now()
        self.count += 1
        if now > self.origin + (self.count + 1) * self.dt:
            self.count = int(np.ceil((now - self.origin) / self.dt))
        self.rig.clock.sleep_until(self.origin + self.count * self.dt)
        self.stamp = self.rig.clock.now()

    def rule(self, decision: Decision | None, state: VehicleState, land: bool, elapsed: float) -> Ruling:
        """Let the supervisor decide; without a decision the flight is being ended."""
        self.reckoning = self.reckoning.advance(state, self.previous.as_array(), elapsed)
        if decision is not None and decision.whereabouts is not None:
            self.reckoning = DeadReckoning.at(decision.whereabouts)
        # Nobody looks at pictures any more once the flight is being ended.
        picture_age, depth_age, located = 0.0, 0.0, False
        if decision is not None:
            picture_age, depth_age, located = self.senses.ages(self.stamp, decision)
        inputs = Inputs(
            wanted=Command() if decision is None else decision.command,
            dt=self.dt,
            picture_age=picture_age,
            depth_age=depth_age,
            located=located,
            state_age=self.stamp - state.stamp,
            flight_state=state.flight_state,
            battery=state.battery,
            position=self.reckoning.position,
            yaw=self.reckoning.yaw,
            margin=self.reckoning.margin(self.bounds.fence),
            emergency_asked=self.orders.emergency.is_set(),
            hover_asked=decision is None or self.orders.hover.is_set(),
            land_asked=land or self.orders.land.is_set(),
        )
        ruling = supervise(self.supervisor, inputs, self.previous, self.bounds)
        self.supervisor = ruling.state
        return ruling

    def execute(self, ruling: Ruling) -> Command:
        """Do what the supervisor decided; returns what was really sent."""
        vehicle = self.rig.vehicle
        if ruling.action == Action.EMERGENCY:
            vehicle.emergency()
            sent = ruling.command
        elif ruling.action == Action.NOTHING:
            sent = ruling.command
        elif ruling.action == Action.LAND and ruling.command == Command():
            if not self.landing:
                vehicle.land()
            self.landing = True
            sent = ruling.command
        else:
            sent = vehicle.send(ruling.command, self.settings.valid_for_s)
        self.previous = sent
        self.sent.append(sent)
        return sent

    def fly_tick(self, pilot: Pilot, flown: Flown) -> None:
        """One tick with the pilot."""
        state, (picture, depth) = self.rig.vehicle.state(), self.senses.look()
        matches = () if self.worker is None else self.worker.collect(self.stamp)
        told = Observation(self.stamp, state, picture, matches, depth, self.sent[-1] if self.sent else None)
        begin = time.perf_counter()
        decision = pilot.step(told)
        ruling = self.rule(decision, state, False, self.dt if flown.samples.times else 0.0)
        tick_ms = 1e3 * (time.perf_counter() - begin)
        sent = self.execute(ruling)
        if self.worker is not None and self.senses.picture is not None:
            for request in decision.requests:
                self.worker.submit(request, self.senses.picture, self.stamp)
        flown.phase, flown.end = decision.phase, self.stamp
        flown.samples.times.append(self.stamp)
        flown.samples.tick_ms.append(tick_ms)
        flown.samples.epsilons.append(decision.diagnostics.epsilon_px)
        flown.samples.targets.append(decision.diagnostics.target_index)
        flown.samples.whereabouts.append(decision.whereabouts)
        flown.samples.phases.append(decision.phase)
        truth = self.record(told, ruling, sent, decision, tick_ms)
        self.judge(flown, decision, ruling, truth)

    def record(
        self,
        told: Observation,
        ruling: Ruling,
        sent: Command,
        decision: Decision | None = None,
        tick_ms: float = 0.0,
    ) -> Truth | None:
        """Record the tick and return the truth, where there is one."""
        truth = None if self.rig.referee is None else self.rig.referee.truth()
        if self.recorder is not None:
            asked = Command() if decision is None else decision.command
            message = sent_message(self.stamp, asked, sent, ruling.state, ruling.action, ruling.reason)
            self.recorder.tick(
                self.stamp,
                told.state,
                told.picture,
                told.matches,
                truth,
                message,
                decision,
                tick_ms,
                told.depth,
                told.sent,
            )
        return truth

    def judge(self, flown: Flown, decision: Decision, ruling: Ruling, truth: Truth | None) -> None:
        """See whether this tick was the last."""
        if truth is not None:
            flown.samples.truths.append(truth)
            if truth.contacts or truth.clearance <= 0.0:
                touched = ", ".join(truth.contacts) or "something"
                flown.finish(Outcome.COLLIDED, f"touched {touched}")
        if ruling.state in (State.LANDING, State.LANDED, State.EMERGENCY):
            flown.finish(Outcome.ABORTED, f"the supervisor ended the flight: {ruling.reason}")
        if decision.outcome is not None:
            flown.finish(decision.outcome, decision.reason)
        if self.stamp - flown.begin >= self.settings.time_limit_s - 0.5 * self.dt:
            limit = self.settings.time_limit_s
            flown.finish(Outcome.STUCK, f"the time limit of {limit:g} s has passed")

    def end(self, land: bool) -> None:
        """Brake to hover, then land if asked to."""
        begin, resting = self.stamp, False
        while self.supervisor not in (State.LANDED, State.EMERGENCY):
            self.wait()
            state = self.rig.vehicle.state()
            since = self.stamp - begin
            landing = (resting and land) or self.supervisor == State.LANDING
            ruling = self.rule(None, state, landing, self.dt)
            sent = self.execute(ruling)
            try:
                self.record(Observation(self.stamp, state), ruling, sent)
            except RecordingError:
                self.recorder = None
            speed = 0.0 if state.v_body is None else float(np.linalg.norm(state.v_body))
            resting = resting or (sent == Command() and speed < _RESTING) or since > _BRAKE_LIMIT
            if (resting and not landing and not land) or since > _BRAKE_LIMIT + _LAND_LIMIT:
                return


def fly(
    rig: Rig,
    pilot: Pilot,
    matcher: Matcher | None,
    settings: LoopSettings,
    bounds: Bounds,
    recorder: FlightRecorder | None,
    show: Show,
    start: Pose,
    orders: Orders | None = None,
) -> Flown:
    """Fly until the pilot, the judge, the supervisor or Ctrl-C ends it, then brake to hover (and land).

    The vehicle is connected and the cameras open. Without a `matcher` the pilot may ask for no matches.
    `start` is where dead reckoning begins. What went wrong is
    in the result's `error`, for the caller to raise once all is closed.
    """
    take_off(rig, settings.height, settings.rate_hz)
    flown = Flown()
    worker = None if matcher is None else MatchWorker(matcher, settings.match_delay_s)
    loop = _Loop(rig, settings, bounds, worker, recorder, start, flown.samples.sent, orders or Orders())
    with interruptible() as interrupted, _collected():
        try:
            loop.wait()
            flown.begin = flown.end = loop.stamp
            wall = time.perf_counter()
            while flown.outcome is None:
                try:
                    loop.fly_tick(pilot, flown)
                except RecordingError as error:
                    loop.recorder = None
                    flown.finish(Outcome.ABORTED, str(error), error)
                except Exception as error:
                    flown.finish(Outcome.ABORTED, f"{type(error).__name__}: {error}", error)
                flown.wall = time.perf_counter() - wall
                if interrupted.is_set():
                    flown.finish(Outcome.ABORTED, "Ctrl-C", Aborted(_aborted(loop.stamp - flown.begin)))
                if flown.outcome is None:
                    show(loop.stamp - flown.begin, flown.phase)
                    loop.wait()
            try:
                lost = settings.land_when_lost and flown.outcome == Outcome.LOST
                loop.end(settings.land_at_end or lost or flown.outcome == Outcome.ABORTED)
            except DeviceError as error:
                # The first error tells more: a lost link fails here again.
                flown.error = flown.error or error
        except BaseException:
            with suppress(DeviceError):
                rig.vehicle.land()
            raise
        finally:
            if worker is not None:
                worker.close()
    return flown


@contextmanager
def _collected() -> Iterator[None]:
    """Leave what is there already out of garbage collection: going through it takes longer than a tick."""
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def _aborted(elapsed: float) -> str:
    return (
        f"flight: ended by Ctrl-C after {elapsed:.1f} s, hovered and landed; "
        "the recording until then can be read"
    )
