"""From the located pilot to the visual one, in the air and without a jump."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from pilots_located_flight import LIMITS, fly

from noctule.control.limiter import limit_command
from noctule.control.paths import FixedHeading, SpeedSettings, line, plan
from noctule.messages import Command, Decision, Limits, MatchRequest, Outcome
from noctule.pilots.handover import HandoverPilot
from noctule.pilots.located_settings import HandoverSettings

LIMIT = Limits(**LIMITS.model_dump())
WAY = plan(line((0, 0, 1), (1.0, 0, 1)), SpeedSettings(cruise=0.4), FixedHeading(0.0))
END = np.array([1.0, 0.0, 1.0])


@dataclass
class Visual:
    """A visual pilot that recognises after a while, and then flies to the left."""

    recognises: float = 1.0  # [s] after it is first asked
    ends: float = np.inf
    outcome: Outcome = Outcome.REACHED
    asked: list = field(default_factory=list)

    def step(self, observation):
        self.asked.append(observation.stamp)
        since = observation.stamp - self.asked[0]
        phase = "flying" if since >= self.recognises else "matching"
        outcome = self.outcome if since >= self.ends else None
        reason = "its own words" if outcome else ""
        return Decision(Command(left=0.4), phase, requests=(MatchRequest(0),), outcome=outcome, reason=reason)


def flown(visual, settings=None, **more):
    settings = settings or HandoverSettings()
    more = {"seconds": 14.0, **more}
    flight = fly(WAY, pilot_of=lambda located: HandoverPilot(located, visual, LIMIT, settings), **more)
    return flight, [d.phase for d in flight.decisions]


def test_the_visual_pilot_takes_over_where_the_path_in_space_ends_and_nothing_jumps():
    visual = Visual()
    flight, phases = flown(visual)
    order = [p for k, p in enumerate(phases) if k == 0 or p != phases[k - 1]]
    assert order[-2:] == ["hand over", "flying"]
    warm, taken = phases.index("hand over"), phases.index("flying")
    assert visual.asked[0] == flight.t[warm]  # not before it is there
    assert flight.t[taken] - flight.t[warm] == pytest.approx(1.3, abs=0.05)
    off = np.linalg.norm(flight.state[warm:taken, :3] - END, axis=1)
    assert off.max() < 0.08  # the located pilot holds the point
    for before, after, dt in zip(flight.commands, flight.commands[1:], np.diff(flight.t), strict=False):
        np.testing.assert_allclose(limit_command(after, before, LIMIT, dt + 1e-9), after, atol=1e-9)
    # Blended in over a second, though the limits would allow it within three ticks.
    assert abs(flight.commands[taken : taken + 6, 1].mean()) < 0.15
    np.testing.assert_allclose(flight.commands[taken + 32 :, 1], 0.4, atol=1e-9)


def test_its_requests_pass_while_it_warms_up_and_where_the_drone_is_is_told_to_the_end():
    flight, phases = flown(Visual())
    for phase, decision in zip(phases, flight.decisions, strict=True):
        assert (decision.requests != ()) == (phase in ("hand over", "flying"))
    last = flight.decisions[-1].whereabouts
    assert np.linalg.norm(last.position - flight.state[-1, :3]) < 0.03


def test_a_visual_pilot_that_recognises_nothing_ends_the_flight_with_the_reason():
    flight, _ = flown(Visual(recognises=np.inf), HandoverSettings(warm_up_s=2.0))
    ended = next(d for d in flight.decisions if d.outcome is not None)
    assert ended.outcome is Outcome.LOST
    assert ended.reason == (
        "the visual pilot does not recognise the first key image from here, after 2.0 s; "
        "end the path in space where the visual path begins"
    )


def test_one_that_gives_up_by_itself_is_quoted():
    flight, _ = flown(Visual(recognises=np.inf, ends=1.0, outcome=Outcome.LOST))
    ended = next(d for d in flight.decisions if d.outcome is not None)
    assert ended.reason == (
        "the visual pilot does not recognise the first key image from here, after 1.0 s: its own words; "
        "end the path in space where the visual path begins"
    )


def test_after_the_handover_its_outcome_ends_the_flight():
    flight, phases = flown(Visual(ends=4.0))
    k = next(k for k, d in enumerate(flight.decisions) if d.outcome is not None)
    assert phases[k] == "flying"
    assert flight.decisions[k].outcome is Outcome.REACHED
    assert flight.decisions[k].reason == "its own words"


def test_a_drone_that_is_lost_on_the_way_never_reaches_the_visual_pilot():
    visual = Visual()
    flight, _ = flown(visual, hidden=((2.0, 99.0),))
    ended = next(d for d in flight.decisions if d.outcome is not None)
    assert ended.outcome is Outcome.LOST
    assert ended.reason.startswith("the ceiling camera has not seen the drone for 10.0 s")
    assert visual.asked == []


def test_a_drone_hidden_at_the_handover_point_is_waited_for_and_then_handed_over():
    # Longer than the visual pilot has to recognise in, shorter than the camera may miss the drone.
    flight, phases = flown(Visual(recognises=1.5), HandoverSettings(warm_up_s=2.0), hidden=((4.2, 10.5),))
    warm, taken = phases.index("hand over"), phases.index("flying")
    assert flight.t[warm] < 4.2
    assert flight.t[taken] > 10.5
    assert all(d.outcome is None for d in flight.decisions[: taken + 1])


def test_a_drone_that_stays_hidden_there_is_landed_with_the_cameras_reason():
    flight, _ = flown(
        Visual(recognises=np.inf), HandoverSettings(warm_up_s=2.0), hidden=((4.2, 99.0),), seconds=18.0
    )
    ended = next(d for d in flight.decisions if d.outcome is not None)
    assert ended.outcome is Outcome.LOST
    assert ended.reason.startswith("the ceiling camera has not seen the drone for 10.0 s")
