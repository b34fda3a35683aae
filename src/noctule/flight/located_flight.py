"""What a flight along a path in space needs: a taught site, calibrated sensors, the plan, and its pilot."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from noctule.camera import FixedCamera
from noctule.control.paths import PathPlan
from noctule.errors import NoctuleError
from noctule.estimation.sensors import Sensors
from noctule.flight.mission import Mission, check_flyable
from noctule.flight.path_view import require_free
from noctule.flight.teach_ceiling import Progress, teach_ceiling
from noctule.flight.teach_sensors import teach_sensors
from noctule.flight.visual_flight import zipped
from noctule.geometry import Pose
from noctule.localization.sensors_file import SENSORS, load_sensors, save_sensors
from noctule.localization.site import Site, load_site, locator_of, save_site
from noctule.messages import FlightState, Observation, VehicleState
from noctule.pilots import path_follower
from noctule.pilots.located import LocatedPilot
from noctule.pilots.located_factory import make_located_pilot
from noctule.simulation.ceiling import DepthStage, Motion

SITE = "site"
"""The folder, beside the recording, of what the flight's camera was taught."""

_NEAR, _TURNED = 0.005, 0.005  # [m], [rad] that the simulated camera may hang elsewhere than the site's
_SAME_FOCUS = 0.1  # [px]
_WARM_TICKS = 4


class OtherCameraError(NoctuleError):
    """A site of another camera than the one that the mission simulates."""


@dataclass(frozen=True, slots=True)
class LocatedFlight:
    """What flies a path in space below a depth camera."""

    plan: PathPlan
    folder: Path  # of the site
    site: Site
    sensors: Sensors
    pilot: LocatedPilot
    motions: tuple[Motion, ...]  # that the camera sees beside the drone, in simulation

    def zipped(self) -> bytes:
        """Return the site as a zip, with sensors.toml in it."""
        return zipped(file for file in self.folder.iterdir() if file.suffix in (".toml", ".npz"))


def prepare_located(mission: Mission, out: Path, show: Progress) -> LocatedFlight:
    """Teach the simulated camera, or load the site that the mission names, and make the pilot.

    A site that is taught is written into `out`/site. A site without sensors.toml has sensors that nobody
    calibrated: nothing is taken off their measurements.

    Raises
    ------
    MissionFileError, SpacePathFileError
        When the path cannot be flown.
    UnseenPathError
        When the camera does not see all of it, or something stands in it.
    SiteFileError, SiteFormatError, SiteCameraError, OtherCameraError
        When the site that the mission names is not one for its camera.
    """
    plan = check_flyable(mission, f"mission {mission.name}")
    seed, folder = mission.flight.seed, mission.ceiling.site
    if folder is None:
        folder = out / SITE
        site = teach_ceiling(mission.ceiling.spec, mission.room, seed, show)
        sensors = teach_sensors(mission.vehicle, seed)
        save_site(folder, site)
        save_sensors(folder, sensors)
    else:
        site = load_site(folder)
        _require_same_camera(site.camera.camera, mission.ceiling.spec.camera, folder)
        sensors = load_sensors(folder) if (folder / SENSORS).exists() else Sensors()
    require_free(site, plan, f"mission {mission.name}")
    _warm_up(mission, site, sensors, plan)
    people = tuple(person.walker(plan) for person in mission.people)
    motions: tuple[Motion, ...] = (*people, *mission.ceiling.hidings())
    return LocatedFlight(plan, folder, site, sensors, located_pilot(mission, plan, site, sensors), motions)


def located_pilot(mission: Mission, plan: PathPlan, site: Site, sensors: Sensors) -> LocatedPilot:
    """Return the pilot of a mission, which has seen nothing yet; raises DelayTooLongError, FollowerError."""
    located = mission.located
    locator = locator_of(site, located.locator)
    limits = mission.limits.values()
    return make_located_pilot(located, plan, locator, sensors, mission.known_vehicle, limits)


def _warm_up(mission: Mission, site: Site, sensors: Sensors, plan: PathPlan) -> None:
    """Show a pilot that is then thrown away a drone: no tick of the flight compiles code."""
    path_follower.warm_up()
    pilot = located_pilot(mission, plan, site, sensors)
    pilot.settings = pilot.settings.model_copy(
        update={"doubt": pilot.settings.doubt.model_copy(update={"search_poses": 1})}
    )
    stage, pose = DepthStage(mission.ceiling.spec, mission.flight.seed, mission.room), _seen_place(site)
    dt = 1.0 / mission.flight.rate_hz
    for tick in range(_WARM_TICKS + mission.located.locator.start_frames):
        now = tick * dt
        state = VehicleState(now, FlightState.FLYING, 0.0, 0.0, 0.0, np.zeros(3), float(pose.position[2]))
        pilot.step(Observation(now, state, depth=stage.frame(now, pose)))


def _seen_place(site: Site) -> Pose:
    """Return a pose in the middle of what the camera sees, 1 m above the floor."""
    camera = site.camera.camera
    ray = camera.R_world_camera[:, 2]
    eye = camera.t_world_camera
    return Pose(eye + ray * ((1.0 - eye[2]) / min(float(ray[2]), -0.1)), 0.0)


def _require_same_camera(taught: FixedCamera, simulated: FixedCamera, folder: Path) -> None:
    """Raise OtherCameraError unless both hang in the same place and see alike."""
    here, there = simulated.intrinsics, taught.intrinsics
    same_size = (here.width, here.height) == (there.width, there.height)
    focus = max(abs(a - b) for a, b in zip(here.focal, there.focal, strict=True))
    away = float(np.linalg.norm(simulated.t_world_camera - taught.t_world_camera))
    turned = float(np.linalg.norm(simulated.R_world_camera - taught.R_world_camera)) / np.sqrt(2.0)
    if same_size and focus <= _SAME_FOCUS and away <= _NEAR and turned <= _TURNED:
        return
    x, y, z = simulated.t_world_camera
    u, v, w = taught.t_world_camera
    raise OtherCameraError(
        f"site {folder}: its camera has {there.width}x{there.height} px and hangs at ({u:.2f}, {v:.2f}, "
        f"{w:.2f}) m, the mission's has {here.width}x{here.height} px and hangs at ({x:.2f}, {y:.2f}, "
        f"{z:.2f}) m, turned by {np.degrees(turned):.1f} deg; leave `site` out to have it taught, or put the "
        "site's camera into [ceiling]"
    )
