"""Scenes with known motion: what they promise holds, and real flow and proposals work on the rendered ones."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import write_folder
from runs import masks, segment

from zsmoseg.errors import SettingsError
from zsmoseg.flow.dis import Dis, between
from zsmoseg.metrics.tracks import track_scores
from zsmoseg.settings import resolve
from zsmoseg.synthetic import CAMERAS, Camera, Scene, flow_scene, flow_scenes, rigid_flow, video_scene
from zsmoseg.synthetic import Motion as Screw

SMALL = 120, 214


@pytest.fixture(scope="module")
def clip() -> Scene:
    return video_scene(3, n_movers=2, n_objects=3, camera="general", n_frames=10, shape=(240, 427))


def test_a_seed_is_a_scene() -> None:
    first, again, other = (flow_scene(seed, n_pairs=2, shape=SMALL, min_contrast=0.3) for seed in (5, 5, 6))
    for name in ("labels", "flow", "inverse_depth", "group"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    assert first.labels.shape == other.labels.shape == (3, *SMALL)
    assert not np.array_equal(first.labels, other.labels)


def test_a_rendered_seed_is_a_clip() -> None:
    first, again = (video_scene(1, 1, 1, n_frames=2, shape=(60, 106), exact=False) for _ in range(2))
    assert first.frames is not None
    np.testing.assert_array_equal(first.frames, again.frames)


def test_instantaneous_flow_is_the_limit_of_finite_motion() -> None:
    rng = np.random.default_rng(0)
    focal, motion = 200.0, Screw(rng.normal(0, 1e-5, 3), rng.normal(0, 1e-4, 3))
    x, y, z = rng.uniform(-100, 100, 50), rng.uniform(-60, 60, 50), rng.uniform(3, 9, 50)
    point = np.stack([x * z / focal, y * z / focal, z], 1)
    moved = point + np.cross(motion.turn, point) + motion.shift
    u, v = rigid_flow(x, y, 1 / z, focal, motion)
    np.testing.assert_allclose(u, focal * moved[:, 0] / moved[:, 2] - x, atol=1e-5)
    np.testing.assert_allclose(v, focal * moved[:, 1] / moved[:, 2] - y, atol=1e-5)
    assert np.abs(u).max() > 1e-3


@pytest.mark.parametrize("movers", [0, 1, 3])
def test_movers_are_as_many_as_asked_for_and_clear(movers: int) -> None:
    scene = flow_scene(2, n_movers=movers, n_objects=9, n_pairs=4)
    assert scene.group.max() == movers
    assert scene.objects == 10
    assert (scene.contrast[scene.group > 0] >= 0.75).all()
    assert (scene.moving == (scene.group > 0)).all()


def test_movers_that_stop_have_the_camera_s_flow_afterwards() -> None:
    scene = flow_scene(2, n_movers=1, n_objects=4, camera="still", noise=0.0, stop=True, n_pairs=4)
    speed = np.sqrt((scene.flow**2).sum(1))
    mover = (scene.group > 0)[scene.labels[:-1]]
    assert (speed[:2][mover[:2]] > 0).mean() > 0.99
    assert not speed[2:].any()
    assert not scene.moving[2:].any()


def test_noise_has_the_size_asked_for() -> None:
    calm, noisy = (flow_scene(8, n_movers=1, n_objects=4, noise=n, n_pairs=3) for n in (0.0, 0.3))
    np.testing.assert_array_equal(calm.labels, noisy.labels)
    assert (noisy.flow - calm.flow).std() == pytest.approx(0.3, rel=0.03)


def test_leaking_masks_are_larger() -> None:
    tight, leaky = (flow_scene(8, n_movers=1, n_objects=4, leak=leak, n_pairs=2) for leak in (0, 4))
    assert ((tight.labels > 0) <= (leaky.labels > 0)).all()
    assert (leaky.labels > 0).sum() > 1.1 * (tight.labels > 0).sum()


def test_right_groups_are_those_of_the_truth_whatever_their_names() -> None:
    scene = flow_scene(0, n_movers=2, n_objects=7, n_pairs=2)
    names = np.array([0, 9, 4])[scene.group]
    assert scene.right(names) == (True, True)
    assert scene.right((scene.group > 0).astype(int)) == (False, True)
    assert scene.right(np.zeros_like(scene.group)) == (False, False)


# -------------------------------------------------------------------------- rendered
def test_rendered_clips_keep_their_promises(clip: Scene) -> None:
    assert clip.frames is not None
    assert clip.frames.shape == (10, 240, 427, 3)
    assert clip.truth.max() == 2
    for n in np.flatnonzero(clip.group):
        mine = clip.labels == n
        assert mine.mean((1, 2)).min() > 0.015, "large enough"
        border = [mine[:, 0].any(), mine[:, -1].any(), mine[:, :, 0].any(), mine[:, :, -1].any()]
        assert not any(border), "not cut by the frame"
    first, second = ((clip.labels == n).astype(np.uint8) for n in np.flatnonzero(clip.group))
    for a, b in zip(first, second, strict=True):
        assert not (cv2.dilate(a, np.ones((5, 5))) & b).any(), "apart from each other"


def test_exact_flow_carries_the_picture_and_the_labels(clip: Scene) -> None:
    assert clip.frames is not None
    y, x = np.mgrid[:240, :427].astype(np.float32)
    for t in (0, 5):
        at_x, at_y = x + clip.flow[t, 0], y + clip.flow[t, 1]
        back = cv2.remap(clip.frames[t + 1], at_x, at_y, cv2.INTER_LINEAR).astype(float)
        label = cv2.remap(clip.labels[t + 1], at_x, at_y, cv2.INTER_NEAREST)
        inner = (at_x > 1) & (at_x < 425) & (at_y > 1) & (at_y < 238)
        same = inner & (label == clip.labels[t])
        assert same.sum() > 0.93 * inner.sum()
        moved = np.abs(back - clip.frames[t]).mean(2)[same].mean()
        stayed = np.abs(clip.frames[t + 1].astype(float) - clip.frames[t]).mean(2)[same].mean()
        assert moved < 0.3 * stayed


@pytest.mark.parametrize("camera", CAMERAS)
def test_real_optical_flow_works_on_rendered_clips(camera: Camera) -> None:
    scene = video_scene(2, 1, 2, camera, n_frames=3, shape=(240, 427))
    assert scene.frames is not None
    flow = np.stack([between(a, b, resolve().flow.parameters(Dis))[0] for a, b in pairwise(scene.frames)])
    error = np.sqrt(((flow - scene.flow) ** 2).sum(1))
    assert np.median(error) < 0.25
    still = scene.group[scene.labels[:-1]] == 0
    if camera == "still":
        assert np.abs(scene.flow[:, :, :, :][np.repeat(still[:, None], 2, 1)]).max() < 1e-3


def test_depth_of_rendered_clips_explains_their_flow(clip: Scene) -> None:
    assert (clip.contrast[clip.group > 0] > 0.3).all()
    assert clip.contrast[clip.group == 0].max() < 0.1


def test_too_fast_movers_are_refused_in_words() -> None:
    with pytest.raises(SettingsError, match="ask for fewer or slower"):
        video_scene(0, n_movers=2, n_objects=0, n_frames=9, shape=(60, 106), speed=40)


WRONG: list[tuple[Any, dict[str, Any], str]] = [
    *[
        (make, given, words)
        for make in (flow_scene, video_scene)
        for given, words in (
            ({"camera": "nope"}, "camera = 'nope': expected one of still, pan"),
            ({"camera": 3}, "camera = 3: expected one of"),
            ({"n_movers": -1}, "n_movers = -1: expected a whole number, 0 to"),
            ({"n_objects": -2}, "n_objects = -2: expected a whole number, 0 to"),
            ({"n_objects": 2.5}, "n_objects = 2.5: expected a whole number"),
            ({"n_objects": 100_000}, "n_objects = 100000: expected a whole number, 0 to 10000"),
            ({"shape": (0, 96)}, "the height in shape = 0: expected a whole number, 16 or more"),
            ({"shape": (64, -1)}, "the width in shape = -1"),
            ({"shape": 64}, "shape = 64: expected height and width"),
            ({"shape": (64, 96, 3)}, "expected height and width"),
        )
    ],
    (video_scene, {"n_frames": 1}, "n_frames = 1: expected a whole number, 2 or more"),
    (video_scene, {"n_near": -1}, "n_near = -1"),
    (video_scene, {"speed": float("nan")}, "a speed = nan: expected a number, 0 or more"),
    (video_scene, {"speeds": (1.0, float("inf"))}, "a speed = inf"),
    (video_scene, {"seed": -1}, "seed = -1"),
    (flow_scene, {"n_pairs": 0}, "n_pairs = 0: expected a whole number, 1 or more"),
    (flow_scene, {"min_contrast": float("nan")}, "min_contrast = nan: expected a number"),
    (flow_scene, {"min_contrast": -1}, "min_contrast = -1"),
    (flow_scene, {"noise": "much"}, "noise = 'much': expected a number"),
    (flow_scene, {"companions": 1.5}, "companions = 1.5: expected a number, 0 to 1"),
    (flow_scene, {"leak": -3}, "leak = -3"),
    (flow_scene, {"n_movers": 9, "n_objects": 4}, "n_movers = 9: expected a whole number, 0 to 4"),
    (flow_scene, {"n_mover": 1}, "n_mover is no wish; there are n_movers, "),
]


@pytest.mark.parametrize(("make", "given", "words"), WRONG)
def test_what_no_scene_can_be_is_refused_by_name(make: Any, given: dict[str, Any], words: str) -> None:
    with pytest.raises(SettingsError) as error:
        make(**{"seed": 0, **given})
    assert words in str(error.value)


@pytest.mark.parametrize("given", [{"min_contrast": 50, "n_movers": 1}, {"n_movers": 9, "n_objects": 12}])
def test_scenes_that_are_never_clear_are_given_up(given: dict[str, Any], monkeypatch: Any) -> None:
    monkeypatch.setattr(flow_scenes, "ATTEMPTS", 2)
    with pytest.raises(SettingsError, match=r"in 12 layouts .* ask for less contrast or fewer movers"):
        flow_scene(0, n_pairs=1, shape=(32, 48), **given)


def test_a_rendered_clip_is_segmented_from_its_pictures(tmp_path: Path) -> None:
    scene = video_scene(
        0, n_movers=2, n_objects=3, camera="general", n_frames=16, shape=(270, 480), exact=False
    )
    assert scene.frames is not None
    report, _ = segment(write_folder(tmp_path / "clip", scene.frames), tmp_path)
    assert not report.failures
    found = masks(next((tmp_path / "out").rglob("masks")).parent)
    scores = track_scores(
        ((t > 0).astype(int), (m > 0).astype(int)) for t, m in zip(scene.truth, found, strict=True)
    )
    assert scores.fu >= 90
