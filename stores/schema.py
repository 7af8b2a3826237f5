"""How video arrays lie on disk: Zarr v3, only codecs of its specification, so that any reader can open them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from zsmoseg.stores import packing, shards
from zsmoseg.stores.fields import TIMES, Codec, Field
from zsmoseg.stores.records import RECORDS


@dataclass(frozen=True)
class ArraySpec:
    """A video array: its first dimension is ``frame`` or ``pair``, of known length.

    Parameters
    ----------
    name, dims, shape, dtype
        ``dtype`` by its numpy name.
    fill_value
        What is stored where nothing is known. With a scale it must be the lowest or highest stored number.
    scale
        What is stored is the value divided by it, rounded to the nearest integer; 1: values as they are.
    units, long_name
        CF attributes.
    kind
        Chooses the codec.
    """

    name: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: str
    fill_value: int | float = 0
    scale: float = 1.0
    units: str = ""
    long_name: str = ""
    kind: Codec = "image"

    def __post_init__(self) -> None:
        if len(self.dims) != len(self.shape) or self.dims[0] not in TIMES:
            raise ValueError(f"{self.name}: dims {self.dims} do not name {self.shape} from frame or pair on")
        if not self.name.isidentifier() or self.name == RECORDS:
            raise ValueError(f"{self.name}: no name for an array")

    @classmethod
    def of(cls, name: str, field: Field, sizes: Mapping[str, int]) -> ArraySpec:
        """The declared ``field`` in a video whose dimensions have the ``sizes``."""
        shape = tuple(sizes[dim] for dim in field.dims)
        fill = int(field.fill) if float(field.fill).is_integer() else field.fill
        about = field.scale, field.unit, field.meaning, field.codec
        return cls(name, field.dims, shape, field.dtype, fill, *about)

    @classmethod
    def from_json(cls, fields: Mapping[str, Any]) -> ArraySpec:
        """Of ``to_json``."""
        return cls(**{**fields, "dims": tuple(fields["dims"]), "shape": tuple(fields["shape"])})

    @property
    def attributes(self) -> dict[str, Any]:
        """CF attributes: readers such as xarray give physical units."""
        out: dict[str, Any] = {}
        if self.long_name:
            out["long_name"] = self.long_name
        if self.units:
            out["units"] = self.units
        if self.scale != 1:
            out |= {"scale_factor": self.scale, "_FillValue": self.fill_value}
        return out

    @property
    def chunk(self) -> tuple[int, ...]:
        """Shape of what is compressed at once: one frame; of flow one component of it."""
        lead = 2 if self.dims[1:2] == ("component",) else 1
        return (1,) * lead + self.shape[lead:]

    def to_json(self) -> dict[str, Any]:
        """As plain JSON types."""
        return {**asdict(self), "dims": list(self.dims), "shape": list(self.shape)}

    def metadata(self, length: int) -> dict[str, Any]:
        """Content of its ``zarr.json``; a part of ``length`` frames is one shard."""
        dtype = np.dtype(self.dtype)
        return packing.metadata(
            dtype,
            self.shape,
            (length, *self.shape[1:]),
            self.dims,
            self.fill_value,
            self.attributes,
            shards.codecs(self.kind, self.chunk, dtype.itemsize),
        )
