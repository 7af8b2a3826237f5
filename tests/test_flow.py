"""Optical flow, and which frames are pairs."""

import itertools
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import textured

from zsmoseg.flow.consistency import Tolerance, closed, round_trip, round_trip_of
from zsmoseg.flow.dis import Dis, between
from zsmoseg.flow.pairs import PairCriteria, pair_state
from zsmoseg.settings import Flow
from zsmoseg.synthetic import CAMERAS, video_scene

S = Flow().parameters(Dis)
FAST = ("motocross-jump", "drift-straight", "bmx-trees")


def world(seed: int = 0, colour: tuple[int, int, int] = (110, 130, 90)) -> np.ndarray:
    return textured(np.random.default_rng(seed), 150, 220, colour)


def view(image: np.ndarray, x: int, y: int) -> np.ndarray:
    return np.ascontiguousarray(image[y : y + 120, x : x + 160])


def state(a: np.ndarray, b: np.ndarray) -> str:
    return pair_state(a, b, *between(a, b, S), Flow().parameters(PairCriteria))


def small_frames(davis: Path, name: str) -> list[np.ndarray]:
    files = sorted((davis / "JPEGImages/480p" / name).glob("*.jpg"))
    return [cv2.resize(cv2.imread(str(f)), (427, 240), interpolation=cv2.INTER_AREA) for f in files]


def test_flow_of_a_pan_is_the_pan_and_its_opposite():
    a, b = view(world(), 10, 8), view(world(), 14, 6)
    forward, backward = between(a, b, S)
    assert forward.shape == backward.shape == (2, 120, 160)
    assert forward.dtype == np.float32
    inside = np.s_[:, 12:-12, 12:-12]
    assert np.abs(forward[inside] - np.array([-4, 2])[:, None, None]).max() < 0.3
    assert np.abs(backward[inside] - np.array([4, -2])[:, None, None]).max() < 0.3


@pytest.mark.parametrize("shape", [(16, 32), (32, 33), (120, 35)])
def test_small_grids_have_flow(shape):
    image = textured(np.random.default_rng(0), *shape, (100, 100, 100))
    assert np.isfinite(between(image, np.roll(image, 1, 1), S)).all()


@pytest.mark.parametrize("seed", [0, 2, 4, 6])
def test_what_is_small_and_moves_far_is_searched(seed):
    """A rendered thing of about 50 px that moves by 21 px a frame of the working grid."""
    scene = video_scene(seed, camera=CAMERAS[seed % len(CAMERAS)], n_frames=2, speeds=[1.0, 10.0])
    first, second = (np.ascontiguousarray(picture[::2, ::2]) for picture in scene.pictures)
    truth, group = scene.flow[0][:, ::2, ::2] / 2, scene.truth[0][::2, ::2]
    fast = group == group.max()
    lost, found = (np.hypot(*(between(first, second, p)[0] - truth)) < 2 for p in (replace(S, reach=0), S))
    assert lost[fast].mean() < 0.1
    assert found[fast].mean() > 0.6
    assert (lost & ~found)[~fast].mean() < 0.02


def thing(shift: int | None, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """A square of 40 px that moves by ``shift`` px before a world that stands still; None: it is not in the second frame."""
    rng = np.random.default_rng(seed)
    still, moving = textured(rng, 200, 360, (110, 130, 90)), textured(rng, 40, 40, (225, 220, 230))
    first, second = still.copy(), still.copy()
    first[80:120, 100:140] = moving
    if shift is not None:
        second[80:120, 100 + shift : 140 + shift] = moving
    return first, second


@pytest.mark.parametrize(
    "pair",
    [
        thing(3),
        thing(None),
        thing(100),
        (world(0), world(7)),
        (world(0)[:12, :16], world(7)[:12, :16]),
        (np.zeros((64, 96, 3), np.uint8), np.full((64, 96, 3), 255, np.uint8)),
    ],
    ids=["slow", "hidden", "too far", "another shot", "tiny", "one colour"],
)
def test_without_something_found_the_flow_is_as_without_a_search(pair):
    for plain, searched in zip(between(*pair, replace(S, reach=0)), between(*pair, S), strict=True):
        np.testing.assert_array_equal(searched, plain)


def test_a_frame_shown_twice_is_a_repeat_also_with_noise_and_another_coding():
    a = view(world(), 10, 8)
    rng = np.random.default_rng(1)
    noisy = [np.clip(a + rng.normal(0, 3, a.shape), 0, 255).astype(np.uint8) for _ in range(2)]
    coded = cv2.imdecode(cv2.imencode(".jpg", a, [cv2.IMWRITE_JPEG_QUALITY, 80])[1], cv2.IMREAD_COLOR)
    assert state(a, a) == state(*noisy) == state(a, coded) == "repeat"


def test_a_small_thing_that_moves_in_a_still_scene_is_no_repeat():
    a = view(world(), 10, 8)
    b = a.copy()
    b[50:62, 71:83] = a[50:62, 70:82]
    assert state(a, b) == "ok"


def test_another_scene_is_a_cut():
    assert state(view(world(0), 10, 8), view(world(1, (60, 80, 160)), 10, 8)) == "cut"


def test_neither_a_pan_nor_a_flash_nor_a_large_mover_is_a_cut():
    a, panned = view(world(), 0, 8), view(world(), 12, 8)
    flash = np.clip(panned * 1.3 + 30, 0, 255).astype(np.uint8)
    covered = panned.copy()
    covered[20:100, 30:110] = world(3, (200, 60, 60))[:80, :80]
    assert state(a, panned) == state(a, flash) == state(a, covered) == "ok"


@pytest.mark.parametrize("name", FAST)
def test_no_cut_within_fast_real_shots(davis, name):
    frames = small_frames(davis, name)
    assert {state(a, b) for a, b in itertools.pairwise(frames[::2] if name == "bmx-trees" else frames)} == {
        "ok"
    }


def test_every_change_from_one_real_shot_to_another_is_a_cut(davis):
    names = sorted(path.name for path in (davis / "JPEGImages/480p").iterdir())
    ends = {}
    for name in names:
        files = sorted((davis / "JPEGImages/480p" / name).glob("*.jpg"))
        ends[name] = [
            cv2.resize(cv2.imread(str(f)), (427, 240), interpolation=cv2.INTER_AREA)
            for f in (files[-1], files[0])
        ]
    pairs = list(itertools.permutations(names, 2))[::2]
    assert {state(ends[a][0], ends[b][1]) for a, b in pairs} == {"cut"}


# ----------------------------------------------------------------------- there and back
CLOSURE = Tolerance(0.5, 0.05, "sum")


def test_flow_that_does_not_lead_back_or_leads_out_is_no_flow():
    flow = np.zeros((2, 30, 40), np.float32)
    flow[0] = 3.0
    back = -flow
    back[:, 10:15] = 0.0
    lost = ~closed(round_trip(flow, back), CLOSURE)
    assert lost[10:15].all()
    assert lost[:, 37:].all(), "what leaves the frame has no way back"
    rest = np.delete(lost, np.s_[10:15], axis=0)
    assert not rest[:, :36].any()
    flow[:, 20, 20] = np.nan
    assert not closed(round_trip(flow, back), CLOSURE)[20, 20]
    back[0] += 0.6
    assert closed(round_trip(flow, back), CLOSURE)[2, 2], "half a pixel and a part of the length"
    assert not closed(round_trip(flow, back), Tolerance(0.5, 0.0, "sum"))[2, 2]


def test_each_rule_of_closure_allows_what_it_says():
    forward, backward = np.zeros((2, 1, 40), np.float32), np.zeros((2, 1, 40), np.float32)
    forward[0], backward[0] = 10.0, -8.0
    trip = round_trip(forward, backward)
    np.testing.assert_array_equal(trip.error[0, 0, :30], 2.0)
    for rule, absolute, relative, good in (
        ("sum", 1.0, 0.1, True), ("sum", 0.9, 0.1, False), ("larger", 1.0, 0.2, True), ("larger", 1.0, 0.1, False),
        ("squares", 2.4, 0.01, True), ("squares", 2.3, 0.01, False),
    ):  # fmt: skip
        assert closed(trip, Tolerance(absolute, relative, rule))[0, 0] == good


def test_points_and_pixels_go_the_same_way():
    rng = np.random.default_rng(0)
    forward, backward = rng.normal(0, 1, (2, 2, 20, 30)).astype(np.float32)
    y, x = np.mgrid[5:15, 5:25]
    place = np.stack([x.ravel(), y.ravel()]).astype(np.float32)
    points, pixels = round_trip_of(place, forward, backward), round_trip(forward, backward)
    np.testing.assert_allclose(points.end, pixels.end[:, 5:15, 5:25].reshape(2, -1), atol=1e-6)
    np.testing.assert_allclose(points.error, pixels.error[:, 5:15, 5:25].reshape(2, -1), atol=0.1)
    assert points.inside.all()


def test_a_coarser_grid_is_read_with_flow_in_px_of_the_finer_one():
    forward = np.zeros((2, 10, 10), np.float32)
    forward[0] = 8.0
    trip = round_trip(forward, -forward, scale=4)
    np.testing.assert_array_equal(trip.end[0, 0], np.arange(10) + 2)
    assert not trip.error[:, :, :8].any()
    assert trip.inside.sum() == 80
