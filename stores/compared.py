"""The files of an artifact for Zarr, each compared with its record.

Zarr's own checksums find what changed in a file. They do not find a file in the place of another: coordinates, tables and
shards of other settings, or of another video, have often the same shape and length.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePath
from typing import Any, Self

from zarr.abc.store import ByteRequest, Store
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import StorePath, WrapperStore

from zsmoseg.errors import StoreError
from zsmoseg.stores import files
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.checks import Expected


def compared(artifact: Artifact) -> StorePath:
    """What Zarr opens as the group of an artifact that is a folder, finished and sealed."""
    expected: dict[str, Mapping[str, int]] = dict((artifact.done or {}).get("files", {}))
    for part in range(len(artifact.parts)):
        record = artifact.part(part)
        expected |= record.files if record else {}
    place = files.zarr_store(artifact.path)
    return StorePath(Compared(place.store, place.path, artifact.path, expected), place.path)


class Compared(WrapperStore[Store]):
    """``store``, in which the files below ``folder``, called ``path`` by users, have to be as ``expected``; pieces of a file are
    not compared.
    """

    def __init__(self, store: Store, folder: str, path: PurePath, expected: Expected) -> None:
        super().__init__(store)
        self._folder, self._path, self._expected = folder, path, expected

    def _with_store(self, store: Store) -> Self:
        return type(self)(store, self._folder, self._path, self._expected)

    async def get(
        self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """As ``Store`` says.

        Raises
        ------
        StoreError
            If the content is not what was written.
        """
        found = await super().get(key, prototype, byte_range)
        name = key[len(self._folder) :].lstrip("/")
        told: Any = self._expected.get(name) if byte_range is None else None
        if told and (found is None or files.crc32(found.to_bytes()) != told["crc32"]):
            raise StoreError(
                f"{self._path / name}: has other content than was written; zsmoseg repair takes it back, and the "
                "next run makes it again"
            )
        return found
