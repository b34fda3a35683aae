import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from noctule.control.activation import Activation, ActivationError, FadingTask
from noctule.control.hierarchy import TaskRows
from noctule.control.transition import Transition

STEPS = st.lists(st.tuples(st.booleans(), st.floats(0.0, 0.2)), min_size=1, max_size=60)
J, DEMAND = np.array([[1.0, 0.0, 0.0, 0.2]]), np.array([-0.3])


def test_an_activation_is_exactly_off_and_exactly_on_at_its_ends():
    assert Activation(3.0).h == 0.0
    assert Activation(3.0).step(True, 5.0).h == 1.0
    assert Activation(3.0, 1.0).step(False, 5.0).h == 0.0


def test_an_activation_follows_the_printed_cosine():
    state = Activation(2.0)
    for _ in range(6):
        state = state.step(True, 0.1)
    assert state.h == pytest.approx(0.5 * (1 - np.cos(np.pi * 0.6 / 2.0)))


@given(STEPS, st.floats(0.2, 3.0))
def test_an_activation_is_continuous_under_random_switching(steps, duration):
    state = Activation(duration)
    for on, dt in steps:
        new = state.step(on, dt)
        assert abs(new.h - state.h) <= 0.5 * np.pi * dt / duration + 1e-12
        assert 0.0 <= new.h <= 1.0
        assert new.phase >= state.phase if on else new.phase <= state.phase
        state = new


def test_a_deactivation_that_interrupts_an_activation_goes_back_the_way_it_came():
    state = Activation(1.0).step(True, 0.3)
    assert state.step(True, 0.2).step(False, 0.2).h == pytest.approx(state.h)


def test_stepping_leaves_the_old_state_alone():
    state = Activation(1.0, 0.5)
    state.step(True, 0.2)
    assert state.phase == 0.5


def test_a_task_keeps_its_last_rows_while_it_fades():
    task = FadingTask(Activation(0.2)).step((J, DEMAND), 0.2)
    fading = task.step(None, 0.1)
    ((held, demand, h),) = fading.rows
    np.testing.assert_array_equal(held, J)
    np.testing.assert_array_equal(demand, DEMAND)
    assert h == pytest.approx(0.5)


def test_a_task_forgets_its_rows_when_it_is_off():
    task = FadingTask(Activation(0.2)).step((J, DEMAND), 0.1).step(None, 1.0)
    assert task.rows == ()
    assert task.J is None


def test_the_activation_of_the_rows_that_come_in_does_not_count():
    ((_, _, h),) = FadingTask(Activation(1.0)).step(TaskRows(J, DEMAND, 1.0), 0.5).rows
    assert h == pytest.approx(0.5)


def test_a_task_that_was_never_seen_has_no_rows():
    assert FadingTask(Activation(0.2, 0.7)).step(None, 0.01).rows == ()


def test_a_task_that_is_seen_again_takes_the_new_rows_and_goes_on_from_where_it_was():
    task = FadingTask(Activation(1.0)).step((J, DEMAND), 0.6).step(None, 0.1).step((2 * J, DEMAND), 0.1)
    ((rows, _, h),) = task.rows
    np.testing.assert_array_equal(rows, 2 * J)
    assert h == pytest.approx(Activation(1.0, 0.6).h)


LAST, NEW = np.array([0.3, 0.0, -0.1, 0.2]), np.array([-0.2, 0.5, 0.1, -0.4])


def test_a_transition_starts_at_the_last_command_and_ends_at_the_new_one():
    start = Transition(LAST, 1.0)
    np.testing.assert_array_equal(start.blend(NEW), LAST)
    end = start.step(1.0)
    assert end.done
    np.testing.assert_array_equal(end.blend(NEW), NEW)


def test_a_transition_follows_eq_29():
    blend = Transition(LAST, 2.0, h_0=0.1).step(0.5)
    h = 0.1 + 0.5 * 0.9 * (1 - np.cos(np.pi * 0.25))
    assert blend.h == pytest.approx(h)
    np.testing.assert_allclose(blend.blend(NEW), h * NEW + (1 - h) * LAST)


@given(st.lists(st.tuples(st.booleans(), st.floats(0.0, 0.1)), min_size=1, max_size=50))
def test_the_command_is_continuous_over_switches_at_any_time(ticks):
    duration, targets = 0.5, [NEW, LAST]
    blend, nu = Transition(LAST, duration), LAST
    for switch, dt in ticks:
        if switch:
            targets.reverse()
            blend = Transition(nu, duration)
        blend = blend.step(dt)
        new = blend.blend(targets[0])
        # The law is constant between switches, so only h moves the command.
        assert np.linalg.norm(new - nu) <= 0.5 * np.pi * dt / duration * np.linalg.norm(NEW - LAST) + 1e-12
        nu = new


def test_a_floor_on_the_weight_makes_a_step_of_just_that_size():
    np.testing.assert_allclose(Transition(LAST, 1.0, h_0=0.2).blend(NEW) - LAST, 0.2 * (NEW - LAST))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Activation(0.0),
            "duration is 0 s, expected more than 0; use a small one for a quick switch",
        ),
        (lambda: Activation(1.0, 1.5), "phase is 1.5, expected 0 to 1; start at 0 (off) or 1 (on)"),
        (
            lambda: Activation(1.0).step(True, -0.1),
            "time step is -0.1 s, expected 0 or more; are the stamps in order?",
        ),
        (
            lambda: Transition(LAST, float("inf")),
            "duration is inf s, expected more than 0; use a small one for a quick switch",
        ),
        (lambda: Transition(LAST, 1.0, h_0=2.0), "h_0 is 2, expected 0 to 1; 0 makes the switch continuous"),
        (
            lambda: Transition(LAST, 1.0).step(float("nan")),
            "time step is nan s, expected 0 or more; are the stamps in order?",
        ),
    ],
)
def test_bad_times_say_what_is_wrong(make, message):
    with pytest.raises(ActivationError) as caught:
        make()
    assert str(caught.value) == message
