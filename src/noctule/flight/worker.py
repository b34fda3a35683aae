"""The worker beside the loop: matches live pictures to key images in a thread of its own.

In simulation the delay is simulated, not raced: a result arrives a fixed flight time after its request, and
the loop waits for the thread at that moment if it has to. In real life it arrives when it is ready.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from noctule.messages import MatchRequest, MatchResult, Picture

Matcher = Callable[[Picture, int], MatchResult]
"""Matches a picture to the key image of that index; a failure to match is a result with a reason."""

_ROUNDING = 1e-9  # [s], a tick's stamp and a due time are sums of different terms


@dataclass(frozen=True, slots=True)
class _Job:
    due: float  # [s] of flight; real life: the time of the request
    future: Future[MatchResult]


class MatchWorker:
    """Runs a matcher in one thread.

    With `delay` [s] (simulation) requests are served one after the other, each `delay` after it could begin.
    Without (real life) they take the time they take, and a request that has not begun makes way for a newer
    one.
    """

    def __init__(self, matcher: Matcher, delay: float | None) -> None:
        self._matcher, self._delay = matcher, delay
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="noctule-matcher")
        self._jobs: deque[_Job] = deque()

    def submit(self, request: MatchRequest, picture: Picture, now: float) -> None:
        """Ask for a match of `picture` at flight time `now` [s]."""
        if self._delay is None:
            # cancel() only succeeds on a job that has not begun.
            self._jobs = deque(job for job in self._jobs if not job.future.cancel())
            due = now
        else:
            due = max([now, *(job.due for job in self._jobs)]) + self._delay
        self._jobs.append(_Job(due, self._pool.submit(self._match, picture, request.key_index)))

    def collect(self, now: float) -> tuple[MatchResult, ...]:
        """Return what is finished at flight time `now` [s], oldest first; in simulation wait for it."""
        finished = []
        while self._jobs:
            job = self._jobs[0]
            ready = job.future.done() if self._delay is None else job.due <= now + _ROUNDING
            if not ready:
                break
            finished.append(self._jobs.popleft().future.result())
        return tuple(finished)

    def _match(self, picture: Picture, key_index: int) -> MatchResult:
        found = self._matcher(picture, key_index)
        # Exactly what the recording will hold, so that a replay sees the same numbers.
        p_ref = np.array(found.p_ref, dtype=np.float64).reshape(-1, 2)
        p_current = np.array(found.p_current, dtype=np.float64).reshape(-1, 2)
        return MatchResult(found.stamp, found.key_index, p_ref, p_current, found.reason)

    def close(self) -> None:
        """Drop what has not begun; what runs is waited for."""
        self._pool.shutdown(wait=True, cancel_futures=True)
