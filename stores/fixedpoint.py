"""Physical values as integers and back: the values divided by a scale, rounded, unknown as a fill value."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = np.ndarray[Any, Any]


def encode(values: Array, attributes: Mapping[str, Any], dtype: np.dtype[Any]) -> tuple[Array, int]:
    """Physical values as stored.

    Parameters
    ----------
    values
        Floating where ``attributes`` has a ``scale_factor``; NaN and infinity are stored as ``_FillValue``.
        Else of type ``dtype``, and left as they are.
    attributes
        ``scale_factor`` and ``_FillValue`` (the lowest or highest number of ``dtype``), or neither.
    dtype
        Of what is stored.

    Returns
    -------
    stored, clipped
        The largest error is half a scale, except in the ``clipped`` values that were out of range.

    Raises
    ------
    TypeError
        If the values are of another type: nothing is cut to fit in silence.
    """
    if "scale_factor" not in attributes:
        if values.dtype != dtype:
            raise TypeError(f"expected {dtype}, got {values.dtype}")
        return values, 0
    if values.dtype.kind != "f":
        raise TypeError(f"expected floating values in physical units, got {values.dtype}")
    working = np.float32 if dtype.itemsize <= 2 else np.float64
    scaled = np.multiply(values, working(1 / attributes["scale_factor"]), dtype=working)
    np.rint(scaled, out=scaled)
    low, high = _range(dtype, attributes["_FillValue"])
    if not scaled.size or (scaled.min() >= low and scaled.max() <= high):
        return scaled.astype(dtype), 0
    known = np.isfinite(scaled)
    clipped = int(np.count_nonzero(known & ((scaled < low) | (scaled > high))))
    stored = np.where(known, np.clip(scaled, low, high), attributes["_FillValue"])
    return stored.astype(dtype), clipped


def decode(stored: Array, attributes: Mapping[str, Any]) -> Array:
    """Stored values in physical units, float32, NaN where unknown; arrays without a scale as they are."""
    if "scale_factor" not in attributes:
        return stored
    # in this order for its time: a cast, a product in place, and one look at the end of the range where the fill value is
    values: NDArray[np.float32] = stored.astype(np.float32)
    values *= np.float32(attributes["scale_factor"])
    fill = attributes["_FillValue"]
    if stored.size and fill in (stored.min(), stored.max()):
        values[stored == fill] = np.nan
    return values


def _range(dtype: np.dtype[Any], fill: int) -> tuple[int, int]:
    """Lowest and highest number that a value may take: ``fill`` is none of them."""
    info = np.iinfo(dtype)
    return int(info.min) + (fill == info.min), int(info.max) - (fill == info.max)
