"""Track points: kernels of rectangular residuals, fusion, segments merged, classification and its error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import SHARED

from zsmoseg.grouping.fusion import coregularised, count_groups, embedding, fused, merged, sparsify
from zsmoseg.grouping.kernels import ordered, shared_choices
from zsmoseg.grouping.points import classify, combined, cue_affinity, parted
from zsmoseg.grouping.twoview import CUES
from zsmoseg.metrics.misclassification import classification_error


# -------------------------------------------------------------------------- the error
@pytest.mark.parametrize(
    ("truth", "prediction", "error"),
    [
        ([1, 1, 2, 2], [5, 5, 0, 0], 0.0),
        ([1, 1, 2, 2], [5, 5, 5, 0], 25.0),
        ([1, 1, 2, 2], [7, 7, 7, 7], 50.0),
        ([1, 1, 1, 1], [0, 1, 2, 3], 75.0),
        ([1] * 5 + [2] * 4, [0] * 3 + [1] * 2 + [0] * 4, 100 * 3 / 9),
    ],
)
def test_error_under_the_best_assignment(truth: list[int], prediction: list[int], error: float) -> None:
    assert classification_error(np.array(truth), np.array(prediction)) == pytest.approx(error)


def test_error_of_other_points_is_refused() -> None:
    with pytest.raises(ValueError, match="same points"):
        classification_error(np.zeros(3, int), np.zeros(4, int))


# -------------------------------------------------------------------------- kernels and fusion
def test_shared_choices_equal_the_ordered_kernel_of_columns() -> None:
    residual = np.random.default_rng(0).random((40, 7))
    np.testing.assert_allclose(shared_choices(residual, 0.2), ordered(residual, 0.2, "column") / 8, atol=1e-6)


def test_points_that_rank_hypotheses_alike_share_them_whatever_their_scale() -> None:
    residual = np.random.default_rng(0).random((50, 1)) * np.array([1.0, 100.0])
    np.testing.assert_array_equal(shared_choices(residual, 0.1), np.ones((2, 2)))


def blocks(sizes: tuple[int, ...], within: float, across: float, noise: float = 0.05) -> np.ndarray:
    group = np.repeat(np.arange(len(sizes)), sizes)
    clean = np.where(group[:, None] == group, within, across)
    jitter = noise * np.random.default_rng(3).random(clean.shape)
    return clean + (jitter + jitter.T) / 2


def test_sparsifying_takes_the_floor_away_and_leaves_what_stands_out() -> None:
    affinity = blocks((20, 20), 0.8, 0.3)
    sparse = sparsify(affinity)
    assert sparse[:20, 20:].max() == 0
    kept = sparse > 0
    assert kept[:20, :20].mean() > 0.4
    np.testing.assert_array_equal(sparse, sparse.T)
    assert set(np.unique(np.round(sparse[kept] / affinity[kept], 9))) <= {0.5, 1.0}


def test_a_sparse_row_of_equal_entries_is_kept_finite() -> None:
    assert np.isfinite(sparsify(np.ones((4, 4)))).all()


def test_a_sum_is_the_mean_of_what_stands_out_in_each_view() -> None:
    one, two = blocks((20, 20), 0.8, 0.3), blocks((10, 30), 0.6, 0.2)
    np.testing.assert_array_equal(fused([one, two]), (sparsify(one) + sparsify(two)) / 2)
    np.testing.assert_allclose(fused([one, one]), sparsify(one))


def test_coregularised_views_find_what_neither_finds_alone() -> None:
    first, second = blocks((10, 20), 0.9, 0.1), blocks((20, 10), 0.9, 0.1)
    rows = coregularised([first, second], 3)
    assert rows.shape == (30, 6)
    np.testing.assert_allclose(np.linalg.norm(rows, axis=1), 1)
    centre = np.stack([rows[:10].mean(0), rows[10:20].mean(0), rows[20:].mean(0)])
    nearest = np.linalg.norm(rows[:, None] - centre, axis=2).argmin(1)
    np.testing.assert_array_equal(nearest, np.repeat([0, 1, 2], 10))


def test_coregularisation_draws_views_together() -> None:
    first, second = blocks((12, 12), 0.6, 0.3, 0.4), blocks((12, 12), 0.5, 0.4, 0.6)

    def apart(strength: float) -> float:
        rows = coregularised([first, second], 2, strength).reshape(24, 2, 2) * np.sqrt(2)
        one, two = rows[:, 0] @ rows[:, 0].T, rows[:, 1] @ rows[:, 1].T
        return float(np.abs(one - two).mean())

    assert apart(0.5) < 0.9 * apart(0.0)


def test_coregularised_affinity_lies_between_0_and_1_and_parts_the_groups() -> None:
    view = blocks((4, 3), 0.9, 0.1)
    affinity = fused([view, view], 2)
    assert affinity.min() >= 0
    assert affinity.max() <= 1
    assert affinity[:4, :4].min() > 0.9 > 0.1 > affinity[:4, 4:].max()


def test_more_clusters_than_things_are_no_error() -> None:
    assert embedding(np.ones((2, 2)), 5).shape == (2, 2)


def test_what_is_like_nothing_has_an_embedding() -> None:
    affinity = blocks((3, 3), 1.0, 0.0, 0.0)
    affinity[0] = affinity[:, 0] = 0
    assert np.isfinite(embedding(affinity, 2)).all()


def test_segments_merge_by_likeness_not_by_size() -> None:
    affinity = blocks((60, 40, 6, 6), 0.9, 0.05)
    affinity[:60, 60:100] = affinity[60:100, :60] = 0.3
    segment = np.repeat([0, 1, 2, 3], [60, 40, 6, 6])
    found = merged(affinity, segment, 3)
    np.testing.assert_array_equal(found, np.repeat([0, 0, 2, 3], [60, 40, 6, 6]))
    np.testing.assert_array_equal(merged(affinity, segment, 4), segment)


@pytest.mark.parametrize("groups", [2, 3, 5])
def test_number_of_groups_where_eigenvalues_grow_most(groups: int) -> None:
    assert count_groups(sparsify(blocks((20,) * groups, 0.8, 0.3))) == groups


@pytest.mark.parametrize("count", [1, 2])
def test_number_of_groups_of_few_things(count: int) -> None:
    assert count_groups(np.ones((count, count))) == count


def test_a_segment_number_that_no_point_has_is_no_group() -> None:
    segment = np.repeat([0, 2, 4], 5)
    assert len(np.unique(merged(blocks((5, 5, 5), 0.9, 0.1), segment, 3))) == 3


# -------------------------------------------------------------------------- classification
def two_bodies(frames: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """Tracks of a deep scene and of a body that moves by itself, before a moving camera."""
    rng = np.random.default_rng(4)
    scene = rng.uniform((-2, -2, 4), (2, 2, 8), (90, 3))
    mover = rng.uniform((-0.1, -0.6, 3.4), (1.1, 0.6, 4.6), (40, 3))
    points = []
    for t in range(frames):
        seen = np.concatenate([scene, mover + np.array([0.0, 0.12 * t, 0.0])])
        seen += (0.1 * t, 0.0, -0.05 * t)
        points.append(400 * seen[:, :2] / seen[:, 2:] + rng.normal(0, 0.1, (130, 2)))
    return np.stack(points, axis=1), np.repeat([0, 1], [90, 40])


def test_bodies_of_two_motions_are_told_apart() -> None:
    points, truth = two_bodies()
    affinities = {cue: cue_affinity(points, np.ones(points.shape[:2], bool), cue) for cue in CUES}
    found = classify(affinities, 2)
    assert set(found) == {*CUES, "added", "co-regularised"}
    assert classification_error(truth, found["added"]) < 3
    assert classification_error(truth, found["co-regularised"]) < 3
    total = combined(affinities)
    assert count_groups(total) == 2
    np.testing.assert_array_equal(parted(total, 2), found["added"])


def test_affinity_lies_between_0_and_1_and_is_0_for_what_is_never_seen_together() -> None:
    points, _ = two_bodies()
    visible = np.ones(points.shape[:2], bool)
    visible[:60, 3:] = False
    visible[60:, :3] = False
    affinity = cue_affinity(points, visible, "homography", gaps=(1,))
    assert affinity[:60, 60:].max() == 0
    assert 0 <= affinity.min() <= affinity.max() < 1
    np.testing.assert_array_equal(affinity, affinity.T)


def test_too_few_points_for_a_cue_say_nothing() -> None:
    points, _ = two_bodies()
    few = points[:8]
    assert cue_affinity(few, np.ones(few.shape[:2], bool), "fundamental").max() == 0
    assert cue_affinity(few, np.ones(few.shape[:2], bool), "affine").max() > 0


def test_the_same_tracks_give_the_same_bytes() -> None:
    points, _ = two_bodies(3)
    visible = np.ones(points.shape[:2], bool)
    one, again = (cue_affinity(points, visible, "fundamental") for _ in range(2))
    np.testing.assert_array_equal(one, again)


@pytest.fixture(scope="module")
def kt3dmoseg() -> Path:
    folder = SHARED / "kt3dmoseg"
    if not folder.is_dir():
        pytest.skip("the KT3DMoSeg tracks are not beside the checkout")
    return folder


def test_a_real_clip_with_one_mover(kt3dmoseg: Path) -> None:
    with np.load(kt3dmoseg / "seq037_clip01.npz") as clip:
        points, visible, truth = clip["points"], clip["visible"], clip["label"]
    found = classify({cue: cue_affinity(points, visible, cue) for cue in CUES}, 2)
    assert classification_error(truth, found["added"]) < 2
    assert classification_error(truth, found["co-regularised"]) < 2
