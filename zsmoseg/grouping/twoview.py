"""What two views of one rigid motion share: an affine map, a homography or a fundamental matrix.

Fitted to many minimal samples at once; algebra as in Hartley and Zisserman, "Multiple View Geometry", chapters 4, 11.

Distances: Sampson, "Fitting conic sections to very scattered data", CGIP 1982. Conditioning: Hartley, "In defense of
the eight-point algorithm", PAMI 1997.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from zsmoseg.motion.models import Floats

Cue = Literal["affine", "homography", "fundamental"]
CUES: tuple[Cue, ...] = ("affine", "homography", "fundamental")
SAMPLE: dict[Cue, int] = {"affine": 3, "homography": 4, "fundamental": 8}
"""Points that determine a model; the linear fit of a fundamental matrix takes eight."""

TINY = 1e-12


def homogeneous(points: Floats) -> Floats:
    """(..., 3) of (..., 2)."""
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)


def centred(points: Floats) -> Floats:
    """(N, 2) with mean 0 and mean length sqrt(2), so that linear fits are well conditioned."""
    moved = points - points.mean(0)
    return np.asarray(moved * (np.sqrt(2) / max(float(np.linalg.norm(moved, axis=1).mean()), TINY)))


def fit_samples(cue: Cue, first: Floats, second: Floats) -> Floats:
    """Models (M, 3, 3) of M samples.

    Parameters
    ----------
    first, second : (M, k, 2) points in either frame, k at least ``SAMPLE[cue]``; lengths near 1 (``centred``).

    Returns
    -------
    Maps from the first frame to the second, or matrices with second' F first = 0 of rank 2. A degenerate sample
    gives some matrix that explains nothing well.
    """
    if cue == "fundamental":
        return _rank_two(_null(_epipolar_rows(first, second)))
    if cue == "homography":
        return _null(_projective_rows(first, second))
    lifted = homogeneous(first)
    square = lifted.swapaxes(1, 2) @ lifted + TINY * np.eye(3)
    top = np.linalg.solve(square, lifted.swapaxes(1, 2) @ second).swapaxes(1, 2)
    return np.concatenate([top, np.broadcast_to([0.0, 0.0, 1.0], (len(top), 1, 3))], axis=1)


def _epipolar_rows(first: Floats, second: Floats) -> Floats:
    rows = homogeneous(second)[..., :, None] * homogeneous(first)[..., None, :]
    return rows.reshape(*rows.shape[:-2], 9)


def _projective_rows(first: Floats, second: Floats) -> Floats:
    lifted, zero = homogeneous(first), np.zeros((*first.shape[:-1], 3))
    across = np.concatenate([lifted, zero, -second[..., :1] * lifted], axis=-1)
    down = np.concatenate([zero, lifted, -second[..., 1:] * lifted], axis=-1)
    return np.concatenate([across, down], axis=1)


def _null(rows: Floats) -> Floats:
    """(M, 3, 3) the unit vectors that (M, r, 9) rows map nearest to 0."""
    vectors = np.linalg.eigh(rows.swapaxes(1, 2) @ rows)[1]
    return np.asarray(vectors[..., 0].reshape(-1, 3, 3))


def _rank_two(matrices: Floats) -> Floats:
    left, values, right = np.linalg.svd(matrices)
    values[:, 2] = 0.0
    return np.asarray((left * values[:, None, :]) @ right)


def distances(cue: Cue, models: Floats, first: Floats, second: Floats) -> Floats:
    """Squared distances (M, N) of N point pairs from M models, in the points' own unit squared.

    Sampson distance for a fundamental matrix; the squared error in the second frame for an affine map, in both
    frames for a homography.
    """
    if cue == "fundamental":
        return sampson(models, first, second)
    ahead = _transfer(models, first, second)
    return ahead if cue == "affine" else ahead + _transfer(_adjugate(models), second, first)


def sampson(models: Floats, first: Floats, second: Floats) -> Floats:
    """First-order squared distance (M, N) of point pairs (N, 2) from the epipolar geometry (M, 3, 3)."""
    x, y = second.T
    a, b, c = _mapped(models, first)
    d, e, _ = _mapped(models.swapaxes(1, 2), second)
    return np.asarray((a * x + b * y + c) ** 2 / np.maximum(a**2 + b**2 + d**2 + e**2, TINY**2))


def _transfer(models: Floats, first: Floats, second: Floats) -> Floats:
    x, y = second.T
    a, b, depth = _mapped(models, first)
    depth = np.where(np.abs(depth) > TINY, depth, TINY)
    return np.asarray((a / depth - x) ** 2 + (b / depth - y) ** 2)


def _mapped(models: Floats, points: Floats) -> Floats:
    """(3, M, N) the three coordinates of (N, 2) points under (M, 3, 3)."""
    return np.asarray(models.transpose(1, 0, 2) @ homogeneous(points).T)


def _adjugate(matrices: Floats) -> Floats:
    """The inverse up to scale, defined where there is none."""
    rows = [np.cross(matrices[:, (i + 1) % 3], matrices[:, (i + 2) % 3]) for i in range(3)]
    return np.stack(rows, axis=2)
