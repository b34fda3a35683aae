"""`noctule experiment`: the papers' experiments, those that are flown and those that measure."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from noctule.cli.commands import Law, NoReport
from noctule.cli.options import Flag, Seed

Experiment = Literal[
    "servo-5.1",
    "servo-5.2",
    "servo-5.3",
    "servo-5.3-ff",
    "loc-detection",
    "loc-pose",
    "loc-identification",
    "loc-fusion",
    "loc-1",
    "loc-2",
    "loc-3",
]
Markers = Literal["truth", "node"]
Model = Literal["identified", "first_order"]


def experiment(
    name: Experiment,
    /,
    *,
    law: Law | None = None,
    attitude_sd: float | None = None,
    laps: int | None = None,
    latency: float | None = None,
    columns: Flag = False,
    hull: Flag = False,
    person: Flag = False,
    poses: int | None = None,
    noise: float | None = None,
    markers: Markers | None = None,
    alone: Flag = False,
    hide: float | None = None,
    model: Model | None = None,
    wrong_model: float | None = None,
    command_delay: float | None = None,
    beyond: Flag = False,
    seconds: float | None = None,
    seed: Seed = None,
    seeds: str | None = None,
    time_limit: float | None = None,
    report: NoReport = True,
    out: Path | None = None,
    json: Flag = False,
) -> int:
    """Fly or measure an experiment of the papers.

    Parameters
    ----------
    name
        servo-5.1: one target past one column. servo-5.2: four images past two columns. servo-5.3: a closed
        oval of 7.7 m, 30 images. servo-5.3-ff: the same, 35 images, the published law with feed-forward.
        loc-detection: which blob is the drone, beside a person, a box and a tray. loc-pose: how true the
        pose of a single frame is. loc-identification: k1 to k8 and the delay of a simulated vehicle.
        loc-fusion: yaw and position of every sensor, and of all of them fused. loc-1: an ellipse below the
        ceiling camera, a stop, pushes. loc-2: an eight, a half turn in the stop, pushes. loc-3: an eight,
        pushes on the way.
    law
        servo: the control law, noctule, or the published one with its errata mended. Left out, noctule.
    attitude_sd
        servo: take the camera off its gimbal and let the drone know its roll and pitch this well [deg].
    laps
        servo-5.3 and -ff: fly the oval this often without a stop.
    latency
        servo-5.3 and -ff: deliver every picture so much later than the camera does anyway [s].
    columns
        servo-5.3 and -ff: stand a column on each straight of the oval.
    hull
        All loc- but loc-identification: the drone wears its indoor hull.
    person
        loc-pose: somebody stands at 0.4 to 0.75 m from the drone. loc-fusion: somebody walks by at 0.6 m.
    poses
        loc-pose: how many poses are measured. Left out, 500.
    noise
        loc-identification: sd of the velocities that are measured [m/s, rad/s]. Left out, 0.01.
    markers
        loc-fusion: truth, the fused heading is also compared with theirs, or node, they are fused. Left out,
        truth.
    alone
        loc-1 to loc-3: nobody walks about.
    hide
        loc-1 to loc-3: a board hides the drone for so long, 20 s after the path was begun [s].
    model
        loc-1 to loc-3: how the vehicle flies: identified, or first_order. Left out, identified.
    wrong_model
        loc-1 to loc-3: each of k1 to k8 that the pilot knows is off by this share, up or down by the seed.
    command_delay
        loc-1 to loc-3: from sending a command to its effect; the pilot knows it [s]. Left out, 0.02.
    beyond
        loc-1 to loc-3: fly though that delay is longer than was shown stable.
    seconds
        loc-1 to loc-3: leave the path after so long [s]. Left out, 82.
    seed
        What this number draws: textures, furniture, columns, start, noise, gusts. Left out, 0.
    seeds
        A range A:B, half open, spread over the cores; 0:10 is the seeds 0 to 9.
    time_limit
        servo: stop after this much flight [s].
    report
        servo, loc-1 to loc-3: write an HTML report beside the recording.
    out
        The folder for recordings, reports and figures; left out, a new one under flights/.
    json
        End standard output with one JSON object.
    """
    from functools import partial

    from noctule.cli.flights import Asked, fly_asked, one_seed
    from noctule.cli.loc_flying import NAMES, fly_loc
    from noctule.cli.measuring import Measurement, measure_asked
    from noctule.cli.overrides import (
        measured_options,
        of_experiment,
        options_of,
        oval_options,
        refuse_others,
    )

    number = one_seed(seed, seeds, 0)
    flown = {"--law": law, "--attitude-sd": attitude_sd, "--time-limit": time_limit}
    oval = {"--laps": laps, "--latency": latency, "--columns": columns or None}
    measured: dict[str, object] = {"hull": hull or None, "person": person or None}
    measured |= {"poses": poses, "noise": noise, "markers": markers}
    located: dict[str, object] = {"alone": alone or None, "hide": hide, "model": model}
    located |= {"wrong_model": wrong_model, "command_delay": command_delay, "beyond": beyond or None}
    located |= {"seconds": seconds}
    if name in NAMES:
        from noctule.experiments.loc_flight import LocFlightOptions

        refuse_others(name, {**flown, **oval})
        wanted = options_of(name, LocFlightOptions(), {**measured, **located})
        return fly_loc(name, wanted, number, seeds, out, report, json)
    refuse_others(name, {f"--{option.replace('_', '-')}": value for option, value in located.items()})
    if name.startswith("loc-"):
        refuse_others(name, {**flown, **oval, "--no-report": None if report else True})
        return measure_asked(Measurement(name, measured_options(name, measured), number, seeds, out, json))
    refuse_others(name, {f"--{option}": value for option, value in measured.items()})
    options = oval_options(name, laps, latency, columns)
    make = partial(of_experiment, name, law or "noctule", attitude_sd or 0.0, time_limit, options)
    return fly_asked(Asked(f"{name}-{law or 'noctule'}", make, number, seeds, out, report, json))
