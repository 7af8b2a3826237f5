"""Loops that are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba as nb

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a loop when it is first called, and keep what was compiled for other processes.

    Where neither the package nor the home folder can be written, every process compiles for itself.
    """
    try:
        return cast(Callable[P, R], nb.njit(cache=True)(function))
    except RuntimeError:  # numba found no folder for its cache
        return cast(Callable[P, R], nb.njit(function))
