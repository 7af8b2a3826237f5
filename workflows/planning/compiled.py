"""Which functions of a stage Numba will have to compile: those that it has not kept beside the code, as it now is."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from numba.core.dispatcher import Dispatcher

EACH = 0.45
"""Seconds that one function takes, about (``benchmarks/compiling.py``)."""
SCIENCE = "zsmoseg."
ROOMS = ("zsmoseg.workflows", "zsmoseg.stores")


def missing(module: str) -> frozenset[str]:
    """The functions that a stage of ``module`` may call and that are not kept, by module and name."""
    return frozenset(name for name, function in _functions(module).items() if not _is_kept(function))


@cache
def _functions(module: str) -> dict[str, Dispatcher]:
    """The compiled functions of the science that a module leads to."""
    from numba.core.dispatcher import Dispatcher

    found: dict[str, Dispatcher] = {}
    seen: set[str] = set()
    left = [module]
    while left:
        name = left.pop()
        if name in seen or name not in sys.modules:
            continue
        seen.add(name)
        left += _leads_to(sys.modules[name])
        for value in vars(sys.modules[name]).values():
            if isinstance(value, Dispatcher) and value.py_func.__module__ == name:
                found[f"{name}.{value.py_func.__name__}"] = value
    return found


def _leads_to(module: ModuleType) -> Iterator[str]:
    """The modules of the science that what a module has in its hands comes from."""
    for value in vars(module).values():
        name = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None)
        if isinstance(name, str) and name.startswith(SCIENCE) and not name.startswith(ROOMS):
            yield name


def _is_kept(function: Dispatcher) -> bool:
    """Whether there is an index file that is no older than the code."""
    place, code = function.stats.cache_path, function.py_func.__code__
    if place is None:
        return False
    kept = Path(place).glob(f"*.{function.py_func.__qualname__}-{code.co_firstlineno}.*.nbi")
    try:
        newest = max((path.stat().st_mtime for path in kept), default=0.0)
        return newest >= Path(code.co_filename).stat().st_mtime
    except OSError:
        return False
