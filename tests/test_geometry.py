"""What obeys the geometry of the world and stands on it is static, however it moves in the picture."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import write_folder
from runs import segment

from zsmoseg.grouping.geometry import BESIDE, EVERY, NEAREST, VERDICTS, Geometry, Limits, Seen, geometry_of
from zsmoseg.painting.palette import encode_png
from zsmoseg.settings import resolve
from zsmoseg.synthetic import video_scene
from zsmoseg.workflows.cli import main
from zsmoseg.workflows.result import open_store

SIZE = 240, 320
LIMITS = resolve().affinity.parameters(Limits)
SIDEWAYS, FORWARD = (0.06, 0.0, 0.0), (0.0, 0.0, 0.07)
STILL = (0.0, 0.0, 0.0)


def project(points: np.ndarray) -> np.ndarray:
    """A pinhole whose focal length is the width of the frame; y down."""
    return np.asarray(SIZE[1] * points[:, :2] / points[:, 2:] + [SIZE[1] / 2, SIZE[0] / 2])


def ground_and_wall(rng: np.random.Generator) -> np.ndarray:
    ground = np.column_stack([rng.uniform(-6, 6, 900), np.full(900, 1.0), rng.uniform(2.5, 14, 900)])
    wall = np.column_stack([rng.uniform(-7, 7, 300), rng.uniform(-5, 1, 300), np.full(300, 14.0)])
    return np.concatenate([ground, wall])


def plate(rng: np.random.Generator, bottom: float = 1.0, z: float = 5.0) -> np.ndarray:
    """Upright, its lower edge ``bottom`` below the camera: 1 is on the ground."""
    return np.column_stack(
        [rng.uniform(-0.3, 0.3, 60), rng.uniform(bottom - 0.9, bottom, 60), np.full(60, z)]
    )


def looks(
    camera: tuple[float, ...],
    things: list[tuple[np.ndarray, tuple[float, ...]]],
    frames: int = 17,
    turn: float = 0.0,
    world: int = 1200,
    noise: float = 0.05,
    hole: float = 0.0,
) -> Iterator[Seen]:
    """Tracks of a world (object 0) and of things with their own motion a frame, by a camera that moves and turns."""
    rng = np.random.default_rng(0)
    points = ground_and_wall(rng)[:world]
    bodies = [(points[np.abs(points[:, 0]) >= hole], STILL), *things]
    on = np.repeat(np.arange(len(bodies)), [len(points) for points, _ in bodies])
    for t in range(0, frames, EVERY):
        points = np.concatenate([p + t * (np.array(v) - camera) for p, v in bodies])
        c, s = np.cos(turn * t), np.sin(turn * t)
        place = project(points @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]))
        place += noise * rng.normal(size=place.shape)
        inside = (place >= 0).all(1) & (place < SIZE[::-1]).all(1) & (points[:, 2] > 0.5)
        yield np.flatnonzero(inside), place[inside].astype(np.float32), on[inside]


def verdicts(seen: Iterator[Seen], count: int = 2) -> list[str]:
    found = geometry_of(seen, np.arange(count) > 0, SIZE, LIMITS)
    return [VERDICTS[v] for v in found.verdict[1:]]


RNG = np.random.default_rng(1)


@pytest.mark.parametrize("camera", [SIDEWAYS, FORWARD, (0.04, 0.01, 0.05)])
@pytest.mark.parametrize("turn", [0.0, 0.002])
def test_a_plate_on_the_ground_obeys_whatever_the_way_of_the_camera(camera: Any, turn: float) -> None:
    assert verdicts(looks(camera, [(plate(RNG), STILL)], turn=turn)) == ["obeys"]


@pytest.mark.parametrize(
    ("camera", "own"),
    [
        (SIDEWAYS, (0.0, -0.03, 0.0)),  # across the epipolar lines
        (SIDEWAYS, (-0.05, 0.0, 0.0)),  # along them, against the camera
        (SIDEWAYS, (0.04, 0.0, 0.0)),  # along them, followed by the camera
        (FORWARD, (0.0, 0.0, 0.06)),  # along them, driving ahead
        (FORWARD, (0.0, 0.0, -0.06)),  # along them, coming towards it
    ],
)
def test_a_plate_that_moves_breaks_the_geometry_also_along_the_epipolar_lines(camera: Any, own: Any) -> None:
    assert verdicts(looks(camera, [(plate(RNG), own)])) == ["breaks"]


def test_what_cannot_be_known_says_why() -> None:
    thing = plate(RNG)
    assert verdicts(looks(SIDEWAYS, [(thing, STILL)], frames=2)) == ["shot too short"]
    assert verdicts(looks(SIDEWAYS, [(thing, STILL)], world=20)) == ["world hidden"]
    assert verdicts(looks(SIDEWAYS, [(thing[:5], STILL)])) == ["too few tracks"]
    assert verdicts(iter([])) == ["shot too short"]
    none = [(np.zeros(0, np.int64), np.zeros((0, 2), np.float32), np.zeros(0, np.int64))] * 9
    assert verdicts(iter(none)) == ["world hidden"]
    assert verdicts(looks(SIDEWAYS, [(thing, STILL)], hole=0.7)) == ["no world below"]


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_a_camera_that_only_turns_or_rests_holds_nothing_static(noise: float) -> None:
    for turn in (0.0, 0.004):
        for own in ((0.03, 0.0, 0.0), (0.0, -0.03, 0.0), (0.0, 0.0, -0.1)):
            assert verdicts(looks(STILL, [(plate(RNG), own)], turn=turn, noise=noise)) != ["obeys"]


def hidden(
    seen: Iterator[Seen], thing: int, shown: Callable[[int], bool] = lambda look: False
) -> Iterator[Seen]:
    """The same, but a thing is proposed in some looks only: in others it passes for the world."""
    for n, (track, place, on) in enumerate(seen):
        yield track, place, np.where((on == thing) & (not shown(n)), 0, on)


def measured(seen: Iterator[Seen]) -> Geometry:
    return geometry_of(seen, np.array([False, True]), SIZE, LIMITS)


def test_a_half_found_mover_stands_on_itself_but_is_not_as_near_as_the_ground_beside_it() -> None:
    """The other half passes for the world."""
    car, own = np.concatenate([plate(RNG, z=4.0) for _ in range(6)]), (-0.1, 0.0, 0.0)
    upper = car[:, 1] < np.median(car[:, 1])
    half = measured(hidden(looks(SIDEWAYS, [(car[upper], own), (car[~upper], own)]), 2))
    assert half.foot[1] == 1
    assert half.beside[1] > BESIDE
    assert VERDICTS[half.verdict[1]] == "breaks"


def test_a_wall_that_is_near_obeys_with_far_more_parallax_than_the_world() -> None:
    wall = measured(looks(SIDEWAYS, [(plate(np.random.default_rng(1), z=3.4), STILL)]))
    assert LIMITS.parallax < wall.parallax[1] < NEAREST * LIMITS.parallax
    assert VERDICTS[wall.verdict[1]] == "obeys"


@pytest.mark.parametrize("look", [0, 4, 8])
@pytest.mark.parametrize(("own", "verdict"), [(STILL, "obeys"), ((0.0, -0.03, 0.0), "breaks")])
def test_what_is_proposed_for_a_moment_is_followed_to_the_frames_beside(
    own: Any, verdict: str, look: int
) -> None:
    assert verdicts(hidden(looks(SIDEWAYS, [(plate(RNG), own)]), 1, lambda n: n == look)) == [verdict]


def test_what_is_seen_longer_does_without_tracks_that_slide_off_it() -> None:
    """Where it is not proposed they may be on anything: here they rest with the world, and it moves."""
    still, moving = (looks(SIDEWAYS, [(plate(RNG), own)]) for own in (STILL, (0.0, -0.03, 0.0)))
    mixed = (one if n < 3 else other for n, (one, other) in enumerate(zip(moving, still, strict=True)))
    assert verdicts(hidden(mixed, 1, lambda n: n < 3)) == ["breaks"]


def test_scraps_count_beside_a_mover_that_breaks_and_not_beside_what_obeys_alone() -> None:
    still, scrap, mover = (plate(RNG), STILL), (plate(RNG)[:5], STILL), (plate(RNG, z=6.0), (0.0, -0.05, 0.0))

    def counts(things: list[Any]) -> list[bool]:
        moving = np.arange(len(things) + 1) > 0
        return geometry_of(looks(SIDEWAYS, things), moving, SIZE, LIMITS).counts[1:].tolist()

    assert counts([still, scrap]) == [True, False]
    assert counts([still, scrap, mover]) == [True, True, True]
    assert counts([scrap]) == [True], "nothing obeys: all stays as it is"


# --------------------------------------------------------------- from the command line on
@pytest.fixture(scope="module")
def passing(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A clip of a static scene that a camera passes sideways, and its things as proposals."""
    root = tmp_path_factory.mktemp("passing")
    scene = video_scene(6, 0, 0, "lateral", 12, (240, 427), exact=False, n_near=5)
    write_folder(root / "clip", scene.pictures)
    (root / "masks").mkdir()
    for t, labels in enumerate(scene.labels):
        (root / "masks" / f"{t:05d}.png").write_bytes(encode_png(labels.astype(np.uint8)))
    return root / "clip", root / "masks"


def moving(root: Path, name: str = "clip") -> dict[str, Any]:
    told: dict[str, Any] = json.loads((root / "out" / name / "summary.json").read_text())
    return told


@pytest.mark.parametrize("given", [False, True])
def test_a_static_scene_that_a_camera_passes_is_empty_with_the_reason_whoever_proposes(
    passing: tuple[Path, Path], given: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip, masks = passing
    settings = {"proposals.path": str(masks)} if given else {}
    segment(clip, tmp_path, {**settings, "affinity.geometry": False})
    assert moving(tmp_path)["moving_pixels_percent"] > 0
    assert {e["geometry"] for e in moving(tmp_path)["evidence"]} == {"not asked"}
    _, counter = segment(clip, tmp_path, settings)
    assert "flow" not in counter.stages
    summary = moving(tmp_path)
    assert summary["moving_pixels_percent"] == 0
    (first, *_) = [e for e in summary["evidence"] if e["geometry"] == "obeys"]
    assert first["affinity_with_world"] == 1
    assert (
        main(["explain", "clip", "--store", str(tmp_path / "store"), "--object", str(first["object"])]) == 0
    )
    said = capsys.readouterr().out.splitlines()[0]
    measured = ", ".join(
        f"{name} {first[name]:.2f}" for name in ("front", "error", "parallax", "foot", "beside")
    )
    assert (
        f"it stands on the ground beside it: {measured}: affinity 1.00 with the world; so it is static"
        in said
    )
    result = open_store(tmp_path / "store")["clip"]
    assert float(result.tree["affinity/affinity"].sel(object=first["object"], other=0)) == 1


@pytest.mark.parametrize("limit", ["affinity.error", "affinity.parallax"])
def test_what_exceeds_a_limit_moves(passing: tuple[Path, Path], limit: str, tmp_path: Path) -> None:
    clip, masks = passing
    segment(clip, tmp_path, {"proposals.path": str(masks), limit: 0.01})
    summary = moving(tmp_path)
    assert summary["moving_pixels_percent"] > 0
    assert "obeys" not in {e["geometry"] for e in summary["evidence"]}


def test_the_kernels_of_the_paper_ask_for_no_geometry(passing: tuple[Path, Path], tmp_path: Path) -> None:
    clip, masks = passing
    settings = {"proposals.path": str(masks), "affinity.kernel": "ordered", "groups.rule": "spectral"}
    segment(clip, tmp_path, settings)
    assert {e["geometry"] for e in moving(tmp_path)["evidence"]} == {"not asked"}
