"""From superpixels to pixels."""

import numpy as np
import pytest

from zsmoseg.proposals.embedded.guided_filter import GuidedFilter, guided_filter
from zsmoseg.proposals.embedded.upsampling import paint
from zsmoseg.settings import Labels

S = Labels().parameters(GuidedFilter)


def picture(height: int = 60, width: int = 90) -> tuple[np.ndarray, np.ndarray]:
    """A disc of another colour, and where it is."""
    y, x = np.mgrid[:height, :width]
    disc = (y - 30) ** 2 + (x - 40) ** 2 < 18**2
    frame = np.where(disc[..., None], [40, 60, 200], [120, 130, 110]) + np.random.default_rng(0).normal(
        0, 3, (height, width, 3)
    )
    return np.clip(frame, 0, 255).astype(np.uint8), disc


def blocks(height: int = 60, width: int = 90, side: int = 6) -> np.ndarray:
    y, x = np.mgrid[:height, :width]
    return (y // side * (width // side) + x // side).astype(np.uint16)


def shares(segment: np.ndarray, mask: np.ndarray) -> np.ndarray:
    return np.bincount(segment.ravel(), mask.ravel()) / np.bincount(segment.ravel())


def iou(a: np.ndarray, b: np.ndarray) -> float:
    return (a & b).sum() / (a | b).sum()


@pytest.mark.parametrize("shape", [(60, 90), (121, 181), (479, 853), (45, 70)])
def test_a_frame_without_objects_is_zero_at_the_displayed_size(shape):
    frame, _ = picture()
    ids = np.zeros(150, np.int32)
    label = paint(frame, blocks(), ids, shape, S)
    assert label.shape == shape
    assert label.dtype == np.uint16
    assert not label.any()


def test_masks_move_to_the_edges_of_the_picture():
    frame, disc = picture()
    segment = blocks()
    ids = (shares(segment, disc) > 0.5).astype(np.int32)
    label = paint(frame, segment, ids, (60, 90), S)
    assert iou(label > 0, disc) > 0.95 > iou((ids > 0)[segment], disc)


def test_objects_keep_their_ids_at_any_displayed_size():
    frame, disc = picture()
    segment = blocks()
    ids = (shares(segment, disc) > 0.5).astype(np.int32)
    right = shares(segment, np.broadcast_to(np.arange(90) > 40, (60, 90))) > 0.5
    ids[(ids > 0) & right] = 700
    for shape in ((60, 90), (121, 183)):
        label = paint(frame, segment, ids, shape, S)
        assert label.shape == shape
        assert np.unique(label).tolist() == [0, 1, 700]
        assert label[shape[0] // 2, shape[1] // 3] == 1
        assert label[shape[0] // 2, shape[1] * 52 // 90] == 700


def test_an_object_that_fills_the_frame_stays_whole():
    frame, _ = picture()
    ids = np.ones(150, np.int32)
    assert paint(frame, blocks(), ids, (120, 180), S).all()


def test_the_guided_filter_keeps_what_is_linear_in_the_guide():
    guide = np.random.default_rng(0).random((40, 50, 3)).astype(np.float32)
    x = (0.2 + guide @ np.array([0.5, -0.3, 0.1], np.float32)).astype(np.float32)
    assert np.abs(guided_filter(guide, x, GuidedFilter(guide_radius=4, guide_eps=1e-6)) - x).max() < 1e-2


def test_the_guided_filter_equals_window_by_window_regression():
    rng = np.random.default_rng(1)
    guide, x = rng.random((13, 13, 3)).astype(np.float32), rng.random((13, 13)).astype(np.float32)
    radius, eps = 2, 0.01
    total = []
    for y0 in range(2, 7):
        for x0 in range(2, 7):
            here = np.s_[y0 : y0 + 5, x0 : x0 + 5]
            g, t = guide[here].reshape(-1, 3).astype(float), x[here].ravel().astype(float)
            centred = g - g.mean(0)
            a = np.linalg.solve(centred.T @ centred / 25 + eps * np.eye(3), centred.T @ (t - t.mean()) / 25)
            total.append(a @ guide[6, 6] + t.mean() - a @ g.mean(0))
    assert (
        abs(guided_filter(guide, x, GuidedFilter(guide_radius=radius, guide_eps=eps))[6, 6] - np.mean(total))
        < 1e-3
    )
