"""Superpixels, and what is measured on them."""

from itertools import pairwise

import cv2
import numpy as np
import pytest
from conftest import draw_clip, textured
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from zsmoseg.errors import SettingsError
from zsmoseg.flow.dis import Dis, between
from zsmoseg.proposals.embedded import extraction
from zsmoseg.proposals.embedded.extraction import Links
from zsmoseg.proposals.embedded.features import SuperpixelFeatures
from zsmoseg.proposals.embedded.features_loops import ERROR, RIM, SIZE
from zsmoseg.proposals.embedded.superpixels import Superpixels, lab, segment
from zsmoseg.settings import Flow, Segments

S = Links(link_least=1)
SLIC = Segments().parameters(Superpixels)
FRAMES = draw_clip(frames=5, height=60, width=80)[0]
SEGMENTS = np.stack([segment(frame, SLIC) for frame in FRAMES])
FORWARD, BACKWARD = map(
    np.stack,
    zip(*[between(a, b, Flow().parameters(Dis)) for a, b in pairwise(FRAMES)], strict=True),
)


def measure(start: int, stop: int, ignore: np.ndarray | None = None, frames: np.ndarray = FRAMES):
    last = min(stop + 1, len(frames))
    return extraction.measure(
        frames[start:last],
        SEGMENTS[start:last],
        FORWARD[start : last - 1],
        BACKWARD[start : last - 1],
        ["ok"] * (last - 1 - start),
        stop - start,
        ignore,
        S,
    )


WHOLE = measure(0, 5)


def same(one: SuperpixelFeatures, two: SuperpixelFeatures) -> bool:
    return all(
        a.dtype == two.arrays()[name].dtype and np.array_equal(a, two.arrays()[name])
        for name, a in one.arrays().items()
    )


def test_superpixels_are_numbered_without_gaps_and_each_is_connected():
    for found in SEGMENTS:
        assert found.dtype == np.uint16
        assert np.array_equal(np.unique(found), np.arange(found.max() + 1))
        for k in range(found.max() + 1):
            assert cv2.connectedComponents((found == k).astype(np.uint8), connectivity=4)[0] == 2


def test_superpixels_are_about_as_many_as_the_pitch_says():
    image = textured(np.random.default_rng(0), 90, 150, (100, 120, 140))
    for pitch in (6.0, 10.0):
        count = segment(image, Segments(pitch=pitch).parameters(Superpixels)).max() + 1
        assert 0.7 < count * pitch**2 / (90 * 150) < 1.3


def test_superpixels_keep_to_a_colour_edge():
    image = np.full((60, 80, 3), 200, np.uint8)
    side = np.add.outer(np.arange(60), np.arange(80)) < 65
    image[side] = (40, 90, 30)
    found = segment(image, SLIC).ravel()
    inside = np.bincount(found, side.ravel()) / np.bincount(found)
    assert np.minimum(inside, 1 - inside).max() < 0.2


def test_too_many_superpixels_are_refused_with_the_setting_named():
    with pytest.raises(SettingsError, match=r"segments\.pitch = 4: .* use 4\.7 or more"):
        segment(np.zeros((600, 1200, 3), np.uint8), Segments(pitch=4).parameters(Superpixels))


def test_features_and_edges_equal_counting_by_hand():
    found, n = SEGMENTS[1], WHOLE.superpixel_offset
    feature = WHOLE.feature[n[1] : n[2]]
    y, x = np.mgrid[:60, :80]
    colour = lab(FRAMES[1])
    for k in range(len(feature)):
        here = found == k
        expected = [here.sum(), y[here].mean(), x[here].mean(), *colour[here].mean(0)]
        assert np.allclose(feature[k, SIZE:RIM], expected, rtol=1e-4, atol=1e-3)
        assert (feature[k, RIM] > 0) == (here & ((y < 2) | (x < 2) | (y > 57) | (x > 77))).any()
    steps = np.concatenate(
        [
            np.stack([found[:, :-1].ravel(), found[:, 1:].ravel()], 1),
            np.stack([found[:-1].ravel(), found[1:].ravel()], 1),
        ]
    )
    steps = np.sort(steps[steps[:, 0] != steps[:, 1]], axis=1)
    edge, length = np.unique(steps, axis=0, return_counts=True)
    rows = slice(*WHOLE.edge_offset[1:3])
    assert np.array_equal(WHOLE.edge[rows], edge)
    assert np.array_equal(WHOLE.boundary[rows], length)


def test_links_equal_counting_by_hand():
    counted: dict[tuple[int, int], list[int]] = {}
    for way, (one, two, moved) in enumerate(
        [(SEGMENTS[2], SEGMENTS[3], FORWARD[2]), (SEGMENTS[3], SEGMENTS[2], BACKWARD[2])]
    ):
        for y in range(60):
            for x in range(80):
                u, v = np.rint(x + moved[0, y, x]), np.rint(y + moved[1, y, x])
                if 0 <= u < 80 and 0 <= v < 60:
                    key = (int(one[y, x]), int(two[int(v), int(u)]))
                    counted.setdefault(key if way == 0 else key[::-1], [0, 0])[way] += 1
    rows = slice(*WHOLE.link_offset[2:4])
    assert [tuple(pair) for pair in WHOLE.link[rows].tolist()] == sorted(counted)
    assert WHOLE.carried[rows].tolist() == [counted[key] for key in sorted(counted)]


def test_flow_features_hold_the_mean_flow_and_what_does_not_close():
    rows = slice(*WHOLE.superpixel_offset[2:4])
    number = SEGMENTS[2].ravel()
    for c in range(2):
        mean = np.bincount(number, FORWARD[2][c].ravel()) / np.bincount(number)
        assert np.allclose(WHOLE.forward[rows][:, c], mean, atol=1e-4)
    static = np.zeros_like(FORWARD[:1])
    shut = extraction.measure(FRAMES[:2], SEGMENTS[:2], static, static, ["ok"], 2, None, S)
    open_ = extraction.measure(FRAMES[:2], SEGMENTS[:2], static + 3, static, ["ok"], 2, None, S)
    assert np.allclose(shut.forward[:, ERROR], 0)
    assert np.allclose(open_.forward[:, ERROR], np.hypot(3, 3), atol=1e-4)


@given(st.lists(st.integers(1, 4), min_size=1, max_size=5))
@hypothesis_settings(max_examples=20, deadline=None)
def test_features_do_not_depend_on_how_the_video_is_cut(lengths):
    ends = np.minimum(np.cumsum([0, *lengths, 5]), 5)
    chunks = [measure(a, b) for a, b in pairwise(ends) if a < b]
    assert same(SuperpixelFeatures.join(chunks), WHOLE)


def test_a_part_of_the_features_is_the_features_of_that_part():
    alone = extraction.measure(
        FRAMES[1:4], SEGMENTS[1:4], FORWARD[1:3], BACKWARD[1:3], ["ok"] * 2, 3, None, S
    )
    assert same(WHOLE.part(1, 4), alone)
    assert same(SuperpixelFeatures(**WHOLE.arrays()), WHOLE)


def test_a_cut_has_no_links():
    cut = extraction.measure(FRAMES[:2], SEGMENTS[:2], FORWARD[:1], BACKWARD[:1], ["cut"], 2, None, S)
    assert len(cut.link) == 0
    assert not cut.forward.any()
    assert cut.state.tolist() == [1]


def test_links_of_few_pixels_are_left_out():
    few = extraction.measure(
        FRAMES[:2], SEGMENTS[:2], FORWARD[:1], BACKWARD[:1], ["ok"], 2, None, Links(link_least=10)
    )
    rows = slice(*WHOLE.link_offset[:2])
    kept = WHOLE.carried[rows].sum(1) >= 10
    assert np.array_equal(few.link, WHOLE.link[rows][kept])


def test_what_is_under_the_ignore_mask_is_in_no_feature():
    ignore = np.zeros((60, 80), np.bool_)
    ignore[45:, 10:70] = True
    other = FRAMES.copy()
    other[:, ignore] = np.random.default_rng(0).integers(0, 255, 3)
    one = measure(0, 5, ignore)
    assert same(one, measure(0, 5, ignore, other))
    assert not same(one, WHOLE)
    hidden = np.setdiff1d(SEGMENTS[0][ignore], SEGMENTS[0][~ignore])
    assert len(hidden)
    assert not one.feature[hidden, SIZE].any()
    assert not np.isin(one.edge[slice(*one.edge_offset[:2])], hidden).any()
    assert one.feature[: one.superpixel_offset[1], SIZE].sum() == (~ignore).sum()
