"""Whole flights along a path in space, below a simulated camera that is taught first: short ones."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

from noctule.flight import fly_mission, parse_mission, read_recording
from noctule.flight.located_flight import OtherCameraError, prepare_located
from noctule.flight.mission_flight import settled
from noctule.flight.summary import summary_of
from noctule.flight.teach_ceiling import teach_ceiling
from noctule.flight.teach_sensors import teach_sensors
from noctule.geometry import wrap_angle
from noctule.localization.site import load_site
from noctule.messages import Doubt
from noctule.simulation.navdata import NavdataSpec, table_3_error
from noctule.simulation.spec import VehicleSpec

MISSION = """
name = "short line"
[room]
corner = [-3.0, -3.0]
size = [6.0, 6.0, 3.6]
furniture = 6
pictures = 0
lamps = 0
keep_clear = { x_min = -1.7, x_max = 1.7, y_min = -1.7, y_max = 1.9, margin = 0.4 }
[vehicle]
model = "identified"
gusts = 0.6
command_latency = 0.02
navdata = {}
limits = { forward = 1.0, left = 1.0, up = 1.0, yaw_rate = 1.5, acceleration = 5.0, yaw_acceleration = 10.0 }
[limits]
forward = 1.0
left = 1.0
up = 1.0
yaw_rate = 1.5
acceleration = 5.0
yaw_acceleration = 10.0
[start]
x = 0.2
y = -0.3
on_floor = true
[flight]
land = true
time_limit_s = 30.0
[space_path]
speed = { cruise = 0.4 }
[[space_path.segments]]
kind = "line"
points = [[0.2, -0.2, 1.1], [-0.1, 0.5, 1.2]]
[[people]]
passes_m = 0.6
"""


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    return fly_mission(
        parse_mission(MISSION, "short.toml"), 3, tmp_path_factory.mktemp("located"), None, False
    )


COMPILING = """
import gc, sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from noctule.control.paths import nearest_anywhere
from noctule.flight import fly_mission, mission_flight, parse_mission

def versions():
    made = (d for d in gc.get_objects() if isinstance(d, Dispatcher))
    flown = (d for d in made if ".simulation." not in d.py_func.__module__)
    return {d.py_func.__qualname__: len(d.signatures) for d in flown}

def prepare(*args):
    made = mission_flight_prepare(*args)
    nearest_anywhere(made.plan.path, made.plan.path.position[0])  # what the judge compiles is no tick's
    before.update(versions())
    return made

before = {}
mission_flight_prepare, mission_flight.prepare_located = mission_flight.prepare_located, prepare
text, site, out = sys.argv[1:]
mission = parse_mission(text, "short.toml")
mission = mission.model_copy(update={"ceiling": mission.ceiling.model_copy(update={"site": Path(site)})})
flight = fly_mission(mission, 3, Path(out), None, False)
assert flight.summary["outcome"] == "reached" and sum(before.values()) > 20, before
late = {name: count for name, count in versions().items() if count != before[name]}
assert not late, late
"""


def test_no_tick_of_a_flight_has_anything_left_to_compile(flown, tmp_path):
    site = flown.recording.parent / "site"
    done = subprocess.run(
        [sys.executable, "-c", COMPILING, MISSION, str(site), str(tmp_path)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def below(site, text=""):
    """Return the same mission below a camera that is taught already."""
    mission = parse_mission(MISSION + text, "short.toml")
    return mission.model_copy(update={"ceiling": mission.ceiling.model_copy(update={"site": site})})


FAULTS = {
    "camera": (
        "[ceiling.bump]\ntime_s = 6.0\nroll_deg = 2.0\n",
        "the ceiling camera has not seen the drone for 3.0 s (the camera is no longer where it was "
        "calibrated); landed on what the vehicle measures itself",
    ),
    "navdata": (
        "[[vehicle.navdata.silences]]\nbegin_s = 6.0\nseconds = 600.0\n",
        "the vehicle has reported nothing for 3.0 s; landed",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_bumped_camera_or_a_link_that_is_gone_ends_in_a_hover_and_a_landing_that_says_why(
    fault, flown, tmp_path
):
    text, reason = FAULTS[fault]
    limits = "".join(
        f"[located.doubt.{name}]\nfly_on_s = 0.15\nslow_s = 0.5\nhover_s = 1.0\nland_s = 3.0\n"
        for name in ("unseen", "silent")
    )
    slowly = MISSION.replace("cruise = 0.4", "cruise = 0.1").replace("navdata = {}\n", "")
    slowly = slowly.replace("[limits]", "[vehicle.navdata]\nloss = 0.03\n[limits]", 1)
    mission = parse_mission(slowly + limits + text, "short.toml")
    site = flown.recording.parent / "site"
    mission = mission.model_copy(update={"ceiling": mission.ceiling.model_copy(update={"site": site})})
    fault_flight = fly_mission(mission, 3, tmp_path, None, False)
    assert (fault_flight.summary["outcome"], fault_flight.summary["reason"]) == ("lost", reason)
    ticks = [t for t in read_recording(fault_flight.recording).ticks if t.decision is not None]
    doubts = [t.decision.whereabouts.doubt for t in ticks if t.stamp > 6.0 and t.decision.whereabouts]
    assert list(dict.fromkeys(doubts))[-3:] == [Doubt.SLOW, Doubt.HOVER, Doubt.LAND]
    truth = [t.truth.pose.position for t in ticks]
    gone = np.linalg.norm(truth[-1] - next(p for t, p in zip(ticks, truth, strict=True) if t.stamp > 6.0))
    assert gone < 0.35  # it flies on for a second, and drifts while it hovers


def test_it_takes_off_finds_itself_flies_the_path_and_lands(flown):
    summary, ticks = flown.summary, read_recording(flown.recording).ticks
    assert (summary["outcome"], summary["reason"]) == ("reached", "the path is flown")
    assert summary["cross_track_max_m"] < 0.05
    assert summary["position_rms_m"] < 0.015
    assert summary["lost_s"] == 0.0
    phases = [tick.decision.phase for tick in ticks if tick.decision is not None]
    assert list(dict.fromkeys(phases)) == ["searching", "to start", "settle", "follow", "hold"]
    assert ticks[0].truth.pose.position[2] > 0.9
    assert ticks[-1].truth.pose.position[2] < 0.1


def test_the_recording_alone_tells_the_same_and_holds_the_site(flown):
    recording = read_recording(flown.recording)
    again = summary_of(recording)
    assert {k: v for k, v in again.items() if k != "recording"} == {
        k: v for k, v in flown.summary.items() if k != "recording"
    }
    assert {"mission.json", "mission.toml", "site.zip"} <= set(recording.files)
    assert "path.zip" not in recording.files
    assert recording.notes["flight"]["law"] == "located"


def test_nobody_else_is_told_where_it_really_is(flown):
    mission = json.loads(read_recording(flown.recording).files["mission.json"])
    assert mission["ceiling"]["site"] is None
    assert load_site(flown.out / "site").camera.offset == pytest.approx(np.zeros(3), abs=0.01)


def test_hidden_for_long_it_hovers_lands_and_says_why(flown, tmp_path):
    board = "[ceiling]\n[[ceiling.boards]]\nplace = [0.05, 0.15, 1.15]\nbegin_s = 6.0\nseconds = 60.0\n"
    soon = "[located.doubt]\nunseen = { fly_on_s = 0.15, slow_s = 0.3, hover_s = 0.6, land_s = 2.0 }\n"
    long = "[space_path]\nspeed = { cruise = 0.1 }"
    mission = below(flown.out / "site", board + soon)
    mission = mission.model_copy(
        update={
            "space_path": parse_mission(
                MISSION.replace("[space_path]\nspeed = { cruise = 0.4 }", long), ""
            ).space_path
        }
    )
    result = fly_mission(mission, 3, tmp_path, None, False)
    assert result.summary["outcome"] == "lost"
    assert result.summary["reason"].startswith("the ceiling camera has not seen the drone for 2.0 s")
    ticks = read_recording(result.recording).ticks
    assert ticks[-1].truth.pose.position[2] < 0.1
    hidden = [t for t in ticks if t.decision is not None and t.decision.whereabouts is not None]
    off = [
        np.linalg.norm(t.decision.whereabouts.position - t.truth.pose.position)
        for t in hidden
        if t.decision.whereabouts.doubt != "sure"
    ]
    assert max(off) < 0.4
    assert not any(t.truth.contacts for t in ticks if t.decision is not None)


def test_the_same_mission_twice_is_the_same_flight(flown, tmp_path):
    again = fly_mission(below(flown.out / "site"), 3, tmp_path, None, False)
    one, two = (read_recording(path).ticks for path in (flown.recording, again.recording))
    assert [tick.sent for tick in one] == [tick.sent for tick in two]
    assert [tick.truth.pose.yaw for tick in one] == [tick.truth.pose.yaw for tick in two]


def test_a_site_of_another_camera_is_refused(flown, tmp_path):
    mission = below(flown.out / "site")
    mission = mission.model_copy(update={"ceiling": mission.ceiling.model_copy(update={"x_m": 0.5})})
    with pytest.raises(OtherCameraError) as caught:
        prepare_located(mission, tmp_path, lambda done, text: None)
    assert str(caught.value) == (
        f"site {flown.out / 'site'}: its camera has 640x480 px and hangs at (0.24, -0.78, 3.32) m, the "
        "mission's has 640x480 px and hangs at (0.50, -0.78, 3.32) m, turned by 0.0 deg; leave `site` out to "
        "have it taught, or put the site's camera into [ceiling]"
    )


def test_a_camera_is_taught_once_in_a_process_and_tells_what_it_learns(flown):
    mission = settled(parse_mission(MISSION, "short.toml"), 3, None)
    told = []
    site = teach_ceiling(mission.ceiling.spec, mission.room, 3, lambda done, text: told.append(done))
    assert told == []
    assert np.array_equal(site.background.mean, load_site(flown.out / "site").background.mean)


def test_reports_are_calibrated_from_a_flight_by_hand():
    onboard = teach_sensors(VehicleSpec(navdata=NavdataSpec(heading_drift=0.0)), 5).onboard
    left = [
        wrap_angle(onboard.heading.corrected(yaw + table_3_error(yaw)) - yaw)
        for yaw in np.linspace(-3, 3, 25)
    ]
    assert np.degrees(np.abs(left)).max() < 8.0  # of the 30 degrees that the vehicle's heading is off by
    assert onboard.noise.velocity_sd == pytest.approx(0.06, rel=0.2)
    assert teach_sensors(VehicleSpec(), 5).onboard.heading.cosines == ()
