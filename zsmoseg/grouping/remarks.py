"""What deserves a word about the groups of a shot."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.clustering import Count, Labels


def remarks(seen: NDArray[np.bool_], group: Labels, count: Count, world: bool, inferred: bool) -> list[str]:
    """One sentence each.

    Parameters
    ----------
    seen : (T, N - 1) whether a frame shows an object; without the background.
    group : (N,) 0 = static.
    count : the number of groups asked for.
    world : whether any pair of frames shows a static world behind the objects.
    inferred : whether the groups come from an affinity, which is inferred where objects are never seen together.
    """
    if not seen.any():
        return ["no object stands out from the camera's motion: everything is static"]
    return [
        *_of_objects(seen.sum(0)),
        *(() if world else _of_no_world()),
        *_of_groups(seen, group, count),
        *(_of_affinity(seen) if inferred else ()),
    ]


def _of_objects(frames: NDArray[np.int64]) -> Iterator[str]:
    objects, brief = int((frames > 0).sum()), int((frames == 1).sum())
    if objects == 1:
        yield "there is one object only"
    if brief:
        yield f"{brief} of {objects} objects are seen in one frame only, which proves no motion"


def _of_no_world() -> Iterator[str]:
    yield "no pair of frames shows a static world behind the objects: what moves by itself cannot be told"


def _of_groups(seen: NDArray[np.bool_], group: Labels, count: Count) -> Iterator[str]:
    groups = len(np.unique(group))
    if count != "auto" and count > groups:
        yield (
            f"{count} groups asked for, but there are {int(seen.any(0).sum())} objects and the background: "
            f"{groups} groups"
        )
    if count == "auto" and not group.any():
        yield "no object moves against the background: the whole frame moves as one"


def _of_affinity(seen: NDArray[np.bool_]) -> Iterator[str]:
    present = seen.any(0)
    together = (seen.T.astype(np.int64) @ seen > 0)[present][:, present]
    apart = int(np.count_nonzero(~together)) // 2
    if apart:
        yield f"{apart} pairs of objects are never seen together: their affinity is inferred"
