"""Real photographs that scikit-image ships, at the camera size, and views of them that are known exactly."""

from functools import cache

import cv2
import numpy as np
import skimage.data

WIDTH, HEIGHT = 856, 480
CENTRE = np.array([[1.0, 0.0, (WIDTH - 1) / 2], [0.0, 1.0, (HEIGHT - 1) / 2], [0.0, 0.0, 1.0]])
NAMES = ("astronaut", "coffee", "chelsea", "rocket")


@cache
def photograph(name, width=WIDTH, height=HEIGHT):
    pixels = getattr(skimage.data, name)()
    scale = max(width / pixels.shape[1], height / pixels.shape[0])
    size = (int(np.ceil(pixels.shape[1] * scale)), int(np.ceil(pixels.shape[0] * scale)))
    pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)
    top, left = (pixels.shape[0] - height) // 2, (pixels.shape[1] - width) // 2
    cut = np.ascontiguousarray(pixels[top : top + height, left : left + width])
    cut.setflags(write=False)
    return cut


def motion(scale=1.0, angle=0.0, right=0.0, down=0.0, tilt=0.0):
    """The homography (3, 3) in pixels of a view turned and scaled about the picture's centre."""
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    H = np.array([[c, -s, right], [s, c, down], [tilt, 0.0, 1.0]])
    return CENTRE @ H @ np.linalg.inv(CENTRE)


def moved(H, p):
    q = np.column_stack([p, np.ones(len(p))]) @ H.T
    return q[:, :2] / q[:, 2:]


def view(name, H, noise=2.0, seed=0):
    """The photograph seen through H, with what lies around its middle 600 x 336 really there, and noise."""
    big = photograph(name, 2 * WIDTH, 2 * HEIGHT)
    whole = np.array([[1.0, 0.0, WIDTH - 0.5], [0.0, 1.0, HEIGHT - 0.5], [0.0, 0.0, 1.0]])
    G = H @ CENTRE @ np.diag([0.7, 0.7, 1.0]) @ np.linalg.inv(whole)
    soft = cv2.GaussianBlur(big, (0, 0), 0.7)
    flat = cv2.warpPerspective(soft, G, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    return noisy(flat, noise, seed)


def noisy(pixels, noise, seed=0):
    rng = np.random.default_rng(seed)
    return np.clip(np.rint(pixels + rng.normal(0.0, noise, pixels.shape)), 0, 255).astype(np.uint8)
