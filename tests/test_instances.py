"""Objects that are one instance: nearness, broken ids, pieces that come off, and real video."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from zsmoseg.flow.dis import Dis, between
from zsmoseg.grouping.core import Core, group_arrays
from zsmoseg.grouping.groups import ShotGroups
from zsmoseg.grouping.instances import Joining, box_gap, nearness
from zsmoseg.grouping.pieces import BINS, Pieces, measure_pieces
from zsmoseg.metrics.regions import region_j
from zsmoseg.settings import resolve
from zsmoseg.synthetic import Scene, flow_scene

S = resolve().groups.parameters(Joining)
SHAPE = 120, 160
STILL = np.zeros((2, 4, 2))


def boxes(*lives: tuple[range, tuple[int, int], tuple[int, int]], colours: tuple[int, ...] = ()) -> Pieces:
    """Pieces of 20 x 20 px: frames, place at the first of them, px a frame."""
    count, frames = len(lives) + 1, max(life.stop for life, _, _ in lives)
    area = np.zeros((frames, count), np.int32)
    box = np.full((frames, count, 4), np.nan, np.float32)
    colour = np.zeros((count, int(np.prod(BINS))), np.int64)
    for n, (life, (x, y), (u, v)) in enumerate(lives, start=1):
        colour[n, colours[n - 1] if colours else 5] = 400 * len(life)
        for k, t in enumerate(life):
            area[t, n] = 400
            box[t, n] = x + k * u, y + k * v, x + k * u + 20, y + k * v + 20
    return Pieces(area, box, colour)


def near(pieces: Pieces, velocity: np.ndarray | None = None) -> tuple[bool, bool]:
    """Whether objects 1 and 2 are near, and whether one goes on in the other."""
    count = pieces.area.shape[1]
    found = nearness(
        pieces, np.zeros((2, count, 2)) if velocity is None else velocity, SHAPE, np.arange(1, count), S
    )
    np.testing.assert_array_equal(found.distance, found.distance.T)
    return bool(found.distance[1, 2] <= 1), bool(found.goes_on[1, 2])


def test_tables_equal_counting_pixel_by_pixel() -> None:
    rng = np.random.default_rng(0)
    label = np.repeat(np.repeat(rng.choice([0, 3, 8], (2, 6, 8)), 5, 1), 5, 2).astype(np.uint16)
    frames = rng.integers(0, 256, (2, 30, 40, 3), np.uint8)
    ids = np.array([0, 3, 5, 8])
    pieces = measure_pieces(label, frames, ids)
    for t in range(2):
        lab = cv2.cvtColor(frames[t], cv2.COLOR_BGR2LAB).astype(int)
        for slot, n in enumerate(ids):
            y, x = np.nonzero(label[t] == n)
            assert pieces.area[t, slot] == len(y)
            if n in (3, 8):
                assert pieces.box[t, slot].tolist() == [x.min(), y.min(), x.max() + 1, y.max() + 1]
                assert lab.shape == (30, 40, 3)
    assert np.isnan(pieces.box[:, [0, 2]]).all()
    lab = np.stack([cv2.cvtColor(f, cv2.COLOR_BGR2LAB) for f in frames]).astype(int)[label == 3]
    code = (lab[:, 0] * 8 // 256 * 6 + np.clip((lab[:, 1] - 80) // 16, 0, 5)) * 6
    code += np.clip((lab[:, 2] - 80) // 16, 0, 5)
    np.testing.assert_array_equal(pieces.colour[1], np.bincount(code, minlength=int(np.prod(BINS))))


def test_distance_of_boxes_is_zero_where_they_overlap() -> None:
    a = np.array([0.0, 0, 10, 10])
    assert box_gap(a, np.array([5.0, 5, 20, 20])) == 0
    assert box_gap(a, np.array([13.0, 14, 20, 20])) == 5


def test_what_is_seen_together_is_near_by_the_median_distance() -> None:
    assert near(boxes((range(8), (30, 40), (0, 0)), (range(8), (60, 40), (0, 0)))) == (True, False)
    assert near(boxes((range(8), (30, 40), (0, 0)), (range(8), (90, 40), (0, 0)))) == (False, False)


def test_an_id_that_broke_goes_on_where_its_motion_leads() -> None:
    pieces = boxes((range(4), (20, 40), (12, 0)), (range(8, 12), (116, 40), (12, 0)))
    assert near(pieces) == (False, False)
    velocity = np.zeros((2, 3, 2))
    velocity[:, 1:] = 12, 0
    assert near(pieces, velocity) == (True, True)


def test_a_gap_needs_like_colours_and_has_a_longest_length() -> None:
    early = range(4), (30, 40), (0, 0)
    assert near(boxes(early, (range(7, 9), (30, 40), (0, 0)))) == (True, True)
    assert near(boxes(early, (range(7, 9), (30, 40), (0, 0)), colours=(5, 9))) == (False, False)
    assert near(boxes(early, (range(4, 9), (30, 40), (0, 0)), colours=(5, 9))) == (True, True)
    late = 4 + S.gap
    assert near(boxes(early, (range(late, late + 2), (30, 40), (0, 0)))) == (False, False)


def test_a_limb_that_came_off_in_the_open_goes_on_in_its_instance() -> None:
    whole = range(12), (60, 40), (0, 0)
    assert near(boxes(whole, (range(3, 6), (60, 62), (0, 0)))) == (True, False), "never without its successor"
    body = range(6, 12), (60, 40), (0, 0)
    assert near(boxes((range(7), (60, 62), (0, 0)), body)) == (True, True)
    assert near(boxes((range(7), (60, 100), (0, 0)), (range(6, 12), (82, 100), (0, 0)))) == (True, False), (
        "border"
    )


# ----------------------------------------------------------------------- broken ids
def broken(scene: Scene, gap: int) -> tuple[np.ndarray, np.ndarray]:
    """Labels in which every object gets a new id half way, after ``gap`` frames without; (new ids,) old id."""
    labels = scene.labels.copy()
    half, count = len(labels) // 2, scene.objects
    late = labels[half + gap :]
    late[late > 0] += np.uint16(count - 1)
    labels[half : half + gap] = 0
    return labels, np.concatenate([np.arange(count), np.arange(1, count)])


def grouped(scene: Scene, labels: np.ndarray) -> ShotGroups:
    core = resolve().parameters(Core)
    return group_arrays(labels, scene.pictures, scene.flow, scene.inverse_depth, "screw-shift", core)[0]


@pytest.mark.parametrize("gap", [0, 2])
def test_ids_that_break_stay_one_instance_and_one_group(gap: int) -> None:
    whole = 0
    for seed in (2, 4, 9):
        scene = flow_scene(seed, n_movers=1, n_objects=6, companions=0.0, n_pairs=14, noise=0.1)
        labels, old = broken(scene, gap)
        found = grouped(scene, labels)
        present = np.bincount(labels.ravel(), minlength=len(old))[: len(found.group)] > 200
        np.testing.assert_array_equal((found.group > 0)[present], (scene.group[old] > 0)[present])
        assert found.group.max() == 1
        whole += int(len(np.unique(found.instance)) == 2)
    assert whole == 3


def test_two_movers_far_apart_are_two_instances() -> None:
    for seed in range(20):
        scene = flow_scene(seed, n_movers=2, n_objects=6, companions=0.0)
        found = grouped(scene, scene.labels)
        if len(np.unique(found.instance)) == 3:
            assert found.group.max() == 2
            return
    pytest.fail("no scene with two instances")


def test_instances_never_cross_groups() -> None:
    for seed in range(4):
        scene = flow_scene(seed, n_movers=3, n_objects=9, shape=(120, 214), n_pairs=5, min_contrast=0.4)
        found = grouped(scene, scene.labels)
        assert ((found.instance > 0) == (found.group > 0)).all()
        for instance in np.unique(found.instance[found.instance > 0]):
            assert len(np.unique(found.group[found.instance == instance])) == 1


# ------------------------------------------------------------------------ real video
@pytest.mark.parametrize(("name", "kind", "least"), [("dog", "damaged", 75), ("car-shadow", "damaged", 86)])
def test_on_real_video_the_mover_stays_and_the_background_goes(
    davis: Path, name: str, kind: str, least: float
) -> None:
    proposals = davis.parent / "proposals" / kind / f"{name}.npz"
    if not proposals.exists():
        pytest.skip("the damaged proposals are not beside the checkout")
    labels = np.load(proposals)["labels"].astype(np.uint16)[:24]
    ids = np.unique(np.append(0, labels))
    labels = np.searchsorted(ids, labels).astype(np.uint16)
    files = sorted((davis / "JPEGImages" / "480p" / name).glob("*.jpg"))[:24]
    truth = [cv2.imread(str(davis / "Annotations" / "480p" / name / f"{f.stem}.png"), 0) > 0 for f in files]
    frames = np.stack(
        [cv2.resize(cv2.imread(str(f)), (427, 240), interpolation=cv2.INTER_AREA) for f in files]
    )
    settings = resolve()
    flow = np.stack([between(a, b, settings.flow.parameters(Dis))[0] for a, b in pairwise(frames)])
    small = np.stack([cv2.resize(x, (427, 240), interpolation=cv2.INTER_NEAREST_EXACT) for x in labels])
    found, _ = group_arrays(small, frames, flow, None, "affine", settings.parameters(Core))
    masks = (found.group > 0)[labels]
    kept = 100 * np.mean([region_j(t, p > 0) for t, p in zip(truth, labels, strict=True)])
    j = 100 * np.mean([region_j(t, p) for t, p in zip(truth, masks, strict=True)])
    assert kept < 40, "most proposals are background"
    assert j > least
    assert found.group.max() == 1
