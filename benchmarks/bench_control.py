"""Times the parts of a control tick on one core and prints a table: python benchmarks/bench_control.py."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from timing import measure

from noctule.control.activation import Activation
from noctule.control.gains import AdaptiveGain, gain_vector
from noctule.control.hierarchy import TaskRows, solve_hierarchy
from noctule.control.limiter import limit_command
from noctule.control.servoing import body_velocity, camera_twist, camera_twist_matrix, homography_error
from noctule.control.tasks import CollisionAvoidance, Visibility
from noctule.messages import Limits

MOUNT = np.array([0.09, 0.0, 0.0])


def tick() -> np.ndarray:
    """Run the published law once: errors, both tasks half active, hierarchy, limits."""
    e = homography_error(H, np.array([0.1, -0.05]))
    bottom = body_velocity(camera_twist(e, gain_vector(GAIN(e), 2.5, 0.5)), MOUNT)
    avoid = CollisionAvoidance(
        m1=np.array([-0.02, 0.0]),
        m2=np.array([0.05, 0.0]),
        z1=0.8,
        z2=0.8,
        sigma=0.05,
        gain=0.5,
        activation=0.5,
    )
    see = Visibility(points=POINTS, centroid_ref=np.zeros(2), depth=2.0, gain=0.2, activation=0.5)
    wanted = solve_hierarchy([avoid.rows(B), see.rows(B)], bottom)
    return limit_command(wanted, np.zeros(4), Limits(), 1.0 / 30.0)


rng = np.random.default_rng(0)
H = np.eye(3) + 0.05 * rng.normal(size=(3, 3))
POINTS = rng.uniform(-0.5, 0.5, (60, 2))
GAIN = AdaptiveGain(2.8, 0.1, 5.0)
B = camera_twist_matrix(MOUNT)
BOTTOM = rng.normal(size=4)
TASKS = [TaskRows(rng.normal(size=(m, 4)), rng.normal(size=m)) for m in (1, 2)]


def hierarchy(*activations: float) -> Callable[[], object]:
    tasks = [task._replace(activation=h) for task, h in zip(TASKS, activations, strict=True)]
    return lambda: solve_hierarchy(tasks, BOTTOM)


if __name__ == "__main__":
    cases: dict[str, Callable[[], object]] = {
        "hierarchy, two tasks, both off": hierarchy(0.0, 0.0),
        "hierarchy, two tasks, both on": hierarchy(1.0, 1.0),
        "hierarchy, two tasks, one fading": hierarchy(1.0, 0.4),
        "hierarchy, two tasks, both fading": hierarchy(0.3, 0.4),
        "error, gain, body velocity": lambda: body_velocity(
            camera_twist(homography_error(H, np.zeros(2)), gain_vector(GAIN(BOTTOM))), MOUNT
        ),
        "activation step": lambda: Activation(1.0, 0.3).step(True, 0.03).h,
        "limiter": lambda: limit_command(BOTTOM, np.zeros(4), Limits(), 1.0 / 30.0),
        "whole tick, published law, 60 points": tick,
    }
    print(f"{'':40s}{'median':>10s}{'p95':>10s}  [us]")
    for name, call in cases.items():
        median, p95 = measure(call)
        print(f"{name:40s}{median:10.1f}{p95:10.1f}")
