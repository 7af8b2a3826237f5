"""``zsmoseg ablate``: variants over cached cues, scored."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import draw_clip, write_folder
from PIL import Image

from zsmoseg.painting.palette import encode_png
from zsmoseg.workflows.ablation import sweep
from zsmoseg.workflows.cli import main
from zsmoseg.workflows.result import open_store


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip of a disc, its truth in a plain folder, masks of the disc and of a still patch."""
    root = tmp_path_factory.mktemp("ablate")
    frames, disc = draw_clip(0, 8)
    write_folder(root / "videos" / "disc", frames)
    for folder in ("truth/disc", "masks/disc"):
        (root / folder).mkdir(parents=True)
    for t, mask in enumerate(disc):
        ids = np.where(mask, 1, 0).astype(np.uint8)
        (root / "truth/disc" / f"{t:05d}.png").write_bytes(encode_png(ids))
        ids[70:118, 5:45][ids[70:118, 5:45] == 0] = 2
        (root / "masks/disc" / f"{t:05d}.png").write_bytes(encode_png(ids))
    return root


def ablate(data: Path, out: Path, *more: str) -> int:
    common = ["--truth", str(data / "truth"), "--store", str(out / "store"), "-o", str(out / "tables")]
    own = ["--proposals", str(data / "masks"), "--scheduler", "serial", "--format", "json"]
    return main(["ablate", str(data / "videos" / "disc"), *common, *own, *more])


def test_the_steps_of_the_paper_are_scored_and_depth_rows_need_a_depth(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ablate(data, tmp_path) == 0
    told = capsys.readouterr()
    assert "proposals: imported, flow: dis, depth: constant" in told.out
    board = json.loads((tmp_path / "tables" / "steps.json").read_text())
    assert list(board["methods"]) == ["Base", "OC", "ours"]
    assert board["methods"]["ours"]["mean"]["Fu"] == pytest.approx(100.0)
    assert board["methods"]["Base"]["mean"]["Pu"] < 60, "the still patch is kept"
    assert ablate(data, tmp_path, "--set", "depth.source=ground") == 0
    board = json.loads((tmp_path / "tables" / "steps.json").read_text())
    assert list(board["methods"]) == ["Base", "OC", "OC + Depth, as printed", "OC + Depth", "ours"]


def test_a_second_time_nothing_is_computed_and_a_run_to_the_end_stays_what_is_opened(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = [
        "run",
        str(data / "videos" / "disc"),
        "--store",
        str(tmp_path / "store"),
        "-o",
        str(tmp_path / "out"),
    ]
    assert main([*run, "--scheduler", "serial", "--proposals", str(data / "masks")]) == 0
    keys = open_store(tmp_path / "store")["disc"].keys
    assert ablate(data, tmp_path) == 0
    capsys.readouterr()
    assert ablate(data, tmp_path) == 0
    assert capsys.readouterr().err.count("nothing to do") == 3
    assert open_store(tmp_path / "store")["disc"].keys == keys


def test_sweeps_become_tables_and_plots_and_one_setting_is_one_table(data: Path, tmp_path: Path) -> None:
    sweeps = ["affinity.floor=0.05,0.1", "motion.model=affine,quadratic", "affinity.floor=0.2,0.1"]
    assert ablate(data, tmp_path, *(w for text in sweeps for w in ("--sweep", text))) == 0
    board = json.loads((tmp_path / "tables" / "affinity.floor.json").read_text())
    assert [m.partition(" = ")[2] for m in board["methods"]] == ["0.05", "0.1", "0.2"]
    with Image.open(tmp_path / "tables" / "motion.model.png") as plot:
        assert plot.size == (768, 480)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--sweep", "affinity.floor"], "--sweep affinity.floor: expected"),
        (["--sweep", "=1,2"], "--sweep =1,2: expected"),
        (["--sweep", "affinity.floor=0.1", "--sweep", "affinity.flor=1"], "affinity.flor is unknown"),
        (["--sweep", "motion.model=affine,cubic"], "motion.model = 'cubic'"),
    ],
)
def test_bad_sweeps_get_one_line_before_anything_is_run(
    more: list[str], words: str, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ablate(data, tmp_path, *more) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert not (tmp_path / "tables").exists()


def test_an_output_folder_of_something_else_is_refused(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "mine.txt").write_text("mine")
    assert ablate(data, tmp_path) == 2
    assert "was not made by zsmoseg" in capsys.readouterr().err


def test_values_of_a_sweep_are_read_as_settings_are() -> None:
    assert [dict(v.settings) for v in sweep("affinity.floor = 0.1, 0.2")] == [
        {"affinity.floor": 0.1},
        {"affinity.floor": 0.2},
    ]


def test_published_figures_of_the_dataset_stand_below_and_are_marked(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(data / "videos" / "disc", tmp_path / "DAVIS/JPEGImages/480p/goat")
    shutil.copytree(data / "truth" / "disc", tmp_path / "DAVIS/Annotations/480p/goat")
    places = [
        "--truth",
        str(tmp_path / "DAVIS"),
        "--store",
        str(tmp_path / "store"),
        "-o",
        str(tmp_path / "o"),
    ]
    words = ["--proposals", str(data / "masks" / "disc"), "--scheduler", "serial", "--sweep", "flow.stride=4"]
    assert main(["ablate", str(tmp_path / "DAVIS/JPEGImages/480p"), *places, *words]) == 0
    told = capsys.readouterr().out
    measured, published = told.split(
        "published, not computed here: davis-moving-val, all 22 sequences; scored here: 1"
    )
    assert "flow.stride = 4" in measured
    assert "EM (Meunier" not in measured
    assert "73.18" in published
    assert "EM (Meunier et al. 2023)" in published
    assert "EM (Meunier et al. 2023)" in (tmp_path / "o" / "flow.stride.txt").read_text()
