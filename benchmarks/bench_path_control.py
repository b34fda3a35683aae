"""Times path following on one core: python benchmarks/bench_path_control.py.

Wanted: control and nearest point together within 50 us per tick. With --table also the stability tables of
docs/path-following.md, flown on the simulator's dynamics (some minutes). Times are the best of five rounds.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from timing import measure

from noctule.control.cascade import CascadeSettings, cascade, predict_over_delay
from noctule.control.paths import FixedHeading, Stop, loc_1, loc_2, nearest, plan
from noctule.control.paths.heading import TurnReference
from noctule.control.paths.progress import advance, begin
from noctule.estimation.filter_state import StateEstimate
from noctule.estimation.vehicle_model import VehicleModel
from noctule.messages import Observation
from noctule.pilots.located import LocatedPilot
from noctule.pilots.located_settings import LocatedSettings
from noctule.pilots.path_follower import FollowerSettings, PathFollower

DT = 1.0 / 30.0


def follower_tick() -> Callable[[], object]:
    """Return a tick of a follower on the ellipse, with a delay of 0.1 s, that flies as it is told."""
    made, model = loc_1(), VehicleModel.identified(delay=0.1)
    follower = PathFollower(made, model, np.ones(4), FollowerSettings(go_to_start=False))
    x = np.zeros(8)
    x[:3], x[3] = made.path.position[0], np.pi / 2
    now, covariance = [0.0, x], np.eye(8)

    def tick() -> object:
        t, state = now
        command, report = follower.step(StateEstimate(t, state, covariance), t)
        # Near enough to flying: the state that was predicted, a tick later.
        after = predict_over_delay(
            state, t, t + DT, np.array([t]), command.as_array()[None], np.zeros(4), model.input_gains,
            model.drags, 0.0,
        )  # fmt: skip
        now[:] = [t + DT, after]
        return report

    return tick


def times() -> None:
    made, model = loc_2(), VehicleModel.identified(delay=0.1)
    path = made.path
    x = np.append(path.at(1.0).position + 0.02, [0.1, 0.2, 0.1, 0.0, 0.0])
    nothing, (k1, k2, K) = np.zeros(4), CascadeSettings().arrays()
    stamps, commands = np.arange(-64, 0) * DT, np.zeros((64, 4))
    progress = begin(made, TurnReference(0.0))
    gains, drags = model.input_gains, model.drags
    cases: dict[str, Callable[[], object]] = {
        "nearest point, window of +-0.3 m": lambda: nearest(path, x[:3], 1.0),
        "path, profile, heading, stops": lambda: advance(made, progress, x, 1.0, DT),
        "prediction over 0.1 s": lambda: predict_over_delay(
            x, 0.0, 0.1, stamps, commands, nothing, gains, drags, 0.1
        ),
        "both laws, with limits": lambda: cascade(
            x, x[:4], nothing, nothing, nothing, k1, k2, K, gains, drags, nothing, np.ones(4)
        ),
    }
    print(f"{'':44s}{'median':>10s}{'p95':>10s}  [us]")
    for name, call in cases.items():
        median, p95 = measure(call)
        print(f"{name:44s}{median:10.1f}{p95:10.1f}")
    tick = follower_tick()
    aside = measure(
        lambda: predict_over_delay(x, 0.0, DT, stamps[:1], commands[:1], nothing, gains, drags, 0.0)
    )[0]
    median, p95 = measure(tick)
    print(f"{'the whole tick: PathFollower.step':44s}{median - aside:10.1f}{p95 - aside:10.1f}")
    ticks = located_ticks()
    median, p95 = statistics.median(ticks), statistics.quantiles(ticks, n=20)[-1]
    print(f"{'LocatedPilot.step without a depth frame':44s}{median:10.1f}{p95:10.1f}")


def located_ticks() -> list[float]:
    """Return the times [us] of the ticks of a flight of the located pilot that have no depth frame.

    Its reports are fused in them, its commands predicted, its doubt judged and its path followed.
    """
    from pilots_located_flight import fly

    times: list[float] = []

    def watched(pilot: LocatedPilot) -> LocatedPilot:
        step = pilot.step

        class Watched:
            report = None

            def step(self, observation: Observation) -> object:
                start = time.perf_counter_ns()
                decision = step(observation)
                if observation.depth is None:
                    times.append((time.perf_counter_ns() - start) * 1e-3)
                return decision

        return Watched()

    fly(
        loc_1(), seconds=20.0, pilot_of=watched, no_frames=[(0.1 * k, 0.1 * k + 0.05) for k in range(20, 200)]
    )
    return times[100:]


def table() -> None:
    from pilots_space_flight import fly, vehicle

    base = loc_2()
    made = plan(base.path, base.speed, FixedHeading(0.0), (Stop(12.0, time=18.0),), laps=None)
    cascade_settings = CascadeSettings(longest_delay_s=1.0, disturbance_rate=0.0)
    settings = FollowerSettings(go_to_start=False, cascade=cascade_settings)
    print("\neight at 0.3 m/s, stop, two pushes, late and noisy sensors; mean of three seeds")
    print(
        f"{'vehicle':12s}{'delay':>7s}{'known as':>10s}{'cross-track mean, p95':>24s}"
        f"{'hover':>9s}{'recovery':>10s}"
    )
    for kind in ("tilt", "first_order"):
        for delay in (0.0, 0.1, 0.2, 0.3, 0.4, 0.5):
            for share in (1.0, 0.8, 0.0) if delay else (1.0,):
                rows = []
                for seed in range(3):
                    flight = fly(
                        made, kind, 30.0, model=vehicle(kind)[1], delay=delay, known_delay=share * delay,
                        pushes=(12.0, 24.0), fused=True, seed=seed, settings=settings,
                    )  # fmt: skip
                    stops = ((18.0, 30.0),)
                    rows.append(
                        [
                            *flight.cross_track(made, stops),
                            flight.hover_rms(stops),
                            max(flight.recoveries(made.path)),
                        ]
                    )
                mean, p95, hover, recovery = np.mean(rows, axis=0)
                late = f"{recovery:8.2f} s" if recovery < 2.5 else "   never"
                print(
                    f"{kind:12s}{delay:7.1f}{share * delay:10.2f}{1e3 * mean:14.1f}{1e3 * p95:7.1f} mm"
                    f"{1e3 * hover:6.1f} mm{late}"
                )


def located_table() -> None:
    """Fly the located pilot: delays, and models that are off."""
    from pilots_located_flight import fly, loop_model, off_by

    base = loc_2()
    made = plan(base.path, base.speed, FixedHeading(0.0), (Stop(12.0, time=18.0),), laps=None)
    cascade_settings = CascadeSettings(longest_delay_s=1.0)
    settings = LocatedSettings(
        begin_at_s=4.0, end_after_s=30.0, follower=FollowerSettings(cascade=cascade_settings)
    )
    known = [(0.02, 0.02), (0.0, 0.0)]
    for delay in (0.1, 0.2, 0.3, 0.4, 0.5):
        known += [(delay, delay), (delay, delay - 0.05)]
    cases = [(f"{delay:.2f} s, known as {told:.2f} s", delay, told, False) for delay, told in known]
    cases.append(("k1 to k8 off by 30 %", 0.02, 0.02, True))
    print("\nthe located pilot; cross-track mean, p95, hover [mm], recovery mean, worst [s]; four seeds")
    for name, delay, told, wrong in cases:
        rows, recoveries = [], []
        for seed in range(4):
            model = off_by(loop_model(), 0.3, seed) if wrong else loop_model()
            flight = fly(
                made, seconds=40.0, model=model, delay=delay, known_delay=told, pushes=(16.0, 28.0),
                seed=seed, settings=settings, start=(0.1, 0.1, 1.25, 0.1),
            )  # fmt: skip
            *figures, found = flight.figures(made, ((18.0, 30.0),))
            rows.append(figures)
            recoveries += found
        mean, p95, hover = 1e3 * np.mean(rows, axis=0)
        print(f"{name:28s}{mean:8.1f}{p95:8.1f}{hover:8.1f}{np.mean(recoveries):10.2f}{max(recoveries):8.2f}")


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "pilots"))
    times()
    if "--table" in sys.argv:
        table()
        located_table()
