from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from noctule.estimation.column import ColumnEstimate
from noctule.geometry import wrap_angle
from noctule.pilots.detour import Detour, TrackedColumn, merge_blocked
from noctule.pilots.settings import DetourSettings

SETTINGS = DetourSettings()
DT, BODY, AHEAD, LAG = 1.0 / 30.0, 0.2, 0.09, 0.3
KEPT = BODY + SETTINGS.margin  # [m], from the column's surface to the body's centre
FORWARD = np.array([0.45, 0.0])
STILL = np.zeros(2)


def detour(*columns, **settings):
    """A detour that knows columns: (x, y, radius) in the body's frame, or with what else they are."""
    made = Detour(DetourSettings(**settings), BODY, AHEAD, LAG)
    made.columns = tuple(known(*column) for column in columns)
    return made


def known(x, y, radius, hits=10, side=0, sd=0.02, unseen=0.0):
    d, b = np.hypot(x - AHEAD, y), np.arctan2(y, x - AHEAD)
    P = np.diag([0.004**2, sd**2, sd**2])
    return TrackedColumn(ColumnEstimate(np.array([b, np.log(d), np.log(radius)]), P, unseen), hits, side)


def edges(x, y, radius):
    """Bearings of the edges of a column at (x, y) from the body, as the camera sees them."""
    d, b = np.hypot(x - AHEAD, y), np.arctan2(y, x - AHEAD)
    half = np.arcsin(radius / d)
    return b + half, b - half


def settle(d, wanted=FORWARD, v=STILL, goal=None, ticks=30):
    """Ask until the activation has settled; nothing moves meanwhile."""
    for _ in range(ticks):
        demand, h = d.steer(wanted, v, goal, DT)
    return demand, h


disc = st.tuples(st.tuples(st.floats(-3, 3), st.floats(-3, 3)).map(np.array), st.floats(0.05, 1.0))


@given(st.lists(disc, max_size=8))
def test_blocked_headings_are_sorted_disjoint_and_cover_every_disc(found):
    assume(all(np.linalg.norm(c) > 1e-3 for c, _ in found))
    discs = [(centre, radius, i) for i, (centre, radius) in enumerate(found)]
    merged = merge_blocked(discs)
    assert all(b.low < b.high for b in merged)
    for b, after in pairwise(merged):
        assert b.high < after.low
    assert {i for b in merged for i in b.members} == set(range(len(discs)))
    for heading in np.linspace(-np.pi, np.pi, 200):
        if hidden_by(heading, discs, -1e-9):
            assert any(b.low <= heading <= b.high for b in merged)


@given(st.lists(disc, min_size=2, max_size=6))
def test_no_heading_is_blocked_that_no_disc_hides(found):
    assume(all(np.linalg.norm(c) > 1e-3 for c, _ in found))
    discs = [(centre, radius, i) for i, (centre, radius) in enumerate(found)]
    for b in merge_blocked(discs):
        for heading in np.linspace(max(b.low, -np.pi), min(b.high, np.pi), 50):
            assert hidden_by(heading, discs, 1e-9)


def hidden_by(heading, discs, slack):
    """Return whether a disc hides a heading, by the angle between the two; `slack` widens every disc."""
    for centre, radius, _ in discs:
        d, bearing = np.linalg.norm(centre), np.arctan2(centre[1], centre[0])
        half = np.arcsin(radius / d) if d > radius else np.pi / 2.0
        if abs(wrap_angle(heading - bearing)) < half + slack:
            return True
    return False


def test_a_column_behind_hides_headings_on_both_sides_of_straight_back():
    discs = [(np.array([-0.45, 0.05]), 0.3, 0)]
    merged = merge_blocked(discs)
    for heading in (3.0, -3.0, np.pi, -np.pi + 1e-9):
        assert any(b.low < heading < b.high for b in merged)


def test_nothing_known_changes_nothing():
    demand, h = settle(detour())
    assert demand == pytest.approx(FORWARD)
    assert h == 0.0


def test_a_column_in_the_way_is_passed_along_the_edge_of_what_it_hides():
    # Its axis is at (0.8, 0.1), so the nearer side is the right one.
    demand, h = settle(detour((0.8, 0.1, 0.03)), v=STILL)
    hidden = np.arcsin((0.03 + KEPT) / np.hypot(0.8, 0.1))
    assert np.arctan2(demand[1], demand[0]) == pytest.approx(np.arctan2(0.1, 0.8) - hidden, abs=1e-6)
    assert h == 1.0


def test_a_column_beside_the_way_is_left_alone():
    assert settle(detour((0.8, 0.6, 0.03)))[1] == 0.0


def test_a_column_out_of_reach_is_left_alone():
    far = (SETTINGS.reach + 0.1 + KEPT + 0.1, 0.0, 0.03)
    assert settle(detour(far))[1] == 0.0
    assert settle(detour((1.0, 0.0, 0.03)))[1] == 1.0


def test_a_distance_not_known_yet_is_taken_at_its_near_end():
    at = SETTINGS.reach + 0.1 + KEPT
    assert settle(detour((at, 0.0, 0.03, 10, 0, 0.02)))[1] == 0.0
    assert settle(detour((at, 0.0, 0.03, 10, 0, 0.5)))[1] == 1.0


@pytest.mark.parametrize("side", [1, -1])
def test_the_side_is_kept_when_the_column_comes_to_the_other_side(side):
    d = detour((0.8, -0.02 * side, 0.03))
    first, _ = settle(d, ticks=1)
    assert np.sign(first[1]) == side
    assert d.columns[0].side == side
    d.columns = (known(0.8, 0.05 * side, 0.03, side=d.columns[0].side),)  # now the other side is nearer
    demand, _ = settle(d, ticks=1)
    assert np.sign(demand[1]) == side
    fresh, _ = settle(detour((0.8, 0.05 * side, 0.03)), ticks=1)
    assert np.sign(fresh[1]) == -side


def test_columns_too_close_to_pass_between_are_passed_together():
    gate = detour((0.9, 0.3, 0.03), (0.9, -0.25, 0.03))
    demand, _ = settle(gate)
    # The right end of both: beyond the right column's own.
    hidden = np.arcsin((0.03 + KEPT) / np.hypot(0.9, 0.25))
    assert np.arctan2(demand[1], demand[0]) == pytest.approx(-np.arctan2(0.25, 0.9) - hidden, abs=1e-6)
    assert {column.side for column in gate.columns} == {-1}


def test_a_gate_that_is_wide_enough_is_flown_through():
    demand, h = settle(detour((0.9, 0.6, 0.03), (0.9, -0.6, 0.03)))
    assert demand == pytest.approx(FORWARD)
    assert h == 0.0


def test_a_single_false_box_never_moves_the_vehicle():
    d = detour()
    d.see([edges(0.7, 0.0, 0.04)])
    for _ in range(60):
        d.move(STILL, 0.0, DT)
        d.see([])
        demand, h = d.steer(FORWARD, STILL, None, DT)
        assert h == 0.0
        assert demand == pytest.approx(FORWARD)
    assert d.columns == ()  # and is soon forgotten


def test_three_boxes_are_a_column():
    d = detour()
    for n in range(3):
        assert settle(d, ticks=1)[1] == 0.0
        d.see([edges(0.7, 0.0, 0.04)])
        assert d.columns[0].hits == n + 1
    assert len(d.columns) == 1
    assert settle(d)[1] == 1.0


def test_two_boxes_are_two_columns_and_stay_told_apart():
    d = detour()
    for _ in range(5):
        d.move(0.45 * DT * np.array([1.0, 0.0]), 0.0, DT)
        d.see([edges(1.0, 0.4, 0.03), edges(1.0, -0.4, 0.03)])
    assert [column.hits for column in d.columns] == [5, 5]
    assert d.columns[0].estimate.x[0] > 0.0 > d.columns[1].estimate.x[0]


def test_an_edge_out_of_the_picture_begins_no_column_but_keeps_a_known_one():
    left, right = edges(0.6, 0.2, 0.05)
    d = detour()
    d.see([(None, right), (left, None)])
    assert d.columns == ()
    d = detour((0.6, 0.2, 0.05))
    d.move(STILL, 0.0, DT)
    d.see([(None, right)])
    assert d.columns[0].hits == 11
    assert d.columns[0].estimate.unseen == 0.0
    d.see([(None, None)])
    assert len(d.columns) == 1
    assert d.columns[0].hits == 11


def test_a_column_is_forgotten_once_it_is_passed():
    d, step, x = detour((0.3, 0.5, 0.03)), 0.45 * DT, 0.3
    while d.columns and x > -1.0:
        d.move(np.array([step, 0.0]), 0.0, DT)
        x -= step
    assert x == pytest.approx(-(BODY + SETTINGS.margin), abs=2.0 * step)


def test_a_column_out_of_sight_is_forgotten_after_a_while():
    d = detour((0.8, 0.0, 0.03), forget_s=2.0)
    for _ in range(59):
        d.move(STILL, 0.0, DT)
    assert len(d.columns) == 1
    for _ in range(3):
        d.move(STILL, 0.0, DT)
    assert d.columns == ()


@pytest.mark.parametrize("absurd", [(14.0, 0.0, 0.05), (2.0, 0.0, 0.8)], ids=["too far", "too wide"])
def test_what_never_looms_is_dropped(absurd):
    d = detour(absurd, (2.0, 0.0, 0.03))
    d.move(STILL, 0.0, DT)
    assert len(d.columns) == 1
    assert d.columns[0].estimate.radius == pytest.approx(0.03)


def test_a_turn_of_the_body_moves_the_camera_and_turns_the_columns():
    d = detour((0.8, 0.0, 0.03))
    for _ in range(30):
        d.move(STILL, np.radians(3.0), DT)
    c, s = np.cos(np.pi / 2.0), np.sin(np.pi / 2.0)
    expected = np.array([[c, s], [-s, c]]) @ [0.8, 0.0]
    assert d._centre(d.columns[0].estimate) == pytest.approx(expected, abs=1e-6)


def test_inside_the_disc_the_vehicle_is_pushed_straight_outward():
    d = detour((0.2, 0.15, 0.03))
    demand, h = settle(d, wanted=STILL)
    assert h == 1.0
    assert demand / np.linalg.norm(demand) == pytest.approx(-np.array([0.2, 0.15]) / 0.25)
    assert np.linalg.norm(demand) == pytest.approx(1.5 * (0.03 + KEPT - 0.25))


def test_the_push_grows_with_the_intrusion():
    pushes = [np.linalg.norm(settle(detour((x, 0.0, 0.03)), STILL)[0]) for x in (0.41, 0.39, 0.3, 0.15)]
    assert pushes[0] == 0.0
    assert pushes == sorted(pushes)
    assert pushes[1] > 0.0


@given(
    st.floats(-0.5, 2.0), st.floats(-1.0, 1.0), st.floats(0.01, 0.2), st.floats(-np.pi, np.pi),
    st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)).map(np.array),
)  # fmt: skip
def test_the_demand_is_never_faster_than_wanted_plus_the_push(x, y, radius, heading, v):
    assume(np.hypot(x - AHEAD, y) > radius + 1e-3)
    wanted = 0.45 * np.array([np.cos(heading), np.sin(heading)])
    demand, _ = settle(detour((x, y, radius)), wanted, v, ticks=1)
    inside = max(radius + KEPT - np.linalg.norm(np.array([x, y]) - LAG * v), 0.0)
    assert np.linalg.norm(demand) <= 0.45 + 1.5 * inside + 1e-9


@given(st.floats(0.5, 1.5), st.floats(-0.6, 0.6), st.floats(-1.2, 1.2), st.sampled_from([1, -1]))
def test_the_demand_never_points_into_what_is_hidden(x, y, heading, side):
    centre, radius = np.array([x, y]), 0.03 + KEPT
    assume(np.linalg.norm(centre) > radius + 0.01)
    wanted = 0.45 * np.array([np.cos(heading), np.sin(heading)])
    demand, _ = settle(detour((x, y, 0.03, 10, side)), wanted, ticks=1)
    # The nearest that a straight flight along the demand comes to the axis.
    along = demand / np.linalg.norm(demand)
    ahead = max(float(along @ centre), 0.0)
    assert np.linalg.norm(centre - ahead * along) >= radius - 1e-6


def test_a_column_just_left_behind_is_not_turned_into():
    # It is at the right, out of view, not passed yet; the path wants to cut back to the right.
    d = detour((0.05, -0.42, 0.03, 10, 1, 0.02, 0.5))
    wanted = 0.45 * np.array([np.cos(-1.0), np.sin(-1.0)])
    demand, _ = settle(d, wanted)
    assert np.arctan2(demand[1], demand[0]) > -0.5
    assert demand[0] > 0.0


def test_out_of_sight_a_column_is_given_more_room_but_not_without_bound():
    def end(unseen, sd):
        demand, _ = settle(detour((0.8, 0.1, 0.03, 10, 0, sd, unseen)))
        return -np.arctan2(demand[1], demand[0])

    assert end(0.5, 0.05) > end(0.0, 0.05)
    most = np.arcsin((0.03 + KEPT + 0.05) / np.hypot(0.8, 0.1)) - np.arctan2(0.1, 0.8)
    assert end(0.5, 0.6) == pytest.approx(most, abs=1e-6)


def test_a_column_behind_the_goal_is_ignored():
    column = (1.2, 0.0, 0.03)
    assert settle(detour(column), goal=np.array([0.7, 0.0]))[1] == 0.0
    assert settle(detour(column), goal=np.array([1.9, 0.0]))[1] == 1.0


def test_a_goal_inside_the_margin_can_be_reached_but_the_column_is_never_touched():
    goal = np.array([0.3, 0.0])
    beside = detour((0.3, 0.3, 0.03))  # 0.27 m from the goal: inside the margin of 0.40 m, outside the hull
    demand, h = settle(beside, wanted=goal, goal=goal)
    assert h == 0.0
    assert demand == pytest.approx(goal)
    on_it = detour((0.35, 0.0, 0.03))  # the goal is inside the column's reach: the hull would touch
    demand, h = settle(on_it, wanted=goal, goal=goal)
    assert h == 1.0
    assert abs(np.arctan2(demand[1], demand[0])) > 0.5


def test_a_sharp_turn_is_flown_slowly():
    column = (0.55, 0.0, 0.03)
    still = settle(detour(column), v=STILL)[0]
    fast = settle(detour(column), v=np.array([0.15, 0.0]))[0]
    assert np.linalg.norm(fast) < np.linalg.norm(still)
    assert np.linalg.norm(fast) >= 0.35 * 0.45 - 1e-9


def test_the_task_fades_in_and_out_with_its_own_clock():
    d = detour((0.8, 0.0, 0.03))
    rising = [d.steer(FORWARD, STILL, None, DT)[1] for _ in range(15)]
    d.columns = ()
    falling = [d.steer(FORWARD, STILL, None, DT)[1] for _ in range(15)]
    h = np.array([0.0, *rising, *falling])
    assert max(rising) == 1.0
    assert falling[-1] == 0.0
    assert np.abs(np.diff(h)).max() <= np.pi / 2.0 * DT / SETTINGS.fade_s
