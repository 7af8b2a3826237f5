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
