"""detector.toml: what was fitted comes back, and what is wrong with it is one line."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from noctule.camera import CEILING_CAMERA
from noctule.errors import NoctuleError
from noctule.localization.detection.band import SurfaceBand
from noctule.localization.detection.cubics import AreaCubics
from noctule.localization.detection.hu import HuPatterns
from noctule.localization.detector_file import Detectors, load_detectors, save_detectors
from noctule.localization.site_files import SiteCameraError

RNG = np.random.default_rng(4)
DETECTORS = Detectors(
    AreaCubics(RNG.normal(0.0, 1e3, 4), RNG.normal(0.0, 1e-3, 4), 0.4 / 3, 1.9),
    SurfaceBand(0.1 / 3, 0.07, 0.4, 1.9),
    HuPatterns(RNG.normal(0.0, 1.0, (3, 7)) * 10.0 ** -np.arange(0, 21, 3), 1.93),
)
LEARN = "learn it with `noctule calibrate detector`"


def test_detectors_come_back_to_the_last_bit(tmp_path):
    save_detectors(tmp_path, DETECTORS, CEILING_CAMERA)
    read = load_detectors(tmp_path, CEILING_CAMERA)
    assert np.array_equal(read.cubics.g1, DETECTORS.cubics.g1)
    assert np.array_equal(read.cubics.g2, DETECTORS.cubics.g2)
    assert (read.cubics.lowest, read.cubics.highest) == (0.4 / 3, 1.9)
    assert read.band == DETECTORS.band
    assert np.array_equal(read.hu.patterns, DETECTORS.hu.patterns)
    assert read.hu.threshold == 1.93


def test_each_can_be_had_by_its_name():
    assert [DETECTORS.named(name).name for name in ("cubics", "band", "hu")] == ["cubics", "band", "hu"]


def test_areas_in_pixels_of_another_camera_are_refused(tmp_path):
    save_detectors(tmp_path, DETECTORS, CEILING_CAMERA)
    other = replace(CEILING_CAMERA, intrinsics=replace(CEILING_CAMERA.intrinsics, fx=600.0))
    with pytest.raises(SiteCameraError) as caught:
        load_detectors(tmp_path, other)
    assert str(caught.value) == (
        f"site file {tmp_path}/detector.toml: it was made with a camera of fx 527.774 px, camera.toml says "
        f"600; {LEARN}, or put the camera back"
    )


MISTAKES = [
    ("threshold = 1.93", "", "hu.threshold is missing"),
    ("threshold = 1.93", "threshold = 0", "hu.threshold is 0, input should be greater than 0"),
    ("threshold = 1.93", "treshold = 1.93", "hu.threshold is missing"),
    ("smallest = 0.03", "smallest = -0.03", "band.smallest is -0.03"),
    ("g1 = [", "g1 = [1.0, ", "cubics.g1"),
    ("highest = 1.9", "highest = 0.1", "cubics: lowest is 0.133333, expected less than highest, 0.1"),
    ("patterns = [[", "patterns = [[1.0, ", "hu.patterns[0]"),
    ("[band]", "[ring]", "band is missing"),
]


@pytest.mark.parametrize(("good", "bad", "what"), MISTAKES)
def test_every_mistake_in_detector_toml_is_one_line_that_names_the_key(tmp_path, good, bad, what):
    save_detectors(tmp_path, DETECTORS, CEILING_CAMERA)
    path = tmp_path / "detector.toml"
    text = path.read_text()
    assert good in text
    path.write_text(text.replace(good, bad, 1))
    with pytest.raises(NoctuleError) as caught:
        load_detectors(tmp_path, CEILING_CAMERA)
    line = str(caught.value)
    assert line.startswith(f"site file {path}: {what}")
    assert line.endswith(f"; {LEARN}")
    assert "\n" not in line


def test_a_site_without_it_says_what_makes_it(tmp_path):
    with pytest.raises(NoctuleError) as caught:
        load_detectors(tmp_path, CEILING_CAMERA)
    assert str(caught.value) == f"site file {tmp_path}/detector.toml: is missing; {LEARN}"
