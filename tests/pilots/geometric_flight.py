"""Flights without pictures: the law by progress, a first-order vehicle, and sightings made from geometry.

The law never sees the truth: it is handed directions in mean depths whose noise is partly shared between
ticks, bearings of edges, all one frame old, and what the vehicle reports of itself, or nothing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from noctule.estimation.odometry import Odometry
from noctule.geometry import rot_z, wrap_angle
from noctule.messages import Limits
from noctule.pilots.progress import LinkGeometry, ProgressLaw, Sighting
from noctule.pilots.settings import PilotSettings

DT = 1.0 / 30.0
LAG, YAW_LAG = 0.3, 0.2  # [s]
LEVER = np.array([0.09, 0.0, 0.0])
HULL = 0.2  # [m], half the width
GUSTS = 0.6  # [m/s^2], white at 300 Hz
HALF_VIEW = np.arctan(428.0 / 510.0)  # [rad]
EDGE_NOISE = 0.001  # [rad]
SHARED, OWN = 0.002, 0.0015  # [mean depths] of t; the first is kept for 20 ticks or so
SHARED_YAW, OWN_YAW = 0.0005, 0.0005  # [rad]
COVARIANCE = np.diag([0.0007, 0.002, 0.002, 0.002]) ** 2
DEPTH = 3.2  # [m]

Target = tuple[float, float, float, float]  # x, y, z [m], heading [rad]
Disc = tuple[float, float, float]  # x, y, radius [m]
Tamper = Callable[[float, Sighting], Sighting | None]


@dataclass(frozen=True)
class Flown:
    outcome: str  # "reached", "collided" or "stuck"
    duration: float  # [s]
    error: float  # [m]
    yaw_error: float  # [deg]
    clearance: float  # [m], hull to the nearest column, inf without columns
    stamps: np.ndarray  # (n,)
    positions: np.ndarray  # (n, 3)
    headings: np.ndarray  # (n,)
    commands: np.ndarray  # (n, 4)
    images: np.ndarray  # (n,), image that is flown to
    detours: np.ndarray  # (n,), activation of the avoidance
    law: ProgressLaw

    @property
    def steps(self) -> tuple[float, float]:
        """The largest change of the linear command [m/s] and of the yaw rate [rad/s] in a tick."""
        change = np.diff(np.vstack([np.zeros(4), self.commands]), axis=0)
        return float(np.linalg.norm(change[:, :3], axis=1).max()), float(np.abs(change[:, 3]).max())


@dataclass
class Body:
    """A first-order vehicle in gusts."""

    position: np.ndarray
    yaw: float
    v: np.ndarray = field(default_factory=lambda: np.zeros(3))  # world
    rate: float = 0.0

    @property
    def camera(self) -> np.ndarray:
        return self.position + rot_z(self.yaw) @ LEVER

    def move(self, command: np.ndarray, rng: np.random.Generator) -> None:
        h = DT / 10.0
        for _ in range(10):
            wanted = rot_z(self.yaw) @ command[:3]
            self.v = self.v + ((wanted - self.v) / LAG + rng.normal(0.0, GUSTS, 3)) * h
            self.rate += (command[3] - self.rate) / YAW_LAG * h
            self.position = self.position + self.v * h
            self.yaw += self.rate * h


def camera_at(target: Target) -> np.ndarray:
    return np.array(target[:3]) + rot_z(target[3]) @ LEVER


def links_between(targets: Sequence[Target], depth: float) -> tuple[LinkGeometry, ...]:
    return tuple(
        LinkGeometry(rot_z(-a[3]) @ (camera_at(b) - camera_at(a)) / depth, 1.0) for a, b in pairwise(targets)
    )


def edges_of(columns: Sequence[Disc], camera: np.ndarray, yaw: float, rng: np.random.Generator) -> list:
    """Bearings of the edges of the columns in sight; None for an edge out of the picture."""
    found = []
    for x, y, radius in columns:
        ahead = (rot_z(-yaw) @ (np.array([x, y, camera[2]]) - camera))[:2]
        if ahead[0] < 0.05:
            continue
        bearing, half = np.arctan2(ahead[1], ahead[0]), np.arcsin(min(radius / np.hypot(*ahead), 0.99))
        left, right = np.array([bearing + half, bearing - half]) + rng.normal(0.0, EDGE_NOISE, 2)
        if right < HALF_VIEW and left > -HALF_VIEW:
            found.append((left if left < HALF_VIEW else None, right if right > -HALF_VIEW else None))
    return found


class Sight:
    """Turns geometry into sightings, with errors that neighbouring ticks share."""

    def __init__(self, targets: Sequence[Target], depth: float, rng: np.random.Generator) -> None:
        self.targets, self.depth, self.rng = targets, depth, rng
        self.shared = np.zeros((len(targets), 4))

    def of(self, index: int, pose, camera: np.ndarray, yaw: float) -> Sighting:
        if self.rng.random() < 1.0 / 20.0:
            self.shared[index] = self.rng.normal(0.0, 1.0, 4) * [SHARED_YAW, SHARED, SHARED, SHARED]
        own = self.rng.normal(0.0, 1.0, 4) * [OWN_YAW, OWN, OWN, OWN]
        off = self.shared[index] + own
        target = self.targets[index]
        t = rot_z(-yaw) @ (camera_at(target) - camera) / self.depth + off[1:]
        return Sighting(index, pose, t, wrap_angle(yaw - target[3]) + off[0], COVARIANCE)


def drawn_start(rng: np.random.Generator) -> Target:
    """A hover near (0, 0, 1): +-0.05 m, +-3 deg."""
    x, y, z = np.array([0.0, 0.0, 1.0]) + rng.uniform(-0.05, 0.05, 3)
    return x, y, z, np.radians(rng.uniform(-3.0, 3.0))


def fly(
    targets: Sequence[Target],
    columns: Sequence[Disc] = (),
    *,
    seed: int = 0,
    start: Target | None = None,
    report: bool = True,
    depth: float = DEPTH,
    settings: PilotSettings | None = None,
    tamper: Tamper | None = None,
    blind: bool = False,
    time_limit: float = 45.0,
    late: int = 1,
) -> Flown:
    """Fly the law `noctule` through `targets`.

    `report`: whether the vehicle reports velocity (with noise and a bias) and yaw. `depth` [m] is the mean
    depth of the scene, which the law does not know. `tamper` may change or withhold (None) any sighting; it
    is told the time. A `blind` flight is shown no columns. Pictures come `late` frames after their exposure.
    """
    rng = np.random.default_rng([seed, 0xF1E5])
    start = drawn_start(rng) if start is None else start
    body = Body(np.array(start[:3]), start[3])
    links = links_between(targets, depth)
    law = ProgressLaw(settings or PilotSettings(), Limits(), LEVER, links)
    odometry, sight = Odometry(LAG), Sight(targets, depth, rng)
    bias = rng.normal(0.0, 0.01, 3)
    command, clearance, outcome = np.zeros(4), np.inf, "stuck"
    frames: list[tuple[float, np.ndarray, float]] = []
    rows: list[tuple] = []
    for n in range(int(time_limit / DT)):
        t = n * DT
        v = rot_z(-body.yaw) @ body.v + bias + rng.normal(0.0, 0.02, 3)
        pose = odometry.step(t, command, v if report else None, body.yaw if report else None)
        if len(frames) >= late:
            stamp, camera, yaw = frames[-late]
            law.move(odometry.at(stamp))
            for index in (law.k, law.k + 1):
                if index < len(targets):
                    seen = sight.of(index, odometry.at(stamp), camera, yaw)
                    seen = seen if tamper is None else tamper(t, seen)
                    if seen is not None:
                        law.sight(seen)
            law.detour.see([] if blind else edges_of(columns, camera, yaw, rng))
        if law.k in law.targets:
            command = law.step(pose, command, DT)
        frames.append((t, body.camera, body.yaw))
        rows.append((t, body.position, body.yaw, command, law.k, law.detour.activation.h))
        body.move(command, rng)
        gaps = [np.hypot(body.position[0] - x, body.position[1] - y) - r - HULL for x, y, r in columns]
        clearance = min([clearance, *gaps])
        if clearance < 0.0 or law.arrived:
            outcome = "collided" if clearance < 0.0 else "reached"
            break
    last = targets[-1]
    stamps, positions, headings, commands, images, detours = (np.array(x) for x in zip(*rows, strict=True))
    return Flown(
        outcome,
        t,
        float(np.linalg.norm(body.position - np.array(last[:3]))),
        abs(float(np.degrees(wrap_angle(body.yaw - last[3])))),
        clearance,
        stamps,
        positions,
        headings,
        commands,
        images,
        detours,
        law,
    )
