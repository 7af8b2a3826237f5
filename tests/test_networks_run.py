"""Networks in a run: from frames to motion masks with small graphs that know plain colours."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import write_folder
from graphs import coloured_clip, write_depth, write_detector, write_instances, write_segmenter, write_tagger
from runs import data_bytes, masks, segment

from zsmoseg.workflows.cli import main
from zsmoseg.workflows.result import Result, open_store

FRAMES, HEIGHT, WIDTH = 24, 180, 240
MIDWAY, BLUE = FRAMES // 2, 3


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("models")
    write_tagger(root / "tagger")
    write_detector(root / "detector")
    write_segmenter(root / "segmenter")
    write_depth(root / "depth")
    write_instances(root / "instances")
    return root


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    images, truth = coloured_clip(FRAMES, HEIGHT, WIDTH)
    return write_folder(tmp_path_factory.mktemp("coloured") / "clip", images), truth


@pytest.fixture(autouse=True)
def cache(models: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ZSMOSEG_MODELS", str(models))


CHAIN = {
    "proposals.source": "network",
    "proposals.boxes": "detector",
    "proposals.masks": "segmenter",
    "tags.model": "tagger",
    "looks.span": 6,
    "depth.model": "depth",
}
ALONE = {"proposals.model": "instances", "depth.model": "depth"}


def overlap(found: np.ndarray, truth: np.ndarray) -> float:
    return float((found & truth).sum() / (found | truth).sum())


def result(root: Path) -> Result:
    return open_store(root / "store")["clip"]


@pytest.fixture(scope="module")
def chain(
    clip: tuple[Path, np.ndarray], models: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Any]:
    root = tmp_path_factory.mktemp("chain")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ZSMOSEG_MODELS", str(models))
        report, _ = segment(clip[0], root, CHAIN)
    return root, report


@pytest.mark.parametrize("settings", [CHAIN, ALONE], ids=["text", "instances"])
def test_what_moves_is_masked_and_called_by_its_name(
    settings: dict[str, Any], clip: tuple[Path, np.ndarray], tmp_path: Path
) -> None:
    segment(clip[0], tmp_path, settings)
    for found, truth in zip(masks(tmp_path / "out" / "clip"), clip[1], strict=True):
        known = truth != BLUE  # in sight for too short a time to be sure of it
        assert overlap((found > 0) & known, (truth > 0) & known) > 0.85
    told = json.loads((tmp_path / "out/clip/summary.json").read_text())["evidence"]
    assert {entry["category"].split()[0] for entry in told} == {"red", "green", "blue", "yellow"}


def test_an_object_that_enters_midway_is_seen_at_the_next_span_and_keeps_one_id(
    chain: tuple[Path, Any], clip: tuple[Path, np.ndarray]
) -> None:
    found = result(chain[0])
    (blue,) = [n for n, name in enumerate(found.categories) if name == "blue square"]
    label, truth = found.labels.label, clip[1] == BLUE
    assert not (label[: MIDWAY + 1] == blue).any()
    assert overlap(label[20:] == blue, truth[20:]) > 0.85
    ids = [np.unique(label[t][truth[t]]) for t in range(19, FRAMES)]
    assert all(blue in n for n in ids)
    assert len(found.objects) == 5, "background and one object a colour"


def test_tags_boxes_and_scores_are_in_the_tree(chain: tuple[Path, Any]) -> None:
    tree = result(chain[0]).tree
    scores = tree["tags/probability"].sel(tag="red square")
    assert scores.shape == (FRAMES // 6,)
    assert (scores > 0.68).all()
    assert tree["detections/box"].dims == ("candidate", "edge")
    assert tree["detections/box"].edge.values.tolist() == ["left", "top", "right", "bottom"]
    names = tree["proposals/named"].category.values[tree["proposals/category_of"].values]
    assert set(names) <= {"red square", "green square", "blue square", "yellow square"}


def test_thresholds_and_the_deny_list_run_no_network(
    chain: tuple[Path, Any], clip: tuple[Path, np.ndarray], tmp_path: Path
) -> None:
    import shutil

    shutil.copytree(chain[0], tmp_path / "copy")
    for change in ({"selection.overlap": 0.2}, {"selection.score": 0.6}, {"selection.deny": ["red square"]}):
        report, counter = segment(clip[0], tmp_path / "copy", {**CHAIN, **change})
        assert "proposals" in counter.stages
        assert not counter.stages & {"frames", "flow", "depth", "tags", "detections"}
    assert "red square" not in result(tmp_path / "copy").categories
    assert report.summaries["clip"]["evidence"]


def test_a_prompt_stands_for_the_tags(clip: tuple[Path, np.ndarray], tmp_path: Path) -> None:
    words = ["--prompt", "green square, blue square", "--set", "proposals.boxes=detector"]
    where = ["-o", str(tmp_path / "out"), "--store", str(tmp_path / "store"), "--scheduler", "serial"]
    assert main(["run", str(clip[0]), *words, "--set", "proposals.masks=segmenter", *where]) == 0
    assert set(open_store(tmp_path / "store")["clip"].categories) == {"", "green square", "blue square"}


def test_the_executor_and_the_chunks_change_no_byte(
    chain: tuple[Path, Any], clip: tuple[Path, np.ndarray], tmp_path: Path
) -> None:
    segment(clip[0], tmp_path, CHAIN, scheduler="local", workers=2)
    assert data_bytes(tmp_path / "store") == data_bytes(chain[0] / "store")
    segment(clip[0], tmp_path / "long", {**CHAIN, "chunk.length": 100, "networks.threads": 2})
    np.testing.assert_array_equal(
        masks(tmp_path / "long/out/clip", "objects"), masks(chain[0] / "out/clip", "objects")
    )


def test_a_model_is_its_content_wherever_it_lies(
    chain: tuple[Path, Any], clip: tuple[Path, np.ndarray], models: Path, tmp_path: Path
) -> None:
    import shutil

    shutil.copytree(chain[0], tmp_path / "copy")
    shutil.copytree(models / "detector", tmp_path / "moved")
    moved = {**CHAIN, "proposals.boxes": str(tmp_path / "moved")}
    _, counter = segment(clip[0], tmp_path / "copy", moved)
    assert not counter.stages
    write_detector(tmp_path / "other", resize={"rule": "stretch", "multiple_of": 32})
    _, counter = segment(clip[0], tmp_path / "copy", {**CHAIN, "proposals.boxes": str(tmp_path / "other")})
    assert "detections" in counter.stages
    assert "tags" not in counter.stages


def test_categories_go_into_the_exports(chain: tuple[Path, Any], tmp_path: Path) -> None:
    store = ["--store", str(chain[0] / "store")]
    assert main(["export", "clip", *store, "--format", "coco", "-o", str(tmp_path), "--what", "object"]) == 0
    coco = json.loads((tmp_path / "clip.json").read_text())
    names = {c["id"]: c["name"] for c in coco["categories"]}
    assert {names[a["category_id"]] for a in coco["annotations"]} == {
        "red square",
        "green square",
        "blue square",
        "yellow square",
    }
