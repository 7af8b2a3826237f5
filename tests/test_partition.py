"""Which parts of the foreground move apart, and the ids of what they form: made graphs of superpixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from zsmoseg.proposals.embedded import objects as objects_module
from zsmoseg.proposals.embedded.absorption import absorb
from zsmoseg.proposals.embedded.components import NONE, tidy
from zsmoseg.proposals.embedded.contraction import contract
from zsmoseg.proposals.embedded.graph import Graph
from zsmoseg.proposals.embedded.identities import Identities
from zsmoseg.proposals.embedded.objects import Objects as Parameters
from zsmoseg.proposals.embedded.objects import moving_parts
from zsmoseg.proposals.embedded.partition import (
    Partition,
    apart_graph,
    chains,
    far_pairs,
    partition,
    signed_graph,
)
from zsmoseg.proposals.embedded.saliency import Look
from zsmoseg.proposals.embedded.signed_graph import SignedGraph
from zsmoseg.settings import Objects

S = Objects().parameters(Partition)
PITCH, SIZE = 8, 64.0
BACKGROUND = -1


def scene(frames: list[np.ndarray], velocity: list[np.ndarray], known: list[bool] | None = None) -> Graph:
    """Square superpixels in rows and columns.

    Parameters
    ----------
    frames
        Each (rows, columns): the thing that a superpixel shows, or ``BACKGROUND``; a thing moves by whole superpixels.
    velocity
        For each frame the flow (things + 1, 2) in px, x then y, of all things, then of the background; or
        (rows, columns, 2) of all superpixels.
    """
    rows, columns = frames[0].shape
    count, nodes = rows * columns, rows * columns * len(frames)
    number = np.arange(nodes).reshape(len(frames), rows, columns)
    flow = np.stack([v if v.ndim == 3 else v[f] for f, v in zip(frames, velocity, strict=True)])
    edge = np.concatenate(
        [
            np.concatenate(
                [
                    np.stack([n[:, :-1].ravel(), n[:, 1:].ravel()], 1),
                    np.stack([n[:-1].ravel(), n[1:].ravel()], 1),
                ]
            )
            for n in number
        ]
    )
    link = []
    for t in range(len(frames) - 1):
        step = np.rint(flow[t] / PITCH).astype(int)
        for y, x in np.ndindex(rows, columns):
            y2, x2 = y + step[y, x, 1], x + step[y, x, 0]
            if 0 <= y2 < rows and 0 <= x2 < columns and frames[t][y, x] == frames[t + 1][y2, x2]:
                link.append((number[t, y, x], number[t + 1, y2, x2]))
    forward = np.concatenate([flow.reshape(nodes, 2), np.zeros((nodes, 2))], 1).astype(np.float64)
    place = np.stack(np.indices((rows, columns)), 2).reshape(count, 2) * PITCH + PITCH / 2
    return Graph(
        start=0,
        shape=(rows * PITCH, columns * PITCH),
        offset=np.arange(len(frames) + 1) * count,
        frame=np.repeat(np.arange(len(frames)), count),
        size=np.full(nodes, SIZE),
        place=np.tile(place, (len(frames), 1)),
        colour=np.zeros((nodes, 3)),
        rim=np.zeros(nodes, np.bool_),
        detail=np.ones(nodes),
        structure=np.ones((nodes, 3)),
        edge=edge,
        boundary=np.full(len(edge), float(PITCH)),
        link=np.array(link, np.int64).reshape(-1, 2),
        carried=np.full(len(link), 2 * SIZE),
        forward=forward,
        backward=forward * [-1, -1, 1, 1],
        has_flow=np.repeat(known or [True] * len(frames), count),
    )


def thing(frames: list[np.ndarray]) -> np.ndarray:
    """(nodes) what a superpixel shows."""
    return np.concatenate([f.ravel() for f in frames])


def found(w: Graph, frames: list[np.ndarray], s: Partition = S) -> list[set[int]]:
    """The parts that each thing is in."""
    shown = thing(frames)
    part = partition(w, shown != BACKGROUND, s)[1]
    return [set(part[shown == n].tolist()) for n in range(int(shown.max()) + 1)]


def crossing(distance: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """A block that moves right, and one in front of it that moves left from ``distance`` columns further on."""
    frames, velocity = [], []
    for t in range(12):
        frame = np.full((8, 24), BACKGROUND)
        frame[2:6, 2 + t : 7 + t] = 0
        x = 7 + distance - t
        frame[3:7, max(x, 0) : x + 4] = 1
        frames.append(frame)
        velocity.append(np.array([[8.0, 0], [-8, 0], [0, 0]]))
    return frames, velocity


@pytest.mark.parametrize("distance", [0, 3, 8], ids=["from the start on", "after 2 frames", "after 4 frames"])
def test_two_movers_that_touch_and_cross_are_two_parts_in_all_frames(distance: int) -> None:
    frames, velocity = crossing(distance)
    first, second = found(scene(frames, velocity), frames)
    assert len(first) == len(second) == 1
    assert first != second


def test_two_movers_that_touch_keep_their_ids_and_an_occluder_splits_none() -> None:
    frames, velocity = crossing(8)
    w = scene(frames, velocity)
    foreground = thing(frames) != BACKGROUND
    part = tidy(foreground, partition(w, foreground, S)[1], w.size, w.edge, 2 * SIZE)
    ids = Identities().name(part, w.size, 0)
    assert [set(ids[thing(frames) == n].tolist()) for n in (BACKGROUND, 0, 1)] == [{0}, {1}, {2}]


def bleeding(t: int, apart: float) -> tuple[np.ndarray, np.ndarray]:
    """Two blocks side by side, whose flow goes over into one another without a step; ``apart`` px a frame in all."""
    frame = np.full((12, 34), BACKGROUND)
    frame[2:10, 2 + t : 12 + t], frame[2:10, 12 + t : 22 + t] = 0, 1
    flow = np.zeros((12, 34, 2))
    flow[2:10, 2 + t : 22 + t, 0] = 8
    flow[2:10, 2 + t : 22 + t, 1] = apart * (np.arange(20).clip(8, 11) - 8) / 3
    flow[frame != BACKGROUND] += np.random.default_rng(t).normal(0, 0.05, (160, 2))
    return frame, flow


@pytest.mark.parametrize(("apart", "parts"), [(2.4, 2), (0.6, 1)])
def test_where_flow_bleeds_over_the_border_two_movers_are_one_whole_and_two_parts(
    apart: float, parts: int
) -> None:
    frames, flow = map(list, zip(*[bleeding(t, apart) for t in range(10)], strict=True))
    shown = thing(frames)
    whole, part = partition(scene(frames, flow), shown != BACKGROUND, S)
    assert len(set(whole[shown != BACKGROUND].tolist())) == 1
    assert len(set(part[shown != BACKGROUND].tolist())) == parts
    halves = [int(np.bincount(part[shown == n]).argmax()) for n in (0, 1)]
    assert (halves[0] != halves[1]) == (parts == 2)


@pytest.mark.parametrize("apart", [False, True], ids=["one behind a pole", "two"])
def test_what_moved_apart_before_it_touched_is_two(apart: bool) -> None:
    """From frame 6 on the two move alike and touch; before that they come towards each other, or a pole hides where they touch."""
    frames, velocity = [], []
    for t in range(12):
        frame = np.full((8, 44), BACKGROUND)
        early, right = t < 6, 8 + t
        if early and apart:
            right = 8 + 6 + (6 - t)
        frame[2:6, 2 + t : 8 + t - early] = 0
        frame[2:6, right : right + 5] = 1
        frames.append(frame)
        velocity.append(np.array([[8.0, 0], [-8.0 if early and apart else 8.0, 0], [0, 0]]))
    w, shown = scene(frames, velocity), thing(frames)
    whole, part = (x[shown != BACKGROUND] for x in partition(w, shown != BACKGROUND, S))
    assert (len(set(whole.tolist())), len(set(part.tolist()))) == (1, 1 + apart)
    of = shown[shown != BACKGROUND]
    assert (part[of == 0][0] != part[of == 1][0]) == apart
    nothing = apart_graph(w, np.zeros(len(shown), np.bool_), S)
    assert nothing.pair.shape == (0, 2)


def test_parts_of_two_looks_have_numbers_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """What stood for a part may be dropped as too small, and stand for another in the next look."""
    frame = np.array([[0, 0, BACKGROUND, 1, 1, BACKGROUND]])
    w = scene([frame] * 2, [np.zeros((3, 2))] * 2)
    looks = iter([np.array([1, 1, 0, 0, 0, 0] * 2), np.array([0, 0, 0, 1, 1, 0] * 2)])

    def look(*given: object) -> Look:
        return Look(np.where(next(looks, np.zeros(12)) > 0, 1.0, -1.0), np.ones(2))

    monkeypatch.setattr(objects_module, "first_look", lambda *given: (look(), None))
    monkeypatch.setattr(objects_module, "look_again", look)
    same = lambda graph, foreground, parameters: (np.full(12, 5), np.full(12, 5))  # noqa: E731
    monkeypatch.setattr(objects_module, "partition", same)
    found = moving_parts(w, Objects().parameters(Parameters))
    assert found.look.tolist() == [1, 1, 0, 2, 2, 0] * 2
    assert found.part[0] != found.part[3]
    assert found.whole[0] != found.whole[3]


def test_pairs_from_afar_are_just_so_many_steps_apart() -> None:
    row = np.stack([np.arange(5), np.arange(1, 6)], 1)  # 0 - 1 - 2 - 3 - 4 - 5, and a shortcut
    assert far_pairs(row, 3).tolist() == [[0, 3], [1, 4], [2, 5]]
    assert far_pairs(np.concatenate([row, [[0, 4]]]), 3).tolist() == [[1, 5], [2, 5]]
    assert far_pairs(np.zeros((0, 2), np.int64), 3).tolist() == []


def test_movers_that_move_alike_for_a_while_are_told_apart_by_the_other_frames() -> None:
    frames, velocity = [], []
    for t in range(10):
        frame = np.full((8, 20), BACKGROUND)
        frame[1:4, 2 + t : 7 + t] = 0
        start = 2 + (t if t < 3 else 6 - t if t < 6 else t - 6)
        frame[4:7, start : start + 5] = 1
        frames.append(frame)
        ahead = 8.0 if t < 3 or t >= 6 else -8.0
        velocity.append(np.array([[8.0, 0], [ahead, 0], [0, 0]]))
    velocity[2] = np.array([[8.0, 0], [8.0, 0], [0, 0]])
    first, second = found(scene(frames, velocity), frames)
    assert len(first) == len(second) == 1
    assert first != second


def limbs(t: int, swing: float) -> tuple[np.ndarray, np.ndarray]:
    """A body that moves, turns and breathes, over two legs that swing from it; and the flow."""
    rng = np.random.default_rng(t)
    frame = np.full((12, 26), BACKGROUND)
    frame[2:6, 3 + t : 11 + t] = 0
    flow = np.zeros((12, 26, 2))
    flow[2:6, 3 + t : 11 + t] = 8, 0
    for k, x in enumerate((3 + t, 9 + t)):
        frame[6:10, x : x + 2] = 0
        down = np.arange(1, 5)[:, None]
        flow[6:10, x : x + 2, 0] = 8 + down / 4 * swing * np.sin(t + 3 * k)
    flow[frame == 0] += rng.normal(0, 0.6, (int((frame == 0).sum()), 2))
    return frame, flow


def test_a_body_with_swinging_legs_stays_whole() -> None:
    frames, flow = map(list, zip(*[limbs(t, 4.0) for t in range(12)], strict=True))
    (part,) = found(scene(frames, flow), frames)
    assert len(part) == 1


def test_a_thing_that_grows_or_turns_stays_whole() -> None:
    y, x = np.indices((10, 16)) * float(PITCH)
    frame = np.full((10, 16), BACKGROUND)
    frame[2:8, 3:13] = 0
    for flow in (np.stack([x - 60, y - 40], 2) / 10, np.stack([40 - y, x - 60], 2) / 10):
        (part,) = found(scene([frame] * 6, [flow] * 6), [frame] * 6)
        assert len(part) == 1


def test_slow_noise_parts_nothing_and_a_step_of_one_frame_neither() -> None:
    frame = np.full((8, 12), BACKGROUND)
    frame[2:6, 2:10] = 0
    rng = np.random.default_rng(0)
    flow = [rng.normal(0, 0.3, (8, 12, 2)) for _ in range(8)]
    assert len(found(scene([frame] * 8, flow), [frame] * 8)[0]) == 1
    flow[4][:, 6:] += 3
    assert len(found(scene([frame] * 8, flow), [frame] * 8)[0]) == 1
    flow[4][:, 6:] += 1  # of eight frames one is much
    assert len(found(scene([frame] * 16, flow + flow[:4] + flow[5:] + flow[:1]), [frame] * 16)[0]) == 1


def test_between_repeats_only_links_attract() -> None:
    frame = np.array([[0, 0, 1, 1]])
    velocity = np.array([[3.0, 0], [-3, 0], [0, 0]])
    moving, still = scene([frame] * 2, [velocity] * 2), scene([frame] * 2, [velocity] * 2, [True, False])
    everything = np.ones(8, np.bool_)
    assert len(signed_graph(moving, everything, S).pair) == len(moving.edge) + len(moving.link)
    assert len(signed_graph(still, everything, S).pair) == len(moving.edge) // 2 + len(moving.link)


def test_neighbours_attract_below_the_neutral_step_and_repel_above_it() -> None:
    frame = np.array([[0, 0, 0, 1]])
    w = scene([frame], [np.array([[0.0, 0], [3.0, 0], [0, 0]])])
    signed = signed_graph(w, np.ones(4, np.bool_), replace(S, part_least=2.0))
    assert signed.attraction.tolist() == [PITCH, PITCH, PITCH * (1 - 3 / 2)]
    assert signed.contact.tolist() == [PITCH] * 3
    w = scene([frame], [np.array([[[0.0, 0], [2, 0], [4, 0], [9, 0]]])])
    signed = signed_graph(w, np.ones(4, np.bool_), replace(S, part_ratio=2.0))
    assert signed.attraction.tolist() == [PITCH * (1 - 2 / 4), PITCH * (1 - 2 / 4), PITCH * (1 - 5 / 4)]


def test_a_chain_goes_on_where_most_is_carried_both_ways() -> None:
    frame = np.array([[0, 0]])
    w = scene([frame] * 2, [np.zeros((2, 2))] * 2)
    w = Graph(
        **{
            **w.__dict__,
            "link": np.array([[0, 2], [0, 3], [1, 3]]),
            "carried": np.array([10.0, 30.0, 20.0]),
        }
    )
    assert chains(w, np.ones(4, np.bool_)).tolist() == [0, 1, 2, 0]


def graph(*edges: tuple[int, int, float]) -> SignedGraph:
    pair = np.array([t[:2] for t in edges], np.int64)
    attraction = np.array([t[2] for t in edges])
    return SignedGraph(pair, attraction, np.maximum(np.abs(attraction), 1.0))


def test_a_weak_spot_of_a_boundary_joins_nothing() -> None:
    """Two triangles; one of three edges between them attracts, all together repel."""
    inside = [(0, 1, 9.0), (1, 2, 9.0), (0, 2, 9.0), (3, 4, 9.0), (4, 5, 9.0), (3, 5, 9.0)]
    across = [(0, 3, 2.0), (1, 4, -3.0), (2, 5, -3.0)]
    part = contract(np.arange(6), graph(*inside, *across))
    assert len(set(part[:3].tolist())) == len(set(part[3:].tolist())) == 1
    assert part[0] != part[3]
    joined = contract(np.arange(6), graph(*inside, (0, 3, 7.0), *across[1:]))
    assert len(set(joined.tolist())) == 1


def test_joining_ends_where_all_repel() -> None:
    rng = np.random.default_rng(0)
    i, j = np.triu_indices(40, 1)
    signed = SignedGraph(np.stack([i, j], 1), rng.normal(-0.2, 1, len(i)), np.ones(len(i)))
    part = contract(np.arange(40), signed)
    rest = signed.between(part)
    assert 1 < len(set(part.tolist())) < 40
    assert (rest.attraction <= 0).all()
    inside = part[i] == part[j]
    assert rest.attraction.sum() + signed.attraction[inside].sum() == pytest.approx(signed.attraction.sum())


def test_small_parts_go_to_what_repels_them_least() -> None:
    size = np.array([100.0, 100, 3, 3])
    signed = graph((0, 1, -50.0), (0, 2, -1.0), (1, 2, -3.0))
    signed = SignedGraph(signed.pair, signed.attraction, np.array([50.0, 4, 4]))
    assert absorb(np.arange(4), signed, size, 0.05).tolist() == [0, 1, 0, 3], "what touches nothing stays"
    assert absorb(np.arange(4), signed, size, 0.02).tolist() == [0, 1, 2, 3]


def test_no_foreground_is_lost_and_small_bodies_are_dropped() -> None:
    edge = np.array([[0, 1], [1, 2], [2, 3], [5, 6]])
    foreground = np.array([1, 1, 1, 1, 0, 1, 0, 1], np.bool_)
    part, size = np.array([0, 0, 7, 7, 4, 5, 6, 7]), np.array([9.0, 9, 2, 2, 9, 3, 9, 5])
    assert tidy(foreground, part, size, edge, 5.0).tolist() == [0, 0, 0, 0, NONE, NONE, NONE, 7]
    assert tidy(foreground, part, size, edge, 4.0).tolist() == [0, 0, 7, 7, NONE, NONE, NONE, 7]


def test_ids_go_to_the_part_that_shares_most_and_to_one_only() -> None:
    identities = Identities()
    assert identities.name(np.array([9, 4, NONE, 4, 9, 2]), np.ones(6), 0).tolist() == [1, 2, 0, 2, 1, 3]
    size = np.array([1.0, 1, 5, 5, 5, 1, 1, 1, 1])
    assert identities.name(np.array([8, 8, NONE, 8, 5, NONE, 5, 6, 8]), size, 6).tolist() == [1, 4, 2]
    assert identities.name(np.array([5, 3, 3, 5, 1]), np.ones(5), 2).tolist() == [2, 4, 5]
