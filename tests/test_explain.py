"""``zsmoseg explain``: what it says follows from the arrays of the store."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import draw_clip, write_folder
from runs import segment

from zsmoseg.synthetic import video_scene
from zsmoseg.workflows.cli import main
from zsmoseg.workflows.result import open_store


@pytest.fixture(scope="module")
def store(clip: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("explain")
    segment(clip, root)
    return root / "store"


def test_the_evidence_of_a_mover_is_what_the_arrays_say(
    store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = open_store(store)["disc"]
    groups, tree = result.groups, result.tree
    mover = int(groups.object[groups.group == 1][0])
    assert main(["explain", "disc", "--store", str(store), "--object", str(mover)]) == 0
    first, affinity, residuals, margin, states, values = capsys.readouterr().out.splitlines()
    assert (
        f"costs {groups.excess[mover]:.3f} px more than one each, {groups.tolerance[mover]:.3f} px are"
        in first
    )
    assert (
        f"affinity {groups.world[mover]:.2f} with the world, below the border of 0.50; so it moves: group 1"
        in first
    )
    assert groups.world[mover] == pytest.approx(float(tree["affinity/affinity"].sel(object=mover, other=0)))
    own = np.sqrt(tree["residuals/residual"].sel(model=mover, object=mover).mean("pair"))
    world = np.sqrt(tree["residuals/residual"].sel(model=0, object=mover).mean("pair"))
    assert f"its own motion leaves {float(own):.3f} px" in residuals
    assert f"the background's motion {float(world):.3f} px" in residuals
    assert f"median {np.nanmedian(tree['groups/margin'].sel(object=mover)):+.2f}" in margin
    frames = np.flatnonzero(tree["groups/moving"].sel(object=mover))
    assert f"moving at frames {frames[0]} to {frames[-1]}" in states
    assert (
        f"with the static world {float(tree['affinity/affinity'].sel(object=mover, other=0)):.2f}" in affinity
    )
    assert f"{float(tree['groups/eigenvalue'].max()):.2f}" in values


@pytest.mark.parametrize("frames", [[3], [0], [0, 1, 2, 3], [1, 3]], ids=["last", "first", "all", "some"])
def test_what_no_pair_of_frames_shows_is_not_said_to_be_measured(
    frames: list[int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    images, truth = draw_clip(0, 4, 60, 80)
    patch = np.zeros((4, 60, 80), np.uint8)
    patch[frames, 4:16, 60:76] = 2
    np.save(tmp_path / "masks.npy", np.where(truth, 1, patch).astype(np.uint8))
    segment(
        write_folder(tmp_path / "disc", images), tmp_path, {"proposals.path": str(tmp_path / "masks.npy")}
    )
    assert main(["explain", "disc", "--store", str(tmp_path / "store"), "--object", "2"]) == 0
    first = capsys.readouterr().out.splitlines()[0]
    unseen = np.isnan(open_store(tmp_path / "store")["disc"].groups.excess[2])
    assert ("no pair of frames shows it against the static world" in first) == (frames == [3])
    assert "error ratio 0.00" not in first
    assert unseen or "costs" in first


def test_every_pair_is_told_where_asked(store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = open_store(store)["disc"]
    mover = int(result.groups.object[result.groups.group == 1][0])
    assert main(["explain", "disc", "--store", str(store), "--object", str(mover), "--pairs"]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("  frames ")]
    affinity = result.affinity
    assert len(lines) == int(np.isfinite(affinity.excess[:, mover]).sum()) > 0
    cost, tolerated = affinity.excess[0, mover], affinity.tolerance[0, mover]
    told = f"costs {cost:.3f} px, tolerated {tolerated:.3f} px, affinity {tolerated / (tolerated + cost):.2f}"
    assert lines[0] == f"  frames 0 and 1: {told}"
    assert main(["explain", "disc", "--store", str(store), "--pairs"]) == 2
    assert "name it with --object N" in capsys.readouterr().err


def test_an_object_that_is_not_there_is_named(store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "disc", "--store", str(store), "--object", "77"]) == 2
    assert "disc has no object 77; there are" in capsys.readouterr().err


def test_all_objects_get_a_line_each(store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "disc", "--store", str(store)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(open_store(store)["disc"].objects) - 1


def test_an_object_of_a_later_look_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = video_scene(
        2, n_objects=0, camera="still", n_frames=8, shape=(240, 427), exact=False, speeds=(0.8, 8)
    )
    segment(write_folder(tmp_path / "two", scene.pictures), tmp_path)
    result = open_store(tmp_path / "store")["two"]
    found = result.tree["objects"]
    assert int(result.groups.group.max()) >= 2
    for number in result.groups.object[result.groups.group > 0]:
        assert main(["explain", "two", "--store", str(tmp_path / "store"), "--object", str(number)]) == 0
        lines = [line for line in capsys.readouterr().out.splitlines() if "found by look" in line]
        mine = found["object_of"].values == number
        look, sure = found["look"].values[mine].max(), found["sure"].values[mine].max()
        assert len(lines) == (look > 1)
        assert all(f"found by look {look}, " in line and f"mean score {sure:.2f} " in line for line in lines)
    assert found["look"].values.max() == 2
