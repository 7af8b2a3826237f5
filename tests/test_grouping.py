"""Kernels, affinity, the static world, clustering, number of groups and motion state."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from zsmoseg.grouping.affinity import UNKNOWN, ShotAffinity, accumulate, completed, normalised, shot_affinity
from zsmoseg.grouping.clustering import average_linkage, by_weight, k_means, spectral
from zsmoseg.grouping.core import Core, group_arrays, shot_pairs
from zsmoseg.grouping.groups import ShotGroups, means_against_world
from zsmoseg.grouping.kernels import geometric, merge, ordered, ordered_weighted
from zsmoseg.grouping.rules.linkage import Membership, members, odds
from zsmoseg.grouping.state import hysteresis, median_filter
from zsmoseg.grouping.world import Pair, evidence_of
from zsmoseg.motion.models import MODELS
from zsmoseg.motion.residuals import pair_residuals
from zsmoseg.settings import Settings, resolve
from zsmoseg.synthetic import CAMERAS, Scene, flow_scene

SHIFT = {"motion.model": "screw-shift"}
CORE = resolve().parameters(Core)
MODEL = MODELS["screw-shift"]


def answer(scene: Scene, **settings: Any) -> ShotGroups:
    """Groups of a scene; settings as ``section__name``."""
    chosen = resolve(overrides={**SHIFT, **{n.replace("__", "."): v for n, v in settings.items()}})
    return grouped(scene, chosen)


def grouped(scene: Scene, chosen: Settings) -> ShotGroups:
    model = chosen.motion.chosen(True)
    core = chosen.parameters(Core)
    return group_arrays(scene.labels, scene.pictures, scene.flow, scene.inverse_depth, model, core)[0]


def pairs_of(scene: Scene) -> list[Pair]:
    return shot_pairs(scene.labels, scene.flow, scene.inverse_depth, MODEL, CORE.statistics)


def affinity_of(scene: Scene, **settings: Any) -> ShotAffinity:
    """Affinity of a scene; settings of the section ``affinity``."""
    kernel = resolve(overrides={f"affinity.{n}": v for n, v in settings.items()}).parameters(Core).affinity
    pairs = pairs_of(scene)
    return shot_affinity(lambda: iter(pairs), (len(scene.flow), scene.objects), MODEL, kernel)


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


def test_two_view_residuals_are_judged_by_the_model_of_the_larger_object() -> None:
    residual, k = np.array([[1.0, 2.0], [401.0, 1.0]]), CORE.affinity.tolerance
    for pixels, expected in (((900.0, 50.0), 1.0), ((50.0, 900.0), 20.0), ((90.0, 90.0), 20.0)):
        excess, tolerance = geometric(residual, np.array(pixels), k)
        np.testing.assert_allclose(excess, [[0, expected], [expected, 0]])
        np.testing.assert_allclose(tolerance, k.floor + np.sqrt(2))


@pytest.mark.parametrize("drift", [(0.0, 1.5), (1.5, 0.0)])
def test_two_motions_cost_more_than_is_tolerated_however_far_apart_they_are(
    drift: tuple[float, float],
) -> None:
    """One affine motion explains them the better the farther apart they are: as a stretch that neither shows."""
    y, x = np.mgrid[:240, :427]
    cost = []
    for away in (42, 126, 252):
        label = np.zeros((2, 240, 427), np.int32)
        flow = np.zeros((1, 2, 240, 427), np.float32)
        for n, left in enumerate((80, 80 + away)):
            disc = (x - left) ** 2 + (y - 120) ** 2 < 20**2
            label[:, disc] = n + 1
            flow[0][:, disc] = np.array(drift)[:, None] * (1 - 2 * n) / 2
        (p,) = shot_pairs(label, flow, None, MODELS["affine"], CORE.statistics)
        excess, tolerance = merge(p, MODELS["affine"], CORE.affinity.tolerance)
        cost.append(float(excess[1, 2]))
        assert cost[-1] > tolerance[1, 2]
    assert cost[1] / cost[2] == pytest.approx(np.sqrt(2), rel=0.05), "by the root of the distance, not by it"


def test_a_motion_that_hangs_on_a_given_depth_bridges_nothing_by_a_stretch() -> None:
    assert {name for name, model in MODELS.items() if model.stretches} == {
        "affine",
        "quadratic",
        "planar",
        "screw-plane",
    }


# -------------------------------------------------------------------------- affinity
def with_slots(p: Pair, count: int) -> Pair:
    """The same pair as a chunk that lists more objects would have it."""
    gram = np.concatenate([p.gram, np.zeros((count - len(p.ids), 11, 11))])
    return Pair(p.pair, np.arange(count), gram, p.noise, pair_residuals(gram, MODEL))


@pytest.mark.parametrize("kernel", ["merge", "ordered", "ordered-weighted"])
@pytest.mark.parametrize("weight", ["area", "equal"])
def test_affinity_does_not_depend_on_the_slots_of_chunks(kernel: str, weight: str) -> None:
    scene = flow_scene(4, n_objects=6, shape=(90, 160), noise=0.2, min_contrast=0.1)
    chosen = resolve(overrides={"affinity.kernel": kernel, "affinity.weight": weight}).parameters(Core)
    pairs = pairs_of(scene)
    wide = [with_slots(p, 11) if p.pair % 2 else p for p in pairs]
    found = []
    for some in (pairs, wide):
        found.append(shot_affinity(lambda some=some: iter(some), (len(pairs), 11), MODEL, chosen.affinity))
    for name in ("agreement", "together", "affinity", "static", "pairs", "excess", "tolerance", "weight"):
        np.testing.assert_array_equal(*(getattr(one, name) for one in found), err_msg=name)
    np.testing.assert_array_equal(found[0].together, found[0].together.transpose(0, 2, 1))


def test_the_affinity_is_the_mean_tolerance_over_that_and_the_mean_cost() -> None:
    """Pair by pair and by hand: the kernel ``merge`` of two objects, and the row of the world."""
    scene = flow_scene(7, n_movers=2, n_objects=6)
    found, pairs, k = affinity_of(scene), pairs_of(scene), CORE.affinity.tolerance
    cost = share = np.zeros((2, 2))
    for p in pairs:
        excess, tolerance = (x[1, 2] for x in merge(p, MODEL, k))
        w = np.sqrt(p.found.pixels[1:3].min()) / np.sqrt(excess + tolerance)
        cost, share = cost + w * tolerance, share + w * (tolerance + excess)
    assert found.affinity[1, 2] == pytest.approx((cost / share)[0, 0])
    excess, tolerance = means_against_world(found)
    np.testing.assert_allclose(found.affinity[0], tolerance / (tolerance + excess), rtol=1e-12)
    assert (found.affinity[0][scene.group > 0] < 0.5).all()
    assert found.static.tolist() == (scene.group == 0).tolist()


def test_what_moves_together_agrees_and_what_does_not_disagrees() -> None:
    for seed in range(20, 26):
        scene = flow_scene(seed, n_movers=2, companions=1.0, noise=0.3)
        affinity, movers = affinity_of(scene).affinity, np.flatnonzero(scene.group)
        for i in movers:
            for j in movers[movers != i]:
                assert (affinity[i, j] >= 0.5) == (scene.group[i] == scene.group[j]), (seed, i, j)


def test_what_the_picture_does_not_show_has_weight_nothing_and_is_not_known_to_move() -> None:
    scene = flow_scene(7, n_movers=2, n_objects=6)
    pairs, kernel = pairs_of(scene), CORE.affinity
    visibility = np.full(scene.objects, 9.0)
    mover = int(np.flatnonzero(scene.group)[0])
    visibility[mover] = 1.0
    size = len(scene.flow), scene.objects
    found = shot_affinity(lambda: iter(pairs), size, MODEL, kernel, visibility)
    assert not found.weight[:, mover].any()
    assert np.isnan(found.affinity[0, mover])
    assert found.static[mover]
    assert (found.weight[:, 0] > 0).all()


def test_noise_of_the_flow_is_no_tolerance() -> None:
    """What is tolerated is freed of the measured noise."""
    raised = flow_scene(7, n_movers=2, noise=0.3)
    loud = affinity_of(raised)
    blind = [Pair(p.pair, p.ids, p.gram, 0.0, p.found) for p in pairs_of(raised)]
    size = len(raised.flow), raised.objects
    deaf = shot_affinity(lambda: iter(blind), size, MODEL, CORE.affinity)
    assert (deaf.tolerance[:, 0] > 1.5 * loud.tolerance[:, 0]).all()


def test_never_together_is_unknown_and_filled_over_a_common_neighbour() -> None:
    agreement = np.array([[4.0, 4, 0, 0], [4, 4, 3, 0], [0, 3, 4, 0], [0, 0, 0, 1]])
    together = np.array([[4.0, 4, 0, 0], [4, 4, 4, 0], [0, 4, 4, 0], [0, 0, 0, 1]])
    affinity = normalised(agreement, together, "merge")
    assert np.isnan(affinity[0, 2])
    filled = completed(affinity)
    assert filled[0, 2] == filled[2, 0] == 0.75
    assert filled[0, 3] == filled[3, 1] == UNKNOWN
    assert filled[0, 1] == 1.0


def test_kernels_are_summed_with_their_weights() -> None:
    half = np.array([[1.0, 0.5], [0.5, 1.0]])
    pairs = [(np.array([0, 2]), half, 2 * np.ones((2, 2))), (np.array([0, 1]), half, np.ones((2, 2)))]
    agreement, together, number = accumulate(pairs, 3)
    assert agreement.tolist() == [[3, 0.5, 1], [0.5, 1, 0], [1, 0, 2]]
    assert together.tolist() == [[3, 1, 2], [1, 1, 0], [2, 0, 2]]
    assert number.tolist() == [[2, 1, 1], [1, 1, 0], [1, 0, 1]]


def test_evidence_does_not_depend_on_the_slots_of_chunks() -> None:
    scene = flow_scene(4, n_objects=5, shape=(90, 160), min_contrast=0.1)
    static, counts = np.arange(20) == 0, np.ones(20, np.bool_)
    for p in pairs_of(scene):
        a, b = (
            evidence_of(x, static, MODEL, CORE.affinity.tolerance, counts, ~counts)
            for x in (p, with_slots(p, 20))
        )
        assert a is not None
        assert b is not None
        for name in ("ids", "excess", "tolerance", "weight"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


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


# --------------------------------------------------------------------- what is found
def test_the_border_is_one_half() -> None:
    np.testing.assert_allclose(odds(np.array([1.0, 0.5, 0.25])), [0, 1, 3])
    assert np.isnan(odds(np.array([np.nan]))[0])


def test_the_strongest_of_a_pair_always_costs_more_than_is_tolerated_unless_it_is_noise() -> None:
    """However much its own motion leaves: no video is emptied by a rough world."""
    for seed in range(5):
        scene = flow_scene(seed, n_movers=1, depth_noise=0.3)
        found = affinity_of(scene)
        cost, tolerated = np.nan_to_num(found.excess), found.tolerance
        strongest = (cost * found.weight).argmax(1)
        rows = np.arange(len(cost))
        moving = cost[rows, strongest] > CORE.affinity.tolerance.floor
        assert (cost[rows, strongest] > tolerated[rows, strongest])[moving].all()


@pytest.mark.parametrize(("weak", "open_"), [(0.5, True), (0.9, False)])
def test_what_is_seen_while_no_mover_is_may_come_back_on_weak_odds(weak: float, open_: bool) -> None:
    """Object 1 moves and goes; object 2, of odds 0.8 against the world, is seen after it, object 3 beside it."""
    affinity = np.eye(4)
    affinity[0] = affinity[:, 0] = 1 / (1 + np.array([0, 3, 0.8, 0.8]))
    pairs, by_pair = np.full((4, 4), 5), np.ones((9, 4))
    static = np.array([True, False, True, True])
    found = ShotAffinity(affinity, affinity[None], affinity[None], pairs, static, by_pair, by_pair, by_pair)
    seen = np.ones((10, 4), np.bool_)
    seen[5:, 1] = seen[:5, 2] = seen[5:, 3] = False
    rule = resolve(overrides={"groups.weak": weak}).groups.parameters(Membership)
    chosen = members(found, seen, np.array([0.0, 50, 50, 50]), rule)
    assert chosen.strong.tolist() == [False, True, False, False]
    assert chosen.open.tolist() == [False, False, open_, False]


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
def test_spectral_clustering_of_the_affinity_finds_the_groups_of_exact_flow() -> None:
    for seed in (0, 1, 2, 3, 4, 6):
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
    letter = default = 0
    for seed in range(8):
        scene = flow_scene(seed, n_movers=1, camera="general", n_pairs=4)
        found = grouped(scene, paper)
        assert len(np.unique(found.group)) == 2
        letter += scene.right(found.group)[0]
        default += scene.right(answer(scene).group)[0]
    assert default == 8
    assert letter < 8


# ------------------------------------------------------------------- number asked for
@pytest.mark.parametrize("rule", ["linkage", "spectral"])
@pytest.mark.parametrize("kernel", ["merge", "ordered", "ordered-weighted"])
@pytest.mark.parametrize("count", range(1, 8))
@pytest.mark.parametrize("movers", [0, 2])
def test_exactly_as_many_groups_as_asked_for(rule: str, kernel: str, count: int, movers: int) -> None:
    scene = flow_scene(6, n_movers=movers, n_objects=6, n_pairs=4, shape=(120, 214), min_contrast=0.4)
    found = answer(scene, groups__rule=rule, groups__count=count, affinity__kernel=kernel)
    assert found.group[0] == 0
    assert sorted(np.unique(found.group)) == list(range(count))
    assert not found.warnings
    assert (found.group > 0).any() == (found.instance > 0).any()


@pytest.mark.parametrize("rule", ["linkage", "spectral"])
def test_more_groups_than_objects_gives_as_many_as_there_are_and_says_so(rule: str) -> None:
    scene = flow_scene(6, n_movers=1, n_objects=3, n_pairs=4, shape=(120, 214), min_contrast=0.4)
    found = answer(scene, groups__rule=rule, groups__count=9)
    assert sorted(np.unique(found.group)) == [0, 1, 2, 3]
    assert any("9 groups asked for, but there are too few objects" in text for text in found.warnings)


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
    core = (settings or resolve()).parameters(Core)
    return group_arrays(labels, frames, flow, None, "affine", core, **more)[0]


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
    assert [text for text in found.warnings if "moves as one" not in text] == []
    assert len(found.warnings) == (groups == 1)


@pytest.mark.parametrize("rule", ["linkage", "spectral"])
def test_an_object_in_one_frame_only_and_objects_never_together(rule: str) -> None:
    labels = blank(8)
    labels[:4, 20:40, 30:60] = 1
    labels[4:7, 20:40, 30:60] = 2
    labels[7, 5:10, 5:10] = 3
    found = shot(labels, resolve(overrides={"groups.rule": rule}), motion=3.0)
    assert np.isfinite(found.excess[:3]).all()
    assert np.isnan(found.excess[3]), "no pair of frames shows it"
    assert found.group[1] > 0
    assert found.group[2] > 0
    assert not found.warnings, "nobody can do anything about that"


@pytest.mark.parametrize("rule", ["linkage", "spectral"])
def test_an_object_that_covers_the_frame_leaves_nothing_undefined(rule: str) -> None:
    found = shot(blank() + np.uint16(1), resolve(overrides={"groups.rule": rule}), motion=3.0)
    assert not found.group.any()
    assert np.isnan(found.excess).all(), "no world is seen"
    assert any("shows a static world" in text for text in found.warnings)


def test_a_shot_without_valid_pairs_moves_nothing() -> None:
    labels = blank()
    labels[:, 20:40, 30:60] = 1
    found = shot(labels, motion=3.0, valid=np.zeros(4, np.bool_))
    assert not found.group.any()
    assert np.isnan(found.margin).all()
    assert any("shows a static world" in text for text in found.warnings)


def test_pairs_that_are_no_pairs_count_for_nothing() -> None:
    labels = blank(9)
    labels[:, 20:40, 30:60] = 1
    valid = np.ones(8, np.bool_)
    valid[4] = False
    rng = np.random.default_rng(0)
    flow = rng.normal(0, 0.05, (8, 2, 60, 90)).astype(np.float32)
    frames = np.zeros((*labels.shape, 3), np.uint8)
    calm, _ = group_arrays(labels, frames, flow, None, "affine", CORE, valid=valid)
    flow[4] = 50.0 * rng.normal(size=(2, 60, 90))
    wild, _ = group_arrays(labels, frames, flow, None, "affine", CORE, valid=valid)
    np.testing.assert_array_equal(calm.excess, wild.excess)
    np.testing.assert_array_equal(calm.margin, wild.margin)


def test_a_single_frame_has_groups_without_pairs() -> None:
    labels = blank(1)
    labels[0, 20:40, 30:60] = 1
    assert not shot(labels).group.any()
