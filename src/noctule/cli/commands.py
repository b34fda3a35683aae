"""The subcommands: their options and help. What they do is imported when they run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from noctule.cli.options import Flag, Seed

Law = Literal["noctule", "published"]
NoReport = Annotated[bool, Parameter(name="--report", negative="--no-report")]


def fly(
    mission: str = "two-columns",
    /,
    *,
    law: Law | None = None,
    attitude_sd: float | None = None,
    seed: Seed = None,
    seeds: str | None = None,
    time_limit: float | None = None,
    report: NoReport = True,
    out: Path | None = None,
    json: Flag = False,
) -> int:
    """Fly a mission in the simulator, record it, report on it.

    Exit code 0 if and only if the end of the path was reached (by every seed).

    Parameters
    ----------
    mission
        A bundled mission (see `noctule missions`) or a mission file.
    law
        The control law; left out, the mission's.
    attitude_sd
        Take the camera off its gimbal and let the drone know its roll and pitch this well [deg].
    seed
        What this number draws: textures, furniture, start, noise, gusts. Left out, the mission's.
    seeds
        A range A:B, half open, flown over the cores; 0:10 is the seeds 0 to 9.
    time_limit
        Stop after this much flight [s].
    report
        Write an HTML report beside the recording.
    out
        The folder for recording and report; left out, a new one under flights/.
    json
        End standard output with one JSON object.
    """
    from functools import partial

    from noctule.cli.flights import Asked, fly_asked, one_seed
    from noctule.cli.overrides import as_it_is, changed
    from noctule.flight.mission import load_mission

    loaded = changed(load_mission(mission), law, attitude_sd, time_limit)
    number = one_seed(seed, seeds, loaded.flight.seed)
    return fly_asked(Asked(loaded.name, partial(as_it_is, loaded), number, seeds, out, report, json))


def missions(*, seed: Seed = None, out: Path | None = None, json: Flag = False) -> int:
    """List the missions that come with Noctule.

    Parameters
    ----------
    seed
        Put this seed into the commands to paste.
    out
        Copy the mission files into this folder, to change them.
    json
        End standard output with one JSON object.
    """
    from noctule.cli.listing import list_missions

    return list_missions(seed, out, json)


def report(*recordings: Path, seed: Seed = None, out: Path | None = None, json: Flag = False) -> int:
    """Write the report of a recording, or lay campaigns of several laws side by side.

    Parameters
    ----------
    recordings
        A recording (.mcap), the folder of a flight, or the folders of campaigns flown with --seeds.
    seed
        Of a campaign's folder, the one flight of this seed.
    out
        The folder for the report; left out, beside the recording.
    json
        End standard output with one JSON object.
    """
    from noctule.cli.reporting import report_on

    return report_on(recordings, seed, out, json)


def doctor(*, seed: Seed = None, out: Path | None = None, json: Flag = False) -> int:
    """Check that this machine can fly the simulator, and say what to do where it cannot.

    Parameters
    ----------
    seed
        Of the room that is drawn as a test. Left out, 0.
    out
        Look for disk space in this folder, and leave the test picture there.
    json
        End standard output with one JSON object.
    """
    from noctule.cli.doctor import examine

    return examine(seed or 0, out, json)
