"""The arrays of an artifact as stages leave them and read them: frozen dataclasses, read when they are used.

A stage says what it leaves as a subclass of ``Arrays`` (see ``zsmoseg.stores.fields``), makes one for every run of
frames that it has finished, and reads those of other stages by attribute: ``flow.forward`` are the rows of the
frames that ``flow`` stands for, loaded when they are first asked for.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Self

from zsmoseg.errors import StoreError
from zsmoseg.stores.artifact import AGAIN, Artifact, Block
from zsmoseg.stores.fields import IDS_OF, LABELS, fields_of, tables_of
from zsmoseg.stores.joining import Joined
from zsmoseg.stores.reader import blocks, read_table, read_video


@dataclass(frozen=True)
class Source:
    """Where arrays are read from: the frames ``start`` to ``stop - 1`` of an artifact, or one block of it."""

    kind: type[Arrays]
    artifact: Artifact
    start: int
    stop: int
    block: Block | None = None

    @cached_property
    def _joined(self) -> Joined:
        found = [self.block] if self.block else blocks(self.artifact, self.start, self.stop)
        return join(self.kind, self.artifact, found, self.start, self.stop)

    def load(self, name: str) -> Any:
        """One array; None where the artifact has none."""
        declared = fields_of(self.kind)[name]
        if declared.grid is None:
            if self.block is None:
                return self._joined.whole(name)
            return read_table(self.artifact, self.block, name) if name in self.block.tables else None
        if name not in self.artifact.arrays:
            return None
        length = self.artifact.shape(name)[0]
        return read_video(self.artifact, name, min(self.start, length), min(self.stop, length))


@dataclass(frozen=True)
class Arrays:
    """What a stage leaves of the frames ``start`` to ``stop - 1``; pairs are those that start in them."""

    labels: ClassVar[Mapping[str, Sequence[str]]] = {}
    """Labels of dimensions, where they are the same in every block."""

    start: int = field(kw_only=True)
    stop: int = field(kw_only=True)

    @classmethod
    def read(cls, artifact: Artifact, start: int = 0, stop: int | None = None) -> Self:
        """What an artifact holds of the frames ``start`` to ``stop - 1``; without them of the whole video.

        Nothing is read before an attribute is used, and then only that array: frames and pairs in order, tables
        joined over the union of their objects (``zsmoseg.stores.joining``).

        Raises
        ------
        StoreError
            If there is no such artifact.
        """
        artifact = artifact.for_reading
        parts = artifact.parts
        if not parts:
            raise StoreError(f"{artifact.path}: is not there, or damaged; {AGAIN}")
        end = parts[-1][1]
        return cls._of(Source(cls, artifact, start, end if stop is None else min(stop, end)))

    @classmethod
    def _of(cls, source: Source) -> Self:
        found = object.__new__(cls)
        found.__dict__.update(start=source.start, stop=source.stop, _source=source)
        return found

    def __getattr__(self, name: str) -> Any:
        """Read an array when it is first used."""
        if name not in fields_of(type(self)) or "_source" not in self.__dict__:
            raise AttributeError(f"{type(self).__name__} has no {name}")
        value = self.__dict__["_source"].load(name)
        self.__dict__[name] = value
        return value

    def of(self, start: int, stop: int) -> Self:
        """The same of some frames only, of what was read from an artifact."""
        source: Source = self.__dict__["_source"]
        return self._of(Source(source.kind, source.artifact, start, stop))

    def blocks(self) -> Iterator[Self]:
        """Block by block as it was written, one in memory at a time; whole blocks, also at the ends."""
        source: Source = self.__dict__["_source"]
        for block in blocks(source.artifact, self.start, self.stop):
            yield self._of(Source(source.kind, source.artifact, block.start, block.stop, block))

    def has(self, name: str) -> bool:
        """Whether these frames have the table ``name``, without reading it."""
        source: Source = self.__dict__["_source"]
        found = [source.block] if source.block else blocks(source.artifact, self.start, self.stop)
        return any(name in block.tables for block in found)


def labels_of(kind: type[Arrays], artifact: Artifact) -> dict[str, Sequence[str]]:
    """The labels of all dimensions of an artifact that have the same in every block."""
    return {**LABELS, **kind.labels, **artifact.laid_out.get("labels", {})}


def join(kind: type[Arrays], artifact: Artifact, found: Sequence[Block], start: int, stop: int) -> Joined:
    """The tables of some blocks of an artifact as one."""
    last_pair = max(artifact.parts[-1][1] - 1, 0) if artifact.parts else 0
    fixed = frozenset(labels_of(kind, artifact))
    return Joined(
        tables_of(kind),
        found,
        lambda block, name: read_table(artifact, block, name),
        start,
        stop,
        last_pair,
        fixed - set(IDS_OF),
    )
