"""Times of calls on a machine that others use too."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable

ROUNDS = 5


def least(rounds: Iterable[list[float]]) -> tuple[float, float]:
    """Return median and 95th percentile of the round with the least median: others use the machine too."""
    return min((statistics.median(times), statistics.quantiles(times, n=20)[-1]) for times in rounds)


def measure(call: Callable[[], object], repeats: int = 1000) -> tuple[float, float]:
    """Return the median and the 95th percentile [us] of `repeats` calls, the best of five rounds."""

    def times() -> list[float]:
        taken = []
        for _ in range(repeats):
            start = time.perf_counter_ns()
            call()
            taken.append((time.perf_counter_ns() - start) * 1e-3)
        return taken

    for _ in range(100):
        call()
    return least(times() for _ in range(ROUNDS))
