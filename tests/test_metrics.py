"""Metrics against the numbers of the official evaluators, their definitions, and the golden scores."""

from __future__ import annotations

import csv
import itertools
import weakref
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import SHARED
from PIL import Image
from scipy.ndimage import distance_transform_edt
from scipy.optimize import linear_sum_assignment

from zsmoseg.errors import FormatError
from zsmoseg.metrics.clips import Clip, Frame
from zsmoseg.metrics.contours import BOUND, boundary_map, contour, contour_f, tolerance
from zsmoseg.metrics.counts import PairSums, pair_counts
from zsmoseg.metrics.davis import frame_scores, match_proposals, statistics
from zsmoseg.metrics.davis_protocols import score_objects, score_proposals
from zsmoseg.metrics.fbms import region_scores
from zsmoseg.metrics.means import mean_scores
from zsmoseg.metrics.misclassification import classification_error
from zsmoseg.metrics.motion_state import motion_scores
from zsmoseg.metrics.moving_protocol import score_moving
from zsmoseg.metrics.protocols import PROTOCOLS
from zsmoseg.metrics.regions import region_j
from zsmoseg.metrics.tracks import match_tracks, merged_scores, track_scores
from zsmoseg.metrics.votes import PointVotes

HALF = np.repeat([[1, 1, 1, 1, 1, 0, 0, 0, 0, 0]], 10, 0)
NOTHING = np.zeros_like(HALF)


def painted(base: np.ndarray, *parts: tuple[slice, slice, int]) -> np.ndarray:
    """A copy with rectangles filled."""
    out = base.copy()
    for rows, columns, label in parts:
        out[rows, columns] = label
    return out


ALL = slice(None)
TWO_HALVES = painted(HALF, (slice(5, 10), slice(0, 5), 2))
SIX_TO_FOUR = painted(HALF, (slice(6, 10), slice(0, 5), 2))
WITH_VOID = painted(HALF, (slice(0, 5), slice(5, 6), 255))
WIDE = np.repeat([[1] * 10 + [0] * 10], 10, 0)
CASES = {
    "perfect": (HALF, HALF, (100, 100, 100)),
    "empty prediction": (HALF, NOTHING, (0, 0, 0)),
    "empty truth": (NOTHING, HALF, (0, 0, 0)),
    "both empty": (NOTHING, NOTHING, (0, 0, 0)),
    "split into equal tracks": (HALF, TWO_HALVES, (50, 50, 50)),
    "split 30 + 20": (HALF, SIX_TO_FOUR, (60, 60, 60)),
    "a second track on background": (HALF, painted(HALF, (ALL, slice(5, 8), 2)), (62.5, 100, 76.9231)),
    "two objects under one track": (SIX_TO_FOUR, HALF, (60, 60, 60)),
    "disjoint": (HALF, 1 - HALF, (0, 0, 0)),
    "255 in the truth is a track": (WITH_VOID, HALF, (100, 90.9091, 95.2381)),
    "255 covered by the object's track": (WITH_VOID, (WITH_VOID > 0).astype(int), (90.9091,) * 3),
    "255 with a track of its own": (WITH_VOID, painted(HALF, (slice(0, 5), slice(5, 6), 7)), (100, 100, 100)),
    "F decides, not the overlap": (
        WIDE,
        painted(np.zeros_like(WIDE), (slice(0, 4), slice(0, 10), 1), (slice(4, 10), slice(0, 20), 2)),
        (25, 40, 30.7692),
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_tracks_of_the_worked_examples(case: str) -> None:
    truth, prediction, expected = CASES[case]
    assert track_scores([(truth, prediction)]) == pytest.approx(expected, abs=5e-5)


def test_an_identity_that_switches_costs_half() -> None:
    frames = [(HALF, HALF), (HALF, HALF), (HALF, 2 * HALF), (HALF, 2 * HALF)]
    assert track_scores(frames) == (50, 50, 50)


def volume_scores(truth: np.ndarray, prediction: np.ndarray) -> tuple[float, float, float]:
    """Pu, Ru, Fu by their definition, on whole volumes, mask by mask."""
    objects, tracks = np.unique(truth[truth != 0]), np.unique(prediction[prediction != 0])
    hits, f = np.zeros((len(objects), len(tracks))), np.zeros((len(objects), len(tracks)))
    for i, o in enumerate(objects):
        for k, t in enumerate(tracks):
            hits[i, k] = np.count_nonzero((truth == o) & (prediction == t))
            p, r = hits[i, k] / np.count_nonzero(prediction == t), hits[i, k] / np.count_nonzero(truth == o)
            f[i, k] = 2 * p * r / max(p + r, 1e-10)
    hit = hits[linear_sum_assignment(-f)].sum()
    p = 100 * hit / max(np.count_nonzero(prediction), 1e-10)
    r = 100 * hit / max(np.count_nonzero(truth), 1e-10)
    return p, r, 2 * p * r / max(p + r, 1e-10)


def test_tracks_of_random_volumes_are_those_of_the_definition() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        shape = (int(rng.integers(1, 5)), *rng.integers(2, 14, 2))
        truth = rng.choice([0, 1, 2, 5, 255], shape)
        prediction = rng.choice([-3, 0, 0, 1, 4, 70_000], shape)
        assert track_scores(zip(truth, prediction, strict=True)) == volume_scores(truth, prediction)


def test_merged_tracks_are_never_worse_than_matched_ones() -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        truth, prediction = rng.integers(0, 4, (2, 8, 9))
        sums = PairSums()
        sums.add(pair_counts(truth, prediction))
        merged = merged_scores(sums.table())
        assert merged == track_scores([(truth > 0, prediction > 0)])
        assert all(a >= b for a, b in zip(merged, track_scores([(truth, prediction)]), strict=True))


def test_no_frame_is_kept_while_tracks_are_counted() -> None:
    alive: list[weakref.ref[np.ndarray]] = []
    most = 0

    def frames() -> itertools.chain:  # type: ignore[type-arg]
        nonlocal most
        for n in range(20):
            truth = np.full((50, 50), n % 3)
            alive.append(weakref.ref(truth))
            most = max(most, sum(ref() is not None for ref in alive))
            yield truth, truth

    assert track_scores(frames()).fu == 100
    assert most <= 3


def clip_of(truth: np.ndarray, prediction: np.ndarray, *rules: Any) -> Clip:
    """One frame to score; ``rules``: void, official, objects."""
    return Clip([Frame("goat", 0, truth, prediction)], *rules)


def test_without_background_the_formula_gives_a_value_and_official_stops() -> None:
    full = np.ones((4, 4), int)
    for truth, prediction in ((full, NOTHING[:4, :4]), (HALF[:4, :4], 2 * full)):
        score_moving(clip_of(truth, prediction))
        with pytest.raises(FormatError, match=r"goat: the official program stops.*no background pixel"):
            score_moving(clip_of(truth, prediction, None, True))


def test_void_leaves_pixels_out_of_tracks_only_when_asked() -> None:
    covered = (WITH_VOID > 0).astype(int)
    as_label = score_moving(clip_of(WITH_VOID, covered)).values
    left_out = score_moving(clip_of(WITH_VOID, covered, 255)).values
    assert as_label["Fu"] == pytest.approx(90.9091, abs=5e-5)
    assert left_out["Fu"] == left_out["J"] == 100


def boundary_f(
    truth: np.ndarray, prediction: np.ndarray, void: np.ndarray | None = None, bound: float = BOUND
) -> float:
    """F of two whole masks; void pixels are background in both before outlines are drawn."""
    if void is not None:
        truth, prediction = truth & ~void, prediction & ~void
    radius = tolerance(truth.shape, bound)
    return contour_f(contour(truth, radius), contour(prediction, radius))


TRUTH = np.zeros((480, 854), bool)
TRUTH[100:300, 200:500] = True


@pytest.mark.parametrize(
    ("shift", "j", "f"),
    [
        ((0, 0), 1, 1),
        ((0, 4), 0.973684210526, 1),
        ((0, 8), 0.948051948052, 1),
        ((0, 9), 0.941747572816, 0.616),
        ((5, 5), 0.920768307323, 1),
        ((6, 6), 0.905850962455, 0.999),
    ],
)
def test_j_and_f_of_a_shifted_rectangle(shift: tuple[int, int], j: float, f: float) -> None:
    moved = np.roll(TRUTH, shift, (0, 1))
    assert region_j(TRUTH, moved) == pytest.approx(j, abs=1e-12)
    assert boundary_f(TRUTH, moved) == pytest.approx(f, abs=1e-12)
    numbers = TRUTH.astype(np.uint8), 3 * moved.astype(np.uint8)
    assert frame_scores(*numbers, [(1, 3)]) == ([region_j(TRUTH, moved)], [boundary_f(TRUTH, moved)])


def test_j_and_f_of_empty_and_full_masks() -> None:
    empty, full = np.zeros_like(TRUTH), np.ones_like(TRUTH)
    assert (region_j(TRUTH, empty), boundary_f(TRUTH, empty)) == (0, 0)
    assert (region_j(empty, TRUTH), boundary_f(empty, TRUTH)) == (0, 0)
    assert (region_j(empty, empty), boundary_f(empty, empty)) == (1, 1)
    assert region_j(TRUTH, full) == pytest.approx(0.146370023419, abs=1e-12)
    assert boundary_f(TRUTH, full) == 0
    numbers = TRUTH.astype(np.uint8)
    assert frame_scores(numbers, numbers, [(1, 2), (2, 2), (2, 1)]) == ([0, 1, 0], [0, 1, 0])


def test_void_pixels_count_for_neither_j_nor_f() -> None:
    void = np.zeros_like(TRUTH)
    void[100:300, 500:520] = True
    assert region_j(TRUTH, TRUTH | void, void) == boundary_f(TRUTH, TRUTH | void, void) == 1


@pytest.mark.parametrize(
    ("rows", "columns", "expected"),
    [
        ((2, 4), (3, 6), {(1, 2), (1, 3), (1, 4), (1, 5), (2, 2), (2, 5), (3, 2), (3, 3), (3, 4), (3, 5)}),
        ((4, 6), (5, 8), {(3, 4), (3, 5), (3, 6), (3, 7), (4, 4), (5, 4)}),
        ((0, 2), (0, 2), {(0, 1), (1, 0), (1, 1)}),
        ((0, 6), (0, 8), set()),
    ],
)
def test_the_outline_lies_where_the_evaluators_draw_it(
    rows: tuple[int, int], columns: tuple[int, int], expected: set[tuple[int, int]]
) -> None:
    mask = np.zeros((6, 8), bool)
    mask[slice(*rows), slice(*columns)] = True
    assert set(map(tuple, np.argwhere(boundary_map(mask)).tolist())) == expected


def test_tolerance_grows_with_the_frame() -> None:
    sizes = {(480, 854): 8, (480, 910): 9, (240, 426): 4, (360, 640): 6}
    sizes |= {(540, 960): 9, (720, 1280): 12, (1080, 1920): 18}
    assert {size: tolerance(size) for size in sizes} == sizes
    assert tolerance((480, 854), 3) == 3


def plain_f(truth: np.ndarray, prediction: np.ndarray, void: np.ndarray, bound: float) -> float:
    """F by its definition: distances to outlines on the whole frame."""
    radius = bound if bound >= 1 else np.ceil(bound * np.hypot(*truth.shape))
    edges = [boundary_map(mask & ~void) for mask in (truth, prediction)]
    if not all(edge.any() for edge in edges):
        return float(not any(edge.any() for edge in edges))
    near = [distance_transform_edt(~edge) <= radius + 1e-6 for edge in edges]
    recall = np.count_nonzero(edges[0] & near[1]) / np.count_nonzero(edges[0])
    precision = np.count_nonzero(edges[1] & near[0]) / np.count_nonzero(edges[1])
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def blobs(rng: np.random.Generator, shape: tuple[int, ...], labels: int) -> np.ndarray:
    """Rectangles of random labels, some of them away."""
    out = np.zeros(shape, np.uint8)
    for label in rng.integers(0, labels + 1, 6):
        y, x = (int(rng.integers(0, size)) for size in shape)
        out[y : y + int(rng.integers(1, 25)), x : x + int(rng.integers(1, 25))] = label
    return out


def test_f_of_random_masks_is_that_of_the_definition() -> None:
    rng = np.random.default_rng(2)
    for bound in (0.008, 0.03, 3):
        for _ in range(40):
            shape = tuple(rng.integers(5, 90, 2))
            truth, prediction = blobs(rng, shape, 1) > 0, blobs(rng, shape, 1) > 0
            void = blobs(rng, shape, 1) > 0
            assert boundary_f(truth, prediction, void, bound) == plain_f(truth, prediction, void, bound)


def test_statistics_of_the_worked_examples() -> None:
    falling = np.array([0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.05, 0.0])
    assert statistics(falling) == pytest.approx((0.413636, 0.363636, 0.7), abs=5e-7)
    assert statistics(np.arange(10) / 10) == pytest.approx((0.45, 0.4, -0.7))


def test_decay_beyond_256_frames_is_right_and_official_wraps() -> None:
    series = np.linspace(1, 0, 300)
    assert statistics(series).decay == pytest.approx(0.74916, abs=5e-6)
    assert np.isnan(statistics(series, official=True).decay)
    assert statistics(series[:256], official=True) == statistics(series[:256])


def test_matched_proposals_are_those_of_trying_every_pair() -> None:
    rng = np.random.default_rng(3)
    for _ in range(15):
        frames = [(blobs(rng, (60, 70), 2), blobs(rng, (60, 70), 4)) for _ in range(4)]
        void = [blobs(rng, (60, 70), 1) > 0 for _ in frames]
        marked = [(np.where(v, 255, t), p) for (t, p), v in zip(frames, void, strict=True)]
        matched = match_proposals(marked, 2, void=255)
        most = max(2, *(int(p.max()) for _, p in frames))
        j, f = np.zeros((2, 2, most, len(frames)))
        for o, p, k in np.ndindex(j.shape):
            a, b = frames[k][0] == o + 1, frames[k][1] == p + 1
            j[o, p, k], f[o, p, k] = region_j(a, b, void[k]), boundary_f(a, b, void[k])
        pairs = linear_sum_assignment(-(j.mean(2) + f.mean(2)))
        assert np.array_equal(matched.j, j[pairs])
        assert np.array_equal(matched.f, f[pairs])


def test_ids_that_a_protocol_does_not_allow_are_named() -> None:
    with pytest.raises(FormatError, match="goat: has the id 21, but the protocol allows 20 proposals"):
        score_proposals(clip_of(HALF, 21 * HALF, 255, False, 1))
    with pytest.raises(FormatError, match="goat: is a 0/255 mask, which this protocol reads as object 255"):
        score_proposals(clip_of(HALF, 255 * HALF, 255, False, 1))
    with pytest.raises(FormatError, match="goat: has the id 2, but the highest id of the truth is 1"):
        score_objects(clip_of(HALF, 2 * HALF, 255, False, 1))


def fbms(truth: np.ndarray, prediction: np.ndarray, weight: np.ndarray | None = None) -> tuple[float, ...]:
    """P, R, F of one frame."""
    sums = PairSums()
    sums.add(pair_counts(truth, prediction, weight))
    return region_scores(sums.table())


def test_fbms_counts_background_and_leaves_surplus_free() -> None:
    assert fbms(HALF, HALF) == (100, 100, 100)
    assert fbms(HALF, painted(HALF, (ALL, slice(8, 10), 2))) == pytest.approx((100, 80, 800 / 9))
    assert fbms(HALF, TWO_HALVES) == pytest.approx((100, 75, 600 / 7))


def test_fbms_gives_a_region_without_cluster_full_precision_and_no_recall() -> None:
    p, r, f = fbms(HALF, NOTHING)
    assert (p, r) == (75, 50)
    assert f == pytest.approx(2 * 75 * 50 / 125)


def test_fbms_weighs_pixels_by_their_probability() -> None:
    wrong = painted(HALF, (slice(0, 1), slice(0, 5), 0))
    assert fbms(HALF, wrong)[1] == pytest.approx(95)
    assert fbms(HALF, wrong, (np.arange(10)[:, None] > 0) * np.ones((10, 10))) == (100, 100, 100)


def test_fbms_mean_f_is_that_of_mean_p_and_mean_r() -> None:
    values = {"F": np.array([1.0, 2.0]), "P": np.array([100.0, 50.0]), "R": np.array([50.0, 100.0])}
    assert mean_scores(values, np.ones(2), PROTOCOLS["fbms"]) == {"P": 75, "R": 75, "F": 75}


def test_means_skip_what_a_sequence_does_not_have_and_weigh_objects() -> None:
    values = {"J": np.array([1.0, np.nan, 0.0]), "K": np.full(3, np.nan)}
    means = mean_scores(values, np.array([3.0, 9.0, 1.0]), PROTOCOLS["davis-2017"])
    assert means["J"] == 0.75
    assert np.isnan(means["K"])


def test_motion_scores_count_only_frames_at_which_an_object_moves() -> None:
    half_found = painted(HALF, (slice(0, 5), ALL, 0))
    frames = [(n, pair_counts(HALF, p)) for n, p in enumerate((NOTHING, HALF, half_found, 2 * (1 - HALF)))]
    assert motion_scores(frames, {1: 1}, {1: [(1, 3)]}) == (75, 0.25)
    assert motion_scores(frames, {}, {1: [(1, 3)]}).j == 0
    never = motion_scores(frames, {1: 1}, {1: [(9, 12)]})
    assert np.isnan(never.j)
    assert never.false_objects == 0.75


def test_track_points_take_the_label_of_most_frames_and_groups_the_best_names() -> None:
    points = np.array([[[1, 1], [1, 1], [8, 1]], [[8, 2], [8, 2], [8, 2]], [[2, 2], [30, 2], [2, 2]]], float)
    votes = PointVotes(points, np.array([[1, 1, 1], [1, 1, 0], [0, 1, 0]], bool))
    for frame in range(3):
        votes.add(frame, HALF)
    assert votes.labels().tolist() == [1, 0, 0]
    assert classification_error(np.array([1, 1, 2, 2]), np.array([5, 5, 0, 5])) == 25


def test_partners_are_the_matched_tracks() -> None:
    sums = PairSums()
    sums.add(pair_counts(SIX_TO_FOUR, painted(SIX_TO_FOUR * 10, (ALL, slice(7, 9), 3))))
    assert match_tracks(sums.table()).partners() == {1: 10, 2: 20}


@pytest.fixture(scope="module")
def golden(davis: Path) -> Path:
    folder = SHARED / "golden"
    if not folder.is_dir():
        pytest.skip("the golden scores are not beside the checkout")
    return folder


def rows(path: Path) -> dict[str, list[dict[str, str]]]:
    """Lines of a golden table by sequence."""
    found = defaultdict(list)
    with path.open(newline="") as file:
        for row in csv.DictReader(file):
            found[row["sequence"]].append(row)
    return found


def labels(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path))


def check_statistics(row: dict[str, str], j: np.ndarray, f: np.ndarray) -> None:
    found = (*statistics(j), *statistics(f))
    expected = [float(row[f"{m}_{s}"]) for m in "JF" for s in ("mean", "recall", "decay")]
    assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("sequence", ["bmx-trees", "car-shadow", "motocross-jump", "scooter-black"])
def test_golden_scores_of_one_object(davis: Path, golden: Path, sequence: str) -> None:
    folder = golden / "davis-osvos"
    frames = rows(folder / "per_frame.csv")[sequence]
    pairs = [
        (davis / "Annotations/480p" / sequence / name, folder / "masks" / sequence / name)
        for name in (f"{row['frame']}.png" for row in frames)
    ]
    masks = [[(labels(path) > 0).astype(np.uint8) for path in pair] for pair in pairs]
    j, f = np.array([frame_scores(t, p, [(1, 1)]) for t, p in masks])[..., 0].T
    assert j == pytest.approx([float(row["J"]) for row in frames], abs=1e-9)
    assert f == pytest.approx([float(row["F"]) for row in frames], abs=1e-9)
    check_statistics(rows(folder / "per_sequence.csv")[sequence][0], j, f)


@pytest.mark.parametrize("sequence", ["car-shadow", "drift-straight", "scooter-black"])
def test_golden_scores_of_matched_proposals(davis: Path, golden: Path, sequence: str) -> None:
    folder = golden / "davis-rvos"
    frames = rows(folder / "per_frame.csv")[sequence]
    truth, proposals = davis / "Annotations/480p" / sequence, SHARED / "proposals/rvos" / sequence
    names = [f"{row['frame']}.png" for row in frames]
    pairs = (((labels(truth / n) > 0).astype(np.uint8), labels(proposals / n)) for n in names)
    matched = match_proposals(pairs, 1)
    assert matched.j[0] == pytest.approx([float(row["J"]) for row in frames], abs=1e-9)
    assert matched.f[0] == pytest.approx([float(row["F"]) for row in frames], abs=1e-9)
    row = rows(folder / "per_sequence.csv")[sequence][0]
    check_statistics(row, matched.j[0], matched.f[0])
    assert matched.proposal.tolist() == [int(row["matched_id"])]
