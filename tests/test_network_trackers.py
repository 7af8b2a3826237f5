"""Trackers of networks: the adapters of DeAOT and Cutie, on generated graphs that know plain colours."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from graphs import coloured_clip
from graphs_tracker import write_cutie_tracker, write_tracker

from zsmoseg.errors import ModelError
from zsmoseg.networks.contract import load_contract
from zsmoseg.networks.export.cutie import cutie
from zsmoseg.networks.export.deaot import deaot
from zsmoseg.networks.image import aligned
from zsmoseg.networks.session import Network
from zsmoseg.tracking.aggregation import aggregated_groups, aggregated_objects, softmax
from zsmoseg.tracking.by_cutie import CutieTracker
from zsmoseg.tracking.by_deaot import DeaotTracker
from zsmoseg.tracking.by_network import network_tracker
from zsmoseg.tracking.protocol import Step, Tracker
from zsmoseg.tracking.spans import Moment, Spans, follow

Writer = Callable[[Path], Path]
STYLES = pytest.mark.parametrize("write", [write_tracker, write_cutie_tracker], ids=["deaot", "cutie"])
CELL = 4


def opened(folder: Path) -> Network:
    return Network(load_contract(folder), "cpu")


def clip(frames: int = 16, height: int = 121, width: int = 167) -> tuple[np.ndarray, np.ndarray]:
    """Frames, and truth with the one that comes in as the last number: 1 red, 2 green, 3 yellow, 4 blue."""
    images, truth = coloured_clip(frames, height, width)
    return images, np.array([0, 1, 2, 4, 3], np.uint16)[truth]


def begun(network: Network, image: np.ndarray, label: np.ndarray) -> Tracker:
    tracker = network_tracker(network)()
    tracker.start(image, label)
    return tracker


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / max((a | b).sum(), 1))


def worst(label: np.ndarray, truth: np.ndarray, numbers: tuple[int, ...]) -> float:
    return min(overlap(label == n, truth == n) for n in numbers)


@STYLES
@pytest.mark.parametrize("size", [(121, 167), (200, 150)], ids=str)
def test_squares_are_followed_at_any_size(write: Writer, size: tuple[int, int], tmp_path: Path) -> None:
    images, truth = clip(16, *size)
    tracker = begun(opened(write(tmp_path)), images[0], truth[0])
    for t in range(1, 16):
        label = tracker.step(Step(images[t]))
        assert label.shape == size
        assert label.dtype == np.uint16
        visible = np.where(truth[t] == 4, 0, truth[t])
        assert worst(label, visible, (1, 2, 3)) > 0.75, t


@pytest.mark.parametrize(
    "write", [partial(write_tracker, gap=50), write_cutie_tracker], ids=["deaot", "cutie"]
)
def test_one_that_is_added_midway_is_followed_from_there(write: Writer, tmp_path: Path) -> None:
    images, truth = clip(24)
    tracker = begun(opened(write(tmp_path)), images[0], truth[0])
    for t in range(1, 24):
        label = tracker.step(Step(images[t]))
        if t == 20:
            assert not (label == 4).any()
            tracker.add(images[t], truth[t])
    assert worst(label, truth[23], (1, 2, 3, 4)) > 0.75


def test_more_objects_than_identities_are_tracked_in_groups(tmp_path: Path) -> None:
    images, truth = clip(24)
    tracker = DeaotTracker(opened(write_tracker(tmp_path, objects=2, gap=50)))
    tracker.start(images[14], np.where(truth[14] == 4, 0, truth[14]))
    assert len(tracker.groups) == 2
    for t in range(15, 19):
        label = tracker.step(Step(images[t]))
    assert np.unique(label).tolist() == [0, 1, 2, 3]
    tracker.add(images[18], truth[18])
    for t in range(19, 24):
        label = tracker.step(Step(images[t]))
    assert len(tracker.groups) == 2
    assert worst(label, truth[23], (1, 2, 3, 4)) > 0.6


def test_an_identity_that_no_object_has_never_wins(tmp_path: Path) -> None:
    images, truth = clip(4)
    tracker = DeaotTracker(opened(write_tracker(tmp_path)))
    tracker.start(images[0], truth[0])
    logits = tracker.logits(images[1])
    assert len(logits) == 11
    assert (logits[4:] < -1e9).all()
    assert (logits[:4] > -20).all()


def test_the_memory_of_deaot_holds_the_first_frame_and_the_newest_ones_only(tmp_path: Path) -> None:
    images, truth = clip(40)
    tracker = DeaotTracker(opened(write_tracker(tmp_path, gap=3, frames=2)))
    tracker.start(images[0], truth[0])
    cells, held = (128 // CELL + 1) * (160 // CELL + 1), []  # 129 x 161 px
    for t in range(1, 40):
        tracker.step(Step(images[t]))
        held.append(tracker.tokens() / cells)
    # the masks of frame 3 are remembered when frame 4 comes
    assert held[:8] == [1, 1, 1, 2, 2, 2, 3, 3]
    assert max(held) == 3
    tracker.add(images[39], truth[39])
    assert tracker.tokens() / cells == 4


def test_masks_that_are_added_take_the_place_of_those_found(tmp_path: Path) -> None:
    images, truth = clip(8)
    tracker = DeaotTracker(opened(write_tracker(tmp_path, gap=1, frames=4)))
    tracker.start(images[0], truth[0])
    tracker.step(Step(images[1]))
    before = tracker.tokens()
    tracker.add(images[1], np.where(truth[1] == 2, 0, truth[1]))
    assert tracker.tokens() == 2 * before
    assert tracker.groups[0].found is None
    short = tracker.groups[0].short[2][0]
    assert short[:, 2].max() == 0  # nobody is 2 in the frame before


def test_the_memory_of_cutie_holds_the_first_frame_and_the_newest_ones_only(tmp_path: Path) -> None:
    images, truth = clip(16)
    tracker = CutieTracker(opened(write_cutie_tracker(tmp_path, frames=3, every=2)))
    tracker.start(images[0], truth[0])
    held = []
    for t in range(1, 16):
        tracker.step(Step(images[t]))
        held.append(tracker.remembered())
    assert held[:6] == [1, 1, 2, 2, 3, 3]
    assert max(held) == 3


def test_cells_of_the_border_around_a_frame_are_not_matched(tmp_path: Path) -> None:
    images, truth = clip(4, 121, 167)
    tracker = CutieTracker(opened(write_cutie_tracker(tmp_path)))
    tracker.start(images[0], truth[0])
    inside = tracker._inside()
    assert inside.shape == (128 // CELL, 176 // CELL)
    assert (inside.any(1).sum(), inside.any(0).sum()) == (30, 42)
    assert not inside[0].any()
    assert inside[1:31, 1:43].all()


@STYLES
def test_the_same_frames_give_the_same_bytes(write: Writer, tmp_path: Path) -> None:
    images, truth = clip(8)
    network, runs = opened(write(tmp_path)), []
    for _ in range(2):
        tracker = begun(network, images[0], truth[0])
        runs.append([tracker.step(Step(image)).tobytes() for image in images[1:]])
    assert runs[0] == runs[1]


@pytest.mark.parametrize(
    "write", [partial(write_tracker, objects=2), write_cutie_tracker], ids=["deaot", "cutie"]
)
def test_an_object_that_enters_midway_keeps_one_number_through_spans_of_a_network(
    write: Writer, tmp_path: Path
) -> None:
    images, truth = clip(30)
    orders = {0: (2, 1, 3), 10: (3, 2, 1), 18: (4, 1, 3, 2), 25: (1, 2, 4)}
    moments = []
    for t, image in enumerate(images):
        table = np.zeros(5, np.uint16)
        table[list(orders.get(t, ()))] = np.arange(1, len(orders.get(t, ())) + 1)
        moments.append(Moment(Step(image), table[truth[t]] if t in orders else None))
    spans = Spans(handover=3, overlap=0.5, gap=3, carry=True)
    found = list(follow(moments, network_tracker(opened(write(tmp_path))), spans))
    # numbers in the order of the first masks: 1 green, 2 red, 3 yellow, then blue
    became = [f.masks.tolist() for f in found if f.masks is not None]
    assert became == [[1, 2, 3], [3, 1, 2], [4, 2, 3, 1], [2, 1, 4]]
    assert worst(found[29].label, np.array([0, 2, 1, 3, 4])[truth[29]], (1, 2, 3, 4)) > 0.7
    assert not any((f.label == 4).any() for f in found[:18])


def test_groups_agree_on_the_background_by_the_product_of_theirs() -> None:
    rng = np.random.default_rng(0)
    one, two = (rng.normal(size=(n, 3, 4)).astype(np.float32) for n in (4, 3))
    np.testing.assert_array_equal(aggregated_groups([one]), one)
    merged = aggregated_groups([one, two])
    assert merged.shape == (6, 3, 4)
    chance = 1 / (1 + np.exp(-merged))
    np.testing.assert_allclose(chance[0], softmax(one)[0] * softmax(two)[0], rtol=1e-4)
    np.testing.assert_allclose(chance[1:], np.concatenate([softmax(one)[1:], softmax(two)[1:]]), rtol=1e-4)


def test_objects_judged_apart_share_a_pixel_by_their_odds() -> None:
    apart = np.array([0.9, 0.6, 0.0], np.float32)[:, None, None]
    odds = np.array([0.04 / 0.96, 9.0, 1.5, 1e-7])
    np.testing.assert_allclose(aggregated_objects(apart)[:, 0, 0], odds / odds.sum(), rtol=1e-4)


def test_maps_are_stretched_with_corners_on_corners() -> None:
    y, x = np.mgrid[:5, :7].astype(np.float32)
    large = aligned(np.stack([x, y]), (17, 25))
    np.testing.assert_allclose(large[0], np.broadcast_to(np.arange(25) / 4, (17, 25)), atol=1e-6)
    np.testing.assert_allclose(large[1], np.broadcast_to(np.arange(17)[:, None] / 4, (17, 25)), atol=1e-6)


def test_a_tracker_of_no_known_style_is_refused(tmp_path: Path) -> None:
    path = write_tracker(tmp_path) / "contract.toml"
    path.write_text(path.read_text().replace('"deaot"', '"siam"'))
    with pytest.raises(ModelError, match=r"style is siam; cutie and deaot are known"):
        network_tracker(opened(tmp_path))
    path.write_text(path.read_text().replace('"siam"', '"deaot"').replace("gap = 3", "gap = 0"))
    with pytest.raises(
        ModelError, match=r"contract.toml: \[tracker\] gap: Input should be greater than or equal to 1"
    ):
        network_tracker(opened(tmp_path))()


@pytest.mark.parametrize(
    ("build", "hint"), [(partial(deaot, "r50-deaotl"), "pip install deaotpy"), (cutie, "hkchengrex/Cutie")]
)
def test_an_export_without_the_authors_code_says_where_to_get_it(
    build: Callable[[], object], hint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("aot", "configs", "cutie"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ModelError, match=hint):
        build()
