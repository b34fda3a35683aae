"""The same mission over many seeds, spread over the cores; a worker that dies does not lose the others."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import TYPE_CHECKING, Any

from noctule.campaign.worker import Run, failed_run, fly_one, one_thread_for_children
from noctule.errors import NoctuleError

if TYPE_CHECKING:
    from noctule.flight import Mission

FlyOne = Callable[["Callable[[int], Mission]", int, Path, "Callable[[Run], Run] | None"], Run]
Pool = Callable[[Sequence[Run]], dict[str, Any]]


class CampaignError(NoctuleError):
    """A campaign that cannot be flown as asked."""


def fly_seeds(
    make_mission: Callable[[int], Mission],
    seeds: Sequence[int],
    out: Path,
    jobs: int | None = None,
    progress: bool = True,
    finish: Callable[[Run], Run] | None = None,
    fly: FlyOne = fly_one,
    together: Pool | None = None,
    good: str = "reached",
) -> dict[str, Any]:
    """Fly one mission per seed and return {"runs": [one summary per seed, in order], "summary": pooled}.

    Parameters
    ----------
    make_mission
        Makes the mission of a seed; it is sent to the workers.
    seeds
        The seeds, each once.
    out
        The folder; seed 7 flies into `out`/seed-7.
    jobs
        Flights at a time, one thread each; None for one per core.
    progress
        Whether to draw a bar on stderr.
    finish
        Called in the worker with each summary, returns it completed (writes the report, say).
    fly
        What flies one seed; only tests give another.
    together
        Makes of all runs what stands beside them; None for "summary", as `flight.summary.pool` has it.
    good
        The outcome that the bar counts.

    Raises
    ------
    CampaignError
        When there are no seeds, a seed comes twice, or `jobs` is below 1.
    """
    check_seeds(seeds, jobs)
    runs: dict[int, Run] = {}
    bar = _Bar(len(seeds), good) if progress else None

    def note(run: Run) -> None:
        runs[run["seed"]] = run
        if bar is not None:
            bar.advance(run)

    def task(seed: int) -> Any:
        from joblib import delayed

        return delayed(fly)(make_mission, seed, out / f"seed-{seed}", finish)

    try:
        with one_thread_for_children():
            _fly_all(task, list(seeds), jobs or os.cpu_count() or 1, runs, note)
    finally:
        if bar is not None:
            bar.close()
    ordered = [runs[seed] for seed in seeds]
    return {"runs": ordered, **(together or _pooled)(ordered)}


def _pooled(runs: Sequence[Run]) -> dict[str, Any]:
    from noctule.flight.summary import pool

    return {"summary": pool(runs)}


def check_seeds(seeds: Sequence[int], jobs: int | None) -> None:
    """Raise CampaignError unless there are seeds, each once, and jobs to do them."""
    if not seeds:
        raise CampaignError("a campaign has no seeds, expected at least one; give a range such as 0:10")
    twice = sorted({seed for seed in seeds if list(seeds).count(seed) > 1})
    if twice:
        raise CampaignError(
            f"seed {twice[0]} is given more than once, expected each seed once; leave one out"
        )
    if jobs is not None and jobs < 1:
        raise CampaignError(f"a campaign has {jobs} jobs, expected 1 or more; leave it out for one per core")


def _fly_all(
    task: Callable[[int], Any], seeds: list[int], jobs: int, runs: dict[int, Run], note: Callable[[Run], None]
) -> None:
    """Fly in rounds; the seeds that were in the air when a worker died are tried once more, each alone.

    A dead worker takes its whole pool with it and does not say which seed killed it: alone, the guilty one
    dies again and is named, and the innocent come home.
    """
    suspects: list[int] = []
    waiting = seeds
    while waiting:
        started = _round(task, waiting, jobs, note)
        suspects += [seed for seed in started if seed not in runs]
        waiting = [seed for seed in waiting if seed not in runs and seed not in started]
    for seed in suspects:
        _round(task, [seed], 1, note)
        if seed not in runs:
            note(failed_run(seed, f"the worker that flew seed {seed} died twice; is there memory enough?"))


def _round(task: Callable[[int], Any], seeds: list[int], jobs: int, note: Callable[[Run], None]) -> set[int]:
    """Fly `seeds` until all are home or a worker dies; return those that were started."""
    from joblib import Parallel

    started: set[int] = set()

    def feed() -> Iterator[Any]:
        for seed in seeds:
            started.add(seed)
            yield task(seed)

    # With one job joblib would fly in this very process, and its death would be ours; `pre_dispatch` keeps
    # the number in the air at `jobs`, so that `started` holds few seeds besides the guilty one.
    parallel = Parallel(
        n_jobs=max(jobs, 2),
        backend="loky",
        batch_size=1,
        pre_dispatch=jobs,
        return_as="generator_unordered",
    )
    try:
        for run in parallel(feed()):
            note(run)
    except BrokenProcessPool:
        pass
    return started


class _Bar:
    """A progress bar over flights, on stderr."""

    def __init__(self, total: int, good: str) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            console=Console(stderr=True),
        )
        self._task = self._progress.add_task("flights", total=total)
        self._good, self._reached = good, 0
        self._progress.start()

    def advance(self, run: Run) -> None:
        self._reached += run["outcome"] == self._good
        said = f"flights ({self._reached} {self._good})"
        self._progress.update(self._task, advance=1, description=said)

    def close(self) -> None:
        self._progress.stop()
