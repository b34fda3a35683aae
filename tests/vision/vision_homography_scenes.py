"""Synthetic pairs of views with known motion, for the homography tests and the benchmark."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from noctule.geometry import rot_x, rot_y, rot_z

FOCAL, WIDTH, HEIGHT = 510.0, 856, 480


@dataclass(frozen=True)
class Pair:
    m_ref: np.ndarray
    m_cur: np.ndarray
    yaw: float
    t: np.ndarray  # harmonic mean depths of the true matches
    depth: np.ndarray
    good: np.ndarray
    roll: float
    pitch: float


def depths(kind, m, rng):
    """Depth of the points seen at m: a tilted wall, a room with furniture, or a loose cloud."""
    n = len(m)
    base = rng.uniform(1.5, 5.0)
    if kind == "planar":
        a, b = rng.normal(0, 0.35, 2) * [1.0, 0.5]
        return base / np.clip(1 + a * m[:, 0] + b * m[:, 1], 0.25, None)
    if kind == "room":  # back wall, side walls, floor and ceiling, and objects in front of them
        wall, side, floor, top = base, rng.uniform(1.0, 2.5), 1.0, rng.uniform(1.2, 2.0)
        z = np.minimum(wall, side / np.maximum(np.abs(m[:, 0]), 1e-9))
        z = np.minimum(z, np.where(m[:, 1] > 0, floor, top) / np.maximum(np.abs(m[:, 1]), 1e-9))
        near = rng.random(n) < 0.3
        return np.where(near, z * rng.uniform(0.4, 0.9, n), z)
    if kind == "cloud":
        return rng.uniform(0.5, 1.6, n) * base
    if kind == "two":  # a wall and something close before it
        return np.where(rng.random(n) < 0.25, 0.35, 1.0) * base * rng.uniform(0.97, 1.03, n)
    raise ValueError(kind)


def make_pair(kind, n, rng, *, baseline, yaw_max=0.28, noise_px=0.3, attitude=0.0, outliers=0.0):
    """Draw a pair of views; `noise_px` is put on both images, t has the length `baseline` [m]."""
    half = np.array([WIDTH, HEIGHT]) / 2 / FOCAL
    for _ in range(200):
        count = 12 * n + 100
        m = rng.uniform(-1, 1, (count, 2)) * half
        z = depths(kind, m, rng)
        x = np.column_stack([m, np.ones(count)]) * z[:, None]
        yaw = rng.uniform(-yaw_max, yaw_max)
        roll, pitch = rng.normal(0, 1, 2) * attitude
        v = rng.normal(size=3) * [1.0, 0.4, 1.0]
        t = baseline * v / np.linalg.norm(v) if baseline else np.zeros(3)
        y = x @ (rot_z(roll) @ rot_x(pitch) @ rot_y(yaw)).T + t
        m2 = y[:, :2] / y[:, 2:]
        seen = (y[:, 2] > 0.2) & (np.abs(m2) < half).all(axis=1)
        if seen.sum() >= n:
            break
    else:
        raise RuntimeError("no overlap")
    pick = np.flatnonzero(seen)[:n]
    m, m2, z = m[pick], m2[pick], z[pick]
    sd = noise_px / FOCAL
    good = np.ones(n, bool)
    m = m + rng.normal(0, sd, m.shape)
    m2 = m2 + rng.normal(0, sd, m2.shape)
    k = round(outliers * n)
    if k:
        bad = rng.permutation(n)[:k]
        m2[bad] = rng.uniform(-1, 1, (k, 2)) * half
        good[bad] = False
    return Pair(m, m2, yaw, t * np.mean(1 / z[good]), z, good, roll, pitch)


def angle_deg(a, b):
    """Angle between two vectors [deg]."""
    c = a @ b / (np.linalg.norm(a) * np.linalg.norm(b))
    return float(np.degrees(np.arccos(np.clip(c, -1, 1))))
