"""Builds the located pilot of a mission."""

from __future__ import annotations

import math

from noctule.control.paths.plan import PathPlan
from noctule.estimation.identification import VehicleModelSettings
from noctule.estimation.sensors import Sensors
from noctule.localization.fusion import Fusion
from noctule.messages import Limits
from noctule.pilots.located import LocatedPilot
from noctule.pilots.located_settings import LocatedSettings
from noctule.pilots.path_follower import PathFollower
from noctule.pilots.senses import Locating, Senses

NODES = ("onboard", "depth")


def make_located_pilot(
    settings: LocatedSettings,
    plan: PathPlan,
    locator: Locating,
    sensors: Sensors,
    model: VehicleModelSettings,
    limits: Limits,
) -> LocatedPilot:
    """Return the pilot for a path in space; it keeps `locator` to itself.

    Raises DelayTooLongError for a vehicle that answers too late, FollowerError for one that cannot be flown.
    """
    known = model.model()
    end_after = math.inf if settings.end_after_s is None else settings.end_after_s
    follower = PathFollower(plan, known, limits.speeds, settings.follower, end_after=end_after)
    fusion = Fusion(NODES, known, sensors, settings.filter)
    return LocatedPilot(settings, limits, Senses(locator, fusion), follower)
