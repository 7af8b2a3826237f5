"""Clusters of objects: spectral on an affinity, average linkage on distances of which some are unknown."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zsmoseg.motion.models import Floats

Labels = NDArray[np.int64]
Count = Literal["auto"] | int
"""Number of groups, the static one included, or ``auto``."""
TINY = 1e-12
"""Instead of 0 as divisor, and below which a row is 0."""
LEAST_WEIGHT = 1e-9
"""Part of the largest weight that every object has at least: k-means wants none without."""
STARTS = 20
"""Random starts of k-means, of which the best is taken."""
DIGITS = 9
"""Of rows that count: rows that differ by rounding are equal."""


def average_linkage(distance: Floats, weight: Floats, clusters: int | None = None) -> Labels:
    """Groups (k,) 1.. by falling weight: average linkage.

    Sokal, Michener, "A statistical method for evaluating systematic relationships", 1958, with weights. The two groups with the smallest weighted mean distance are joined while it is at most 1, or until there are
    ``clusters`` groups. A distance that is not finite is unknown and does not count.

    Parameters
    ----------
    distance : (k, k) symmetric, in units of what is allowed.
    weight : (k,).
    """
    k = len(weight)
    known = np.isfinite(distance)
    pair = weight[:, None] * weight[None, :] * known
    total, mass = np.where(known, distance, 0.0) * pair, pair
    member = np.arange(k)
    alive = list(range(k))
    while len(alive) > (clusters or 1):
        block, part = total[np.ix_(alive, alive)], mass[np.ix_(alive, alive)]
        mean = np.where(part > 0, block / np.where(part > 0, part, 1.0), np.inf)
        np.fill_diagonal(mean, np.inf)
        a, b = sorted(divmod(int(mean.argmin()), len(alive)))
        best = mean[a, b]
        if clusters is None and not best <= 1.0:
            break
        first, second = alive[a], alive[b]
        for matrix in (total, mass):
            matrix[first] += matrix[second]
            matrix[:, first] += matrix[:, second]
        member[member == second] = first
        alive.remove(second)
    return by_weight(member, weight)


def by_weight(member: NDArray[np.integer], weight: Floats) -> Labels:
    """Renumber groups 1.. by falling weight, then by their first member."""
    names, first = np.unique(member, return_index=True)
    mass = np.array([weight[member == name].sum() for name in names])
    rank = np.empty(len(names), np.int64)
    rank[np.lexsort((first, -mass))] = np.arange(1, len(names) + 1)
    return rank[np.searchsorted(names, member)]


def spectral(affinity: Floats, clusters: int, weight: Floats | None = None) -> tuple[Labels, Floats]:
    """Normalised spectral clustering with rows of length 1.

    Ng, Jordan, Weiss, "On spectral clustering: analysis and an algorithm", NIPS 2002.

    With ``weight`` every object counts as that many equal copies of itself. An object without any affinity is
    a component of its own. There are as many clusters as asked for, if there are as many objects.

    Returns
    -------
    labels (N,), eigenvalues (N,) of the normalised affinity, the largest first.
    """
    count = len(affinity)
    w = np.ones(count) if weight is None else np.maximum(weight / max(weight.max(), TINY), LEAST_WEIGHT)
    degree = affinity @ w
    scale = np.sqrt(w / np.where(degree > 0, degree, np.inf))
    matrix = scale[:, None] * affinity * scale
    alone = np.flatnonzero(degree <= 0)
    matrix[alone, alone] = 1.0
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    order = np.argsort(-values, kind="stable")
    if clusters <= 1:
        return np.zeros(count, np.int64), values[order]
    rows = vectors[:, order[:clusters]]
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    rows = np.where(length > TINY, rows / np.maximum(length, TINY), 0.0)
    return k_means(rows, min(clusters, count), w), values[order]


def k_means(rows: Floats, clusters: int, weight: Floats) -> Labels:
    """Exactly ``clusters`` clusters (N,) of ``rows`` (N, d); equal rows are parted only if they must be."""
    from sklearn.cluster import KMeans

    different, label = np.unique(np.round(rows, DIGITS), axis=0, return_inverse=True)
    label = label.reshape(-1).astype(np.int64)
    if len(different) > clusters:
        found = KMeans(clusters, n_init=STARTS, random_state=0).fit(rows, sample_weight=weight)
        label = found.labels_.astype(np.int64)
    while len(np.unique(label)) < clusters:
        names, members = np.unique(label, return_counts=True)
        label[np.flatnonzero(label == names[members.argmax()])[-1]] = names.max() + 1
    return label


def agreement(affinity: Floats, label: Labels, weight: Floats) -> float:
    """How well a partition explains an affinity, -1 to 1: mean of (2A - 1) within groups and (1 - 2A) across."""
    sign = np.where(label[:, None] == label[None, :], 1.0, -1.0)
    w = weight[:, None] * weight[None, :]
    np.fill_diagonal(w, 0.0)
    return float((sign * (2 * affinity - 1) * w).sum() / max(w.sum(), TINY))
