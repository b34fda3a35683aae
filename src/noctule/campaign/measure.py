"""The same measurement over many seeds, spread over the cores, and what the seeds say together."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from noctule.campaign.seeds import check_seeds
from noctule.campaign.worker import one_thread_for_children

Figures = Mapping[str, Any]
"""Numbers by name; groups of numbers (the methods, say) are mappings themselves."""


def measure_seeds(
    measure: Callable[[int], Figures],
    seeds: Sequence[int],
    jobs: int | None = None,
    note: Callable[[int], None] = lambda _: None,
) -> dict[str, Any]:
    """Measure every seed and return {"runs": [in order, each with its "seed"], "summary", "least", "most"}.

    Parameters
    ----------
    measure
        Measures one seed; it is sent to the workers, so it is a function of a module, or a partial of one.
    seeds
        The seeds, each once.
    jobs
        Measurements at a time, one thread each; None for one per core.
    note
        Told the number of seeds that are done, after each.

    Raises
    ------
    CampaignError
        When there are no seeds, a seed comes twice, or `jobs` is below 1.
    """
    from joblib import Parallel, delayed

    check_seeds(seeds, jobs)
    jobs = min(jobs or os.cpu_count() or 1, len(seeds))
    parallel = Parallel(n_jobs=jobs, backend="loky", batch_size=1, return_as="generator")
    runs: list[dict[str, Any]] = []
    with one_thread_for_children():
        for seed, figures in zip(seeds, parallel(delayed(measure)(seed) for seed in seeds), strict=True):
            runs.append({"seed": seed, **figures})
            note(len(runs))
    return {"runs": runs, **together(runs)}


def together(runs: Sequence[Figures]) -> dict[str, Any]:
    """Return the mean of every number over the runs as "summary", and "least" and "most" likewise.

    A number that some run does not have is judged over those that do.
    """
    rest = [{name: value for name, value in run.items() if name != "seed"} for run in runs]
    return {
        "summary": _over(rest, lambda values: sum(values) / len(values)),
        "least": _over(rest, min),
        "most": _over(rest, max),
    }


def _over(runs: Sequence[Figures], of: Callable[[list[float]], float]) -> dict[str, Any]:
    names = list(dict.fromkeys(name for run in runs for name in run))
    found: dict[str, Any] = {}
    for name in names:
        values = [run[name] for run in runs if name in run]
        groups = [value for value in values if isinstance(value, Mapping)]
        numbers = [float(value) for value in values if isinstance(value, int | float)]
        if groups:
            found[name] = _over(groups, of)
        elif numbers:
            found[name] = of(numbers)
    return found
