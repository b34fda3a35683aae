"""A structured-light depth sensor: what it makes of exact depths.

A projector to the right of the camera throws dots; where the camera sees them tells the disparity, in
eighths of a pixel. So depth comes in steps that grow with its square, what the projector cannot reach has
none (shadows on the left of near things), and at edges dots of two surfaces mix.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from noctule.camera import PinholeCamera
from noctule.simulation.ceiling.spec import CeilingSpec

_SLACK = 512  # a frame takes a window of the noise at a place of its own, this many places each way
_NOISE_UNIT = 32  # of the 8-bit noise is one sd
_SHIFT_BLUR, _NOISE_BLUR = 1.0, 2.5  # [px], how far sensors' errors reach: the matching window's size
_SMOOTH_SHARE = 0.6  # of the noise's variance is shared by neighbours


class NoiseBank:
    """Random fields drawn once; a frame takes windows of them, at places that its number alone decides."""

    def __init__(self, camera: PinholeCamera, spec: CeilingSpec, seed: np.random.SeedSequence) -> None:
        self._entropy = [int(v) for v in seed.generate_state(4)]
        self._size = (camera.height, camera.width)
        size = (camera.height + _SLACK, camera.width + _SLACK)
        rng = np.random.default_rng(self._entropy)
        smooth, white = _smooth(rng, size, _NOISE_BLUR), rng.standard_normal(size, dtype=np.float32)
        noise = np.sqrt(_SMOOTH_SHARE) * smooth + np.sqrt(1.0 - _SMOOTH_SHARE) * white
        self._noise = np.clip(np.rint(_NOISE_UNIT * noise), -127, 127).astype(np.int8)
        shift = np.rint(spec.sensor.sideways_px * _smooth(rng, size, _SHIFT_BLUR))
        self._shift = np.clip(shift, -3, 3).astype(np.int8)
        self._chance = rng.integers(0, 65536, size, dtype=np.uint16)

    def windows(self, number: int) -> tuple[NDArray[np.int8], ...]:
        """Return windows (height, width) of frame `number`: noise, noise, shift along u, shift along v."""
        rng = np.random.default_rng([*self._entropy, number])
        fields = (self._noise, self._noise, self._shift, self._shift)
        return tuple(self._window(field, rng) for field in fields)

    def chances(self, number: int) -> tuple[NDArray[np.uint16], ...]:
        """Return two windows (height, width), uniform from 0 to 65535, of frame `number`."""
        rng = np.random.default_rng([*self._entropy, number, 1])
        return self._window(self._chance, rng), self._window(self._chance, rng)

    def _window(self, field: NDArray, rng: np.random.Generator) -> NDArray:  # type: ignore[type-arg]
        v, u = (int(k) for k in rng.integers(0, _SLACK, 2))
        return field[v : v + self._size[0], u : u + self._size[1]]


def _smooth(rng: np.random.Generator, size: tuple[int, int], blur: float) -> NDArray[np.float32]:
    field = cv2.GaussianBlur(rng.standard_normal(size, dtype=np.float32), (0, 0), blur)
    return np.asarray(field / field.std(), dtype=np.float32)


class DepthSensor:
    """Makes uint16 millimetres of nearness; the errors depend on the frame's number and the seed alone."""

    def __init__(self, camera: PinholeCamera, spec: CeilingSpec, seed: np.random.SeedSequence) -> None:
        s = spec.sensor
        self.bank = NoiseBank(camera, spec, seed)
        self._steps = 1000.0 / s.step_mm  # disparity [steps] at 1 m
        self._shadow = camera.fx * s.baseline_m  # disparity [px] at 1 m
        # From an edge in px of disparity to one in nearness; without a baseline there are no edges.
        self._edge = s.edge_px / self._shadow if self._shadow > 0.0 else np.inf
        self._chances = np.array([s.edge_holes, s.dropouts]) * 65536.0
        self._least = s.least_echo
        self._noise = s.noise_steps / _NOISE_UNIT / np.sqrt(2.0)
        self._table = self._depths(spec.nearest_m, spec.farthest_m)

    def _depths(self, nearest: float, farthest: float) -> NDArray[np.uint16]:
        """Return the depth [mm] of every disparity [steps]."""
        disparity = np.arange(int(self._steps / nearest) + 2)
        z = self._steps / np.maximum(disparity, 1e-9)
        return np.where((z >= nearest) & (z <= farthest), np.rint(1000.0 * z), 0.0).astype(np.uint16)

    def shade(self, nearness: NDArray[np.float32], lit: NDArray[np.bool_], top: int, bottom: int) -> None:
        """Write to rows `top` to `bottom` of `lit` (height, width) what the projector reaches."""
        _shade(nearness, lit, top, bottom, self._shadow)

    def sense(
        self,
        number: int,
        nearness: NDArray[np.float32],
        lit: NDArray[np.bool_],
        echo: NDArray[np.float32],
    ) -> NDArray[np.uint16]:
        """Return the depth image [mm] of frame `number`; `echo` is reflectance x cosine; all (height, width)."""
        out = np.empty(nearness.shape, np.uint16)
        a, b, du, dv = self.bank.windows(number)
        edge, loss = self.bank.chances(number)
        _sense(
            *(nearness, lit, echo, a, b, du, dv, edge, loss, self._table, out),
            *(self._steps, self._noise, self._edge, *self._chances, self._least),
        )
        return out


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _shade(nearness, lit, top, bottom, scale):  # type: ignore[no-untyped-def]
    width = nearness.shape[1]
    most = 1
    for v in range(top, bottom):
        for u in range(width):
            most = max(most, int(nearness[v, u] * scale) + 2)
    # The nearest disparity in every column of the projector's own picture; epipolar lines are the rows.
    first = np.empty(width + most + 2, np.float32)
    for v in range(top, bottom):
        first[:] = 0.0
        for u in range(width):
            d = nearness[v, u] * scale
            c = int(u - d + most)
            first[c] = max(first[c], d)
            first[c + 1] = max(first[c + 1], d)
        for u in range(width):
            d = nearness[v, u] * scale
            # Up to one pixel of disparity is the slope of a surface, not something before it.
            lit[v, u] = d + 1.0 >= first[int(u - d + most + 0.5)]


@njit(cache=True, nogil=True, fastmath=False)  # type: ignore[untyped-decorator]
def _sense(  # type: ignore[no-untyped-def]
    nearness, lit, echo, noise_a, noise_b, du, dv, edge_chance, loss_chance, table, out, steps, noise, edge,
    holes, dropouts, least,
):  # fmt: skip
    height, width = nearness.shape
    for v in range(height):
        for u in range(width):
            sv, su = min(max(v + dv[v, u], 0), height - 1), min(max(u + du[v, u], 0), width - 1)
            n = nearness[sv, su]
            out[v, u] = 0
            if n <= 0.0 or not lit[sv, su]:
                continue
            if edge_chance[v, u] < holes:
                left, right = nearness[sv, max(su - 2, 0)], nearness[sv, min(su + 2, width - 1)]
                above, below = nearness[max(sv - 1, 0), su], nearness[min(sv + 1, height - 1), su]
                jump = max(max(abs(left - n), abs(right - n)), max(abs(above - n), abs(below - n)))
                if jump > edge:
                    continue
            # Half of the rays are lost at the least echo, an eighth of the loss at twice of it.
            weak = least / max(echo[sv, su] * n * n, 1e-9)
            if loss_chance[v, u] < dropouts + 65536.0 * weak * weak * weak / (1.0 + weak * weak * weak):
                continue
            d = int(n * steps + noise * (noise_a[v, u] + noise_b[v, u]) + 0.5)
            if 0 < d < len(table):
                out[v, u] = table[d]
