"""A structured-light depth sensor: what it makes of exact depths.

A projector to the right of the camera throws dots; where the camera sees them tells the disparity, in
eighths of a pixel. So depth comes in steps that grow with its square, what the projector cannot reach has
none (shadows on the left of near things), and at edges dots of two surfaces mix.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from noctule.camera import PinholeCamera
from noctule.geometry import Array
from noctule.simulation.ceiling.casting import Canvas, Image
from noctule.simulation.ceiling.spec import CeilingSpec

_SLACK = 512  # a frame takes a window of the noise at a place of its own, this many places each way
_NOISE_UNIT = 32  # of the 8-bit noise is one sd
_SHIFT_BLUR, _NOISE_BLUR, _VEIL_BLUR = 1.0, 2.5, 2.5  # [px], neighbours share errors: the matching window
_SMOOTH_SHARE = 0.6  # of the noise's variance is shared by neighbours
BORDER = 3  # [px], most by which an edge is displaced; pixels this near to the frame are not


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
        du, dv = (
            np.clip(np.rint(spec.sensor.sideways_px * _smooth(rng, size, _SHIFT_BLUR)), -BORDER, BORDER)
            for _ in range(2)
        )
        self._shift = (dv * camera.width + du).astype(np.int16)
        self._chance = rng.integers(0, 65536, size, dtype=np.uint16)
        # The ranks of a smooth field are uniform: patches, not dots.
        order = np.argsort(_smooth(rng, size, _VEIL_BLUR), axis=None)
        self._veil = np.empty(size, np.uint16)
        self._veil.flat[order] = np.arange(order.size) * 65536 // order.size

    def errors(self, number: int) -> tuple[NDArray[Any], ...]:
        """Return windows (height, width) of a frame: noise, noise, shift in the flat image [px], chance."""
        rng = np.random.default_rng([*self._entropy, number])
        fields = (self._noise, self._noise, self._shift, self._chance)
        return tuple(self._window(field, rng) for field in fields)

    def veil(self, number: int) -> NDArray[np.uint16]:
        """Return what opacity is compared with in a frame (height, width): 0 to 65535, in patches."""
        return self._window(self._veil, np.random.default_rng([*self._entropy, number, 1]))

    def _window(self, field: NDArray[Any], rng: np.random.Generator) -> NDArray[Any]:
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
        edge = s.edge_px / self._shadow if self._shadow > 0.0 else np.inf
        self._loss = np.array([self._shadow, edge, s.edge_holes, s.dropouts, s.least_echo])
        self._noise = s.noise_steps / _NOISE_UNIT / np.sqrt(2.0)
        self._table = self._depths(spec.nearest_m, spec.farthest_m)

    def _depths(self, nearest: float, farthest: float) -> NDArray[np.uint16]:
        """Return the depth [mm] of every disparity [steps]."""
        disparity = np.arange(int(self._steps / nearest) + 2)
        z = self._steps / np.maximum(disparity, 1e-9)
        return np.where((z >= nearest) & (z <= farthest), np.rint(1000.0 * z), 0.0).astype(np.uint16)

    def lose(self, canvas: Canvas, loss: NDArray[np.uint16]) -> None:
        """Write to `loss` (height, width) how probable it is that a pixel has no depth, 0 to 65535.

        Because the projector does not reach it, because it is at an edge, or because too little comes back.
        Only what the parts on the canvas change is written; the rest must be there already.
        """
        _lose(canvas.nearness, canvas.echo, canvas.owner, canvas.spans, loss, self._loss)

    def sense(self, number: int, canvas: Canvas, loss: NDArray[np.uint16]) -> NDArray[np.uint16]:
        """Return the depth image [mm] (height, width) of frame `number`."""
        out = np.empty(loss.shape, np.uint16)
        noise_a, noise_b, shift, chance = self.bank.errors(number)
        fields = (canvas.nearness, loss, noise_a, noise_b, shift, chance)
        _sense(*fields, self._table, out, self._steps, self._noise)
        return out


@njit(cache=True, nogil=True, error_model="numpy")
def _lose(
    nearness: Image,
    echo: Image,
    owner: NDArray[np.int16],
    spans: NDArray[np.int32],
    loss: NDArray[np.uint16],
    settings: Array,
) -> None:
    height, width = nearness.shape
    scale, edge, edge_holes, dropouts, least = settings
    for v in range(height):
        above, below = max(v - 1, 0), min(v + 1, height - 1)
        left = min(spans[above, 0], spans[v, 0], spans[below, 0])
        right = min(max(spans[above, 1], spans[v, 1], spans[below, 1]) + 2, width)
        if left >= right:
            continue
        reach = int(nearness[v].max() * scale) + 2  # [px], how far to the left a shadow falls
        left, end = max(left - reach, 0), min(right + reach, width)
        # The nearest disparity in every column of the projector's own picture; epipolar lines are the rows.
        first = np.zeros(width + reach + 2, np.float32)
        for u in range(left, end):
            d = nearness[v, u] * scale
            c = int(u - d + reach)
            first[c] = max(first[c], d)
            first[c + 1] = max(first[c + 1], d)
        for u in range(left, right):
            n = nearness[v, u]
            d = n * scale
            # Up to one pixel of disparity is the slope of a surface, not something before it.
            if n <= 0.0 or d + 1.0 < first[int(u - d + reach + 0.5)]:
                loss[v, u] = 65535
                continue
            jump = max(abs(nearness[v, max(u - 2, 0)] - n), abs(nearness[v, min(u + 2, width - 1)] - n))
            jump = max(jump, abs(nearness[above, u] - n), abs(nearness[below, u] - n))
            if jump <= edge and owner[v, u] < 0:
                continue
            weak = (least / max(echo[v, u] * n * n, 1e-9)) ** 3
            kept = (1.0 - dropouts) / (1.0 + weak)
            if jump > edge:
                kept *= 1.0 - edge_holes
            loss[v, u] = int(65535.0 * (1.0 - kept))


@njit(cache=True, nogil=True)
def _sense(
    nearness: Image,
    loss: NDArray[np.uint16],
    noise_a: NDArray[np.int8],
    noise_b: NDArray[np.int8],
    shift: NDArray[np.int16],
    chance: NDArray[np.uint16],
    table: NDArray[np.uint16],
    out: NDArray[np.uint16],
    steps: float,
    noise: float,
) -> None:
    height, width = nearness.shape
    flat_nearness, flat_loss = nearness.ravel(), loss.ravel()
    last = len(table) - 1
    for v in range(height):
        inside = BORDER <= v < height - BORDER
        for u in range(width):
            at = v * width + u
            if inside and BORDER <= u < width - BORDER:
                at += shift[v, u]
            d = int(flat_nearness[at] * steps + noise * (noise_a[v, u] + noise_b[v, u]) + 0.5)
            z = table[min(max(d, 0), last)]
            # A chance of 65535 loses what is lost for certain.
            out[v, u] = z if chance[v, u] >= flat_loss[at] and flat_loss[at] < 65535 else 0
