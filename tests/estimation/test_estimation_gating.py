"""What the gates let in, what they refuse, and how a filter that went astray finds back."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.estimation.chi_square import chi_square_quantile
from noctule.estimation.delayed import DelayedFilter, FilterSettings
from noctule.estimation.filter_state import Prior, start_at
from noctule.estimation.gating import GateSettings, Group, Streak, judge, surprises
from noctule.estimation.measurements import Measurement, linearise

GATE = GateSettings()
POSE = np.array([0, 1, 2, 3])
R = np.diag([0.01, 0.01, 0.01, 0.03]) ** 2
POSITION, YAW = Streak(0.0, 0, frozenset({0, 1, 2})), Streak(0.0, 1, frozenset({3}))
SURE = start_at(0.0, np.zeros(3), 0.0, Prior(0.02, 0.03, 0.1, 0.1, 0.05, 0.02))


def pose(z, stamp=0.0, sequence=0):
    return Measurement(stamp, POSE, np.array(z, dtype=float), R, "depth", sequence)


@settings(deadline=None)
@given(st.integers(0, 10_000))
def test_a_surprise_is_the_innovation_in_the_metric_of_its_covariance(seed):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(11, 11))
    x, P = rng.normal(size=11), A @ A.T
    parts, z = np.array([4, 7, 0, 3, 5, 2]), rng.normal(size=6)
    noise = np.diag(rng.uniform(0.1, 1.0, 6))
    d2, counts = surprises(x, P, parts, z, noise)
    residual, H = linearise(x, parts, z)
    S = H @ P @ H.T + noise
    for group, rows in enumerate([[2, 5], [1, 3], [0, 4]]):
        expected = residual[rows] @ np.linalg.solve(S[np.ix_(rows, rows)], residual[rows])
        assert d2[group] == pytest.approx(expected, rel=1e-6)
        assert counts[group] == 2


def test_a_good_measurement_passes_whole():
    verdict = judge(SURE.x, SURE.P, pose([0.01, 0.0, -0.02, 0.03]), {}, GATE)
    assert verdict.kept is not None
    assert verdict.kept.components.tolist() == [0, 1, 2, 3]
    assert verdict.jump is None
    assert verdict.refused == ()
    assert not verdict.since


def test_a_wild_yaw_costs_the_yaw_alone():
    verdict = judge(SURE.x, SURE.P, pose([0.01, 0.0, 0.0, 3.0]), {}, GATE)
    assert verdict.kept is not None
    assert verdict.kept.components.tolist() == [0, 1, 2]
    assert verdict.refused == ("yaw gate",)


def test_a_wild_position_costs_the_position_alone():
    verdict = judge(SURE.x, SURE.P, pose([1.0, 0.0, 0.0, 0.02]), {}, GATE)
    assert verdict.kept is not None
    assert verdict.kept.components.tolist() == [3]
    assert verdict.refused == ("position gate",)


def test_nothing_is_left_of_a_measurement_wild_in_all():
    verdict = judge(SURE.x, SURE.P, pose([1.0, 0.0, 0.0, 3.0]), {}, GATE)
    assert verdict.kept is None
    assert verdict.refused == ("position gate", "yaw gate")
    assert verdict.since == {"depth/position": POSITION, "depth/yaw": YAW}


def test_a_yaw_on_the_other_side_of_the_half_turn_is_near():
    start = start_at(0.0, np.zeros(3), np.pi - 0.01, Prior(0.02, 0.03))
    assert judge(start.x, start.P, pose([0, 0, 0, -np.pi + 0.01]), {}, GATE).refused == ()


def test_the_share_of_good_measurements_that_is_refused_is_the_one_asked_for():
    rng = np.random.default_rng(0)
    S = SURE.P[:4, :4] + R
    drawn = rng.standard_normal((4000, 4)) * np.sqrt(np.diag(S))
    gate = GateSettings(confidence=0.95)
    refused = [judge(SURE.x, SURE.P, pose(z), {}, gate).refused for z in drawn]
    share = np.mean(["position gate" in r for r in refused]), np.mean(["yaw gate" in r for r in refused])
    # 0.05 with a deviation of 0.0034
    assert share == pytest.approx((0.05, 0.05), abs=0.012)


def test_body_velocities_wait_until_the_yaw_is_known():
    lost = start_at(0.0, np.zeros(3), 0.0, Prior(yaw=0.7))
    z = Measurement(0.0, np.array([4, 5, 6, 2]), np.zeros(4), np.eye(4) * 0.01, "onboard")
    verdict = judge(lost.x, lost.P, z, {}, GATE)
    assert verdict.refused == ("yaw unknown",)
    assert verdict.kept is not None
    assert verdict.kept.components.tolist() == [2]
    assert judge(SURE.x, SURE.P, z, {}, GATE).refused == ()


def test_the_limit_doubles_with_every_time_of_refusals():
    limit = chi_square_quantile(GATE.confidence, 3)
    off = np.sqrt(limit * 7.0 * (0.02**2 + 0.01**2))  # 7 times the limit: between 4 and 8
    since = {"depth/position": POSITION._replace(begun=1.0)}
    early = judge(SURE.x, SURE.P, pose([off, 0, 0, 0], 1.0 + 2 * GATE.widening_time), since, GATE)
    assert early.refused == ("position gate",)
    assert early.since == since
    late = judge(SURE.x, SURE.P, pose([off, 0, 0, 0], 1.0 + 3 * GATE.widening_time), since, GATE)
    assert late.refused == ()
    assert late.jump is not None
    d2, _ = surprises(SURE.x, SURE.P + np.outer(late.jump, late.jump), POSE, np.array([off, 0, 0, 0]), R)
    assert d2[0] == pytest.approx(limit)
    assert not late.since
    assert since == {"depth/position": POSITION._replace(begun=1.0)}


def test_another_source_s_refusals_widen_nothing():
    since = {"markers/yaw": YAW}
    verdict = judge(SURE.x, SURE.P, pose([0, 0, 0, 1.0], 10.0), since, GATE)
    assert verdict.refused == ("yaw gate",)
    assert verdict.since == {"markers/yaw": YAW, "depth/yaw": YAW._replace(begun=10.0)}


def test_a_wild_reading_after_a_silence_is_refused_all_the_same():
    filter_ = DelayedFilter(SURE, None, FilterSettings(window=10.0))
    filter_.insert(pose([0, 0, 0, 0], 0.1))
    filter_.insert(pose([9.0, 0, 0, 0], 1.1, 1))
    assert abs(filter_.estimate().x[0]) < 0.1
    assert filter_.refusals == {"depth: position gate": 1}


def test_who_measures_no_more_than_what_is_believed_is_not_let_in_by_waiting():
    height = Streak(0.0, 0, frozenset({2}))
    since = {"onboard/position": height, "markers/yaw": YAW, "onboard/yaw": Streak(0.0, 1, frozenset({7}))}
    after = judge(SURE.x, SURE.P, pose([0, 0, 0, 0], 1.0), since, GATE).since
    # The camera's pose answers for height and yaw; the bias of the onboard heading is another matter.
    assert set(after) == {"onboard/yaw"}
    onboard = Measurement(1.0, np.array([2]), np.zeros(1), np.eye(1) * 1e-4, "onboard")
    lost = {"depth/position": POSITION}
    assert judge(SURE.x, SURE.P, onboard, lost, GATE).since == lost


def test_a_height_above_a_table_never_gets_in_while_the_room_s_camera_sees_the_height():
    filter_ = DelayedFilter(SURE, None, FilterSettings())
    for k in range(300):
        filter_.insert(pose([0, 0, 0, 0], (k + 1) / 30, k))
        table = Measurement(k / 30 + 0.01, np.array([2]), np.array([-0.7]), np.eye(1) * 1e-3, "onboard", k)
        filter_.insert(table)
    assert abs(filter_.estimate().x[2]) < 0.01
    assert filter_.refusals == {"onboard: position gate": 300}


@pytest.mark.parametrize("n", [8, 11])
@pytest.mark.parametrize("component", range(8))
def test_a_jump_takes_up_what_was_surprising_and_is_no_longer_than_that(component, n):
    state = start_at(0.0, np.zeros(3), 0.7, Prior(0.02, 0.03, 0.1, 0.1, 0.05, 0.02), n)
    parts, noise = np.array([component]), np.array([[0.01]])
    far = Measurement(100.0, parts, -linearise(state.x, parts, np.zeros(1))[0] + 2.0, noise, "any")
    since = {f"any/{g}": Streak(0.0, k, frozenset({component})) for k, g in enumerate(Group)}
    verdict = judge(state.x, state.P, far, since, GATE)
    assert verdict.jump is not None
    residual, H = linearise(state.x, parts, far.z)
    assert H @ verdict.jump / residual == pytest.approx(np.linalg.norm(verdict.jump) / 2.0)
    d2, _ = surprises(state.x, state.P + np.outer(verdict.jump, verdict.jump), parts, far.z, noise)
    assert max(d2) == pytest.approx(chi_square_quantile(GATE.confidence, 1))


@pytest.mark.parametrize(("offset", "turn"), [(0.5, 0.0), (3.0, 0.0), (0.0, np.pi / 2), (1.0, 3.0)])
def test_a_filter_that_went_astray_is_back_within_five_seconds(offset, turn):
    filter_ = DelayedFilter(SURE, None, FilterSettings())
    for k in range(150):
        filter_.insert(pose([offset, -offset, 0.0, turn], (k + 1) / 30, k))
    end = filter_.estimate()
    assert np.allclose(end.position, [offset, -offset, 0.0], atol=0.02)
    assert abs(end.yaw - turn) < 0.05
    assert np.linalg.eigvalsh(end.P)[0] > 0.0
    assert sum(filter_.refusals.values()) > 5


@pytest.mark.parametrize("seed", range(5))
def test_a_push_is_followed_and_no_reason_to_refuse(seed):
    rng = np.random.default_rng(seed)
    filter_ = DelayedFilter(SURE, None, FilterSettings(noise_without_commands=FilterSettings().noise))
    position, velocity, worst = 0.0, 0.0, 0.0
    for k in range(90):
        velocity += (4.5 if 30 <= k < 36 else 0.0) / 30  # m/s^2 for 0.2 s, in the middle of a hover
        position += velocity / 30
        z = np.array([position, 0.0, 0.0, 0.0]) + rng.standard_normal(4) * np.sqrt(np.diag(R))
        filter_.insert(pose(z, (k + 1) / 30, k))
        if k > 15:
            worst = max(worst, abs(filter_.estimate().x[0] - position))
    assert worst < 0.06
    assert sum(filter_.refusals.values()) <= 2


def test_without_gates_everything_is_let_in():
    filter_ = DelayedFilter(SURE, None, FilterSettings(gate=None))
    filter_.insert(pose([9.0, 0, 0, 0], 0.1))
    assert filter_.estimate().x[0] > 5.0
    assert not filter_.refusals
