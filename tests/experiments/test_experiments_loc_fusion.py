"""`loc-fusion`: the flight by hand, what the network makes of it, and how it is judged."""

import math
from dataclasses import dataclass, field, replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from noctule.estimation.filter_state import StateEstimate
from noctule.estimation.sensors import Sensors
from noctule.experiments import loc_fusion
from noctule.experiments.hand_flight import SPEED, ellipse, fly_by_hand, steer
from noctule.experiments.judging import KINEMATIC, Errors, judge_estimate, judge_pose, judge_report
from noctule.experiments.loc_fusion import LATE, Exposure, FusionOptions, happenings, sense
from noctule.experiments.loc_identification import TRUE, fly_inputs
from noctule.experiments.measured import MEASURED
from noctule.flight.sensor_recording import read_sensor_log
from noctule.geometry import Pose, wrap_angle
from noctule.localization.locator import Located, LocatorState
from noctule.messages import FlightState, HeadingMeasurement, PoseMeasurement, VehicleState

P = np.diag([0.004, 0.004, 0.004, 0.015]) ** 2


@pytest.fixture(scope="module")
def flight():
    return fly_by_hand(3, 1, 45.0)


def test_the_ellipse_is_the_papers_and_its_heading_goes_along_it():
    laps = np.array([ellipse(d)[0] for d in np.linspace(0.0, 10.0, 2001)])
    np.testing.assert_allclose(laps[0], [0.58, 0.1, 1.2, math.pi / 2], atol=1e-9)
    np.testing.assert_allclose(
        ((laps[:, 0] - 0.08) / 0.5) ** 2 + ((laps[:, 1] - 0.1) / 0.8) ** 2, 1.0, atol=1e-6
    )
    np.testing.assert_allclose(np.linalg.norm(np.diff(laps[:, :3], axis=0), axis=1), 0.005, rtol=1e-3)
    assert np.all(np.diff(laps[:, 3]) > 0.0)  # unwrapped, and turning left
    ahead = np.diff(laps[:, :2], axis=0)
    off = np.arctan2(ahead[:, 1], ahead[:, 0]) - laps[:-1, 3]
    assert max(abs(wrap_angle(float(a))) for a in off) < 0.02


@pytest.mark.parametrize("distance", [0.3, 1.1, 2.7, 3.9, 5.2])
def test_its_changes_are_those_by_finite_differences(distance):
    before, after = ellipse(distance - 1e-4)[0], ellipse(distance + 1e-4)[0]
    np.testing.assert_allclose(ellipse(distance)[1], (after - before) / 2e-4, atol=5e-3)


def test_the_hand_keeps_the_vehicle_near_the_point_that_it_chases(flight):
    wanted = np.array([ellipse(SPEED * stamp)[0] for stamp in flight.stamps[::100]])
    behind = np.linalg.norm(flight.truth[::100, :3] - wanted[:, :3], axis=1)
    assert behind.max() < 0.25
    assert np.degrees(np.ptp(flight.truth[:, 3])) > 720.0  # through all headings, more than once


def test_a_vehicle_that_flies_as_it_should_is_only_held_against_its_drag():
    at, per_metre = ellipse(SPEED * 5.0)
    seen = np.concatenate([at, SPEED * per_metre, [0.0, 0.0]])
    u = steer(seen, 5.0)
    forward = math.hypot(*(SPEED * per_metre[:2]))
    assert u[0] == pytest.approx(TRUE.drags[0] * forward / TRUE.input_gains[0], abs=1e-6)
    assert u[1] == pytest.approx(0.0, abs=1e-6)


def test_the_same_seed_flies_the_same_and_parts_of_a_seed_differ(flight):
    again, other = fly_by_hand(3, 1, 5.0), fly_by_hand(3, 0, 5.0)
    np.testing.assert_array_equal(again.truth, flight.truth[: len(again.truth)])
    assert [s.stamp for _, s in again.reports] != [s.stamp for _, s in other.reports]


def test_happenings_come_in_order_and_frames_as_late_as_the_camera_is(flight):
    all_of_them = list(happenings(flight))
    assert [now for now, _ in all_of_them] == sorted(now for now, _ in all_of_them)
    frames = [(now, what) for now, what in all_of_them if isinstance(what, Exposure)]
    assert all(now == pytest.approx(what.stamp + LATE) for now, what in frames)
    assert len(frames) == FusionOptions(seconds=45.0).frames
    reports = [(now, what) for now, what in all_of_them if isinstance(what, VehicleState)]
    assert all(0.042 <= now - what.stamp < 0.1 for now, what in reports)


@dataclass
class MadeUpCamera:
    """Locates the drone from the truth, turned by half a turn now and then; hands on what it was told."""

    flight: object
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(1))
    predicted: list[float] = field(default_factory=list)

    def look(self, at, fused):
        true = self.flight.pose(at.stamp)
        prediction = fused.prediction(at.stamp)
        if prediction is not None:
            self.predicted.append(float(np.linalg.norm(prediction.pose.position - true.position)))
        noise = 0.004 * self.rng.standard_normal(3)
        slip = math.pi if 40 <= at.number % 100 < 70 else 0.0
        yaw = wrap_angle(true.yaw + 0.015 * self.rng.standard_normal() + slip)
        pose = PoseMeasurement(at.stamp, true.position + noise, yaw, P, "registration")
        heading = None
        if at.number % 5 == 0:
            yaw = wrap_angle(true.yaw + 0.01 * self.rng.standard_normal())
            heading = HeadingMeasurement(at.stamp, yaw, 0.0001, "markers")
        return Located(at.stamp, LocatorState.TRACKING, pose, "", True), heading


@pytest.fixture
def made_up(monkeypatch, flight):
    """Sense the flight with a made-up camera."""
    cameras = []

    def watching(taught, flown, person):
        cameras.append(MadeUpCamera(flown))
        return cameras[-1]

    monkeypatch.setattr(loc_fusion, "_Watching", watching)
    monkeypatch.setattr(loc_fusion, "teach_camera", lambda *_, **__: SimpleNamespace())
    return SimpleNamespace(cameras=cameras, sense=partial(sense, SimpleNamespace(), flight))


def test_all_sensors_together_are_truer_than_the_camera_alone_and_know_it(made_up):
    sensors = loc_fusion.calibrated(fly_by_hand(3, 0, 45.0))
    figures = loc_fusion.figures_of(made_up.sense(TRUE, sensors, FusionOptions(seconds=45.0)))
    fused, depth, onboard = (figures[name] for name in ("fused", "depth", "onboard"))
    assert fused["yaw_sd_deg"] < depth["yaw_sd_deg"] < 1.0
    assert abs(fused["yaw_mean_deg"]) < 0.2
    assert fused["position_rms_m"] < depth["position_rms_m"]
    assert fused["nees_per_state"] < 1.5
    assert onboard["yaw_mean_deg"] > 10.0
    assert onboard["position_rms_m"] is None
    assert figures["half_turn_wrong_share"] == pytest.approx(0.3, abs=0.02)
    blind = figures["without_camera"]
    assert blind["calibrated"]["yaw_sd_deg"] < 0.3 * blind["uncalibrated"]["yaw_sd_deg"]
    assert max(made_up.cameras[0].predicted) < 0.06


def test_the_network_predicts_by_a_model_that_was_identified_and_not_by_the_truth(monkeypatch):
    flown = []

    def fly(seed, inputs, noise, gusts):
        flown.append((seed, noise, gusts))
        return fly_inputs(seed, inputs, noise, gusts=gusts)

    monkeypatch.setattr(loc_fusion, "fly_inputs", fly)
    model, other = loc_fusion.identified(3), loc_fusion.identified(4)
    assert flown == [(3, 0.06, 0.6), (4, 0.06, 0.6)]
    for found in (model, other):
        off = np.append(found.input_gains / TRUE.input_gains, found.drags / TRUE.drags) - 1.0
        assert 0.001 < np.abs(off).max() < 0.3
        assert found.delay != TRUE.delay
        assert found.delay == pytest.approx(TRUE.delay, abs=0.03)
    assert (model.drags != other.drags).all()


def test_a_seed_s_network_is_given_its_own_model(made_up, monkeypatch):
    given = []
    real = loc_fusion.Fusion

    def fusion(nodes, model, sensors):
        given.append(model)
        return real(nodes, model, sensors)

    model = replace(TRUE, drags=1.1 * TRUE.drags)
    monkeypatch.setattr(loc_fusion, "Fusion", fusion)
    monkeypatch.setattr(loc_fusion, "identified", lambda seed: {3: model}[seed])
    loc_fusion.measure_fusion(3, FusionOptions(seconds=40.0))
    assert [one is model for one in given] == [True] * 4


def test_markers_are_compared_or_fused_never_both_and_fused_they_make_the_heading_truer(made_up):
    compared, fused = (
        loc_fusion.figures_of(made_up.sense(TRUE, Sensors(), FusionOptions(seconds=45.0, markers=role)))
        for role in ("truth", "node")
    )
    assert "fused_less_markers" in compared
    assert "fused_less_markers" not in fused
    assert compared["markers"] == fused["markers"]
    assert fused["fused"]["yaw_sd_deg"] < compared["fused"]["yaw_sd_deg"]


def test_a_seed_is_measured_step_by_step_and_leaves_its_recording(made_up, tmp_path):
    experiment, options = MEASURED["loc-fusion"], FusionOptions(seconds=40.0)
    shown = []
    figures = experiment.measure(3, options, shown.append)
    assert shown == list(range(1, experiment.steps(options) + 1))
    assert set(figures) >= {"onboard", "depth", "markers", "fused", "fused_uncalibrated"}
    assert experiment.keep is not None
    log = read_sensor_log(experiment.keep(3, options, tmp_path))
    assert len(log.poses) == options.frames
    off = [
        wrap_angle(
            p.yaw
            - float(
                np.interp(p.stamp, [t.stamp for t in log.truth], np.unwrap([t.pose.yaw for t in log.truth]))
            )
        )
        for p in log.poses[10:]
    ]
    assert np.abs(off).max() < 0.3  # half turns as the fusion chose them


def test_errors_are_judged_with_the_yaw_the_short_way_round():
    true = np.array([1.0, 2.0, 3.0, 7.0, 0.1, 0.0, 0.0, 0.2, 0.0, 0.0])
    estimate = StateEstimate(1.0, np.append(true[:8], [0.0, 0.0, 0.0]), np.eye(11))
    errors = Errors()
    turned = replace(estimate, x=estimate.x + np.eye(11)[3] * (2.0 * math.pi + 0.01))
    judge_estimate(errors, true, turned)
    assert errors.yaw[0] == pytest.approx(0.01)
    assert errors.nees[0] == pytest.approx(0.01**2 / KINEMATIC)
    judge_pose(errors, true, PoseMeasurement(1.0, true[:3] + np.array([0.003, 0.0, 0.004]), 7.02, P, "x"))
    figures = errors.figures()
    assert figures["position_rms_m"] == pytest.approx(0.005 / math.sqrt(2))
    assert figures["yaw_worst_deg"] == pytest.approx(math.degrees(0.02))
    assert figures["measured"] == 2.0


def test_a_report_is_judged_in_its_own_axes():
    pose = Pose(np.array([0.0, 0.0, 1.5]), math.pi / 2)
    true = np.array([*pose.position, pose.yaw, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0])
    errors = Errors()
    right = VehicleState(1.0, FlightState.FLYING, yaw=pose.yaw, v_body=np.array([0.3, 0.0, 0.0]), height=1.5)
    judge_report(errors, true, right)
    assert errors.nees[0] == pytest.approx(0.0, abs=1e-12)
    assert errors.figures()["position_rms_m"] is None


def test_a_source_that_never_measured_has_no_figures():
    figures = Errors().figures()
    assert figures["measured"] == 0.0
    assert figures["yaw_sd_deg"] is None
    assert figures["nees_per_state"] is None
