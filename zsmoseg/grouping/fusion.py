"""Several affinities of the same objects or points made one: sum, or embeddings that are drawn towards each other.

Embeddings: Ng, Jordan, Weiss, NIPS 2002; further sources at each step.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from zsmoseg.motion.models import Floats

ISOLATED = 1e-16
"""Added to every affinity, so that what is like nothing has a degree."""
POWER = 10.0
"""That affinities are raised to before the gaps of a row are compared: Xu, Cheong, Li find 5 to 15 good, 10 best."""
STRENGTH, ROUNDS = 0.01, 15
"""Weight of the other views in co-regularisation, the value of Xu, Cheong, Li; and rounds at most."""
SETTLED = 1e-6
"""Change of the sum of traces from which on rounds change nothing."""
TINY = 1e-12
"""Instead of 0 as divisor."""
LEAST_EIGENVALUE = 1e-9
"""Below it an eigenvalue is 0 but for rounding."""


def sparsify(affinity: Floats) -> Floats:
    """Keep what stands out of each row: (N, N), symmetric, entries kept, halved or 0.

    Adaptive: an entry is kept where the logarithm of its distance to the row's largest, as a share of all such
    distances, is below the mean of that logarithm; halved where only one of the two rows keeps it.

    References
    ----------
    Lai, Wang, Yan, Wang, Zou, "Motion segmentation via a sparsity constraint", IEEE T-ITS 2017, as used by Xu,
    Cheong, Li, CVPR 2018.
    """
    raised = affinity**POWER
    gap = raised.max(1, keepdims=True) - raised
    share = gap / np.maximum(gap.sum(1, keepdims=True), np.finfo(float).tiny)
    logarithm = np.log(share + np.finfo(float).eps)
    keep = (logarithm < (share * logarithm).sum(1, keepdims=True)).astype(np.float64)
    return np.asarray((keep + keep.T) / 2 * affinity)


def fused(views: Sequence[Floats], clusters: int | None = None, sparse: bool = True) -> Floats:
    """One affinity (N, N), 0 to 1, of several of the same objects: sum, or co-regularised if ``clusters`` is given.

    Where values only rank, as numbers of shared choices do, each is sparsified first: what two views both find weak would
    otherwise add up to a floor under everything. Where one half is a border, the mean keeps it.

    Parameters
    ----------
    views : (N, N), 0 to 1, as ``affinity.normalised`` gives them.
    clusters : columns of the embedding of each view; the affinity is then the cosine between rows of the common
        embedding, negative ones 0.
    """
    views = [sparsify(view) for view in views] if sparse else views
    if clusters is None:
        return np.asarray(np.mean(views, axis=0))
    rows = coregularised(views, clusters)
    return np.clip(rows @ rows.T, 0.0, 1.0)


def coregularised(affinities: Sequence[Floats], clusters: int, strength: float = STRENGTH) -> Floats:
    """The common embedding (N, views * clusters) of several affinities, rows of length 1.

    Each view's eigenvectors are computed again with those of the others added to its affinity, until the sum of
    the traces settles.

    Parameters
    ----------
    affinities : per view (N, N), symmetric, at least 0.
    clusters : eigenvectors of each view.
    strength : weight of the other views.

    References
    ----------
    Kumar, Rai, Daume, "Co-regularized multi-view spectral clustering", NIPS 2011 (pairwise); Xu, Cheong, Li, "Motion
    segmentation by exploiting complementary geometric models", CVPR 2018.
    """
    views = [laplacian(a) for a in affinities]
    vectors = [lowest(view, clusters) for view in views]
    before = np.inf
    for _ in range(ROUNDS):
        for i, view in enumerate(views):
            others = [u @ u.T for j, u in enumerate(vectors) if j != i]
            vectors[i] = lowest(view - strength * np.sum(others, axis=0), clusters)
        now = sum(float((u * (view @ u)).sum()) for view, u in zip(views, vectors, strict=True))
        if abs(before - now) < SETTLED:
            break
        before = now
    return unit_rows(np.concatenate([unit_rows(u) for u in vectors], axis=1))


def embedding(affinity: Floats, clusters: int) -> Floats:
    """Rows (N, clusters) of length 1 of the lowest eigenvectors (Ng, Jordan, Weiss 2002)."""
    return unit_rows(lowest(laplacian(affinity), clusters))


def laplacian(affinity: Floats) -> Floats:
    """Symmetric normalised Laplacian (N, N)."""
    safe = affinity + ISOLATED
    scale = safe.sum(1) ** -0.5
    return np.asarray(np.eye(len(safe)) - scale[:, None] * safe * scale)


def lowest(matrix: Floats, count: int) -> Floats:
    """Eigenvectors (N, count) of the smallest eigenvalues; fewer columns if there are fewer rows."""
    last = min(count, len(matrix)) - 1
    return np.asarray(scipy.linalg.eigh(matrix, subset_by_index=[0, last])[1])


def unit_rows(rows: Floats) -> Floats:
    """Rows of length 1; rows of 0 stay."""
    return np.asarray(rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), TINY))


def count_groups(affinity: Floats, most: int = 10) -> int:
    """Number of groups, 2 to ``most``: where the eigenvalues of the Laplacian grow by the largest factor.

    The gap itself grows with the eigenvalues and finds the segments within the groups instead.
    """
    last = min(most, len(affinity) - 1)
    if last < 2:
        return len(affinity)
    values = np.maximum(
        scipy.linalg.eigh(laplacian(affinity), eigvals_only=True, subset_by_index=[1, last]), LEAST_EIGENVALUE
    )
    return 2 + int((values[1:] / values[:-1]).argmax())


def merged(affinity: Floats, segment: NDArray[np.int64], groups: int) -> NDArray[np.int64]:
    """Join clusters until ``groups`` are left.

    The next two are those whose mean affinity is largest relative to the mean within the looser of the two, so that
    neither the size nor the spread of a cluster decides; a cut into few balanced parts would rather halve the
    background. Over-segment, then merge: Chin, Wang, Suter, "Robust fitting of multiple structures", ICCV 2009.

    Parameters
    ----------
    affinity : (N, N).
    segment : (N,) clusters 0.. .

    Returns
    -------
    (N,) group of each, named by one of its clusters.
    """
    member = np.eye(int(segment.max()) + 1)[segment]
    total, size = member.T @ affinity @ member, member.sum(0)
    name = np.arange(len(size))
    alive = np.flatnonzero(size)
    while len(alive) > groups:
        mean = total[np.ix_(alive, alive)] / (size[alive][:, None] * size[alive])
        within = np.maximum(np.diagonal(mean), TINY)
        ratio = mean / np.minimum(within[:, None], within)
        np.fill_diagonal(ratio, -1.0)
        first, second = alive[list(divmod(int(ratio.argmax()), len(alive)))]
        total[first] += total[second]
        total[:, first] += total[:, second]
        size[first] += size[second]
        name[name == second] = first
        alive = alive[alive != second]
    return np.asarray(name[segment])
