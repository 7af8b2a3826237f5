"""How arrays lie on disk: Zarr v3, only codecs of its specification, so that any reader can open them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

FORMAT = 1
"""Version of the layout of a store; a newer one is refused."""


@dataclass(frozen=True)
class ArraySpec:
    """A video array: the first dimension is ``frame`` or ``pair``.

    ``scale``: what is stored is the value divided by it, rounded; ``fill`` marks what is unknown.
    ``kind`` chooses the codec: ``image`` (smooth numbers) or ``label`` (few numbers, long runs).
    """

    name: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: str
    fill: int = 0
    scale: float = 1.0
    units: str = ""
    long_name: str = ""
    kind: Literal["image", "label"] = "image"

    @property
    def attributes(self) -> dict[str, Any]:
        """CF attributes: readers such as xarray give physical units."""
        out: dict[str, Any] = {"long_name": self.long_name}
        if self.units:
            out["units"] = self.units
        if self.scale != 1:
            out |= {"scale_factor": self.scale, "_FillValue": self.fill}
        return out

    def chunk(self) -> tuple[int, ...]:
        """One frame; of flow one component."""
        lead = 2 if "component" in self.dims else 1
        return (1,) * lead + self.shape[lead:]


def encode(values: np.ndarray[Any, Any], attributes: Mapping[str, Any], dtype: np.dtype[Any]) -> np.ndarray[Any, Any]:
    """Physical values as stored: fixed point where there is a scale, clipped to its range, unknown as fill.

    Raises
    ------
    TypeError
        If values of another kind would be cut to fit.
    """
    if "scale_factor" in attributes:
        info = np.iinfo(dtype)
        scaled = values * np.float32(1 / attributes["scale_factor"])
        np.rint(scaled, out=scaled)
        np.clip(scaled, info.min + 1, info.max, out=scaled)
        scaled[np.isnan(scaled)] = attributes["_FillValue"]
        return scaled.astype(dtype)
    if values.dtype != dtype:
        raise TypeError(f"expected {dtype}, got {values.dtype}")
    return values


def decode(stored: np.ndarray[Any, Any], attributes: Mapping[str, Any]) -> np.ndarray[Any, Any]:
    """Stored values in physical units, float32, NaN where unknown; plain arrays as they are."""
    if "scale_factor" not in attributes:
        return stored
    values = stored.astype(np.float32) * np.float32(attributes["scale_factor"])
    unknown = stored == attributes["_FillValue"]
    if unknown.any():
        values[unknown] = np.nan
    return values


def image_codecs(kind: str) -> tuple[Any, ...]:
    """Compressors of a video array, a checksum last."""
    from zarr.codecs import BloscCodec, Crc32cCodec, ZstdCodec

    if kind == "label":
        return (ZstdCodec(level=1), Crc32cCodec())
    return (BloscCodec(cname="lz4", clevel=5, shuffle="shuffle"), Crc32cCodec())


def table_codecs() -> tuple[Any, ...]:
    """Compressors of tables."""
    from zarr.codecs import BloscCodec, Crc32cCodec

    return (BloscCodec(cname="zstd", clevel=1, shuffle="shuffle"), Crc32cCodec())
