"""Kernels, affinity, clustering, decision, number of groups and motion state."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from zsmoseg.grouping import decision
from zsmoseg.grouping.affinity import UNKNOWN, Kernel, accumulate, normalised
from zsmoseg.grouping.clustering import average_linkage, by_weight, k_means, spectral
from zsmoseg.grouping.core import Core, group_arrays, shot_grams
from zsmoseg.grouping.decision import Thresholds, coherent
from zsmoseg.grouping.evidence import PairGrams, ShotEvidence, pair_evidence
from zsmoseg.grouping.groups import ShotGroups
from zsmoseg.grouping.kernels import inlier, ordered, ordered_weighted
from zsmoseg.grouping.state import hysteresis, median_filter
from zsmoseg.motion.models import MODELS
from zsmoseg.motion.statistics import Sums
from zsmoseg.settings import Settings, resolve
from zsmoseg.synthetic import CAMERAS, Scene, flow_scene

SHIFT = {"motion.model": "screw-shift"}
SUMS = resolve().statistics.parameters(Sums)
CORE = resolve().parameters(Core)


def answer(scene: Scene, **settings: Any) -> ShotGroups:
    """Groups of a scene; settings as ``section__name``."""
    chosen = resolve(overrides={**SHIFT, **{n.replace("__", "."): v for n, v in settings.items()}})
    return grouped(scene, chosen)


def grouped(scene: Scene, chosen: Settings) -> ShotGroups:
    model = chosen.motion.chosen(True)
    return group_arrays(
        scene.labels, scene.pictures, scene.flow, scene.inverse_depth, model, chosen.parameters(Core)
    )


# -------------------------------------------------------------------------- kernels
FIVE = np.array(
    [[1, 2, 3, 30, 20], [2, 1, 2, 25, 18], [2, 3, 1, 9, 40], [50, 40, 60, 1, 2], [45, 50, 40, 3, 1]], float
)
"""Residuals of five objects of which 0 to 2 and 3 to 4 move together (row = model, column = object)."""


@pytest.mark.parametrize("ranking", ["row", "column"])
def test_truncated_ordered_kernel_of_five_objects(ranking: Any) -> None:
    np.testing.assert_array_equal(ordered(FIVE, 0.2, ranking), np.eye(5))
    two = [[2, 2, 1, 0, 0], [2, 2, 1, 0, 0], [1, 1, 2, 0, 0], [0, 0, 0, 2, 2], [0, 0, 0, 2, 2]]
    np.testing.assert_array_equal(ordered(FIVE, 0.4, ranking), two)


def test_a_group_smaller_than_the_choice_leaks() -> None:
    three = ordered(FIVE, 0.6, "column")
    np.testing.assert_array_equal(three[0], [3, 3, 3, 1, 1])
    np.testing.assert_array_equal(three[4], [1, 1, 1, 2, 3])


def test_weighted_ordered_kernel_of_five_objects() -> None:
    kernel = ordered_weighted(FIVE, "column")
    expected = [
        [1, 0.759124, 0.708029, 0.540146, 0.540146],
        [0.759124, 1, 0.686131, 0.540146, 0.540146],
        [0.708029, 0.686131, 1, 0.540146, 0.540146],
        [0.540146, 0.540146, 0.540146, 1, 0.722628],
        [0.540146, 0.540146, 0.540146, 0.722628, 1],
    ]
    np.testing.assert_allclose(kernel, expected, atol=5e-7)
    values = np.linalg.eigvalsh(kernel)
    np.testing.assert_allclose(values, [0.238815, 0.277372, 0.324605, 0.709689, 3.449519], atol=2e-6)


def test_eigenvalues_of_the_normalised_affinity_of_five_objects() -> None:
    kernel = ordered_weighted(FIVE, "column")
    np.fill_diagonal(kernel, 0)
    label, values = spectral(kernel, 2)
    np.testing.assert_allclose(1 - values, [0, 1.120527, 1.271026, 1.300036, 1.308411], atol=2e-6)
    assert label[:3].tolist() == [label[0]] * 3
    assert label[3:].tolist() == [1 - label[0]] * 2


def test_rows_rank_objects_and_columns_rank_models() -> None:
    small = np.array([[1.0, 5.0, 6.0], [2.0, 3.0, 4.0], [7.0, 8.0, 1.0]])
    np.testing.assert_array_equal(ordered(small, 0.34, "column"), np.eye(3))
    np.testing.assert_array_equal(ordered(small, 0.34, "row"), [[1, 1, 0], [1, 1, 0], [0, 0, 1]])


def test_inliers_are_judged_by_the_model_of_the_larger_object() -> None:
    residual = np.array([[1.0, 1.5], [400.0, 1.0]])
    np.testing.assert_array_equal(inlier(residual, np.array([900.0, 50.0]), 1.4, 0.1), np.ones((2, 2)))
    np.testing.assert_array_equal(inlier(residual, np.array([50.0, 900.0]), 1.4, 0.1), np.eye(2))


# -------------------------------------------------------------------------- affinity
def residuals_of(scene: Scene) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    from zsmoseg.motion.residuals import pair_residuals

    for g in shot_grams(scene.labels, scene.flow, scene.inverse_depth, SUMS):
        residual, pixels, _ = pair_residuals(g.objects, MODELS["screw-shift"])
        yield g.ids, residual, pixels


@pytest.mark.parametrize("kernel", ["inlier", "ordered", "ordered-weighted"])
@pytest.mark.parametrize("weight", ["area", "equal"])
def test_affinity_does_not_depend_on_the_slots_of_chunks(kernel: str, weight: str) -> None:
    s = resolve(overrides={"affinity.kernel": kernel, "affinity.weight": weight}).affinity.parameters(Kernel)
    pairs = list(residuals_of(flow_scene(4, n_objects=6, shape=(90, 160), noise=0.2, min_contrast=0.1)))
    whole = accumulate(iter(pairs), 7, s)
    cut = []
    for m, (ids, residual, pixels) in enumerate(pairs):
        keep = np.flatnonzero(pixels > 0) if m % 2 else ids
        cut.append((ids[keep], residual[np.ix_(keep, keep)], pixels[keep]))
    for a, b in zip(whole, accumulate(iter(cut), 7, s), strict=True):
        np.testing.assert_array_equal(a, b)
    assert (whole[1] == whole[1].T).all()


def test_never_together_is_unknown_and_filled_over_a_common_neighbour() -> None:
    agreement = np.array([[4.0, 4, 0, 0], [4, 4, 3, 0], [0, 3, 4, 0], [0, 0, 0, 1]])
    together = np.array([[4.0, 4, 0, 0], [4, 4, 4, 0], [0, 4, 4, 0], [0, 0, 0, 1]])
    affinity = normalised(agreement, together)
    assert affinity[0, 2] == affinity[2, 0] == 0.75
    assert affinity[0, 3] == affinity[3, 1] == UNKNOWN
    assert affinity[0, 1] == 1.0


def test_evidence_does_not_depend_on_the_slots_of_chunks() -> None:
    scene = flow_scene(4, n_objects=5, shape=(90, 160), min_contrast=0.1)
    model = MODELS["screw-shift"]
    static = np.arange(20) == 0
    for g in shot_grams(scene.labels, scene.flow, scene.inverse_depth, SUMS):
        empty = np.zeros((14, 11, 11))
        wide = PairGrams(g.pair, np.arange(20), np.concatenate([g.objects, empty]), g.cells)
        a, b = (pair_evidence(x, model, static, 100.0) for x in (g, wide))
        assert a is not None
        assert b is not None
        np.testing.assert_array_equal(a.excess, b.excess)
        np.testing.assert_array_equal(a.cells, b.cells)


# ------------------------------------------------------------------------ clustering
def test_average_linkage_joins_up_to_one_and_ignores_what_is_unknown() -> None:
    d = np.array([[0, 0.5, np.inf, 9], [0.5, 0, 0.9, 9], [np.inf, 0.9, 0, 9], [9, 9, 9, 0]])
    weight = np.array([1.0, 1, 1, 10])
    assert average_linkage(d, weight).tolist() == [2, 2, 2, 1]
    assert average_linkage(d, weight, 1).tolist() == [1, 1, 1, 1]
    assert average_linkage(d, weight, 3).tolist() == [2, 2, 3, 1]


def test_groups_are_numbered_by_weight_then_by_first_member() -> None:
    assert by_weight(np.array([7, 3, 3, 5]), np.array([2.0, 1, 1, 9])).tolist() == [2, 3, 3, 1]


@pytest.mark.parametrize("clusters", [1, 2, 3, 4, 5])
def test_k_means_gives_exactly_as_many_clusters_even_of_equal_rows(clusters: int) -> None:
    rows = np.array([[1.0, 0], [1, 0], [1, 0], [0, 1], [0, 1]])
    label = k_means(rows, clusters, np.ones(5))
    assert len(np.unique(label)) == clusters
    if clusters == 2:
        assert label[0] == label[1] == label[2] != label[3] == label[4]


def test_spectral_survives_objects_without_any_affinity() -> None:
    affinity = np.zeros((4, 4))
    affinity[:2, :2] = 1
    label, values = spectral(affinity, 2)
    assert np.isfinite(values).all()
    assert label[0] == label[1]
    assert len(np.unique(label)) == 2


# -------------------------------------------------------------------------- decision
def test_threshold_is_bounded_by_its_terms() -> None:
    s = resolve().groups.parameters(Thresholds)

    def threshold_of(nu: float, largest: float, tau: float, s: Any) -> float:
        return float(decision.threshold_of(nu, largest, tau, np.array([s.top_fraction]), s)[0])

    assert threshold_of(0.1, 0.3, 0.2, s) == np.inf, "weaker than the background's own pieces"
    assert threshold_of(0.2, 0.3, 10.0, s) == pytest.approx(s.certain * 0.2), "certainly moving"
    assert threshold_of(0.2, 3.0, 10.0, s) == pytest.approx(3.0), "never below what the background costs"
    assert threshold_of(1.0, 1.0, 1.5, s) == pytest.approx(np.sqrt(1.5)), "half way"
    assert threshold_of(2.0, 2.0, 2.0, s) == pytest.approx(s.below_strongest * 2.0), "the strongest stays"
    assert threshold_of(1.0, 3.0, 2.0, s) < 2.0, "clear proposals are not all dropped"
    two = resolve(overrides={"groups.count": 2}).groups.parameters(Thresholds)
    assert threshold_of(0.1, 0.3, 0.2, two) < 0.2, "who asks for two groups says that something moves"


def test_what_is_small_beside_the_strongest_needs_more_unless_it_is_certain() -> None:
    s = resolve().groups.parameters(Thresholds)
    part = np.array([s.top_fraction, s.small_fraction])
    large, small = decision.threshold_of(1.0, 2.0, 10.0, part, s)
    assert (large, small) == pytest.approx((s.top_fraction * 10, s.small_fraction * 10))
    sure = decision.threshold_of(0.1, 2.0, 10.0, part, s)
    assert sure == pytest.approx([2.0, 2.0])


def evidence_of(score: list[float], own: list[float]) -> ShotEvidence:
    return ShotEvidence([], np.array(score), np.array(own), np.zeros(0))


def test_what_its_own_motion_explains_no_better_is_no_evidence_beside_what_is_coherent() -> None:
    s, big = resolve().groups.parameters(Thresholds), np.array([False, True, True, False])
    assert coherent(evidence_of([0, 6, 2, 3], [1, 1, 2, 2.5]), big, s).tolist() == [False, True, False, False]
    assert coherent(evidence_of([0, 6, 2, 3.8], [1, 1, 1.2, 2.5]), big, s)[1:].all()


def test_the_strongest_keeps_its_evidence_however_little_it_is_coherent() -> None:
    s, big = resolve().groups.parameters(Thresholds), np.array([False, True, True])
    assert coherent(evidence_of([0, 1.0, 0.4], [1, 1.2, 1.2]), big, s).tolist() == [False, True, False]


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.3])
def test_every_object_is_in_its_right_group(noise: float) -> None:
    wrong = [
        s for s in range(10, 20) if not (scene := flow_scene(s, noise=noise)).right(answer(scene).group)[0]
    ]
    assert not wrong


@pytest.mark.parametrize("camera", CAMERAS)
def test_every_camera_motion_is_told_from_that_of_objects(camera: Any) -> None:
    for seed in range(40, 43):
        scene = flow_scene(seed, camera=camera)
        assert scene.right(answer(scene).group)[0], seed


@pytest.mark.parametrize("movers", [0, 1, 2, 3])
def test_number_of_groups_is_found(movers: int) -> None:
    for seed in range(50, 55):
        scene = flow_scene(seed, n_movers=movers, companions=0.0, n_pairs=5)
        assert answer(scene).group.max() == movers, seed


def test_depth_decides_where_the_camera_translates() -> None:
    scenes = [flow_scene(s, n_movers=1, n_objects=12, camera="lateral") for s in range(4)]
    shift, quadratic = (
        sum(scene.right(answer(scene, motion__model=model).group)[0] for scene in scenes)
        for model in ("screw-shift", "quadratic")
    )
    assert shift == len(scenes)
    assert quadratic < len(scenes)


def test_movers_that_stop_are_at_rest_afterwards() -> None:
    right = total = 0
    for seed in range(6):
        scene = flow_scene(seed, n_movers=2, n_objects=8, stop=True, n_pairs=16)
        found = answer(scene)
        far = np.abs(np.arange(16) - 7.5) > 1
        for n in np.flatnonzero((scene.group > 0) & (found.group > 0)):
            right += int((found.moving[:-1, n] == scene.moving[:, n])[far].sum())
            total += int(far.sum())
    assert total > 100
    assert right >= 0.99 * total


def test_static_objects_never_move_and_the_last_frame_repeats_the_last_pair() -> None:
    scene = flow_scene(3)
    found = answer(scene)
    assert not found.moving[:, found.group == 0].any()
    there = np.array([(scene.labels[-2:] == n).any((1, 2)).all() for n in range(scene.objects)])
    np.testing.assert_array_equal(found.moving[-1, there], found.moving[-2, there])
    np.testing.assert_array_equal(found.margin[-1], found.margin[-2])
    assert found.margin.shape == found.moving.shape == (9, scene.objects)


def test_state_follows_the_margin_with_hysteresis() -> None:
    margin = np.array([np.nan, 0.1, -0.2, -0.5, -0.1, 0.1, 0.5, np.nan, -0.1])
    expected = [True, True, True, False, False, False, True, True, True]
    assert hysteresis(margin, -0.36, 0.26).tolist() == expected
    assert hysteresis(np.full(3, np.nan), -1, 1).all(), "a mover without evidence of its own moves"


def test_median_filter_leaves_unknown_what_no_pair_of_the_window_shows() -> None:
    values = np.array([[1.0], [9.0], [2.0], [np.nan], [np.nan], [np.nan]])
    np.testing.assert_array_equal(median_filter(values, 3)[:, 0], [5, 2, 5.5, 2, np.nan, np.nan])


# -------------------------------------------------------------------- the other rules
def test_inlier_kernel_and_spectral_clustering_find_the_groups_of_exact_flow() -> None:
    for seed in (0, 2, 4, 5, 7):
        scene = flow_scene(seed, noise=0.0)
        found = answer(scene, groups__rule="spectral")
        assert scene.right(found.group)[0], seed
        assert len(found.eigenvalues) == scene.objects


def test_the_paper_to_the_letter_gives_two_groups_and_is_right_less_often() -> None:
    paper = resolve("paper-core")
    assert (paper.motion.model, paper.affinity.kernel, paper.affinity.ranking) == (
        "screw-printed",
        "ordered",
        "row",
    )
    letter = calibrated = 0
    for seed in range(8):
        scene = flow_scene(seed, n_movers=1, camera="general", n_pairs=4)
        found = grouped(scene, paper)
        assert len(np.unique(found.group)) == 2
        letter += scene.right(found.group)[0]
        calibrated += scene.right(answer(scene).group)[0]
    assert calibrated == 8
    assert letter < 8


# ------------------------------------------------------------------- number asked for
@pytest.mark.parametrize("rule", ["calibrated", "spectral"])
@pytest.mark.parametrize("count", range(1, 8))
@pytest.mark.parametrize("movers", [0, 2])
def test_exactly_as_many_groups_as_asked_for(rule: str, count: int, movers: int) -> None:
    scene = flow_scene(6, n_movers=movers, n_objects=6, n_pairs=4, shape=(120, 214), min_contrast=0.4)
    found = answer(scene, groups__rule=rule, groups__count=count)
    assert found.group[0] == 0
    assert sorted(np.unique(found.group)) == list(range(count))
    assert not found.warnings
    assert (found.group > 0).any() == (found.instance > 0).any()


@pytest.mark.parametrize("rule", ["calibrated", "spectral"])
def test_more_groups_than_objects_gives_as_many_as_there_are_and_says_so(rule: str) -> None:
    scene = flow_scene(6, n_movers=1, n_objects=3, n_pairs=4, shape=(120, 214), min_contrast=0.4)
    found = answer(scene, groups__rule=rule, groups__count=9)
    assert sorted(np.unique(found.group)) == [0, 1, 2, 3]
    assert any("9 groups asked for, but there are 3 objects" in text for text in found.warnings)


def test_the_true_number_of_groups_gives_the_true_groups() -> None:
    for seed in (3, 10):
        scene = flow_scene(seed)
        assert scene.right(answer(scene, groups__count=int(scene.group.max()) + 1).group)[0]


# -------------------------------------------------------------------- degenerate shots
def shot(
    labels: np.ndarray, settings: Settings | None = None, motion: float = 0.0, **more: Any
) -> ShotGroups:
    """A still camera; objects move by ``motion`` px to the right."""
    rng = np.random.default_rng(0)
    flow = rng.normal(0, 0.05, (len(labels) - 1, 2, *labels.shape[1:])).astype(np.float32)
    flow[:, 0][labels[:-1] > 0] += motion
    frames = np.zeros((*labels.shape, 3), np.uint8)
    return group_arrays(
        labels, frames, flow, None, "affine", (settings or resolve()).parameters(Core), **more
    )


def blank(frames: int = 5) -> np.ndarray:
    return np.zeros((frames, 60, 90), np.uint16)


def test_no_object_at_all_is_one_group_and_a_word() -> None:
    found = shot(blank())
    assert found.group.tolist() == [0]
    assert found.moving.shape == (5, 1)
    assert "no object" in found.warnings[0]


@pytest.mark.parametrize(("motion", "groups"), [(3.0, 2), (0.0, 1)])
def test_one_object_moves_or_not(motion: float, groups: int) -> None:
    labels = blank()
    labels[:, 20:40, 30:60] = 1
    found = shot(labels, motion=motion)
    assert len(np.unique(found.group)) == groups
    assert "there is one object only" in found.warnings
    assert any("moves as one" in text for text in found.warnings) == (groups == 1)


@pytest.mark.parametrize("rule", ["calibrated", "spectral"])
def test_an_object_in_one_frame_only_and_objects_never_together(rule: str) -> None:
    labels = blank(8)
    labels[:4, 20:40, 30:60] = 1
    labels[4:7, 20:40, 30:60] = 2
    labels[7, 5:10, 5:10] = 3
    found = shot(labels, resolve(overrides={"groups.rule": rule}), motion=3.0)
    assert np.isfinite(found.decision.score).all()
    assert found.group[1] > 0
    assert found.group[2] > 0
    assert any("in one frame only" in text for text in found.warnings)
    assert any("never seen together" in text for text in found.warnings) == (rule == "spectral")


@pytest.mark.parametrize("rule", ["calibrated", "spectral"])
def test_an_object_that_covers_the_frame_leaves_nothing_undefined(rule: str) -> None:
    found = shot(blank() + np.uint16(1), resolve(overrides={"groups.rule": rule}), motion=3.0)
    assert found.group[0] == 0
    assert np.isfinite(found.decision.score).all()


def test_a_shot_without_valid_pairs_moves_nothing() -> None:
    labels = blank()
    labels[:, 20:40, 30:60] = 1
    found = shot(labels, motion=3.0, valid=np.zeros(4, np.bool_))
    assert not found.group.any()
    assert np.isnan(found.margin).all()


def test_pairs_that_are_no_pairs_count_for_nothing() -> None:
    labels = blank(9)
    labels[:, 20:40, 30:60] = 1
    valid = np.ones(8, np.bool_)
    valid[4] = False
    rng = np.random.default_rng(0)
    flow = rng.normal(0, 0.05, (8, 2, 60, 90)).astype(np.float32)
    frames = np.zeros((*labels.shape, 3), np.uint8)
    calm = group_arrays(labels, frames, flow, None, "affine", CORE, valid=valid)
    flow[4] = 50.0 * rng.normal(size=(2, 60, 90))
    wild = group_arrays(labels, frames, flow, None, "affine", CORE, valid=valid)
    np.testing.assert_array_equal(calm.decision.score, wild.decision.score)
    np.testing.assert_array_equal(calm.margin, wild.margin)


def test_a_single_frame_has_groups_without_pairs() -> None:
    labels = blank(1)
    labels[0, 20:40, 30:60] = 1
    assert not shot(labels).group.any()
