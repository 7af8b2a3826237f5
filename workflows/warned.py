"""The warnings about a finished video: those of the grouping, and objects of which everything is ignored."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.remarks import NOTHING
from zsmoseg.stores.artifact import Artifact
from zsmoseg.workflows.stages.motion.groups import Groups
from zsmoseg.workflows.stages.proposed.objects import MaskObjects
from zsmoseg.workflows.wording import counted

SHOWN = 10
"""Objects that are named."""


def warnings_of(said: Sequence[str], groups: Artifact, proposed: Artifact | None) -> list[str]:
    """All warnings.

    Parameters
    ----------
    said : of the grouping.
    groups, proposed : artifacts of the stages ``groups`` and ``objects``; None: the front end proposes nothing that is ignored.
    """
    lost = [] if proposed is None else wholly_ignored(proposed, Groups.read(groups).area)
    if not lost:
        return list(said)
    numbers = ", ".join(map(str, lost[:SHOWN])) + (", ..." if len(lost) > SHOWN else "")
    verb = "lies" if len(lost) == 1 else "lie"
    told = (
        f"left out: {counted(len(lost), 'object')} that {verb} wholly in what is ignored ({numbers}); "
        "if that is not meant, give a mask that leaves more (--ignore)"
    )
    return [told, *(text for text in said if text != NOTHING)]


def wholly_ignored(proposed: Artifact, area: NDArray[np.int64]) -> list[int]:
    """Objects that have masks, and no pixel once what is ignored is taken off.

    Parameters
    ----------
    area : (objects,) pixels of each as displayed.
    """
    found = np.unique(MaskObjects.read(proposed).object_of)
    return [int(n) for n in found if n > 0 and area[n] == 0]
