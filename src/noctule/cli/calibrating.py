"""`noctule calibrate background`: what a site learns of the empty room."""

from __future__ import annotations

from pathlib import Path

from noctule.cli.depth_options import SourceOptions, depth_source
from noctule.cli.depth_stream import open_stream
from noctule.cli.options import out_folder
from noctule.cli.show import as_json

SECONDS = 10.0


def learn_room(options: SourceOptions, out: Path, json: bool) -> int:
    """Learn the background of a site and keep it; 0 when nothing moved."""
    import numpy as np

    from noctule.localization.site import (
        BACKGROUND,
        CAMERA,
        SiteCamera,
        load_camera,
        save_background,
        save_camera,
    )
    from noctule.vision.depth import learn_background

    source = depth_source(options, "calibrate background", "none", SECONDS)
    known = (out / CAMERA).exists() or source.camera is None
    camera = load_camera(out) if known or source.camera is None else SiteCamera(source.camera)
    stream = open_stream(source, camera)
    out_folder(out, "site")
    with stream.judged():
        background = learn_background(frame.depth for frame in stream.frames("learning the empty room"))
    if not known:
        save_camera(out, camera)
    save_background(out, background, camera.camera)
    seen = background.count > 0
    figures = {
        "known": float(np.mean(seen)),
        "usual_depth_m": float(np.median(background.mean[seen])) / 1000.0,
        "deviation_mm": float(np.median(background.deviation[seen])),
    }
    if json:
        print(as_json({"background": out / BACKGROUND, **stream.counts(), **figures}))
        return 0
    print(f"background: learned from {stream.used}; nothing moved")
    print(
        f"known: {100.0 * figures['known']:.1f} % of the picture, usually {figures['usual_depth_m']:.2f} m "
        f"away with a deviation of {figures['deviation_mm']:.0f} mm"
    )
    print(f"site: {out / BACKGROUND}")
    return 0
