"""Numba with its types kept: to the reader and the type checker a compiled function is the Python one."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

from noctule.geometry import wrap_angle

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile `function` on its first call and cache the machine code beside its source file."""
    return cast(F, numba.njit(cache=True, error_model="numpy")(function))


wrap = compiled(wrap_angle)
"""geometry.wrap_angle for compiled callers."""
