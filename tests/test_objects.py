"""Which superpixels move by themselves, and the ids of what they form."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from conftest import draw_clip
from scipy.sparse.csgraph import bellman_ford

from zsmoseg.flow.dis import Dis, between
from zsmoseg.flow.pairs import PairCriteria, pair_state
from zsmoseg.proposals.embedded import objects
from zsmoseg.proposals.embedded.camera import Camera, fit_fields, own_motion, speed
from zsmoseg.proposals.embedded.diffusion import Diffusion, diffuse, similarity
from zsmoseg.proposals.embedded.extraction import Links, measure
from zsmoseg.proposals.embedded.features import SuperpixelFeatures
from zsmoseg.proposals.embedded.geodesic import from_border
from zsmoseg.proposals.embedded.graph import colour_distance, connect_frames
from zsmoseg.proposals.embedded.superpixels import Superpixels, segment
from zsmoseg.settings import Flow, Objects, Segments
from zsmoseg.synthetic import video_scene

S = Objects().parameters(objects.Objects)
SLIC = Segments().parameters(Superpixels)
CAMERA = S.saliency.camera


class Clip:
    """Frames and all that the objects need of them."""

    def __init__(self, frames: np.ndarray) -> None:
        self.frames = frames
        self.segments = np.stack([segment(frame, SLIC) for frame in frames])
        pairs = [between(a, b, Flow().parameters(Dis)) for a, b in itertools.pairwise(frames)]
        shape = (0, 2, *frames.shape[1:3])
        self.forward = np.stack([a for a, _ in pairs]) if pairs else np.zeros(shape, np.float32)
        self.backward = np.stack([b for _, b in pairs]) if pairs else np.zeros(shape, np.float32)
        self.states = [
            pair_state(a, b, f, g, Flow().parameters(PairCriteria))
            for (a, b), (f, g) in zip(itertools.pairwise(frames), pairs, strict=True)
        ]
        self.features = self.measure(0, len(frames))

    def measure(self, start: int, stop: int) -> SuperpixelFeatures:
        last = min(stop + 1, len(self.frames))
        return measure(
            self.frames[start:last],
            self.segments[start:last],
            self.forward[start : last - 1],
            self.backward[start : last - 1],
            self.states[start : last - 1],
            stop - start,
            None,
            Links(),
        )

    def find(self, start: int = 0, stop: int | None = None, load=None) -> list:
        shot = (start, len(self.frames) if stop is None else stop)
        return list(objects.find_objects(load or self.features.part, shot, self.segments.shape[1:], S))

    def ids(self, found: list, start: int = 0) -> np.ndarray:
        return np.stack([row[1][segment] for row, segment in zip(found, self.segments[start:], strict=False)])


def iou(a: np.ndarray, b: np.ndarray) -> float:
    return (a & b).sum() / (a | b).sum()


def same(one: list, two: list) -> bool:
    return len(one) == len(two) and all(
        all(np.array_equal(x, y) for x, y in zip(a, b, strict=True)) for a, b in zip(one, two, strict=True)
    )


FRAMES, TRUTH = draw_clip(frames=12)
DISC = Clip(FRAMES)


def test_what_moves_by_itself_is_found_as_one_object_in_every_frame():
    ids = DISC.ids(DISC.find())
    assert iou(ids > 0, TRUTH) > 0.85
    largest = np.bincount(ids[TRUTH]).argmax()
    assert largest > 0
    assert all((frame == largest).sum() > 500 for frame in ids)


def test_a_pan_without_a_mover_is_empty():
    clip = Clip(draw_clip(frames=8, mover=False)[0])
    assert not clip.ids(clip.find()).any()


def test_a_still_shot_with_noise_is_empty():
    rng = np.random.default_rng(0)
    clip = Clip(
        np.stack([np.clip(FRAMES[0] + rng.normal(0, 3, FRAMES[0].shape), 0, 255) for _ in range(4)]).astype(
            np.uint8
        )
    )
    found = clip.find()
    assert set(clip.states) == {"repeat"}
    assert not clip.ids(found).any()
    assert [score for *_, score in found] == [0] * 4


def test_a_shot_of_one_frame_is_empty():
    clip = Clip(FRAMES[:1])
    (only,) = clip.find()
    assert np.isfinite(only.value).all()
    assert len(only.value) == clip.segments.max() + 1
    assert not only.ids.any()
    assert only.score == 0


def test_a_repeated_frame_is_segmented_like_the_frame_it_repeats():
    order = [0, 1, 2, 3, 4, 4, 5, 6, 6, 6, 7, 8]
    clip = Clip(FRAMES[order])
    assert [m for m, state in enumerate(clip.states) if state == "repeat"] == [4, 7, 8]
    ids = clip.ids(clip.find())
    assert all(iou(ids[t] > 0, TRUTH[frame]) > 0.75 for t, frame in enumerate(order))


def test_two_shots_in_one_video_give_what_each_gives_alone():
    other = draw_clip(seed=5, frames=6)[0]
    both, second = Clip(np.concatenate([FRAMES, other])), Clip(other)
    assert [m for m, state in enumerate(both.states) if state == "cut"] == [11]
    assert same(both.find(0, 12), DISC.find())
    assert same(both.find(12, 18), second.find())


@pytest.mark.parametrize("length", [1, 5, 7])
def test_the_length_of_the_chunks_changes_no_bit(length):
    chunks = [DISC.measure(a, min(a + length, 12)) for a in range(0, 12, length)]

    def load(start: int, stop: int) -> SuperpixelFeatures:
        first = start // length
        joined = SuperpixelFeatures.join(chunks[first : (stop - 1) // length + 1])
        return joined.part(start - first * length, stop - first * length)

    assert same(DISC.find(load=load), DISC.find())


def test_windows_keep_the_ids_and_read_no_more_than_their_margins(monkeypatch):
    clip = Clip(draw_clip(frames=16, width=200)[0])
    whole = clip.ids(clip.find())
    monkeypatch.setattr(objects, "LENGTH", 4)
    monkeypatch.setattr(objects, "MARGIN", 0)
    read = []

    def load(start: int, stop: int) -> SuperpixelFeatures:
        read.append((start, stop))
        return clip.features.part(start, stop)

    s = Objects(window=3).parameters(objects.Objects)
    found = list(objects.find_objects(load, (0, 16), clip.segments.shape[1:], s))
    ids = clip.ids(found)
    assert read == [(0, 7), (1, 11), (5, 15), (9, 16)]
    assert iou(ids > 0, whole > 0) > 0.85
    assert len({np.bincount(frame[frame > 0]).argmax() for frame in ids}) == 1


def test_the_camera_moves_like_what_it_is_fitted_to():
    graph = connect_frames(DISC.features, 0, DISC.segments.shape[1:])
    inside = np.concatenate(
        [
            np.bincount(s.ravel(), t.ravel()) / np.bincount(s.ravel())
            for s, t in zip(DISC.segments, TRUTH, strict=True)
        ]
    )
    free = speed(graph, own_motion(graph, graph.size, CAMERA))
    told = speed(graph, own_motion(graph, graph.size * (inside < 0.5), CAMERA))
    assert np.median(told[inside < 0.5]) < 0.2
    assert np.median(told[inside > 0.9]) > 2
    only_disc = speed(graph, own_motion(graph, graph.size * (inside > 0.5), CAMERA))
    assert np.median(only_disc[inside < 0.01]) > 2
    assert np.median(free[inside < 0.5]) < 0.2


def test_the_robust_fit_recovers_a_quadratic_field_under_outliers():
    rng = np.random.default_rng(0)
    basis = np.column_stack([np.ones(400), rng.uniform(-1, 1, (400, 5))])
    field = rng.normal(size=(6, 2))
    target = basis @ field
    target[:120] += 5
    fitted = fit_fields(np.array([0, 400]), basis, target, np.ones(400), Camera(20, 0.01))[0]
    assert np.abs(fitted - field).max() < 0.01


def test_diffusion_solves_its_equations():
    rng = np.random.default_rng(0)
    upper = sp.random_array((60, 60), density=0.1, rng=rng)
    weight = sp.csr_array(upper + upper.T)
    weight.setdiag(0)
    x, trust = rng.random((60, 2)), rng.uniform(0.1, 1, 60)
    dense = weight.toarray()
    system = np.diag(trust) + 10 * (np.diag(dense.sum(1)) - dense)
    exact = np.linalg.solve(system, trust[:, None] * x)
    assert np.abs(diffuse(weight, x, 10, 1e-6, trust) - exact).max() < 1e-4
    assert np.abs(diffuse(weight, x[:, 0], 10, 1e-6, trust) - exact[:, 0]).max() < 1e-4


def test_paths_from_the_border_are_the_cheapest():
    graph = connect_frames(DISC.features.part(0, 1), 0, DISC.segments.shape[1:])
    rng = np.random.default_rng(0)
    cost, entry = rng.random(len(graph.edge)), rng.random(len(graph.frame))
    n = len(graph.frame)
    dense = np.zeros((n + 1, n + 1))
    dense[graph.edge[:, 0], graph.edge[:, 1]] = dense[graph.edge[:, 1], graph.edge[:, 0]] = cost
    dense[n, np.flatnonzero(graph.rim)] = entry[graph.rim]
    expected = bellman_ford(sp.csr_array(dense), indices=n)[:n]
    assert np.allclose(from_border(graph, cost, entry), expected, atol=1e-6)


def test_links_and_neighbours_weigh_less_the_more_their_colours_differ():
    graph = connect_frames(DISC.features.part(0, 2), 0, DISC.segments.shape[1:])
    weight = similarity(graph, Diffusion(2.5, 10.0, 1.0))
    assert abs(weight - weight.T).max() == 0
    alike = similarity(graph, Diffusion(1e9, 10.0, 1.0))
    i, j = graph.edge[colour_distance(graph, graph.edge).argmax()]
    a, b = graph.edge[colour_distance(graph, graph.edge).argmin()]
    assert weight[i, j] / alike[i, j] < weight[a, b] / alike[a, b]


@pytest.mark.parametrize("speeds", [(0.8, 8.0), (0.8, 2.5, 8.0)])
def test_slower_movers_are_found_by_later_looks_as_objects_of_their_own(speeds):
    scene = video_scene(
        2, n_objects=0, camera="still", n_frames=8, shape=(240, 427), exact=False, speeds=speeds
    )
    clip = Clip(scene.pictures)
    found = clip.find()
    ids, truth = clip.ids(found), scene.truth
    looks = np.stack([row.look[segment] for row, segment in zip(found, clip.segments, strict=True)])
    sure = np.stack([row.sure[segment] for row, segment in zip(found, clip.segments, strict=True)])
    main = [np.bincount(ids[truth == k]).argmax() for k in range(1, len(speeds) + 1)]
    assert len({0, *main}) == len(speeds) + 1
    assert all(iou(ids == main[k - 1], truth == k) > 0.8 for k in range(1, len(speeds) + 1))
    order = [int(looks[ids == n].min()) for n in main]
    assert order == sorted(order, reverse=True)
    assert order[-1] == 1
    assert order[0] > 1
    assert sure[looks > 1].min() >= S.selection.sure
    assert np.array_equal(ids > 0, looks > 0)
    slow = np.stack([row.value[segment] > 0 for row, segment in zip(found, clip.segments, strict=True)])
    assert slow[ids == main[0]].all(), "what a look finds has the log-odds of that look"


def test_what_a_later_look_finds_without_being_sure_is_left_out():
    clip = Clip(
        video_scene(
            2, n_objects=0, camera="still", n_frames=8, shape=(240, 427), exact=False, speeds=(0.8, 8)
        ).pictures
    )
    never = replace(S, selection=replace(S.selection, sure=1.01))
    grid = clip.segments.shape[1:]
    some, none = (list(objects.find_objects(clip.features.part, (0, 8), grid, p)) for p in (S, never))
    assert max(row.look.max() for row in some) > max(row.look.max() for row in none) == 1
