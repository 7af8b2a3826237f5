"""Masks propagated along the flow, and masks of single frames linked to objects."""

from __future__ import annotations

import numpy as np

from zsmoseg.flow.warp import inverted, resized
from zsmoseg.proposals.given.link import Linker, Linking
from zsmoseg.proposals.given.propagate import here, look_up, nearest_known, step


def square(x: int, y: int, side: int = 10, shape: tuple[int, int] = (60, 80)) -> np.ndarray:
    label = np.zeros(shape, np.uint16)
    label[y : y + side, x : x + side] = 1
    return label


def constant(u: float, v: float, shape: tuple[int, int] = (60, 80)) -> np.ndarray:
    return np.stack([np.full(shape, u, np.float32), np.full(shape, v, np.float32)])


def test_a_mask_is_carried_over_several_frames_and_leaves_the_image() -> None:
    where = here(60, 80)
    for _ in range(5):
        where = step(where, constant(-3.0, 1.0))
    np.testing.assert_array_equal(look_up(square(30, 20), where), square(45, 15))
    for _ in range(40):
        where = step(where, constant(-3.0, 1.0))
    assert not look_up(square(30, 20), where).any()


def test_a_mask_of_twice_the_size_is_carried_along_flow_of_the_working_grid() -> None:
    where = step(here(60, 80), constant(-4.0, 0.0))
    large = square(20, 20, 20, (120, 160))
    np.testing.assert_array_equal(look_up(large, where), square(28, 20, 20, (120, 160)))


def test_unknown_flow_leads_nowhere() -> None:
    flow = constant(0.0, 0.0)
    flow[:, 20:25] = np.nan
    found = look_up(square(30, 20), step(here(60, 80), flow))
    assert not found[20:25].any()
    assert found[25:30, 30:40].all()


def test_frames_between_take_the_nearest_known_one_of_their_shot() -> None:
    known = np.zeros(12, np.bool_)
    known[[2, 6, 11]] = True
    assert nearest_known(known, 0, 9).tolist() == [2, 2, 2, 2, 2, 6, 6, 6, 6]
    assert nearest_known(known, 7, 10).tolist() == [-1, -1, -1]


def test_masks_in_any_order_are_linked_to_their_objects_along_the_flow() -> None:
    linker = Linker(Linking(link_overlap=0.3, link_gap=3))
    linker.start((60, 80))
    seen = []
    for t in range(6):
        if t:
            linker.carry(constant(-5.0, 0.0))
        a, b = square(5 + 5 * t, 10), square(5 + 5 * t, 40)
        first = t % 2 + 1
        seen.append(
            linker.see((a * first + b * (3 - first)).astype(np.uint16), np.array([1, 2]))[
                [first - 1, 2 - first]
            ]
        )
    assert all((s == [1, 2]).all() for s in seen)


def test_an_object_that_misses_its_mask_is_found_again_but_not_after_the_gap() -> None:
    mask, none = square(20, 20), np.zeros((60, 80), np.uint16)
    for missing, expected in ((3, 1), (4, 2)):
        linker = Linker(Linking(link_overlap=0.3, link_gap=3))
        linker.start((60, 80))
        linker.see(mask, np.array([1]))
        for _ in range(missing):
            linker.carry(constant(0.0, 0.0))
            linker.see(none, np.zeros(0, np.int64))
        linker.carry(constant(0.0, 0.0))
        assert linker.see(mask, np.array([1])).tolist() == [expected]


def test_numbers_of_masks_may_have_gaps() -> None:
    linker = Linker(Linking(link_overlap=0.3, link_gap=3))
    linker.start((60, 80))
    mask = square(5, 5) * 7 + square(40, 30) * 3
    assert linker.see(mask.astype(np.uint16), np.array([3, 7])).tolist() == [1, 2]
    assert linker.last == 2


def test_inverted_flow_leads_back() -> None:
    y, x = np.mgrid[:60, :80].astype(np.float32)
    there = np.stack([3 + 0.05 * (x - 40), -2 + 0.03 * (y - 30) + 0.02 * x]).astype(np.float32)
    back = inverted(there)
    at = (slice(10, 50), slice(10, 70))
    there_of = 3 + 0.05 * (x + back[0] - 40), -2 + 0.03 * (y + back[1] - 30) + 0.02 * (x + back[0])
    np.testing.assert_allclose(back[0][at], -there_of[0][at], atol=2e-3)
    np.testing.assert_allclose(back[1][at], -there_of[1][at], atol=2e-3)


def test_resized_flow_is_in_pixels_of_the_new_grid_and_unknown_where_most_is() -> None:
    flow = constant(8.0, -4.0)
    flow[:, :, :40] = np.nan
    small = resized(flow, (30, 20))
    np.testing.assert_allclose(small[0, :, 10:], 2.0, rtol=1e-6)
    np.testing.assert_allclose(small[1, :, 10:], -2.0, rtol=1e-6)
    assert np.isnan(small[:, :, :10]).all()
