"""Motion groups of sparse point tracks: affinities of three geometric cues, alone and fused.

After Xu, Cheong, Li, "Motion segmentation by exploiting complementary geometric models", CVPR 2018: hypotheses from
random minimal samples of each pair of frames, ordered residual kernels summed over the pairs, sparsified. A cut of
that affinity into few parts tends to halve the background; more segments are cut and merged again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.clustering import k_means
from zsmoseg.grouping.fusion import coregularised, embedding, merged, sparsify
from zsmoseg.grouping.kernels import shared_choices
from zsmoseg.grouping.twoview import SAMPLE, Cue, centred, distances, fit_samples
from zsmoseg.motion.models import Floats

HYPOTHESES = 500
"""Of each cue and pair of frames (Xu, Cheong, Li)."""
SHARE = 0.1
"""Of the hypotheses, chosen by each point (Xu, Cheong, Li)."""
DAMPING = 0.1
"""Added to the number of common pairs: points seldom seen together count a little less (Xu, Cheong, Li)."""
GAPS = (1, 2)
"""Frames between the two of a pair: slow objects stand out over the longer one, short tracks live on the shorter."""
SEGMENTS = 3
"""Segments cut for each group that is wanted, before merging."""


def cue_affinity(points: Floats, visible: NDArray[np.bool_], cue: Cue, gaps: Sequence[int] = GAPS) -> Floats:
    """Affinity (N, N) of tracks under one cue, 0 to 1; 0 where two are never seen together.

    Parameters
    ----------
    points : (N, T, 2) px.
    visible : (N, T).
    """
    count, frames = visible.shape
    agreement, together = np.zeros((count, count)), np.zeros((count, count))
    for gap in gaps:
        for t in range(frames - gap):
            ids = np.flatnonzero(visible[:, t] & visible[:, t + gap])
            if len(ids) <= SAMPLE[cue]:
                continue
            residual = hypothesis_residuals(cue, points[ids, t], points[ids, t + gap], HYPOTHESES, (t, gap))
            at = np.ix_(ids, ids)
            agreement[at] += shared_choices(residual, SHARE)
            together[at] += 1.0
    return np.asarray(agreement / (together + DAMPING))


def hypothesis_residuals(
    cue: Cue, first: Floats, second: Floats, count: int, seed: tuple[int, ...]
) -> Floats:
    """Squared distances (count, N) of point pairs from models of random samples of them.

    Parameters
    ----------
    first, second : (N, 2) the points in either frame, more than ``SAMPLE[cue]``; any unit.
    seed : numbers of the pair: the same samples whenever it is asked again.
    """
    a, b = centred(first.astype(np.float64)), centred(second.astype(np.float64))
    size = SAMPLE[cue]
    order = np.random.default_rng(seed).random((count, len(a)))
    sample = np.argpartition(order, size - 1, axis=1)[:, :size]
    return distances(cue, fit_samples(cue, a[sample], b[sample]), a, b)


def combined(affinities: Mapping[str, Floats]) -> Floats:
    """Sum (N, N) of the sparsified affinities (kernel addition)."""
    return np.asarray(np.sum([sparsify(affinity) for affinity in affinities.values()], axis=0))


def classify(
    affinities: Mapping[str, Floats], groups: int, merge: bool = True
) -> dict[str, NDArray[np.int64]]:
    """Group of every track (N,), by each affinity alone, by their sum ``added`` and ``co-regularised``.

    Parameters
    ----------
    affinities : (N, N) by name, as ``cue_affinity`` gives them.
    groups : how many, the background included.
    merge : cut ``SEGMENTS`` times as many segments and merge them; otherwise cut directly, as published.
    """
    sparse = {name: sparsify(affinity) for name, affinity in affinities.items()}
    total = combined(affinities)
    out = {name: parted(affinity, groups, merge) for name, affinity in {**sparse, "added": total}.items()}
    segments = _segments(groups, merge)
    rows = coregularised(list(sparse.values()), segments)
    out["co-regularised"] = merged(total, _clusters(rows, segments), groups)
    return out


def parted(affinity: Floats, groups: int, merge: bool = True) -> NDArray[np.int64]:
    """Group of every track (N,) by one sparsified affinity; parameters as in ``classify``."""
    segments = _segments(groups, merge)
    return merged(affinity, _clusters(embedding(affinity, segments), segments), groups)


def _segments(groups: int, merge: bool) -> int:
    return groups * SEGMENTS if merge else groups


def _clusters(rows: Floats, count: int) -> NDArray[np.int64]:
    return k_means(rows, min(count, len(rows)), np.ones(len(rows)))
