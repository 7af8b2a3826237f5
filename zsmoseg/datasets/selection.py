"""Which sequences of a dataset are scored: those named, or the list that belongs to the protocol."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from zsmoseg.datasets.layouts import Dataset
from zsmoseg.datasets.published import sequence_lists
from zsmoseg.errors import DatasetError
from zsmoseg.metrics.protocols import protocol_named


@dataclass(frozen=True)
class Selection:
    """The sequences to score, in order, and in words which they are.

    ``benchmark`` is the published list with which they can be compared: all or some of them are in it; or nothing.
    """

    names: tuple[str, ...]
    words: str
    benchmark: str = ""


def select(dataset: Dataset, wanted: Sequence[str] | None, protocol: str) -> Selection:
    """The sequences that are scored.

    Parameters
    ----------
    wanted : names of sequences or of published lists, or ``all``; ``None`` for the list that belongs to the
        protocol if the dataset holds all of it, else all.

    Raises
    ------
    DatasetError
        A name that the dataset does not hold.
    """
    there, lists = dataset.places, sequence_lists()
    default = protocol_named(protocol).lists.get(dataset.name, "")
    if wanted is None and default and all(name in there for name in lists[default]):
        return Selection(lists[default], f"{default}, {len(lists[default])} sequences", default)
    listed = set(lists.get(default, ()))
    if wanted is None or list(wanted) == ["all"]:
        words = f"all {len(there)} sequences of {dataset.path}"
        return Selection(tuple(there), words, default if listed & there.keys() else "")
    names = list(dict.fromkeys(n for word in wanted for n in lists.get(word, (word,))))
    missing = next((name for name in names if name not in there), None)
    if missing is not None:
        raise DatasetError(
            f"{dataset.path}: has no sequence {missing!r}; it has {_some(there)} (--sequences also takes "
            f"{', '.join(lists)} and all)"
        )
    chosen = wanted[0] if len(wanted) == 1 and wanted[0] in lists else ""
    words = f"{chosen or 'chosen'}, {len(names)} of {len(there)} sequences"
    return Selection(tuple(names), words, chosen or (default if listed & set(names) else ""))


def _some(names: Iterable[str]) -> str:
    """The first of many names."""
    listed = list(names)
    return ", ".join(listed[:5]) + (f" and {len(listed) - 5} more" if len(listed) > 5 else "")
