"""Poses of the quadrotor below the camera: a flight by hand, and poses spread over what the camera sees."""

from __future__ import annotations

import math

import numpy as np

from noctule.camera import FixedCamera
from noctule.errors import NoctuleError
from noctule.geometry import Array, Pose, wrap_angle
from noctule.simulation.ceiling.spec import CeilingSpec

HEIGHTS = (0.4, 1.9)  # [m], where the camera hangs high enough
RADIUS = 0.33  # [m], of a ball about the body's origin that holds every part of the quadrotor
_FALL = 9.81  # [m/s^2]
_LAGS = 4  # first-order lags in a row: a step of the stick is smooth up to its third derivative
_LAG = 0.5  # [s], time constant of each
_STEP = 0.01  # [s]
_DWELL = (2.0, 4.0)  # [s], how long a person flies toward one place
_TURN, _TURN_BACK = (0.4, 1.4), 0.15  # [rad] meanwhile, and how often the other way round
_TILT = math.radians(2.5)  # sd of roll and pitch of single poses
_TRIES = 10000
_LOWEST_TOP, _TOP_STEP = 0.8, 0.05  # [m]
_AROUND = 0.1  # [m], room about the quadrotor at the greatest height


class NoViewError(NoctuleError):
    """A ceiling camera below which nothing can fly in view."""

    def __init__(self, camera: FixedCamera) -> None:
        x, y, z = camera.t_world_camera
        super().__init__(
            f"ceiling camera at ({x:.2f}, {y:.2f}, {z:.2f}) m: it has no room in view for a whole quadrotor "
            f"to fly {HEIGHTS[0]} to {_LOWEST_TOP} m above the floor; hang it higher or point it down"
        )


def heights(camera: FixedCamera) -> tuple[float, float]:
    """Return between which heights [m] to fly: HEIGHTS, less far up below a camera that hangs low.

    Raises NoViewError.
    """
    k = camera.intrinsics
    middle = k.normalise(np.array([[0.5 * (k.width - 1), 0.5 * (k.height - 1)]]))[0]
    ray = camera.R_world_camera @ np.append(middle, 1.0)
    for top in np.arange(HEIGHTS[1], _LOWEST_TOP - 1e-9, -_TOP_STEP).tolist():
        along = (top - camera.t_world_camera[2]) / min(ray[2], -1e-9)
        if sees_whole(camera, camera.t_world_camera + along * ray, RADIUS + _AROUND):
            return HEIGHTS[0], top
    raise NoViewError(camera)


def spread_poses(seed: int, n: int, spec: CeilingSpec | None = None) -> list[Pose]:
    """Return n independent poses, uniform over the volume in which the camera sees all of the quadrotor.

    Headings are uniform; roll and pitch are those of slow flight, 2.5 degrees sd.
    """
    rng = np.random.default_rng([seed, 5])
    camera = (CeilingSpec() if spec is None else spec).camera
    poses, span = [], heights(camera)
    for _ in range(n):
        yaw = wrap_angle(float(rng.uniform(-math.pi, math.pi)))
        roll, pitch = (float(a) for a in rng.normal(0.0, _TILT, 2))
        poses.append(Pose(_place(camera, rng, span), yaw, roll, pitch))
    return poses


def manual_flight(
    seed: int, seconds: float, rate: float, spec: CeilingSpec | None = None
) -> list[tuple[float, Pose]]:
    """Return (stamp [s], pose) `rate` times a second of what a person flies where the camera sees it.

    It wanders over the volume of `spread_poses`, never leaves it, and turns through all headings; roll and
    pitch are those that its accelerations need.
    """
    rng = np.random.default_rng([seed, 6])
    camera = (CeilingSpec() if spec is None else spec).camera
    count = math.ceil(seconds / _STEP) + 2
    wanted, (low, high) = np.empty((count, 4)), heights(camera)
    yaw, way, k = float(rng.uniform(-math.pi, math.pi)), 1.0, 0
    while k < count:
        dwell = math.ceil(float(rng.uniform(*_DWELL)) / _STEP)
        # Mostly on in the same sense, so that a flight of a minute shows every heading.
        way = -way if rng.random() < _TURN_BACK else way
        yaw += way * float(rng.uniform(*_TURN))
        # More often high or low than between, so that the lags let it reach both ends.
        z = low + (high - low) * (0.5 - 0.5 * math.cos(math.pi * rng.random()))
        wanted[k : k + dwell] = [*_place(camera, rng, (z, z)), yaw]
        k += dwell
    flown = wanted
    for _ in range(_LAGS):
        flown = _lagged(flown)
    # Differences in the middle: the acceleration of the step itself.
    acceleration = np.zeros((count, 3))
    acceleration[1:-1] = np.diff(flown[:, :3], 2, axis=0) / _STEP**2
    stamps = np.arange(math.floor(seconds * rate + 1e-9)) / rate
    return [(float(t), _leaning(t, flown, acceleration)) for t in stamps]


def _leaning(stamp: float, flown: Array, acceleration: Array) -> Pose:
    at = stamp / _STEP
    k = min(int(at), len(flown) - 2)
    share = at - k
    x, y, z, yaw = (1.0 - share) * flown[k] + share * flown[k + 1]
    ax, ay, az = (1.0 - share) * acceleration[k] + share * acceleration[k + 1]
    forward, left = ax * math.cos(yaw) + ay * math.sin(yaw), ay * math.cos(yaw) - ax * math.sin(yaw)
    lift = _FALL + az
    # The thrust's direction is R_y(pitch) R_x(roll) e_z, as in the simulated vehicle.
    roll = math.atan2(-left, math.hypot(forward, lift))
    return Pose(np.array([x, y, z]), wrap_angle(float(yaw)), roll, math.atan2(forward, lift))


def _lagged(values: Array) -> Array:
    out = values.copy()
    share = 1.0 - math.exp(-_STEP / _LAG)
    for k in range(1, len(out)):
        out[k] = out[k - 1] + share * (values[k] - out[k - 1])
    return out


def _place(camera: FixedCamera, rng: np.random.Generator, heights: tuple[float, float]) -> Array:
    """Draw a place; rejection keeps it uniform. The volume is convex, so ways between places lie in it."""
    low, high = _box(camera, heights)
    for _ in range(_TRIES):
        x = rng.uniform(low, high)
        if sees_whole(camera, x):
            return np.asarray(x)
    raise NoViewError(camera)


def sees_whole(camera: FixedCamera, x: Array, radius: float = RADIUS) -> bool:
    """Return whether a ball about x (3,) [m] lies inside the picture."""
    return bool(camera.inside(x[None])[0] >= radius)


def _box(camera: FixedCamera, heights: tuple[float, float]) -> tuple[Array, Array]:
    """Return a box (low, high), (3,) each, about what the camera sees between two heights [m]."""
    pinhole = camera.intrinsics
    w, h = pinhole.width - 0.5, pinhole.height - 0.5
    corners = np.array([[-0.5, -0.5], [w, -0.5], [-0.5, h], [w, h]])
    rays = np.hstack([pinhole.normalise(corners), np.ones((4, 1))]) @ camera.R_world_camera.T
    if not (rays[:, 2] < 0.0).all():  # a corner that sees no floor
        raise NoViewError(camera)
    below = [z - camera.t_world_camera[2] for z in heights]
    points = np.vstack([camera.t_world_camera + rays * (z / rays[:, 2:3]) for z in below])
    return points.min(axis=0), points.max(axis=0)
