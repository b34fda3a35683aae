"""How late pictures and commands may be before a law becomes unstable, and the refusal to fly beyond.

One axis of the closed loop: the vehicle answers to a velocity command with a first-order lag, the law asks
for a velocity proportional to the distance, less a lead times the velocity, and all of it comes a delay T
late: L(s) = K (1 + lead s) e^(-T s) / (s (lag s + 1)). The loop is stable up to the T that uses up the phase
left where |L| = 1.
"""

from __future__ import annotations

import math

from noctule.errors import NoctuleError
from noctule.pilots.settings import PilotSettings

MARGIN = 0.8
"""Share of the limit that may be used: at the limit itself a flight swings for ever."""


class LatencyError(NoctuleError):
    """Gains that are not stable with the delays that are known."""


def delay_limit(gain: float, lag: float, lead: float = 0.0) -> float:
    """Return the delay [s] at which the loop of `gain` [1/s], `lag` [s] and `lead` [s] becomes unstable."""
    low, high = 0.0, 1e3
    for _ in range(80):  # |L| falls with frequency as long as the lead is not above the lag
        w = 0.5 * (low + high)
        size = gain * math.hypot(1.0, lead * w) / (w * math.hypot(1.0, lag * w))
        low, high = (w, high) if size > 1.0 else (low, w)
    return (math.pi / 2.0 + math.atan(lead * w) - math.atan(lag * w)) / w


def known_delay(settings: PilotSettings) -> float:
    """Return the delay [s] that the law feels.

    `noctule` places every picture at its own exposure and flies on odometry, so it feels the command's delay
    alone; `published` servoes on the picture as it comes and feels both.
    """
    if settings.law == "noctule":
        return settings.command_latency_s
    return settings.command_latency_s + settings.picture_latency_s


def most_delay(settings: PilotSettings) -> tuple[float, str, float]:
    """Return the delay [s] that a law's gains allow, and the name and value of the gain that decides."""
    lag = settings.vehicle_lag
    if settings.law == "noctule":
        g = settings.progress
        lead = lag  # the part of the lead that answers to the command's delay cancels in the phase
        loops = [
            ("progress.position", g.position, delay_limit(g.position, lag, lead)),
            ("progress.cross", g.cross, delay_limit(g.cross, lag)),
            ("progress.yaw", g.yaw, delay_limit(g.yaw, lag)),
        ]
    else:
        p = settings.published
        sideways = (p.lambda_0 + p.lambda_lateral_extra) / p.scene_distance
        loops = [
            ("published.lambda_0", p.lambda_0, delay_limit(sideways, lag)),
            ("published.lambda_yaw_ratio", p.lambda_yaw_ratio, _yaw_limit(settings)),
        ]
    name, gain, limit = min(loops, key=lambda loop: loop[2])
    return MARGIN * limit, name, gain


def _yaw_limit(settings: PilotSettings) -> float:
    # e_w is twice the sine of the yaw.
    p = settings.published
    return delay_limit(2.0 * p.lambda_yaw_ratio * p.lambda_0, settings.vehicle_lag)


def check_delay(settings: PilotSettings) -> None:
    """Raise LatencyError when the known delays are beyond what the gains allow."""
    limit, name, gain = most_delay(settings)
    delay = known_delay(settings)
    if delay > limit:
        raise LatencyError(
            f"law '{settings.law}': commands and pictures are {delay:.2f} s late, with pilot.{name} = "
            f"{gain:g} at most {limit:.2f} s can be flown; lower that gain to about "
            f"{gain * limit / delay:.2g} or find a faster link"
        )
