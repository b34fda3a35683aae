"""Tracks made by hand along a line, for the judge of flights along a path in space."""

from dataclasses import replace

import numpy as np

from noctule.control.paths import line
from noctule.flight.located_judge import Course
from noctule.flight.located_track import DOUBTS, Track

DT = 1.0 / 30.0
BEGUN = 2.0  # [s], the flight's clock at which the path begins
SECONDS = 40.0
STOP = (20.0, 32.0)
PUSH = BEGUN + 26.0


def course(**changes):
    path = line((0.0, 0.0, 1.0), (20.0, 0.0, 1.0))
    return replace(Course(path, (STOP,), (PUSH,), SECONDS), **changes)


def track(**changes):
    """Return a perfect flight at 0.3 m/s with a stop; every tick is measured."""
    stamps = DT * np.arange(round((BEGUN + SECONDS + 0.5) / DT))
    path_time = np.where(stamps < BEGUN, np.nan, stamps - BEGUN)
    flown = 0.3 * np.minimum(np.nan_to_num(path_time), STOP[0])
    flown += 0.3 * np.maximum(np.nan_to_num(path_time) - STOP[1], 0.0)
    true = np.zeros((stamps.size, 4))
    true[:, 0], true[:, 2] = flown, 1.0
    holding = (path_time >= STOP[0]) & (path_time < STOP[1])
    many = np.ones(stamps.size)
    perfect = Track(
        stamps, true, stamps.copy(), true.copy(), 0.01 * many, true.copy(), path_time, holding,
        np.zeros(stamps.size, dtype=np.int_), many > 0.0, many < 0.0,
    )  # fmt: skip
    return replace(perfect, **changes)


def between(one, begin, end):
    """Return which ticks lie between two of the path's times."""
    return (one.path_time >= begin) & (one.path_time < end)


def moved(mask, offset):
    """Return a perfect flight that is off by `offset` (4,) where `mask` says so, and knows it."""
    one = track()
    true = one.true + np.where(mask, 1.0, 0.0)[:, None] * np.asarray(offset)
    return replace(one, true=true, held=true.copy())


def rank(doubt):
    return DOUBTS.index(doubt)
