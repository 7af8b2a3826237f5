"""Every block of the README runs as it stands, in order, in one folder; names of places are those of small stand-ins."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import cv2
import dask.distributed
import numpy as np
import pytest
from conftest import draw_clip, write_folder, write_mp4
from graphs import write_instances
from PIL import Image

from zsmoseg.painting.palette import encode_png
from zsmoseg.workflows.cli import COMMANDS, main

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "README.md").read_text()
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
COMMAND_LINES = [
    line for kind, block in BLOCKS if kind != "python" for line in block.splitlines() if line.strip()
]
MISSING = "--preset paper"
"""In the line that needs networks which are not here: it is refused, and names what gets them."""


def write_masks(folder: Path, truth: np.ndarray) -> None:
    folder.mkdir(parents=True)
    for t, mask in enumerate(truth):
        (folder / f"{t:05d}.png").write_bytes(encode_png(mask.astype(np.uint8)))


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with what the README speaks of: a video, a small DAVIS, masks and depth of others, a network of the name of one."""
    root = tmp_path_factory.mktemp("readme")
    images, truth = draw_clip(frames=5, height=64, width=96)
    write_mp4(root / "walk.mp4", images)
    write_masks(root / "sam", truth)
    (root / "depth").mkdir()
    for t in range(len(images)):
        Image.fromarray(np.full((64, 96), 9 + t, np.uint8)).save(root / "depth" / f"{t:05d}.png")
    for seed, name in enumerate(("bear", "goat")):
        images, truth = draw_clip(seed, frames=5, height=64, width=96)
        write_folder(root / "DAVIS/JPEGImages/480p" / name, images)
        write_folder(root / "data/videos" / name, images)
        for folder in ("DAVIS/Annotations/480p", "tracks", "other"):
            write_masks(root / folder / name, truth)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        patch.setenv("ZSMOSEG_MODELS", str(root / "models"))
        write_instances(root / "models" / "mobile-sam")
        yield root


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """The address of a cluster in this process."""
    with dask.distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0"
    ) as cluster:
        yield cluster.scheduler_address


def words_of(line: str, place: Path, scheduler: str) -> list[str]:
    """A command line without its remark, ``/data`` and the scheduler's address being those of here."""
    found = shlex.split(line, comments=True)
    return [
        word.replace("/data/", f"{place}/data/").replace("tcp://scheduler:8786", scheduler) for word in found
    ]


def test_there_are_blocks_of_each_kind() -> None:
    assert {kind for kind, _ in BLOCKS} == {"", "python"}
    assert len(COMMAND_LINES) > 15


@pytest.mark.parametrize("line", [line for line in COMMAND_LINES if not line.startswith("make ")])
def test_commands_run_in_order(
    line: str, place: Path, scheduler: str, capsys: pytest.CaptureFixture[str]
) -> None:
    name, *words = words_of(line, place, scheduler)
    assert name == "zsmoseg"
    assert words[0] in COMMANDS
    code, told = main(words), capsys.readouterr()
    if MISSING in line:
        assert (code, "get it with: zsmoseg models fetch" in told.err) == (2, True), told.err
    elif "--retry-failed" in line:
        assert (code, "nothing to retry" in told.err) == (0, True)
    else:
        assert code == 0, told.err


@pytest.mark.parametrize("line", [line for line in COMMAND_LINES if line.startswith("make ")])
def test_targets_of_make_are_there(line: str) -> None:
    targets = (ROOT / "Makefile").read_text()
    assert re.search(rf"^{line.split()[1]}:", targets, re.MULTILINE)


def test_python_runs_in_order(place: Path) -> None:
    pytest.importorskip("matplotlib", reason="the README plots").use("Agg")
    names: dict[str, object] = {}
    for kind, block in BLOCKS:
        if kind == "python":
            exec(compile(block, "README.md", "exec"), names)
    assert {"result", "tree"} <= names.keys()


def test_what_the_readme_says_comes_out_comes_out(place: Path) -> None:
    told = re.findall(r"^\| `([\w./]+\.\w+)` \|", TEXT, re.MULTILINE)
    assert len(told) == 5
    for name in told:
        frame = "masks" in name or "objects" in name
        path = place / "zsmoseg-out" / "walk" / name
        assert path.is_file() or (frame and any(path.parent.glob("*.png"))), name
    assert cv2.imread(str(next((place / "out/bear/masks").glob("*.png")))) is not None


def test_masks_means_what_a_run_writes() -> None:
    for line in COMMAND_LINES:
        words = shlex.split(line, comments=True)
        assert "masks" not in words, line
        assert not any(word.endswith("=masks") for word in words), line
