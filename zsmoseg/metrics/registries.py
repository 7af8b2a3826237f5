"""Registries: entries by name, and functions that they name and that are imported when they are first called.

The command line lists protocols and export formats in its help without loading numpy, so their entries hold the
address of a function instead of the function.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any, TypeVar

from zsmoseg.errors import SettingsError

T = TypeVar("T")


def entry(registry: Mapping[str, T], what: str, name: str) -> T:
    """The entry of a name; ``what`` the entries are, in words.

    Raises
    ------
    SettingsError
        There is none of this name.
    """
    if name not in registry:
        raise SettingsError(f"there is no {what} {name!r}; choose one of {', '.join(registry)}")
    return registry[name]


@dataclass(frozen=True)
class Deferred:
    """The function at ``module:name``, called as that function is.

    Attributes
    ----------
    address : ``package.module:name``.
    """

    address: str

    def load(self) -> Callable[..., Any]:
        """Import the module; the function."""
        module, _, name = self.address.partition(":")
        function: Callable[..., Any] = getattr(import_module(module), name)
        return function

    def __call__(self, *arguments: Any) -> Any:
        """Import the module, call the function."""
        return self.load()(*arguments)
