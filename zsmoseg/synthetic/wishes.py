"""Whether what is asked of a scene can be: every check names the argument, what it is and what it may be."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from numbers import Integral, Real
from typing import Any

from zsmoseg.errors import SettingsError
from zsmoseg.synthetic.scene import CAMERAS

SIDE = 16
"""px, of a frame at least: textures and contrasts need some."""


def check_camera(camera: Any) -> None:
    """Raise ``SettingsError`` if there is no such camera."""
    if not isinstance(camera, str) or camera not in CAMERAS:
        raise SettingsError(f"camera = {camera!r}: expected one of {', '.join(CAMERAS)}")


def check_whole(name: str, value: Any, least: int, most: int | None = None) -> None:
    """Raise ``SettingsError`` if a value is no whole number from ``least`` to ``most``."""
    fits = type(value) is not bool and isinstance(value, Integral)
    if not fits or value < least or (most is not None and value > most):
        to = "or more" if most is None else f"to {most}"
        raise SettingsError(f"{name} = {value!r}: expected a whole number, {least} {to}")


def check_number(name: str, value: Any, least: float = 0.0, most: float | None = None) -> None:
    """Raise ``SettingsError`` if a value is no finite number from ``least`` to ``most``."""
    fits = type(value) is not bool and isinstance(value, Real) and isfinite(value)
    if not fits or value < least or (most is not None and value > most):
        to = "or more" if most is None else f"to {most:g}"
        raise SettingsError(f"{name} = {value!r}: expected a number, {least:g} {to}")


def check_shape(shape: Any) -> None:
    """Raise ``SettingsError`` if it is not the height and width of a frame."""
    if not isinstance(shape, Sequence) or isinstance(shape, str) or len(shape) != 2:
        raise SettingsError(f"shape = {shape!r}: expected height and width, px")
    for name, side in zip(("height", "width"), shape, strict=True):
        check_whole(f"the {name} in shape", side, SIDE)
