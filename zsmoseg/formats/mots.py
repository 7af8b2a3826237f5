"""Masks as MOTS text: one line an object and frame, ``frame id class height width rle``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import FormatError
from zsmoseg.formats import rle

CLASSES = {"car": 1, "person": 2}
"""KITTI's."""
UNKNOWN = 1
"""Class of what is neither, or not named."""

PER_CLASS = 1000
"""An id is 1000 times its class plus the number of the object."""


def too_high(number: int) -> str:
    """What to say of an object whose number MOTS text cannot hold."""
    return f"the object {number} is beyond {PER_CLASS - 1}, the highest number that MOTS text has; use another format"


def encode_mots(labels: Iterable[NDArray[Any]], called: Mapping[int, str] = MappingProxyType({})) -> bytes:
    """MOTS text of one video; frames count from 0.

    Parameters
    ----------
    labels : (H, W) ids of every frame, 0 = none.
    called : category of each id that has one.

    Raises
    ------
    FormatError
        If there are more objects than the format can number.
    """
    lines = []
    for t, label in enumerate(labels):
        for n in np.unique(label[label > 0]).tolist():
            if n >= PER_CLASS:
                raise FormatError(f"frame {t}: {too_high(n)}")
            mask = rle.encode(label == n)
            height, width = mask["size"]
            kind = CLASSES.get(called.get(n, ""), UNKNOWN)
            lines.append(f"{t} {kind * PER_CLASS + n} {kind} {height} {width} {mask['counts']}\n")
    return "".join(lines).encode()
