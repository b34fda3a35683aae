"""`noctule calibrate background`, `detector` and `template`: what a site learns from depth frames."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from noctule.cli.depth_options import SourceOptions, depth_source
from noctule.cli.options import out_folder
from noctule.cli.show import as_json
from noctule.errors import NoctuleError

if TYPE_CHECKING:
    from noctule.flight.depth_sources import DepthSource
    from noctule.localization.health import Sieve
    from noctule.localization.site import SiteCamera
    from noctule.messages import DepthFrame
    from noctule.vision.depth.background import Background

ROOM_SECONDS, FLIGHT_SECONDS = 10.0, 60.0


class OtherCameraError(NoctuleError):
    """A source whose camera is not the site's."""


@dataclass(frozen=True, slots=True)
class Stream:
    """The frames of a source, seen by the camera of a site; those that cannot be used are left out."""

    source: DepthSource
    camera: SiteCamera
    sieve: Sieve

    def frames(self, label: str) -> Iterator[DepthFrame]:
        """Yield the sound frames, with a progress bar."""
        from noctule.localization.site import straightened
        from noctule.reports.progress import with_progress

        shown = with_progress(self.source.frames(), label, total=self.source.count)
        yield from self.sieve.through(straightened(shown, self.camera))

    @contextmanager
    def judged(self) -> Iterator[None]:
        """Blame what cannot be learned on unusable frames, where there were many."""
        try:
            yield
        except NoctuleError:
            self.sieve.require_sound(self.source.name)
            raise
        self.sieve.require_sound(self.source.name)

    def counts(self) -> dict[str, Any]:
        """Return what was seen."""
        return {"frames": self.sieve.seen, "unusable": dict(self.sieve.reasons)}


def open_stream(source: DepthSource, camera: SiteCamera, background: Background | None = None) -> Stream:
    """Return the stream of a source; raises OtherCameraError."""
    from noctule.localization.health import Expected, FrameHealth, Sieve, check_frame

    own = camera.camera.intrinsics
    if source.intrinsics is not None:
        for name in ("width", "height", "fx", "fy", "cx", "cy"):
            theirs, ours = getattr(source.intrinsics, name), getattr(own, name)
            if abs(theirs - ours) > 0.1:
                raise OtherCameraError(
                    f"{source.name}: its camera has {name} {theirs:g} px, the site's camera.toml says "
                    f"{ours:g}; give the site of that camera"
                )
    if background is not None:
        return Stream(source, camera, Sieve(FrameHealth(own, background).check))
    expected = Expected.of(own)
    return Stream(source, camera, Sieve(lambda frame: check_frame(frame, expected)))


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

    source = depth_source(options, "calibrate background", "none", ROOM_SECONDS)
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
    print(f"background: learned from {_used(stream)}; nothing moved")
    print(
        f"known: {100.0 * figures['known']:.1f} % of the picture, usually {figures['usual_depth_m']:.2f} m "
        f"away with a deviation of {figures['deviation_mm']:.0f} mm"
    )
    print(f"site: {out / BACKGROUND}")
    return 0


def _used(stream: Stream) -> str:
    bad = stream.sieve.reasons
    left_out = ", ".join(f"{count} left out: {name}" for name, count in bad.most_common())
    return f"{stream.sieve.seen - bad.total()} frames of {stream.source.name}" + (
        f" ({left_out})" if left_out else ""
    )


def learn_detectors(options: SourceOptions, site: Path, out: Path | None, json: bool) -> int:
    """Fit the three detectors on a flight by hand, draw Fig. 11, keep them; 0 when they could be fitted."""
    from noctule.localization.detection.band import fit_band
    from noctule.localization.detection.cubics import fit_cubics
    from noctule.localization.detection.hu import fit_hu
    from noctule.localization.detection.samples import flight_samples
    from noctule.localization.detector_file import DETECTOR, Detectors, save_detectors
    from noctule.localization.site import load_background, load_camera
    from noctule.reports.detector_figures import write_detector_figure
    from noctule.vision.depth import find_blobs

    source = depth_source(options, "calibrate detector", "manual", FLIGHT_SECONDS)
    camera = load_camera(site)
    background = load_background(site, camera.camera)
    stream = open_stream(source, camera, background)
    folder = out_folder(out or site, "site")
    with stream.judged():
        samples = flight_samples(
            (
                find_blobs(frame.depth, background, camera.camera.intrinsics)[1]
                for frame in stream.frames("looking at the flight")
            ),
            camera.camera,
        )
    detectors = Detectors(fit_cubics(samples), fit_band(samples), fit_hu(samples))
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
    print(f"detector: {len(samples)} frames show the drone whole and alone, of {_used(stream)}")
    print(f"altitudes: {cubics.lowest:.2f} to {cubics.highest:.2f} m; elsewhere the cubics accept nothing")
    print(f"surface: {band.smallest:.3f} to {band.largest:.3f} m^2")
    print(f"figure: {figure}\nsite: {folder / DETECTOR}")
    return 0
