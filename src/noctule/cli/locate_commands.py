"""The subcommands of the depth camera in the room: their options and help."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from noctule.cli.depth_options import NONE, SourceOptions
from noctule.cli.options import Flag

Flown = Literal["none", "manual", "path", "stand"]
Detector = Literal["cubics", "band", "hu"]
Kind = Literal["truth", "markers"]


def calibrate_background(*, source: SourceOptions = NONE, out: Path, json: Flag = False) -> int:
    """Learn the empty room, ten seconds of it; refused when something moved.

    Parameters
    ----------
    out
        The folder of the site, whose camera was calibrated. With --simulated the camera is known.
    json
        End standard output with one JSON object.
    """
    from noctule.cli.calibrating import learn_room

    return learn_room(source, out, json)


def calibrate_detector(
    *, source: SourceOptions = NONE, site: Path, out: Path | None = None, json: Flag = False
) -> int:
    """Learn what the drone's blob looks like, from a flight by hand over all the room and all its heights.

    Parameters
    ----------
    site
        The folder of the site, with its camera and background.
    out
        Write detector.toml and its figure into this folder; left out, the site.
    json
        End standard output with one JSON object.
    """
    from noctule.cli.calibrating_drone import learn_detectors

    return learn_detectors(source, site, out, json)


def calibrate_template(
    *,
    source: SourceOptions = NONE,
    site: Path,
    start_yaw: float | None = None,
    out: Path | None = None,
    json: Flag = False,
) -> int:
    """Learn the drone's top view, from a flight by hand that turns through all headings.

    Parameters
    ----------
    site
        The folder of the site, with its camera and background.
    start_yaw
        Where the nose points in the first frame, to 60 [deg]: 0 along x, 90 along y. Left out, the markers
        tell, or the way it flew.
    out
        Write template.npz and its figure into this folder; left out, the site.
    json
        End standard output with one JSON object.
    """
    from noctule.cli.calibrating_drone import learn_top_view

    return learn_top_view(source, site, start_yaw, out, json)


def calibrate_offset(
    *,
    source: SourceOptions = NONE,
    site: Path,
    height: float | None = None,
    at: str | None = None,
    places: Path | None = None,
    out: Path | None = None,
    json: Flag = False,
) -> int:
    """Find the constant error of positions, from a drone that stands at known places with its motors off.

    Turn it there by a quarter now and then: what its template is off by averages out. One place (a source,
    --height and --at) gives the offset; several (--places) also the slant, what positions seen from aside are
    off by. An offset of more than 0.15 m is refused: then a place is wrong, or where the camera hangs.

    Parameters
    ----------
    site
        The folder of the whole site.
    height
        How high the middle of its hull is above the floor [m]: best on a stool that was there when the
        background was learned, about as high as it will fly. On the floor it is measured below the camera.
        With --simulated the drone is put there.
    at
        Where it stands, as x,y [m]; left out, only the altitude is corrected. With --simulated the drone is
        put there; left out, at 0,0.
    places
        Instead of a source: a .csv file with a line recording,x,y,z for each of three places and more,
        below the camera and far aside of it. The recording is an .mcap file or a folder of images beside it.
    out
        Write camera.toml with the offset, and with --places template.npz with the slant, into this folder;
        left out, the site.
    json
        End standard output with one JSON object.
    """
    from noctule.cli.calibrating_offset import OffsetOptions, find_offset

    return find_offset(source, site, OffsetOptions(height, at, places, out), json)


def calibrate_sensors(
    recording: Path,
    /,
    *,
    site: Path,
    reference: Kind | None = None,
    out: Path | None = None,
    json: Flag = False,
) -> int:
    """Find bias, noise and delay of each sensor, and how its heading depends on the heading.

    Writes sensors.toml, which the filter loads, and draws the errors. Sensors that the recording does not
    hold stay as they are.

    Parameters
    ----------
    recording
        A flight (.mcap) that turns through all headings: the vehicle's reports, and depth frames or what was
        located in them, beside ground truth or colour markers.
    site
        The folder of the site; depth frames are located with it.
    reference
        truth: the ground truth of a simulated flight. markers: the colour markers. Left out, truth where the
        recording holds it.
    out
        Write sensors.toml and the figures into this folder; left out, the site.
    json
        End standard output with one JSON object.
    """
    from noctule.cli.calibrating_sensors import find_sensors

    return find_sensors(recording, site, reference, out, json)


def calibrate_record(
    *,
    source: SourceOptions = NONE,
    out: Path,
    flight: Flown = "manual",
    at: str | None = None,
    height: float | None = None,
    json: Flag = False,
) -> int:
    """Record depth frames without loss, to calibrate from them or to locate the drone in them later.

    Parameters
    ----------
    out
        The recording (.mcap), a new file.
    flight
        With --simulated: what is flown. none: the room is empty. manual: by hand all over the room, nose
        first. path: along an ellipse. stand: it stands still and is turned by quarters.
    at
        With --flight stand: where it stands, as x,y [m]; left out, 0,0.
    height
        With --flight stand: how high the middle of its hull is [m]; left out, 1.2.
    json
        End standard output with one JSON object.
    """
    from noctule.cli.recording_depth import record_depth, standing_place

    return record_depth(source, out, flight, standing_place(flight, at, height), json)


def locate(
    *,
    source: SourceOptions = NONE,
    site: Path,
    detector: Detector = "band",
    frames: Flag = False,
    out: Path | None = None,
    json: Flag = False,
) -> int:
    """Tell and record where the drone is, from any depth camera: position, heading, score, or the reason.

    Exit code 0 if and only if the drone was seen in at least one frame.

    Parameters
    ----------
    site
        The folder of the site, see `noctule calibrate`.
    detector
        What proposes blobs to start from and to find the drone again.
    frames
        Record the depth frames too.
    out
        The folder for located.mcap and located.csv; left out, a new one under flights/.
    json
        End standard output with one JSON object.
    """
    from noctule.cli.locating import locate_drone

    return locate_drone(source, site, detector, frames, out, json)
