"""Teaching: a simulated flight through given poses that takes the key images of a path.

The teacher has eyes: it flies on the referee's truth, in the same room without its columns and in calm air.
What it hands on is pictures and reported attitudes, as a person with a remote control would.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections import deque
from importlib.resources import files
from pathlib import Path

import numpy as np

from noctule.control.limiter import limit_command
from noctule.errors import NoctuleError
from noctule.flight.mission import Mission, PathPose
from noctule.flight.path_folder import Shot, save_path
from noctule.flight.rig import Rig
from noctule.geometry import Pose, rot_z, wrap_angle
from noctule.messages import Command, Limits, Truth, VehicleState
from noctule.simulation import SimulatedWorld

_GAIN = 0.8  # [1/s], critically damped with a lag of 0.3 s
_NEAR = 0.002  # [m]
_TURNED = np.radians(0.1)
_STILL = 0.004  # [m/s]
_PATIENCE = 60.0  # [s] per pose
_LATE = 1.0  # [s], no picture is older


class TeachError(NoctuleError):
    """A pose that the teaching flight cannot reach."""


def position_law(truth: Truth, goal: Pose, previous: Command, limits: Limits, dt: float) -> Command:
    """Return the velocity toward `goal`, proportional to the distance, within the limits."""
    to_goal = rot_z(-truth.pose.yaw) @ (goal.position - truth.pose.position)
    turn = wrap_angle(goal.yaw - truth.pose.yaw)
    wanted = _GAIN * np.array([*to_goal, turn])
    return Command.from_array(limit_command(wanted, previous.as_array(), limits, dt))


def fly_through(rig: Rig, goals: list[Pose], limits: Limits, rate: float) -> list[Shot]:
    """Fly to each goal, settle there, take a picture; the rig has a referee and hovers.

    A shot's truth and attitude are those at its exposure, not at its delivery. Raises TeachError.
    """
    referee, camera = rig.referee, rig.camera
    assert referee is not None
    assert camera is not None
    dt, tick, begin = 1.0 / rate, 0, rig.clock.now()
    previous = Command()
    past: deque[tuple[Truth, VehicleState]] = deque(maxlen=int(_LATE * rate) + 2)

    def step(goal: Pose) -> Truth:
        nonlocal previous, tick
        tick += 1
        rig.clock.sleep_until(begin + tick * dt)
        truth = referee.truth()
        past.append((truth, rig.vehicle.state()))
        previous = rig.vehicle.send(position_law(truth, goal, previous, limits, dt), 10.0 * dt)
        return truth

    shots = []
    for number, goal in enumerate(goals):
        arrived = rig.clock.now()
        while not _settled(truth := step(goal), goal):
            if truth.contacts or rig.clock.now() - arrived > _PATIENCE:
                raise TeachError(_why_not(number, goal, truth))
        settled = rig.clock.now()
        while (picture := camera.latest(_LATE)).stamp < settled:
            step(goal)
        truth, state = min(past, key=lambda p: abs(p[0].stamp - picture.stamp))
        shots.append(Shot(picture.pixels, state.roll or 0.0, state.pitch or 0.0, truth.pose))
    return shots


def _settled(truth: Truth, goal: Pose) -> bool:
    return (
        float(np.linalg.norm(goal.position - truth.pose.position)) < _NEAR
        and abs(wrap_angle(goal.yaw - truth.pose.yaw)) < _TURNED
        and float(np.linalg.norm(truth.v_world)) < _STILL
    )


def _why_not(number: int, goal: Pose, truth: Truth) -> str:
    x, y, z = goal.position
    away = float(np.linalg.norm(goal.position - truth.pose.position))
    what = (
        f"touched {', '.join(truth.contacts)}"
        if truth.contacts
        else f"was still {away:.2f} m away after 60 s"
    )
    return (
        f"teaching: on the way to pose {number} ({x:g}, {y:g}, {z:g}) the vehicle {what}; "
        "is the pose inside the room and free?"
    )


def _poses(mission: Mission) -> tuple[PathPose, ...]:
    assert mission.path is not None
    assert mission.path.poses is not None
    return mission.path.poses


def _fingerprint(mission: Mission, seed: int) -> str:
    """Return a name for what a taught path depends on, the simulator's own source included."""
    room = mission.room.model_copy(update={"columns": (), "seed": seed})
    parts = [
        *(
            g.model_dump_json()
            for g in (room, mission.vehicle, mission.camera, mission.start, mission.limits)
        ),
        json.dumps([_poses(mission), seed, mission.pilot.features]),
    ]
    source = files("noctule.simulation")
    digest = hashlib.sha256("\n".join(parts).encode())
    for file in sorted(source.iterdir(), key=lambda f: f.name):
        if file.name.endswith(".py"):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def take_path(mission: Mission, seed: int, folder: Path) -> Path:
    """Fly the poses of a mission in its room, without columns and in calm air; write the path into `folder`.

    Raises TeachError, PathFolderError.
    """
    room = mission.room.model_copy(update={"columns": (), "seed": seed})
    # Whoever teaches flies well, whatever the vehicle itself measures.
    vehicle = mission.vehicle.model_copy(update={"gusts": 0.0, "pushes": (), "navdata": None})
    start = mission.start.pose(seed)
    goals = [Pose(np.array(p[:3]), wrap_angle(float(np.radians(p[3])))) for p in _poses(mission)]
    with SimulatedWorld(room, vehicle, mission.camera, start, seed) as world, world.vehicle:
        world.camera.open()
        rig = Rig(world.clock, world.vehicle, world.camera, world.referee)
        shots = fly_through(rig, goals, mission.limits.values(), mission.flight.rate_hz)
        save_path(folder, shots, world.camera.intrinsics, world.camera.mount, mission.pilot.features)
    return folder


def teach(mission: Mission, seed: int, out: Path) -> Path:
    """Return the path folder of a mission with poses, taught now or found under `out`/paths.

    Raises TeachError, PathFolderError.
    """
    safe = "".join(c if c.isalnum() or c in "-_" else "-" for c in mission.name)
    folder = out / "paths" / f"{safe}-{seed}-{_fingerprint(mission, seed)}"
    if (folder / "path.toml").exists():
        return folder
    # Written beside and moved: two flights that teach the same path do not meet halfway.
    part = take_path(mission, seed, folder.with_name(f"{folder.name}.{os.getpid()}"))
    try:
        part.rename(folder)
    except OSError:
        shutil.rmtree(part, ignore_errors=True)
    return folder
