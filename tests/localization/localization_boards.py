"""Pictures of a calibration board whose truth is known: the drawn board, warped by its exact homography."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from noctule.camera import FixedCamera, PinholeCamera
from noctule.geometry import rot_x, rot_y, rot_z
from noctule.localization.calibration.board import Board

CAMERA = PinholeCamera(640, 480, 527.77365, 527.22889, 312.15707, 235.82853)
BOARD = Board()
_PER_SQUARE = 120  # [px] of the drawing
_FINER = 4  # rays along each side of a pixel
TO_FACE = np.diag([1.0, -1.0, -1.0])  # a board's axes as seen by a camera that looks straight at it


def photograph(
    R_camera_board, t_camera_board, *, board=BOARD, camera=CAMERA, lens=None, blur=0.5, noise=2.0, seed=0
):
    """Return the grey picture of a board; `blur` is the sd [px] of a Gaussian, or a kernel."""
    square = board.square / _PER_SQUARE
    page = np.array([[square, 0.0, square / 2], [0.0, -square, board.size[1] - square / 2], [0.0, 0.0, 1.0]])
    H = camera.K @ np.column_stack([R_camera_board[:, 0], R_camera_board[:, 1], t_camera_board]) @ page
    size = (camera.width * _FINER, camera.height * _FINER)
    drawn = board.draw(_PER_SQUARE)
    if lens is None:
        fine = np.array([[_FINER, 0.0, (_FINER - 1) / 2], [0.0, _FINER, (_FINER - 1) / 2], [0.0, 0.0, 1.0]])
        picture = cv2.warpPerspective(drawn, fine @ H, size, borderValue=170)
    else:
        x = straight_rays(camera, lens) @ np.linalg.inv(H).T
        on_page = (x[..., :2] / x[..., 2:]).astype(np.float32)
        picture = cv2.remap(drawn, on_page[..., 0], on_page[..., 1], cv2.INTER_LINEAR, borderValue=170)
    picture = cv2.resize(picture, (camera.width, camera.height), interpolation=cv2.INTER_AREA).astype(float)
    if isinstance(blur, np.ndarray):
        picture = cv2.filter2D(picture, -1, blur)
    elif blur:
        picture = cv2.GaussianBlur(picture, (0, 0), blur)
    picture = 30.0 + 0.75 * picture + np.random.default_rng(seed).normal(0.0, noise, picture.shape)
    return np.clip(picture, 0, 255).round().astype(np.uint8)


@lru_cache(maxsize=2)
def straight_rays(camera, lens, finer=2):
    """Return where a pinhole would have each ray of each pixel, homogeneous."""
    u, v = np.meshgrid(
        *((np.arange(n * finer) - (finer - 1) / 2) / finer for n in (camera.width, camera.height))
    )
    p = lens.straighten(np.column_stack([u.ravel(), v.ravel()]), camera)
    return np.column_stack([p, np.ones(len(p))]).reshape(*u.shape, 3)


def held(tilt_x, tilt_y, turn, at, distance, board=BOARD, camera=CAMERA):
    """Return (R_camera_board, t_camera_board) of a board whose middle is seen at `at` [px]; degrees."""
    a, b, c = np.radians([tilt_x, tilt_y, turn])
    R = rot_x(a) @ rot_y(b) @ rot_z(c) @ TO_FACE
    middle = np.array([*camera.normalise(np.array([at]))[0], 1.0]) * distance
    return R, middle - R @ np.array([*board.size / 2, 0.0])


# A set as a careful person takes it: tilted left, right, up and down, over the whole picture.
CAREFUL = [
    (35, 0, 5, (200, 160), 1.0), (-35, 0, -10, (430, 170), 1.0), (0, 35, 0, (210, 320), 1.0),
    (0, -35, 15, (430, 310), 1.0), (30, 30, 90, (330, 240), 1.0), (-30, 30, 45, (160, 240), 1.1),
    (25, -30, -45, (480, 240), 1.1), (-30, -25, 180, (320, 130), 1.1), (10, 5, 0, (320, 350), 0.9),
    (40, 10, 30, (150, 120), 1.3), (-20, 40, 60, (500, 380), 1.3), (20, -40, 120, (140, 370), 1.3),
    (-40, -10, 150, (510, 110), 1.3),
]  # fmt: skip


def floor_picture(camera: FixedCamera, R_world_board, t_world_board, **options):
    """Return what a fixed camera sees of a board that lies somewhere in the world."""
    R = camera.R_world_camera.T @ R_world_board
    t = camera.to_camera(np.asarray(t_world_board)[None])[0]
    return photograph(R, t, camera=camera.intrinsics, **options)


def floor_depth(camera: FixedCamera, height=0.0, noise=0.0, seed=0, scale=1.0):
    """Return the depth image [mm] of a plane at z = `height`, rounded, with `noise` [m] at 3 m."""
    k = camera.intrinsics
    u, v = np.meshgrid(np.arange(k.width), np.arange(k.height))
    rays = np.column_stack([k.normalise(np.column_stack([u.ravel(), v.ravel()])), np.ones(u.size)])
    z = (height - camera.t_world_camera[2]) / (rays @ camera.R_world_camera[2])
    z = z * scale + np.random.default_rng(seed).normal(0.0, 1.0, z.shape) * noise * (z / 3.0) ** 2
    return np.clip(1000.0 * z, 0, 65535).round().astype(np.uint16).reshape(k.height, k.width)
