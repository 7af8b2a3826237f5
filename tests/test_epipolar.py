"""Two-view models, their distances, random hypotheses and the residuals of objects."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from zsmoseg.flow.trajectories import Tracks
from zsmoseg.grouping.affinity import Kernel, accumulate, normalised, of_views
from zsmoseg.grouping.epipolar import (
    LEAST_POINTS,
    epipolar_residuals,
    object_residuals,
)
from zsmoseg.grouping.fusion import fused
from zsmoseg.grouping.points import hypothesis_residuals
from zsmoseg.grouping.robust import model_errors, robust_model
from zsmoseg.grouping.twoview import CUES, SAMPLE, centred, distances, fit_samples
from zsmoseg.settings import resolve

GAPS = resolve().trajectories.gaps
FOCAL, CENTRE = 300.0, np.array([200.0, 120.0])


def project(points: np.ndarray) -> np.ndarray:
    return FOCAL * points[:, :2] / points[:, 2:] + CENTRE


def body(
    rng: np.random.Generator, count: int, at: tuple[float, float, float], size: float = 1.0
) -> np.ndarray:
    return rng.uniform(-size, size, (count, 3)) + at


def moved(points: np.ndarray, turn: float, shift: tuple[float, float, float]) -> np.ndarray:
    c, s = np.cos(turn), np.sin(turn)
    return points @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) + shift


def two_views(count: int = 60, noise: float = 0.0, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A deep scene before a camera that moves and turns."""
    rng = np.random.default_rng(seed)
    scene = body(rng, count, (0, 0, 4))
    first, second = project(scene), project(moved(scene, 0.05, (0.4, 0.05, 0.1)))
    return first + noise * rng.normal(size=first.shape), second + noise * rng.normal(size=second.shape)


# -------------------------------------------------------------------------- models
def planar_views(cue: str) -> tuple[np.ndarray, np.ndarray]:
    first = np.random.default_rng(1).uniform(0, 400, (30, 2))
    perspective = 0.0 if cue == "affine" else 3e-4
    matrix = np.array([[1.05, 0.02, 3.0], [-0.03, 0.97, -2.0], [perspective, -perspective / 2, 1.0]])
    lifted = np.column_stack([first, np.ones(len(first))]) @ matrix.T
    return first, lifted[:, :2] / lifted[:, 2:]


@pytest.mark.parametrize("cue", CUES)
def test_a_minimal_sample_of_exact_points_explains_all_others(cue: Any) -> None:
    a, b = map(centred, two_views() if cue == "fundamental" else planar_views(cue))
    sample = np.stack([np.random.default_rng(k).permutation(len(a))[: SAMPLE[cue]] for k in range(5)])
    error = distances(cue, fit_samples(cue, a[sample], b[sample]), a, b)
    assert error.shape == (5, len(a))
    assert np.median(error) < 1e-12
    wrong = distances(cue, fit_samples(cue, a[sample], b[sample]), a, b[::-1])
    assert np.median(wrong) > 1e-3


def test_fundamental_matrices_have_rank_two() -> None:
    a, b = map(centred, two_views(noise=2.0))
    models = fit_samples("fundamental", a[None, :20], b[None, :20])
    values = np.linalg.svd(models[0], compute_uv=False)
    assert values[2] < 1e-12 < values[1]


def test_sampson_distance_is_that_to_the_nearest_pair_of_true_correspondences() -> None:
    first, second = two_views()
    a, b = first / 100, second / 100
    model = fit_samples("fundamental", a[None], b[None])
    slope = model[0] @ [*a[0], 1.0]
    normal = slope[:2] / np.linalg.norm(slope[:2])
    error = distances("fundamental", model, a[:1], b[:1] + 1e-3 * normal)[0, 0]
    back = model[0].T @ [*b[0], 1.0]
    share = slope[:2] @ slope[:2] / (slope[:2] @ slope[:2] + back[:2] @ back[:2])
    np.testing.assert_allclose(error, 1e-6 * share, rtol=0.02)


def test_a_degenerate_sample_gives_finite_distances() -> None:
    same = np.ones((1, 8, 2))
    for cue in CUES:
        models = fit_samples(cue, same[:, : SAMPLE[cue]], same[:, : SAMPLE[cue]])
        assert np.isfinite(distances(cue, models, *map(centred, two_views()))).all()


@pytest.mark.parametrize("cue", CUES)
def test_hypotheses_are_the_same_for_the_same_pair_and_others_for_another(cue: Any) -> None:
    first, second = two_views()
    one, again, other = (
        hypothesis_residuals(cue, first, second, 20, seed) for seed in ((3, 1), (3, 1), (4, 1))
    )
    assert one.shape == (20, len(first))
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, other)


# -------------------------------------------------------------------------- objects
def test_depth_needs_a_fundamental_matrix_and_a_plane_a_homography() -> None:
    assert robust_model(*two_views(200, 0.3))[0] == "fundamental"
    assert robust_model(*planar_views("homography"))[0] == "homography"


@pytest.mark.parametrize("few", [8, 12])
def test_points_that_stand_still_give_a_model_whatever_their_number(few: int) -> None:
    first = np.random.default_rng(2).uniform(0, 50, (few, 2))
    cue, model = robust_model(first, first)
    assert model_errors(cue, model, first, first).max() < 1e-6
    same = np.ones((few, 2))
    assert np.isfinite(robust_model(same, same)[1]).all()


@pytest.mark.parametrize("cue", ["homography", "fundamental"])
def test_errors_of_all_models_are_on_the_scale_of_the_noise(cue: Any) -> None:
    first, second = two_views(2000) if cue == "fundamental" else planar_views(cue)
    a, b = map(centred, (first, second))
    exact = fit_samples(cue, a[None], b[None])[0]
    rng = np.random.default_rng(5)
    noise = 1e-3
    error = [
        model_errors(
            cue, exact, a + noise * rng.normal(size=a.shape), b + noise * rng.normal(size=b.shape)
        ).mean()
        for _ in range(50)
    ]
    assert np.mean(error) == pytest.approx(noise**2, rel=0.15)


def test_an_outlier_does_not_change_what_a_model_says_of_the_others() -> None:
    first, second = two_views(100, 0.2)
    second[::10] += 30
    cue, model = robust_model(first, second)
    inlier = np.arange(100) % 10 > 0
    assert model_errors(cue, model, first, second)[inlier].mean() < 0.2


def tracks_of(frames: list[np.ndarray]) -> Tracks:
    count = len(frames[0])
    number, frame = np.tile(np.arange(count), len(frames)), np.repeat(np.arange(len(frames)), count)
    return Tracks(number, frame, np.concatenate(frames).astype(np.float32))


def scene_tracks(noise: float = 0.2) -> tuple[Tracks, np.ndarray]:
    """Nine frames: a background (0), two pieces of it (1, 2) and a mover (3) of which 3 and 4 are the halves."""
    rng = np.random.default_rng(7)
    parts = [
        body(rng, 200, (0, 0, 5), 2.0),
        body(rng, 40, (-1, 0, 4), 0.6),
        body(rng, 40, (1, 0.5, 5), 0.6),
        body(rng, 40, (0.0, -0.4, 4), 0.5),
        body(rng, 40, (0.4, -0.4, 4), 0.5),
    ]
    frames = []
    for t in range(9):
        camera = [moved(p, 0.01 * t, (0.08 * t, 0.0, -0.04 * t)) for p in parts]
        camera[3:] = [moved(p, 0.0, (0.0, 0.05 * t, 0.0)) for p in camera[3:]]
        frames.append(np.concatenate([project(p) for p in camera]))
    noisy = [f + noise * rng.normal(size=f.shape) for f in frames]
    return tracks_of(noisy), np.tile(np.repeat(np.arange(5), [len(p) for p in parts]), 9)


def test_pieces_of_the_scene_fit_its_epipolar_geometry_and_movers_do_not() -> None:
    tracks, label = scene_tracks()
    pair = next(epipolar_residuals(tracks, label, (8,)))
    assert (pair.start, pair.gap, pair.ids.tolist()) == (0, 8, [0, 1, 2, 3, 4])
    assert pair.residual[0, 1:3].max() < 0.2
    assert pair.residual[0, 3:].min() > 1.0
    np.testing.assert_array_equal(pair.points, [200, 40, 40, 40, 40])


def test_motion_stands_out_more_over_a_longer_gap() -> None:
    tracks, label = scene_tracks()
    by_gap = [next(epipolar_residuals(tracks, label, (gap,))).residual[0, 3] for gap in (1, 4, 8)]
    assert by_gap[0] < by_gap[1] < by_gap[2]


def test_pairs_of_a_gap_do_not_overlap() -> None:
    tracks, label = scene_tracks()
    found = [(p.gap, p.start) for p in epipolar_residuals(tracks, label, (2, 4))]
    assert found == [(2, 0), (2, 2), (2, 4), (2, 6), (4, 0), (4, 4)]


def test_residuals_make_an_affinity_that_parts_movers_from_the_scene_alone_and_fused() -> None:
    tracks, label = scene_tracks()
    pairs = ((p.ids, p.residual, p.points) for p in epipolar_residuals(tracks, label, GAPS))
    kernel = resolve().affinity.parameters(Kernel)
    view = normalised(*accumulate(of_views(pairs, kernel), 5)[:2], kernel.kernel)
    for affinity in (view, fused([view, view], sparse=False), fused([view, view], 2)):
        same = np.array([0, 0, 0, 1, 1])
        within = affinity[same[:, None] == same]
        across = affinity[same[:, None] != same]
        assert within.min() > across.max() + 0.3
    assert view[0, 1:3].min() > 0.5 > view[0, 3:].max()


def test_objects_of_few_tracks_are_unseen() -> None:
    first, second = two_views(60)
    slot = np.repeat([0, 1], [60 - LEAST_POINTS + 1, LEAST_POINTS - 1])
    residual, points = object_residuals(first, second, slot, 2)
    assert np.isfinite(residual[0, 0])
    assert np.isnan(residual[[0, 1, 1], [1, 0, 1]]).all()
    assert points.tolist() == [60 - LEAST_POINTS + 1, LEAST_POINTS - 1]


def test_a_track_that_changes_its_object_says_nothing() -> None:
    tracks, label = scene_tracks()
    changed = label.copy()
    changed[tracks.at(8)] = 3
    pair = next(epipolar_residuals(tracks, changed, (8,)))
    assert pair.ids.tolist() == [3]


def test_no_tracks_give_no_pairs() -> None:
    none = Tracks(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2), np.float32))
    assert list(epipolar_residuals(none, np.zeros(0, np.int64), GAPS)) == []


def test_residuals_are_the_same_bytes_again() -> None:
    tracks, label = scene_tracks()
    one, again = ([p.residual for p in epipolar_residuals(tracks, label, GAPS)] for _ in range(2))
    for a, b in zip(one, again, strict=True):
        np.testing.assert_array_equal(a, b)
