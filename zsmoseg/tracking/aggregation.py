"""Probabilities of objects that were judged apart, made one decision; maps at another size, corners on corners."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float32]
CERTAIN_GROUPS = 1e-5
CERTAIN_OBJECTS = 1e-7
"""What probabilities are kept away from 0 and 1 by, before they become logits: of groups, and of single objects."""


def softmax(logits: Real) -> Real:
    """(n, h, w) over the first axis."""
    powers = np.exp(logits - logits.max(0))
    return np.asarray(powers / powers.sum(0), np.float32)


def aggregated_groups(logits: Sequence[Real]) -> Real:
    """Logits of all objects from those of groups that do not know each other.

    The background is what every group calls so: the product of the groups' probabilities of it. One group stays as it
    is. Source: Yang, Wei, Yang, "Associating objects with transformers for video object segmentation", NeurIPS 2021,
    authors' code.

    Parameters
    ----------
    logits
        (1 + n, h, w) of each group, the background first.

    Returns
    -------
    (1 + sum of n, h, w)
    """
    if len(logits) == 1:
        return logits[0]
    groups = [softmax(group) for group in logits]
    background = np.prod([group[:1] for group in groups], axis=0)
    return _logit(np.concatenate([background, *(group[1:] for group in groups)]), CERTAIN_GROUPS)


def aggregated_objects(probability: Real) -> Real:
    """Probabilities (1 + n, h, w), the background first, from those of single objects (n, h, w).

    Source: Oh, Lee, Xu, Kim, "Video object segmentation using space-time memory networks", ICCV 2019, section 3.4, in
    the form of Cutie.
    """
    background = np.prod(1 - probability, axis=0, keepdims=True)
    return softmax(_logit(np.concatenate([background, probability]), CERTAIN_OBJECTS))


def _logit(probability: NDArray[np.floating], least: float) -> Real:
    kept = np.clip(np.asarray(probability, np.float32), np.float32(least), np.float32(1 - least))
    return np.asarray(np.log(kept / (1 - kept)), np.float32)


def stretched(values: Real, size: tuple[int, ...]) -> Real:
    """Maps (n, h, w) at another (height, width): bilinear, the corner pixels stay the corner pixels.

    ``cv2.remap`` would round places to 1/32 px.
    """
    rows, columns = (_weights(before, after) for before, after in zip(values.shape[1:], size, strict=True))
    return _between(np.swapaxes(_between(np.swapaxes(values, 1, 2), rows), 1, 2), columns)


def _weights(before: int, after: int) -> tuple[NDArray[np.int64], NDArray[np.int64], Real]:
    """For each new place the two old ones beside it, and how much of the second."""
    place = np.arange(after) * ((before - 1) / max(after - 1, 1))
    low = np.minimum(place.astype(np.int64), before - 1)
    return low, np.minimum(low + 1, before - 1), (place - low).astype(np.float32)


def _between(values: Real, weights: tuple[NDArray[np.int64], NDArray[np.int64], Real]) -> Real:
    low, high, part = weights
    return np.asarray(values[..., low] * (1 - part) + values[..., high] * part, np.float32)
