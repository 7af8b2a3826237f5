"""The tables of many blocks as one: along the frames, over the union of their objects, or row after row.

By the first dimension of a table its values go on from block to block (``frame``, ``pair``: at the number of their
frame; plain rows: one after the other), or are put where their labels are. Every other dimension with ids is
widened to the union of the ids; what no block knows is the fill value. Ids are sorted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from zsmoseg.stores.artifact import Block
from zsmoseg.stores.fields import IDS_OF, TIMES, Field

CHUNK = 2**22
"""Bytes, about, of what is widened at once, and compressed at once where it is written."""

Array = np.ndarray[Any, Any]
Load = Callable[[Block, str], Array]


@dataclass(frozen=True)
class Joined:
    """The tables ``fields`` of ``blocks`` as those of the frames ``start`` to ``stop - 1``.

    Attributes
    ----------
    load
        Reads one table of a block.
    fixed
        Names of the dimensions that have the same labels in all blocks.
    last_pair
        Pairs of the whole video: one less than frames.
    """

    fields: Mapping[str, Field]
    blocks: Sequence[Block]
    load: Load
    start: int
    stop: int
    last_pair: int
    fixed: frozenset[str] = frozenset()

    # ------------------------------------------------------------------ labels
    def ids_name(self, dim: str) -> str | None:
        """The table that has the labels of ``dim``; None where it has none."""
        name = IDS_OF.get(dim, dim)
        return name if name in self.fields and self.fields[name].dims == (name,) else None

    @cached_property
    def _places(self) -> dict[tuple[int, str], Array]:
        """Those that are known already, by block (the object, as two blocks may have the same frames) and ids."""
        return {}

    @cached_property
    def ids(self) -> dict[str, Array]:
        """Every table of ids: the union over all blocks, ascending."""
        found = {}
        for name, field in self.fields.items():
            if field.dims == (name,):
                parts = [self.load(block, name) for block in self.blocks if name in block.tables]
                found[name] = np.unique(np.concatenate([np.zeros(0, field.dtype), *parts]))
        return found

    def _place(self, block: Block, dim: str, length: int) -> Array:
        """Where the values of a block lie along a dimension of the whole."""
        name = self.ids_name(dim)
        if name is None:
            return np.arange(length)
        key = id(block), name
        if key not in self._places:
            self._places[key] = np.searchsorted(self.ids[name], self.load(block, name))
        return self._places[key]

    def _length(self, dim: str, lengths: Sequence[int]) -> int:
        name = self.ids_name(dim)
        return max(lengths, default=0) if name is None else len(self.ids[name])

    # ------------------------------------------------------------------ values
    def having(self, name: str) -> list[Block]:
        """The blocks that hold the table."""
        return [block for block in self.blocks if name in block.tables]

    def streams(self, name: str) -> bool:
        """Whether the first dimension goes on from block to block."""
        dims = self.fields[name].dims
        return bool(dims) and (
            dims[0] in TIMES or (self.ids_name(dims[0]) is None and dims[0] not in self.fixed)
        )

    def whole(self, name: str) -> Array | None:
        """The table, or None where no block has it."""
        found = self.having(name)
        if not found:
            return None
        if name in self.ids:
            return self.ids[name]
        return np.concatenate(list(self.rows(name))) if self.streams(name) else self._gathered(name)

    def shape(self, name: str) -> tuple[int, ...]:
        """Of the whole; where rows stream the first number is that of the longest block, and means nothing."""
        entries = [block.tables[name].shape for block in self.having(name)]
        dims = self.fields[name].dims
        return tuple(self._length(dim, [shape[i] for shape in entries]) for i, dim in enumerate(dims))

    def size(self, name: str) -> int:
        """Bytes of the whole."""
        field, shape = self.fields[name], list(self.shape(name))
        if self.streams(name):
            rows = sum(block.tables[name].shape[0] for block in self.having(name))
            shape[0] = self.stop - self.start if field.dims[0] in TIMES else rows
        return int(np.prod(shape)) * np.dtype(field.dtype).itemsize

    def rows(self, name: str) -> Iterator[Array]:
        """The rows of a table that streams, in order, some at a time: never more than ``CHUNK`` bytes widened.

        Raises
        ------
        ValueError
            Plain rows are asked for of a part of a block: nobody knows which belong to its frames.
        """
        field, shape = self.fields[name], self.shape(name)
        timed = field.dims[0] in TIMES
        cut = [block for block in self.having(name) if block.start < self.start or block.stop > self.stop]
        if cut and not timed:
            raise ValueError(
                f"{name}: rows of frames {self.start} to {self.stop - 1} alone; read it by blocks()"
            )
        length = max(1, CHUNK // max(int(np.prod(shape[1:])) * np.dtype(field.dtype).itemsize, 1))
        end = min(self.stop, self.last_pair) if field.dims[0] == "pair" else self.stop
        at = self.start
        yield np.zeros((0, *shape[1:]), field.dtype)
        for block in self.having(name):
            values = self.load(block, name)
            if timed:
                values = values[max(at - block.start, 0) : max(end - block.start, 0)]
                first = max(block.start, at)
                yield self._unknown(field, (max(min(first, end) - at, 0), *shape[1:]))
                at = max(at, first + len(values)) if len(values) else max(at, min(first, end))
            for row in range(0, len(values), length):
                yield self._widened(name, block, values[row : row + length], shape[1:])
        if timed:
            yield self._unknown(field, (max(end - at, 0), *shape[1:]))

    def _unknown(self, field: Field, shape: tuple[int, ...]) -> Array:
        return np.full(shape, field.fill, field.dtype)

    def _widened(self, name: str, block: Block, values: Array, shape: tuple[int, ...]) -> Array:
        """The values of a block with every dimension but the first as wide as in the whole."""
        field = self.fields[name]
        places = [self._place(block, d, n) for d, n in zip(field.dims[1:], values.shape[1:], strict=True)]
        if all(np.array_equal(place, np.arange(n)) for place, n in zip(places, shape, strict=True)):
            return values
        out = self._unknown(field, (len(values), *shape))
        out[np.ix_(np.arange(len(values)), *places)] = values
        return out

    def _gathered(self, name: str) -> Array:
        """A table that does not stream: values of all blocks at the places of their labels."""
        field, shape = self.fields[name], self.shape(name)
        out, known = self._unknown(field, shape), np.zeros(shape, np.bool_)
        for block in self.having(name):
            values = self.load(block, name)
            at = np.ix_(*(self._place(block, d, n) for d, n in zip(field.dims, values.shape, strict=True)))
            if field.add:
                out[at] += values
            else:
                out[at] = np.where(known[at], out[at], values)
            known[at] = True
        return out
