"""How video arrays lie on disk: Zarr v3, only codecs of its specification, so that any reader can open them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from zsmoseg.stores.fields import TIMES, Codec, Field
from zsmoseg.stores.records import RECORDS

if TYPE_CHECKING:
    from types import ModuleType


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


def load_zarr() -> ModuleType:
    """Zarr, set to be a light guest of a worker with one thread, and to write the same bytes each time.

    Blosc with several threads puts its blocks in the order in which they get ready.
    """
    import zarr
    from numcodecs import blosc  # type: ignore[import-untyped,unused-ignore]

    if blosc.use_threads is not False:
        blosc.use_threads = False
        zarr.config.set({"async.concurrency": 2, "threading.max_workers": 1})
    return zarr


def codecs(kind: str) -> tuple[Any, ...]:
    """Compressors of a video array, the checksum last, so that it covers what is on disk.

    LZ4 for images and flow: half the time of zstd 1 for 14 % (images) and 28 % (flow) more bytes. Zstd for
    labels: half of the bytes of LZ4 for a third more time. (Frames and flow of three DAVIS sequences.)
    """
    from zarr.codecs import BloscCodec, Crc32cCodec, ZstdCodec

    if kind == "label":
        return (ZstdCodec(level=1, checksum=True), Crc32cCodec())
    return (BloscCodec(cname="lz4", clevel=5, shuffle="shuffle"), Crc32cCodec())


def metadata_of(specs: Iterable[ArraySpec], length: int) -> dict[str, Any]:
    """Content of the ``zarr.json`` of every video array, by its name.

    Parameters
    ----------
    length
        Frames of a part: one part is one shard of every array.
    """
    zarr = load_zarr()
    found: dict[str, Any] = {}
    root = zarr.create_group(zarr.storage.MemoryStore(found))
    for spec in specs:
        root.create_array(
            spec.name,
            shape=spec.shape,
            chunks=spec.chunk,
            shards=(length, *spec.shape[1:]),
            dtype=spec.dtype,
            fill_value=spec.fill_value,
            compressors=codecs(spec.kind),
            dimension_names=spec.dims,
            attributes=spec.attributes,
        )
    names = [name for name in found if name != "zarr.json"]
    return {name.removesuffix("/zarr.json"): json.loads(found[name].to_bytes()) for name in names}
