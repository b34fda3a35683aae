"""`noctule node`: one process per sensor, and one that shows what all of them know."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from noctule.cli.depth_options import NONE, SourceOptions
from noctule.cli.locate_commands import Detector
from noctule.cli.node_options import (
    NODE,
    NodeOptions,
    NodeOptionsError,
    Prepared,
    prepare,
    require_within,
)
from noctule.cli.options import Flag, Seed
from noctule.errors import NoctuleError

if TYPE_CHECKING:
    from noctule.flight.depth_sources import DepthSource
    from noctule.flight.network.process import Nothing, Reading
    from noctule.flight.network.sensing import Expectation
    from noctule.flight.reader import Recording
    from noctule.localization.site import SiteCamera
    from noctule.messages import DepthFrame

_SECONDS = 60.0  # of a simulated flight


class CameraTakenError(NoctuleError):
    """A camera that gives no frame, perhaps because another node has it open."""


def node_onboard(
    *,
    node: NodeOptions = NODE,
    recording: Path | None = None,
    simulated: Flag = False,
    seed: Seed = None,
    seconds: float | None = None,
    json: Flag = False,
) -> int:
    """Share what the vehicle reports of itself, and tell the others the commands that it is sent.

    Parameters
    ----------
    recording
        Reports and commands of a recorded flight (.mcap), played in real time.
    simulated
        Reports of a vehicle along the path of the simulated room: that of `noctule node depth --simulated`.
    seed
        With --simulated: draws the errors of the reports. Left out, 0.
    seconds
        Stop after this long.
    json
        End standard output with one JSON object; the live line goes to standard error.
    """
    from noctule.cli.node_running import run_prepared

    given = _one_of("onboard", {"--recording": recording, "--simulated": simulated}, node)
    if seed is not None and given != "--simulated":
        raise NodeOptionsError("node onboard: --seed goes with --simulated only; leave it out")
    ready = prepare("onboard", node)
    recorded = None if recording is None else _recording(recording, ready)

    def readings(stop: threading.Event, expected: Expectation) -> Iterable[Reading]:
        if recorded is not None:
            return _of_recording(recorded, ready, stop)
        return _of_simulation(seed or 0, seconds or _SECONDS, ready, stop)

    return run_prepared(ready, readings, seconds=seconds, as_json=json)


def node_depth(
    *,
    node: NodeOptions = NODE,
    source: SourceOptions = NONE,
    with_markers: Flag = False,
    detector: Detector = "band",
    json: Flag = False,
) -> int:
    """Share where a depth camera in the room sees the drone.

    It needs --site, a folder with camera, background and the drone's top view: see `noctule calibrate`.

    Parameters
    ----------
    with_markers
        Share the heading of the drone's colour markers too: two nodes cannot open one camera.
    detector
        What proposes blobs to start from and to find the drone again.
    json
        End standard output with one JSON object; the live line goes to standard error.
    """
    from noctule.cli.node_running import run_prepared

    _one_of("depth", {"--site": node.site}, node)
    if with_markers and source.simulated:
        source = replace(source, markers=True)
    ready = prepare("depth", node)
    site = node.site
    if site is None:
        return run_prepared(ready, as_json=json)

    from noctule.cli.depth_options import depth_source
    from noctule.cli.depth_stream import require_same_camera
    from noctule.flight.network.sensing import located
    from noctule.localization.locator import Locator
    from noctule.localization.site import load_site

    known = load_site(site)
    frames = depth_source(source, "node depth", "path", _SECONDS)
    require_same_camera(frames, known.camera.camera)
    locator = Locator(
        known.camera.camera,
        known.background,
        known.template,
        known.detectors.named(detector),
        offset=known.camera.offset,
    )
    return run_prepared(
        ready,
        lambda stop, expected: located(
            _timed(frames, known.camera, ready, source, stop),
            locator,
            expected,
            known.background if with_markers else None,
        ),
        as_json=json,
    )


def node_markers(*, node: NodeOptions = NODE, source: SourceOptions = NONE, json: Flag = False) -> int:
    """Share the heading that the drone's colour markers tell, from a depth camera with colour.

    It needs --site, a folder with camera and background: see `noctule calibrate`. Where the depth node has
    the same camera open, give that one --with-markers instead.

    Parameters
    ----------
    json
        End standard output with one JSON object; the live line goes to standard error.
    """
    from noctule.cli.node_running import run_prepared

    _one_of("markers", {"--site": node.site}, node)
    ready = prepare("markers", node)
    site = node.site
    if site is None:
        return run_prepared(ready, as_json=json)

    from noctule.cli.depth_options import depth_source
    from noctule.cli.depth_stream import require_same_camera
    from noctule.flight.network.sensing import marked
    from noctule.localization.site import load_background, load_camera

    camera = load_camera(site)
    background = load_background(site, camera.camera)
    frames = depth_source(source, "node markers", "path", _SECONDS)
    require_same_camera(frames, camera.camera)
    return run_prepared(
        ready,
        lambda stop, expected: marked(
            _timed(frames, camera, ready, source, stop), background, camera.camera, ready.name
        ),
        as_json=json,
    )


def node_fusion(
    *,
    node: NodeOptions = NODE,
    seconds: float | None = None,
    out: Path | None = None,
    json: Flag = False,
) -> int:
    """Show and record what the nodes know together, and who is there or missing. It measures nothing itself.

    Parameters
    ----------
    seconds
        Stop after this long; left out, at Ctrl-C.
    out
        The folder for estimates.csv and estimates.mcap; left out, a new one under flights/. What earlier runs
        left in it is kept: then they are estimates-2.csv and estimates-2.mcap, and so on.
    json
        End standard output with one JSON object; the live line goes to standard error.
    """
    from noctule.cli.node_running import run_prepared

    return run_prepared(prepare("fusion", node), out=out, record=True, seconds=seconds, as_json=json)


def _one_of(role: str, options: dict[str, object], node: NodeOptions) -> str:
    choices = {**options, "--drill": node.drill is not None}
    given = [option for option, value in choices.items() if value]
    if len(given) != 1:
        raise NodeOptionsError(
            f"node {role}: found {' and '.join(given) or 'none'}, expected exactly one of "
            f"{', '.join(choices)}"
        )
    return given[0]


def _timed(
    source: DepthSource, camera: SiteCamera, ready: Prepared, options: SourceOptions, stop: threading.Event
) -> Iterable[DepthFrame | Nothing]:
    from noctule.flight.network.pacing import live_frames, paced_frames
    from noctule.localization.site import straightened

    if options.simulated:
        return _live_simulation(options, ready, stop)
    frames = straightened(_reaching(source, ready), camera)
    if options.device is not None:
        return live_frames(_of_device(frames, options.device, ready.role), stop)
    return paced_frames(frames, ready.schedule, stop)


def _reaching(source: DepthSource, ready: Prepared) -> Iterator[DepthFrame]:
    """Yield the frames of a source; raises NodeOptionsError at its end when that is before --from."""
    first = last = None
    for frame in source.frames():
        last = frame.stamp
        first = last if first is None else first
        yield frame
    if first is not None and last is not None:
        require_within(ready.from_, first, last, source.name, ready.role)


def _of_device(frames: Iterable[DepthFrame], device: str, role: str) -> Iterator[DepthFrame]:
    from noctule.devices.protocols import DeviceError

    seen = False
    try:
        for frame in frames:
            seen = True
            yield frame
    except DeviceError as error:
        if seen:
            raise
        other = "markers" if role == "depth" else "depth"
        raise CameraTakenError(
            f"node {role}: camera {device!r} gives no frame ({error}); where `noctule node {other}` has it "
            "open, stop it: `noctule node depth --with-markers` does both"
        ) from error


def _live_simulation(
    options: SourceOptions, ready: Prepared, stop: threading.Event
) -> Iterable[DepthFrame | Nothing]:
    """Yield what the simulated camera sees in real time: a frame that is past is not drawn at all."""
    from noctule.flight.depth_scene import Scene
    from noctule.flight.network.pacing import paced_frames

    seconds = options.seconds or _SECONDS
    scene = Scene("path", options.seed or 0, options.hull, options.markers, options.person, seconds)
    when = ready.schedule(0.0)
    frames = scene.frames(lambda stamp: when.shared(stamp) >= time.time() and not stop.is_set())
    return paced_frames(frames, lambda first: when, stop)


def _recording(file: Path, ready: Prepared) -> Recording:
    from noctule.flight.reader import read_recording

    recording = read_recording(file)
    if recording.ticks:
        first, last = recording.ticks[0].stamp, recording.ticks[-1].stamp
        require_within(ready.from_, first, last, f"recording {file}", ready.role)
    return recording


def _of_recording(recording: Recording, ready: Prepared, stop: threading.Event) -> Iterable[Reading]:
    from noctule.flight.network.sensing import recorded_navdata

    first = recording.ticks[0].stamp if recording.ticks else 0.0
    return recorded_navdata(recording, ready.schedule(first), ready.name, stop)


def _of_simulation(seed: int, seconds: float, ready: Prepared, stop: threading.Event) -> Iterable[Reading]:
    from noctule.flight.depth_scene import Scene
    from noctule.flight.network.sensing import simulated_navdata

    poses = [
        (stamp, pose) for stamp, pose in Scene("path", seed, seconds=seconds).poses() if pose is not None
    ]
    return simulated_navdata(poses, seed, ready.schedule(0.0), stop)
