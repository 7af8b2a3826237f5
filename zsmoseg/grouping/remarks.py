"""What deserves a warning about the groups of a shot: what somebody can do something about, and what that is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.clustering import Count, Labels

NOTHING = (
    "no object stands out from the camera's motion: everything is static; if something does move, bring masks of it "
    "(--proposals), or have smaller things proposed (zsmoseg settings objects)"
)
RESTING = (
    "no object moves against the background: the whole frame moves as one; zsmoseg explain says why, "
    "--groups 2 takes the likeliest object as moving"
)
NO_WORLD = (
    "no pair of frames shows a static world behind the objects: what moves by itself cannot be told; "
    "bring masks that leave the background free, or have all of them move (--set groups.rule=keep)"
)


def remarks(seen: NDArray[np.bool_], group: Labels, count: Count, world: bool) -> Iterator[str]:
    """The warnings about one shot, or one window of it.

    Parameters
    ----------
    seen : (T, N - 1) whether a frame shows an object; without the background.
    group : (N,) 0 = static.
    count : the number of groups asked for.
    world : whether any pair of frames shows a static world behind the objects.
    """
    if not seen.any():
        yield NOTHING
        return
    if not world:
        yield NO_WORLD
    elif count == "auto" and not group.any():
        yield RESTING
    if count != "auto" and count > len(np.unique(group)):
        yield f"{count} groups asked for, but there are too few objects; ask for fewer (--groups)"


def together(found: Sequence[tuple[Sequence[str], str]]) -> list[str]:
    """The warnings of a video, each once: where some windows have it, they are named before it.

    That nothing moves is worth one only where it is so in the whole video.

    Parameters
    ----------
    found : of each window its warnings, and its name.
    """
    places: dict[str, list[str]] = {}
    for warnings, place in found:
        for text in warnings:
            places.setdefault(text, []).append(place)
    still = [text for text in (RESTING, NOTHING) if text in places]
    whole = still[:1] if sum(len(places[text]) for text in still) == len(found) else []
    rest = {text: where for text, where in places.items() if text not in still}
    return [*whole, *_placed(rest, len(found))]


def _placed(places: Mapping[str, Sequence[str]], windows: int) -> Iterator[str]:
    for text, where in places.items():
        yield text if len(where) == windows else f"{', '.join(where)}: {text}"
