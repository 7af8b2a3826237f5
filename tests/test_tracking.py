"""Masks carried along the flow, linked to objects, and tracked span by span."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import pytest

from zsmoseg.errors import SettingsError
from zsmoseg.flow.warp import inverted, resized
from zsmoseg.tracking.by_flow import Carrying, FlowTracker
from zsmoseg.tracking.carrying import here, look_up, nearest_known, step
from zsmoseg.tracking.linking import Linker, Linking
from zsmoseg.tracking.matching import matched
from zsmoseg.tracking.protocol import Step
from zsmoseg.tracking.spans import Followed, Follower, Moment, Spans, follow


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
    linker = Linker(Linking(overlap=0.3, gap=3))
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
        linker = Linker(Linking(overlap=0.3, gap=3))
        linker.start((60, 80))
        linker.see(mask, np.array([1]))
        for _ in range(missing):
            linker.carry(constant(0.0, 0.0))
            linker.see(none, np.zeros(0, np.int64))
        linker.carry(constant(0.0, 0.0))
        assert linker.see(mask, np.array([1])).tolist() == [expected]


def test_numbers_of_masks_may_have_gaps() -> None:
    linker = Linker(Linking(overlap=0.3, gap=3))
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


GRID = (120, 160)


class Scene:
    """Coloured squares that move over a grey ground with detail; flow is known."""

    def __init__(self, frames: int, squares: list[tuple[int, int, int, int, int]], ends: int = 10**6) -> None:
        """Each square: x, y, px a frame along x, first frame, hue; the first one is gone from frame ``ends`` on."""
        self.frames, self.squares, self.ends = frames, squares, ends
        noise = np.random.default_rng(3).normal(size=GRID)
        noise = cv2.GaussianBlur(noise, (0, 0), 2.0)
        self.ground = (
            np.repeat((110 + 25 * noise / noise.std())[..., None], 3, 2).clip(0, 255).astype(np.uint8)
        )

    def there(self, t: int) -> list[tuple[int, int, int, int, int]]:
        """Number from 1, x, y, px a frame, hue of those in the frame."""
        return [
            (n, x + v * t, y, v, hue)
            for n, (x, y, v, first, hue) in enumerate(self.squares, 1)
            if t >= first and not (n == 1 and t >= self.ends)
        ]

    def frame(self, t: int) -> np.ndarray:
        """(h, w, 3)"""
        image = self.ground.copy()
        for _, x, y, _, hue in self.there(t):
            colour = cv2.cvtColor(np.uint8([[[hue, 220, 220]]]), cv2.COLOR_HSV2BGR)[0, 0]
            image[y : y + 24, max(x, 0) : max(x + 24, 0)] = colour
        return image

    def truth(self, t: int) -> np.ndarray:
        """(h, w)"""
        label = np.zeros(GRID, np.uint16)
        for n, x, y, _, _ in self.there(t):
            label[y : y + 24, max(x, 0) : max(x + 24, 0)] = n
        return label

    def step(self, t: int) -> Step:
        """The frame and the flow from the frame before."""
        if t == 0:
            return Step(self.frame(0))
        backward, forward = np.zeros((2, 2, *GRID), np.float32)
        for n, _, _, v, _ in self.there(t):
            backward[0][self.truth(t) == n] = -v
        for n, _, _, v, _ in self.there(t - 1):
            forward[0][self.truth(t - 1) == n] = v
        return Step(self.frame(t), backward, forward)

    def moments(self, keys: dict[int, list[int]]) -> Iterator[Moment]:
        """All frames; key frames propose the squares of the given numbers, numbered from 1 in the given order."""
        for t in range(self.frames):
            masks = None
            if t in keys:
                table = np.zeros(len(self.squares) + 1, np.uint16)
                table[keys[t]] = np.arange(1, len(keys[t]) + 1)
                masks = table[self.truth(t)]
            yield Moment(self.step(t), masks)


def iou(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / max((a | b).sum(), 1))


def run(scene: Scene, keys: dict[int, list[int]], last: int = 0, **change: object) -> list[Followed]:
    spans = replace(Spans(handover=3, overlap=0.5, gap=3, carry=True), **change)  # type: ignore[arg-type]
    return list(follow(scene.moments(keys), lambda: FlowTracker(GRID), spans, last))


TWO = [(20, 20, 3, 0, 0), (100, 70, -2, 0, 60)]


def test_the_flow_tracker_follows_coloured_squares_and_learns_one_that_is_added() -> None:
    scene = Scene(16, [*TWO, (10, 90, 2, 5, 120)])
    tracker = FlowTracker(GRID)
    tracker.start(scene.frame(0), scene.truth(0))
    for t in range(1, 16):
        label = tracker.step(scene.step(t))
        if t == 5:
            assert not (label == 3).any()
            tracker.add(scene.frame(5), scene.truth(5))
    assert min(iou(label == n, scene.truth(15) == n) for n in (1, 2, 3)) > 0.9


def test_colours_mend_what_wrong_flow_does_to_a_mask() -> None:
    scene, found = Scene(12, [(60, 40, 1, 0, 0)]), []
    for softness in (0.0, 0.6):
        tracker = FlowTracker(GRID, Carrying(softness=softness))
        tracker.start(scene.frame(0), scene.truth(0))
        for t in range(1, 12):
            step = scene.step(t)
            assert step.backward is not None
            step.backward[0] += 0.6
            label = tracker.step(step)
        found.append(iou(label == 1, scene.truth(11) == 1))
    assert found[0] < 0.75
    assert found[1] > 0.85


def test_an_object_that_comes_midway_gets_its_number_at_the_next_key_frame_and_keeps_it() -> None:
    scene = Scene(20, [*TWO, (10, 90, 2, 3, 120)])
    found = run(scene, {0: [1, 2], 8: [3, 2, 1], 16: [2, 3, 1]})
    assert [f.masks.tolist() for f in found if f.masks is not None] == [[1, 2], [3, 2, 1], [2, 3, 1]]
    assert len(found) == 20
    assert not any((f.label == 3).any() for f in found[:8])
    for t in range(8, 20):
        assert min(iou(found[t].label == n, scene.truth(t) == n) for n in (1, 2, 3)) > 0.85


@pytest.mark.parametrize("handover", [1, 3, 50])
def test_an_object_that_is_not_proposed_again_goes_on_only_where_carry_is_on(handover: int) -> None:
    scene, keys = Scene(20, TWO), {0: [1, 2], 8: [2]}
    on = run(scene, keys, handover=handover)
    assert iou(on[19].label == 1, scene.truth(19) == 1) > 0.85
    assert on[8].masks.tolist() == [2]
    off = run(scene, keys, handover=handover, carry=False)
    assert (off[7].label == 1).any()
    assert not any((f.label == 1).any() for f in off[8:])
    assert iou(off[19].label == 2, scene.truth(19) == 2) > 0.85


def test_a_carried_object_ends_after_the_gap_and_is_a_new_one_afterwards() -> None:
    scene = Scene(20, TWO)
    keys = {0: [1, 2], 4: [2], 8: [], 12: [2], 16: [1, 2]}
    assert run(scene, keys, gap=3)[16].masks.tolist() == [1, 2]
    assert run(scene, keys, gap=2)[16].masks.tolist() == [3, 2]


def test_an_object_that_is_lost_ends() -> None:
    scene = Scene(20, TWO, ends=5)
    found = run(scene, {0: [1, 2], 8: [2]})
    assert not any((f.label == 1).any() for f in found[8:])
    assert iou(found[19].label == 2, scene.truth(19) == 2) > 0.85


def test_a_shot_without_masks_has_no_objects_and_the_next_goes_on_counting() -> None:
    scene = Scene(6, TWO)
    assert not any(f.label.any() for f in run(scene, {}))
    assert not any(f.label.any() for f in run(scene, {0: [], 3: []}))
    late = run(scene, {2: [1, 2]}, last=7)
    assert not late[1].label.any()
    assert np.unique(late[5].label).tolist() == [0, 8, 9]


class Scripted:
    """A tracker that says what it is told to, frame by frame."""

    def __init__(self, *labels: np.ndarray) -> None:
        self.labels, self.given = list(labels), []

    def start(self, frame: np.ndarray, label: np.ndarray) -> None:
        self.given.append(label)

    def step(self, step: Step) -> np.ndarray:
        return self.labels.pop(0)

    def add(self, frame: np.ndarray, label: np.ndarray) -> None:
        self.given.append(label)


HERE, THERE = square(5, 5), square(40, 5)


def scripted(old: Scripted, new: Scripted, handover: int = 3) -> list[Followed]:
    """Seven frames; a mask at ``HERE`` is proposed in the first and in the fourth."""
    moments = [Moment(Step(np.zeros((60, 80, 3), np.uint8)), HERE if t in (0, 3) else None) for t in range(7)]
    trackers = iter([old, new])
    return list(follow(moments, lambda: next(trackers), Spans(handover, 0.5, 3, True)))


def test_an_object_that_parts_from_its_mask_during_the_handover_is_added_to_the_next_span() -> None:
    old, new = Scripted(HERE, HERE, HERE, THERE, THERE), Scripted(HERE, HERE, HERE + 2 * THERE)
    found = scripted(old, new)
    assert [f.masks.tolist() for f in found if f.masks is not None] == [[1], [2]]
    assert [np.unique(label).tolist() for label in new.given] == [[0, 1], [0, 1, 2]]
    np.testing.assert_array_equal(found[4].label, 2 * HERE + THERE)
    np.testing.assert_array_equal(found[6].label, 2 * HERE + THERE)


def test_an_object_that_is_carried_and_turns_out_to_be_a_mask_is_there_once() -> None:
    old, new = Scripted(HERE, HERE, THERE, HERE, HERE), Scripted(HERE + 2 * THERE, HERE, HERE + 2 * THERE)
    found = scripted(old, new)
    assert [f.masks.tolist() for f in found if f.masks is not None] == [[1], [1]]
    assert [np.unique(label).tolist() for label in new.given] == [[0, 1, 2]]
    for f in found:
        np.testing.assert_array_equal(f.label, HERE)


def test_more_objects_than_a_label_image_holds_are_refused() -> None:
    scene = Scene(2, TWO)
    assert run(scene, {0: [1, 2]}, last=65533)[0].masks.tolist() == [65534, 65535]
    with pytest.raises(SettingsError, match="more than 65535 objects"):
        run(scene, {0: [1, 2]}, last=65534)


def test_two_masks_never_become_one_object() -> None:
    share = np.array([[0.9, 0.8], [0.85, 0.1], [0.0, 0.0]])
    assert matched(share, 0.5).tolist() == [1, 0, -1]
    assert matched(np.zeros((2, 0)), 0.5).tolist() == [-1, -1]


@pytest.mark.parametrize("handover", [1, 3, 50])
@pytest.mark.parametrize("at", [4, 8, 12, 16])
@pytest.mark.parametrize(
    "keys", [{0: [1, 2], 4: [2], 8: [], 12: [2], 16: [1, 2]}, {4: [], 8: [1], 12: [2], 16: []}]
)
def test_a_shot_that_is_left_before_a_key_frame_goes_on_as_if_it_had_not_been(
    keys: dict[int, list[int]], at: int, handover: int
) -> None:
    scene, spans = Scene(20, TWO), Spans(handover, 0.5, 3, True)
    moments, whole = list(scene.moments(keys)), run(scene, keys, handover=handover)
    one = Follower(lambda: FlowTracker(GRID), spans)
    found = list(one.run(moments[:at], goes_on=True))
    halt, two = one.halt(), Follower(lambda: FlowTracker(GRID), spans, one.last, at)
    two.resume(halt, moments[halt.begun.frame : at] if halt.begun else [])
    found += two.run(moments[at:])
    assert len(found) == len(whole)
    for a, b in zip(found, whole, strict=True):
        np.testing.assert_array_equal(a.label, b.label)
        assert (a.masks is None) == (b.masks is None)
        assert a.masks is None or a.masks.tolist() == b.masks.tolist()


def test_who_goes_on_gives_a_tracker_what_it_was_given_when_it_was_given_it() -> None:
    spans, frame = Spans(3, 0.5, 3, True), Step(np.zeros((60, 80, 3), np.uint8))
    old, new = Scripted(HERE, HERE, HERE, THERE, THERE), Scripted(HERE, HERE)
    trackers, again = iter([old, new]), Scripted(HERE, HERE)
    moments = [Moment(frame, HERE if t in (0, 3) else None) for t in range(6)]
    one = Follower(lambda: next(trackers), spans)
    assert len(list(one.run(moments, goes_on=True))) == 6
    halt = one.halt()
    assert halt.begun is not None
    assert halt.begun.late is not None
    assert (halt.begun.frame, halt.begun.late[0]) == (3, 5)
    Follower(lambda: again, spans).resume(halt, moments[3:])
    assert again.labels == []
    np.testing.assert_array_equal(again.given, new.given)
    assert halt.objects.tolist() == [0, 2, 1]
