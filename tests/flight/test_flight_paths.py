"""Path folders: what is saved is loaded, and each way in which a folder can be wrong is one line."""

from __future__ import annotations

import re

import cv2
import numpy as np
import pytest

import noctule.flight.feature_cache as feature_cache
from noctule.camera import CameraMount, PinholeCamera
from noctule.flight.feature_cache import NeighbourError
from noctule.flight.path_folder import (
    PathCameraError,
    PathFolderError,
    Shot,
    load_path,
    load_truth,
    save_path,
)
from noctule.geometry import Pose

CAMERA = PinholeCamera.centred(320, 240, 200.0)
MOUNT = CameraMount(np.array([0.09, 0.01, -0.02]), stabilised=False)


def textured(seed: int) -> np.ndarray:
    """Blobs of many sizes: something to recognise."""
    rng = np.random.default_rng(seed)
    picture = np.full((300, 400, 3), 90, dtype=np.uint8)
    for _ in range(260):
        centre = tuple(int(v) for v in rng.integers(0, (400, 300)))
        colour = tuple(int(v) for v in rng.integers(0, 255, 3))
        cv2.circle(picture, centre, int(rng.integers(2, 14)), colour, -1, cv2.LINE_AA)
    return picture


def shots() -> list[Shot]:
    scene = textured(1)
    return [
        Shot(scene[:240, :320].copy(), 0.01, -0.02, Pose(np.array([0.0, 0.1, 1.0]), 0.1, 0.01, -0.02)),
        Shot(scene[6:246, 10:330].copy(), 0.0, 0.03, Pose(np.array([0.5, 0.1, 1.0]), -0.2)),
        Shot(scene[12:252, 25:345].copy(), 0.0, 0.0, Pose(np.array([1.0, 0.1, 1.0]), 0.0)),
    ]


@pytest.fixture
def folder(tmp_path):
    save_path(tmp_path / "walk", shots(), CAMERA, MOUNT)
    return tmp_path / "walk"


def wrong(folder, error=PathFolderError, **options) -> str:
    with pytest.raises(error) as caught:
        load_path(folder, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_saved_path_is_loaded_as_it_was(folder):
    path = load_path(folder, CAMERA)
    assert path.camera == CAMERA
    np.testing.assert_array_equal(path.mount.t_body_camera, MOUNT.t_body_camera)
    assert path.mount.stabilised is False
    assert [i.name for i in path.images] == ["000.png", "001.png", "002.png"]
    for image, shot in zip(path.images, shots(), strict=True):
        np.testing.assert_array_equal(image.pixels, shot.pixels)
        assert (image.roll, image.pitch) == pytest.approx((shot.roll, shot.pitch), abs=1e-15)


def test_neighbours_are_linked_by_the_points_they_share(folder):
    links = load_path(folder).links
    assert len(links) == 2
    assert len(links[0].p_ref) >= 16
    shift = links[0].p_next - links[0].p_ref
    np.testing.assert_allclose(np.median(shift, axis=0), [-10.0, -6.0], atol=0.1)


def test_the_path_knows_no_poses_and_the_judge_finds_them_beside_it(folder):
    truth = load_truth(folder)
    assert truth is not None
    np.testing.assert_allclose(truth[1].position, [0.5, 0.1, 1.0])
    assert truth[1].yaw == pytest.approx(-0.2)
    assert (truth[0].roll, truth[0].pitch) == pytest.approx((0.01, -0.02))
    assert "0.5" not in (folder / "path.toml").read_text().split("[[images]]")[2]


def test_a_path_without_truth_is_flown_all_the_same(folder):
    (folder / "truth.toml").unlink()
    assert load_truth(folder) is None
    assert len(load_path(folder).images) == 3


def test_features_are_computed_once_and_then_taken_from_the_cache(folder, monkeypatch):
    first = load_path(folder)
    monkeypatch.setattr(feature_cache, "detect", lambda *a, **k: pytest.fail("computed again"))
    again = load_path(folder)
    for a, b in zip(first.images, again.images, strict=True):
        np.testing.assert_array_equal(a.features.p, b.features.p)
        np.testing.assert_array_equal(a.features.descriptors, b.features.descriptors)
        assert a.features.kind == b.features.kind
    np.testing.assert_array_equal(first.links[1].p_next, again.links[1].p_next)


@pytest.mark.parametrize("damage", [b"", b"PK not a zip", None])
def test_a_damaged_cache_is_made_anew(folder, damage):
    whole = load_path(folder)
    cache = folder / "features.npz"
    cache.write_bytes(cache.read_bytes()[:4000] if damage is None else damage)
    again = load_path(folder)
    np.testing.assert_array_equal(whole.images[0].features.p, again.images[0].features.p)


def test_a_cache_of_other_pictures_is_not_used(folder, tmp_path):
    load_path(folder)
    other = [Shot(s.pixels[:, ::-1].copy()) for s in shots()]
    save_path(tmp_path / "other", other, CAMERA, MOUNT)
    (tmp_path / "other" / "features.npz").write_bytes((folder / "features.npz").read_bytes())
    mirrored = load_path(tmp_path / "other").links[0]
    assert np.median(mirrored.p_next - mirrored.p_ref, axis=0)[0] == pytest.approx(10.0, abs=0.1)


def test_a_cache_with_pickled_objects_is_not_trusted(folder):
    load_path(folder)
    with np.load(folder / "features.npz") as arrays:
        kept = dict(arrays)
    kept["p0"] = np.array([{"an": "object"}], dtype=object)
    np.savez(folder / "features.npz", **kept)
    assert load_path(folder).images[0].features.p.dtype == np.float64


def test_another_kind_of_feature_can_be_asked_for(folder):
    path = load_path(folder, kind="orb")
    assert path.images[0].features.kind == "orb"
    assert load_path(folder).images[0].features.kind == "sift"


def test_a_missing_image_is_named(folder):
    (folder / "001.png").unlink()
    assert wrong(folder) == (
        f"path {folder}: image 001.png cannot be read (No such file or directory); "
        "restore it or teach the path again"
    )


def test_a_changed_image_is_named_with_both_digests(folder):
    (folder / "001.png").write_bytes((folder / "000.png").read_bytes())
    assert re.fullmatch(
        re.escape(f"path {folder}: image 001.png was changed after the path was taught: its sha256 is ")
        + r"[0-9a-f]{12}\.\.\., path\.toml says [0-9a-f]{12}\.\.\.; restore it or teach the path again",
        wrong(folder),
    )


def rewrite(folder, old: str, new: str) -> None:
    text = (folder / "path.toml").read_text()
    assert old in text
    (folder / "path.toml").write_text(text.replace(old, new, 1))


def test_a_picture_of_another_size_than_its_camera_is_told(folder):
    rewrite(folder, "width = 320", "width = 640")
    assert wrong(folder) == (
        f"path {folder}: image 000.png is 320x240 px, its camera 640x240 px; teach the path again"
    )


def test_a_path_of_another_version_is_told(folder):
    rewrite(folder, "format = 1", "format = 7")
    assert wrong(folder) == f"path {folder}: its format is 7, this version reads 1; teach the path again"


def test_an_unknown_key_of_a_path_is_told_with_its_line(folder):
    rewrite(folder, "stabilised = false", "stabilized = false")
    with pytest.raises(PathFolderError) as caught:
        load_path(folder)
    assert str(caught.value).split("\n") == [
        f"path file {folder}/path.toml:4: camera.stabilised is missing; expected a value "
        "(pictures show neither roll nor pitch)",
        f"path file {folder}/path.toml:12: unknown key camera.stabilized; did you mean stabilised?",
    ]


def test_an_image_outside_the_folder_is_refused(folder):
    rewrite(folder, '"000.png"', '"../000.png"')
    assert "images[0].file" in wrong(folder)


def test_a_folder_without_a_path_is_told(tmp_path):
    assert wrong(tmp_path) == (
        f"path {tmp_path}: the folder holds no path.toml; expected one that `noctule teach` made "
        "(a path in space is a .csv or .toml file, no folder)"
    )


def test_a_path_file_that_is_not_toml_is_told(folder):
    (folder / "path.toml").write_text("format = = 1\n")
    assert wrong(folder) == (
        f"path file {folder}/path.toml: this is not TOML: Invalid value (at line 1, column 10); "
        "teach the path again"
    )


def test_neighbours_that_share_too_little_are_both_named_with_the_count(tmp_path):
    pictures = [Shot(textured(k)[:240, :320].copy()) for k in range(2)]
    save_path(tmp_path / "walk", pictures, CAMERA, MOUNT)
    assert re.fullmatch(
        re.escape(f"path {tmp_path}/walk: images 000.png and 001.png share ")
        + r"\d+ points( \(.*\))?, at least 16 are needed to fly "
        r"from one to the other; take a picture between them",
        wrong(tmp_path / "walk", NeighbourError),
    )


def test_another_camera_than_the_one_that_flies_is_told(folder):
    flying = PinholeCamera.centred(320, 240, 510.0)
    assert wrong(folder, PathCameraError, expected=flying) == (
        f"path {folder}: it was taken by a camera with fx 200 px, the mission's has 510; "
        "fly it with the camera that took it or teach the path again"
    )


def test_a_stabilised_camera_does_not_fly_the_path_of_one_that_is_not(folder):
    gimbal = CameraMount(MOUNT.t_body_camera, stabilised=True)
    assert wrong(folder, PathCameraError, mount=gimbal) == (
        f"path {folder}: the camera that took it is not stabilised, the mission's is stabilised; "
        "fly it with the camera that took it or teach the path again"
    )


def test_a_camera_at_another_place_of_the_body_is_told(folder):
    behind = CameraMount(MOUNT.t_body_camera - [0.2, 0.0, 0.0], stabilised=False)
    assert wrong(folder, PathCameraError, mount=behind) == (
        f"path {folder}: it was taken by a camera 0.20 m off the mission's on the body, at most "
        "0.05 m are allowed; mend the mission or teach the path again"
    )
    assert load_path(folder, CAMERA, mount=MOUNT).mount.stabilised is False


def test_a_folder_that_cannot_be_written_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(PathFolderError) as caught:
        save_path(tmp_path / "file" / "walk", shots(), CAMERA, MOUNT)
    assert str(caught.value) == (
        f"path {tmp_path}/file/walk: cannot be written (Not a directory); choose another folder"
    )
