"""Which figures the page of a flight has, in their order, and the words that stand with them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from noctule.reports.doubt_strip import doubt_figure
from noctule.reports.flight_log import FlightLog
from noctule.reports.located_series import (
    control_figure,
    estimate_figure,
    heading_figure,
    pose_figure,
    speed_figure,
)
from noctule.reports.located_views import hover_figure, path_figure
from noctule.reports.series import (
    clearance_figure,
    errors_figure,
    tasks_figure,
    ticks_figure,
    velocities_figure,
)
from noctule.reports.strip import strip_figure
from noctule.reports.views import views_figure

_NO_TRUTH = "There is no truth in this recording (a real drone has none), so this is left out."


@dataclass(frozen=True, slots=True)
class Plan:
    """A figure of a report: how it is drawn and what it is called."""

    name: str
    title: str
    caption: str
    draw: Callable[[FlightLog], Figure | None]
    missing: str = ""
    photograph: bool = False


VISUAL = (
    Plan(
        "camera", "What the camera saw",
        "Pictures over the flight. Red crosses are the tracked points, green circles where the key image has "
        "them; at the target they meet. Yellow boxes are columns that were seen.",
        strip_figure, "There are no pictures in this recording.", photograph=True,
    ),
    Plan(
        "views", "Where it flew",
        "The room to scale, from above and from the side, with the true trajectory coloured by speed. Arrows "
        "are the key images, grey is furniture (in the side view it stands beside the path), columns have "
        "their own colour.",
        views_figure, _NO_TRUTH,
    ),
    Plan(
        "errors", "Errors",
        "The mean distance of the tracked points to their references, and the servoing error, whose descent "
        "the law asks for. Each new target image starts both afresh.",
        errors_figure,
    ),
    Plan(
        "velocities", "Velocities and activations",
        "What was sent to the drone (solid) and what the pilot asked (dashed, seen only where the supervisor "
        "bounded it), how far each task of the hierarchy was switched on, and the step of the command from "
        "tick to tick as a share of what the acceleration limit allows.",
        velocities_figure,
    ),
    Plan(
        "tasks", "Errors of the tasks", "The norm of the error of each task of the hierarchy.",
        tasks_figure, "This recording holds no errors of tasks.",
    ),
    Plan(
        "clearance", "Clearance",
        "From the surface of the hull to the nearest surface of a column, furniture or person, by a "
        "collision check on the true pose.",
        clearance_figure, _NO_TRUTH,
    ),
    Plan(
        "ticks", "Time of a tick", "How long the pilot took from a picture to a command.",
        ticks_figure, "This recording holds no times of ticks.",
    ),
)  # fmt: skip

LOCATED = (
    Plan(
        "path", "The path and the way",
        "The path that was wanted, and the way that was flown: as the ceiling camera measured it, as the "
        "pilot fused it from all sensors, and, in simulation, as it truly was. Dotted is how it came down "
        "after the pilot was done, where that is known.",
        path_figure, "The pilot never knew where it was.",
    ),
    Plan(
        "pose", "Position and heading",
        "As wanted, as fused, as measured by the ceiling camera and, in simulation, as true. Grey is where a "
        "point was held; a star is a push. After a hand-over nothing is wanted of the path any more. Dotted "
        "is the landing, after the pilot was done; without truth only the height that the vehicle measures.",
        pose_figure,
    ),
    Plan(
        "control", "How well the path was followed",
        "The distance to the nearest point of the path, without the stops and the 3 s after a push, and "
        "where the drone was less where it was wanted.",
        control_figure,
    ),
    Plan(
        "hover", "How well points were held",
        "Where the drone was about the point that it held, without the first 4 s of a stop and the 3 s after "
        "a push, which are grey. The ring is the root mean square, in space.",
        hover_figure, "No point was held in this flight.",
    ),
    Plan(
        "estimate", "How well the pilot knew where it was",
        "The error of the fused estimate, and three of the standard deviations that the pilot itself gave "
        "it. Without truth: what the ceiling camera measured less what the pilot held.",
        estimate_figure,
    ),
    Plan(
        "doubt", "Doubt",
        "How far the pilot trusted its estimate and what it did about it, and in which frames the ceiling "
        "camera saw the drone.",
        doubt_figure,
    ),
    Plan(
        "heading", "Heading",
        "The vehicle's own heading counts from a zero of its own and drifts; the pilot corrects it by the "
        "ceiling camera.",
        heading_figure,
    ),
    Plan(
        "speed", "Velocity", "The velocity in the room, as fused and, in simulation, as true.",
        speed_figure,
    ),
    Plan(
        "velocities", "Commands",
        "What was sent to the drone (solid) and what the pilot asked (dashed, seen only where the supervisor "
        "bounded it), and the step of the command from tick to tick as a share of what the acceleration "
        "limit allows.",
        velocities_figure,
    ),
)  # fmt: skip

_OF_AN_ESTIMATE = ("pose", "control", "hover", "estimate")


def plans_of(log: FlightLog) -> tuple[Plan, ...]:
    """Return the figures of a flight; one that was located and then flown by pictures has both kinds.

    Of a pilot that never knew where it was, what is drawn of an estimate is left out.
    """
    if log.located is None:
        return VISUAL
    always = ("clearance", "ticks")
    known = {plan.name for plan in LOCATED}
    others = tuple(p for p in VISUAL if p.name not in known and (log.by_pictures or p.name in always))
    if not np.isfinite(log.located.fused).any():
        return tuple(plan for plan in LOCATED if plan.name not in _OF_AN_ESTIMATE) + others
    return LOCATED + others
