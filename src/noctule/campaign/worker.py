"""One flight in a worker process, on one thread."""

from __future__ import annotations

import os
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from noctule.errors import NoctuleError

if TYPE_CHECKING:
    from noctule.flight import Mission

Run = dict[str, Any]
"""A summary with the keys of the `fly` command's contract, and "seed"."""

ONE_THREAD = dict.fromkeys(
    ("LP_NUM_THREADS", "NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"
)
"""Read by Mesa's software renderer, numba and the BLAS libraries when a process first uses them."""


@contextmanager
def one_thread_for_children() -> Iterator[None]:
    """Let processes that start meanwhile use one thread each; the environment is put back afterwards."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def fly_one(
    make_mission: Callable[[int], Mission], seed: int, out: Path, finish: Callable[[Run], Run] | None
) -> Run:
    """Fly the mission of `seed` into folder `out` and return its summary with "seed".

    Whatever goes wrong ends this flight only; what nobody foresaw shows its traceback as well.
    """
    import cv2

    from noctule.flight import fly_mission

    cv2.setNumThreads(1)
    try:
        result = fly_mission(make_mission(seed), seed, out, progress=False)
        run = {"seed": seed, **result.summary}
        return finish(run) if finish is not None else run
    except (NoctuleError, OSError) as error:
        return failed_run(seed, str(error))
    except Exception as error:
        traceback.print_exc()
        return failed_run(seed, f"{type(error).__name__}: {error}")


def failed_run(seed: int, reason: str) -> Run:
    """Return the summary of a flight that could not be flown to its end: aborted, without figures."""
    return {
        "seed": seed,
        "outcome": "aborted",
        "reason": reason,
        "duration_s": None,
        "position_error_m": None,
        "yaw_error_deg": None,
        "epsilon_px": None,
        "min_clearance_m": None,
        "max_command_step": {"linear": None, "angular": None},
        "tick_ms": {"median": None, "p95": None},
        "realtime_factor": None,
        "cross_track_max_m": None,
        "cross_track_mean_m": None,
        "laps": None,
        "recording": None,
        "report": None,
    }
