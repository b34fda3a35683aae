"""A located flight in a small empty room: recorded with its depth, replayed bit for bit, reported."""

from __future__ import annotations

import io
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from noctule.flight.depth_recording import read_depth_recording
from noctule.flight.mission import Mission, parse_mission
from noctule.flight.mission_flight import fly_mission
from noctule.flight.reader import Recording, RecordingFileError, read_recording
from noctule.flight.replay import NoDepthError, recorded_mission, recorded_pilot, recorded_site, replay
from noctule.localization.detection.band import SurfaceBand
from noctule.localization.detection.cubics import AreaCubics
from noctule.localization.detection.hu import HuPatterns
from noctule.localization.detector_file import Detectors
from noctule.localization.site import Site, SiteCamera, save_site
from noctule.localization.template import build_template
from noctule.messages import Command
from noctule.reports import load_flight_log
from noctule.simulation.ceiling import DepthStage, manual_flight
from noctule.vision.depth import learn_background

MISSION = """
name = "hop"
[room]
corner = [-3.0, -3.0]
size = [6.0, 6.0, 3.6]
furniture = 0
pictures = 0
lamps = 0
[vehicle]
model = "identified"
command_latency = 0.02
navdata = {}
pushes = [{ time_s = 1.5, acceleration_m_s2 = [1.0, 0.0, 0.0] }]
[start]
z = 1.2
[space_path]
stops = [{ s = 0.05, seconds = 0.5 }]
heading = { rule = "fixed" }
[[space_path.segments]]
kind = "line"
points = [[0.0, 0.0, 1.2], [0.2, 0.0, 1.2]]
[[people]]
x = 1.6
y = 0.0
half_axes = [0.4, 0.4]
[flight]
time_limit_s = 3.0
[recording]
depth = true
"""
DETECTORS = Detectors(
    AreaCubics(np.array([9000.0, 0, 0, 0]), np.array([100.0, 0, 0, 0]), 0.2, 2.2),
    SurfaceBand(0.02, 0.3, 0.2, 2.2),
    HuPatterns(np.ones((1, 7)), 1.0),
)


@pytest.fixture(scope="module")
def flown(tmp_path_factory) -> Recording:
    """A flight below a camera whose site is made of true poses, which is quick."""
    folder = tmp_path_factory.mktemp("located")
    mission = parse_mission(MISSION, "hop")
    spec = mission.ceiling.spec
    stage = DepthStage(spec, 0, mission.room)
    background = learn_background(stage.frame(k / 30.0, None).depth for k in range(20))
    seen = [(stage.frame(10.0 + stamp, pose), pose) for stamp, pose in manual_flight(0, 9.0, 10.0, spec)]
    template = build_template(seen, background.nearest, spec.camera)
    save_site(folder / "site", Site(SiteCamera(spec.camera), background, DETECTORS, template))
    ceiling = mission.ceiling.model_copy(update={"site": folder / "site"})
    mission = mission.model_copy(update={"ceiling": ceiling})
    return read_recording(fly_mission(mission, 0, folder / "out", progress=False).recording)


def test_a_located_flight_with_its_depth_is_replayed_bit_for_bit(flown):
    located = [t for t in flown.flown if t.decision.whereabouts is not None]
    assert len(located) > 30
    assert sum(t.decision.whereabouts.measured is not None for t in located) > 30
    outcome = replay(flown)
    assert outcome.exact
    assert outcome.lossless
    assert str(outcome) == f"replay: all {len(flown.flown)} commands are the same, bit for bit"


def test_a_place_that_differs_is_a_difference_even_where_the_command_is_the_same(flown):
    ticks = list(flown.ticks)
    k = next(i for i, t in enumerate(ticks) if t.decision and t.decision.whereabouts is not None) + 5
    known = ticks[k].decision.whereabouts
    moved = replace(known, position=known.position + np.array([0.0, 0.0, 1e-9]))
    ticks[k] = replace(ticks[k], decision=replace(ticks[k].decision, whereabouts=moved))
    outcome = replay(replace(flown, ticks=tuple(ticks)))
    assert outcome.identical == outcome.ticks - 1
    assert outcome.first_difference == k
    assert outcome.worst == 0.0
    assert "lossless, so this is a fault" in str(outcome)


def test_the_pilot_was_told_what_was_really_sent_at_the_tick_before(flown):
    told = [t.observation().sent for t in flown.flown]
    assert told[0] is None
    assert told[1:] == [t.sent for t in flown.flown[:-1]]
    assert any(sent != Command() for sent in told[1:])


def test_without_its_depth_a_located_flight_is_not_replayed_and_one_line_says_why(flown):
    blind = replace(flown, ticks=tuple(replace(t, depth=None) for t in flown.ticks))
    with pytest.raises(NoDepthError) as caught:
        replay(blind)
    assert str(caught.value) == (
        f"replay {flown.path}: its pilot flew by depth frames and they were not kept, expected a recording "
        "with them; fly with recording.depth = true"
    )


def test_a_recording_without_its_site_cannot_be_replayed(flown):
    with pytest.raises(RecordingFileError) as caught:
        recorded_pilot(replace(flown, files={**flown.files, "site.zip": b""}))
    assert str(caught.value) == (
        f"recording {flown.path}: holds no site that can be read, expected site.zip; was it made by noctule "
        "fly?"
    )


def test_a_site_without_calibrated_sensors_has_those_that_nobody_calibrated(flown):
    names = zipfile.ZipFile(io.BytesIO(flown.files["site.zip"])).namelist()
    assert "sensors.toml" not in names
    site, sensors = recorded_site(flown)
    assert site.background.frames == 20
    assert sensors == type(sensors)()


def test_a_flight_with_an_offset_that_no_site_may_have_is_replayed_as_it_was_flown(flown):
    """From when such an offset was still taken."""
    changed = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(flown.files["site.zip"])) as old, zipfile.ZipFile(changed, "w") as new:
        for name in old.namelist():
            new.writestr(name, old.read(name).replace(b"offset = [0.0, 0.0,", b"offset = [0.0, -1.4,"))
    site, _ = recorded_site(replace(flown, files={**flown.files, "site.zip": changed.getvalue()}))
    assert site.camera.offset.tolist() == [0.0, -1.4, 0.0]


def test_the_mission_of_a_recording_is_the_one_that_was_flown(flown):
    mission = recorded_mission(flown)
    assert isinstance(mission, Mission)
    assert mission.model_dump_json().encode() == flown.files["mission.json"]
    assert mission.space_plan().total == pytest.approx(0.2)


def test_the_camera_s_frames_can_be_read_from_the_flight_s_recording(flown):
    frames = list(read_depth_recording(flown.path).frames())
    assert [f.stamp for f in frames] == [t.depth_stamp for t in flown.ticks if t.depth is not None]


def test_the_report_of_a_located_flight_knows_its_path_its_push_and_the_person(flown):
    log = load_flight_log(flown.path)
    located = log.located
    assert located is not None
    assert located.path is not None
    assert located.path.length == pytest.approx(0.2)
    (push,) = located.pushes
    assert push.time == pytest.approx(1.5 - flown.flown[0].stamp)
    assert (push.seconds, push.acceleration) == (0.2, 1.0)
    (walk,) = located.walks
    assert np.hypot(walk[:, 0] - 1.6, walk[:, 1]) == pytest.approx(0.4, abs=0.01)
    rms = float(np.sqrt(np.nanmean(np.sum(located.estimate_off[:, :3] ** 2, axis=1))))
    assert rms < 0.05
