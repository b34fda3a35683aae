"""`noctule calibrate detector` and `template`: what a site learns of the drone, from a flight by hand."""

from __future__ import annotations

import math
from pathlib import Path

from noctule.cli.depth_options import SourceOptions, depth_source
from noctule.cli.depth_stream import open_stream, spinner, thinned
from noctule.cli.options import out_folder
from noctule.cli.show import as_json

SECONDS = 60.0
EVERY = 0.15  # [s], frames that the template is learned from
_ANCHORS = {"markers": "the markers", "start": "the heading at the start", "displacement": "the way it flew"}


def learn_detectors(options: SourceOptions, site: Path, out: Path | None, json: bool) -> int:
    """Fit the three detectors on a flight by hand, draw Fig. 11, keep them; 0 when they could be fitted."""
    from noctule.localization.detector_file import DETECTOR, save_detectors
    from noctule.localization.learning.detectors import fit_detectors
    from noctule.localization.site import load_background, load_camera
    from noctule.reports.detector_figures import write_detector_figure

    source = depth_source(options, "calibrate detector", "manual", SECONDS)
    camera = load_camera(site)
    background = load_background(site, camera.camera)
    stream = open_stream(source, camera, background)
    folder = out_folder(out or site, "site")
    with stream.judged():
        detectors, samples = fit_detectors(stream.frames("looking at the flight"), background, camera.camera)
    save_detectors(folder, detectors, camera.camera)
    figure = write_detector_figure(samples, detectors.cubics, detectors.band, folder / "detector.png")
    cubics, band = detectors.cubics, detectors.band
    if json:
        told = {
            "detector": folder / DETECTOR,
            "figure": figure,
            **stream.counts(),
            "samples": len(samples),
            "altitude_m": [cubics.lowest, cubics.highest],
            "surface_m2": [band.smallest, band.largest],
            "hu_threshold": detectors.hu.threshold,
        }
        print(as_json(told))
        return 0
    print(f"detector: {len(samples)} frames show the drone whole and alone, of {stream.used}")
    print(f"altitudes: {cubics.lowest:.2f} to {cubics.highest:.2f} m; elsewhere the cubics accept nothing")
    print(f"surface: {band.smallest:.3f} to {band.largest:.3f} m^2")
    print(f"figure: {figure}\nsite: {folder / DETECTOR}")
    return 0


def learn_top_view(
    options: SourceOptions, site: Path, start_yaw_deg: float | None, out: Path | None, json: bool
) -> int:
    """Learn the template on a flight by hand, draw it and keep it; 0 when it became sharp."""
    from noctule.localization.learning.template import learn_template
    from noctule.localization.site import TEMPLATE, load_background, load_camera, save_template
    from noctule.reports.template_figure import write_template_figure

    source = depth_source(options, "calibrate template", "manual", SECONDS)
    camera = load_camera(site)
    background = load_background(site, camera.camera)
    stream = open_stream(source, camera, background)
    folder = out_folder(out or site, "site")
    start_yaw = source.start_yaw if start_yaw_deg is None else math.radians(start_yaw_deg)
    with stream.judged():
        frames = list(thinned(stream.frames("looking at the flight"), EVERY))
        with spinner("learning the top view") as tell:
            learned = learn_template(
                frames,
                background,
                camera.camera,
                start_yaw,
                on_round=lambda r: tell(f"round: {r.used} frames fit, poses moved {1e3 * r.moved:.1f} mm"),
            )
    save_template(folder, learned.template)
    figure = write_template_figure(learned.template, folder / "template.png")
    rounds = learned.rounds
    if json:
        told = {
            "template": folder / TEMPLATE,
            "figure": figure,
            **stream.counts(),
            "used": learned.frames_used,
            "looked_at": len(frames),
            "rounds": len(rounds),
            "moved_m": rounds[-1].moved,
            "turned_deg": math.degrees(rounds[-1].turned),
            "heading": learned.heading,
            "anchor": learned.anchor,
            "offset_outdated": bool(camera.offset.any()),
        }
        print(as_json(told))
        return 0
    print(
        f"template: learned in {len(rounds)} rounds from {learned.frames_used} of {len(frames)} frames "
        f"looked at, of {stream.used}"
    )
    print(f"headings: first by {learned.heading}; nose told from tail by {_ANCHORS[learned.anchor]}")
    print(f"figure: {figure}\nsite: {folder / TEMPLATE}")
    if camera.offset.any():
        print("next: noctule calibrate offset; that in camera.toml was measured with another template")
    return 0
