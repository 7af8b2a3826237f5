"""Networks in a run: from frames to motion masks with small graphs that know plain colours."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import write_folder
from graphs import coloured_clip, write_depth, write_detector, write_instances, write_segmenter, write_tagger
from graphs_flow import write_flow
from graphs_tracker import write_tracker
from runs import data_bytes, masks, segment

from zsmoseg.settings import PRESETS, defaults, resolve
from zsmoseg.workflows.cli import main
from zsmoseg.workflows.planning.plan import following
from zsmoseg.workflows.result import Result, open_store
from zsmoseg.workflows.running.request import Request
from zsmoseg.workflows.running.run import run
from zsmoseg.workflows.stages.graph import GRAPHS
from zsmoseg.workflows.stages.proposed import tracks
from zsmoseg.workflows.stages.proposed.tracks import Tracks

FRAMES, HEIGHT, WIDTH = 24, 180, 240
MIDWAY, GREEN, BLUE = FRAMES // 2, 2, 3


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
        _, counter = segment(clip[0], tmp_path / "copy", {**CHAIN, **change})
        assert "proposals" in counter.stages
        assert not counter.stages & {"frames", "flow", "depth", "tags", "detections"}
    assert "red square" not in result(tmp_path / "copy").categories
    assert json.loads((tmp_path / "copy/out/clip/summary.json").read_text())["evidence"]


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


GRID = {"proposals.model": "segmenter", "proposals.points": 8, "looks.span": 6}
ACTS: dict[str, tuple[dict[str, Any], Any]] = {
    "looks.span": (CHAIN, 8),
    "proposals.points": (GRID, 4),
    "tags.prompt": ({**CHAIN, "tags.model": "", "tags.prompt": "red square, yellow square"}, "red square"),
    "selection.score": (CHAIN, 0.99),
    "selection.quality": (GRID, 0.95),
    "selection.stability": (GRID, 1.0),
    "selection.overlap": ({**GRID, "selection.quality": 0.0, "selection.stability": 0.0}, 0.99),
    "selection.largest": (CHAIN, 0.01),
    "selection.deny": (CHAIN, ["red square"]),
    "linking.overlap": ({**CHAIN, "looks.span": 12}, 1.0),
    "linking.gap": (CHAIN, 1),
    "tracking.handover": ({**CHAIN, "linking.overlap": 0.97}, 1),
    "tracking.carry": (CHAIN, False),
}
"""Settings of networks: with what they act, and another value."""


@pytest.mark.parametrize("name", ACTS)
def test_a_setting_of_networks_recomputes_its_stages_and_changes_something(
    name: str, clip: tuple[Path, np.ndarray], tmp_path: Path
) -> None:
    start, value = ACTS[name]
    source = faded(clip, tmp_path) if name in ("linking.gap", "tracking.carry") else clip[0]
    segment(source, tmp_path, start, until=["objects", "labels"])
    old = label_of(tmp_path)
    _, counter = segment(source, tmp_path, {**start, name: value}, until=["objects", "labels"])
    graph = GRAPHS["network-flow"]
    readers = {stage.name for stage in graph.values() if name.split(".")[0] in stage.section_names}
    assert counter.stages == set().union(*(following(graph, reader) for reader in readers)) & TO_LABELS
    assert not np.array_equal(old, label_of(tmp_path)), f"{name} = {value} changed nothing"


def faded(clip: tuple[Path, np.ndarray], root: Path) -> Path:
    """The clip with a green square that is too pale to be proposed in two spans."""
    images = coloured_clip(FRAMES, HEIGHT, WIDTH)[0]
    for image, truth in zip(images[5:17], clip[1][5:17], strict=True):
        image[truth == GREEN] = 0.6 * image[truth == GREEN] + 50
    return write_folder(root / "faded" / "clip", images)


TO_LABELS = {"tags", "detections", "proposals", "tracks", "objects", "labels"}


def label_of(root: Path) -> np.ndarray:
    """The objects of every pixel, of the latest run."""
    return open_store(root / "store").get("clip").labels.label


PAPER = {"looks.span": 6, "chunk.length": 6}


@pytest.fixture(scope="module")
def paper(clip: tuple[Path, np.ndarray], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The whole preset ``paper`` with a small graph in the place of every network."""
    root = tmp_path_factory.mktemp("paper")
    write_tagger(root / "models/ram")
    write_detector(root / "models/grounding-dino-tiny")
    write_segmenter(root / "models/sam-vit-b")
    write_tracker(root / "models/deaot-l")
    write_flow(root / "models/pwc-net", radius=6)
    write_depth(root / "models/dpt-dinov2-small-nyu")
    return root / "models", root


@pytest.mark.parametrize("model", ["", "deaot-l"])
def test_tracks_go_on_from_window_to_window_as_if_there_were_none(
    model: str, clip: tuple[Path, np.ndarray], paper: tuple[Path, Path], tmp_path: Path
) -> None:
    models, _ = paper
    chosen = CHAIN | {
        "proposals.boxes": "grounding-dino-tiny",
        "proposals.masks": "sam-vit-b",
        "tags.model": "ram",
        "depth.source": "constant",
        "tracking.model": model,
        "chunk.length": 6,
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ZSMOSEG_MODELS", str(models))
        del chosen["depth.model"]
        _, counted = segment(clip[0], tmp_path / "whole", chosen, until=["labels"])
        assert [part for stage, part in counted.parts if stage == "tracks"] == [0]
        patch.setitem(tracks.STAGE.__dict__, "least", 6)
        _, counted = segment(clip[0], tmp_path / "cut", chosen, until=["labels"])
        assert [part for stage, part in counted.parts if stage == "tracks"] == [0, 1, 2, 3]
        whole, cut = (result(tmp_path / root) for root in ("whole", "cut"))
        one, other = (r.labels.label for r in (whole, cut))
        assert len(np.unique(one)) > 3
        np.testing.assert_array_equal(other, one)
        for name in ("became", "largest", "run", "object_of", "tracked"):
            found = [getattr(Tracks.read(r.artifact("tracks")), name) for r in (whole, cut)]
            np.testing.assert_array_equal(*found)
        cut.artifact("tracks").invalidate([2])
        _, counted = segment(clip[0], tmp_path / "cut", chosen, until=["labels"])
        assert [part for stage, part in counted.parts if stage == "tracks"] == [2]


def run_paper(clip: Path, models: Path, root: Path, scheduler: str, **more: Any) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ZSMOSEG_MODELS", str(models))
        settings = resolve("paper", overrides={**PAPER, **more})
        request = Request([str(clip)], root / "out", root / "store", settings, scheduler, 2)
        report = run(request)
    assert not report.failures
    return report


def test_the_whole_paper_runs_and_the_executor_changes_no_byte(
    paper: tuple[Path, Path], clip: tuple[Path, np.ndarray]
) -> None:
    models, root = paper
    run_paper(clip[0], models, root / "serial", "serial")
    found = result(root / "serial")
    label = found.labels.label
    assert found.artifact("flow").description["settings"]["flow"]["source"] == "network"
    for n, name in enumerate(found.categories[1:], 1):
        truth = clip[1] == 1 + ["red", "green", "blue", "yellow"].index(name.split()[0])
        seen = (label == n).any((1, 2))
        assert overlap(label[seen] == n, truth[seen]) > 0.8, name
    run_paper(clip[0], models, root / "dask", "local")
    assert data_bytes(root / "dask" / "store") == data_bytes(root / "serial" / "store")
    moving = masks(root / "serial/out/clip") > 0
    np.testing.assert_array_equal(moving, (found.groups.group > 0)[label])
    assert len(np.unique(found.groups.group)) == 2, "the paper is told how many groups there are"
    ours = {name: defaults()[name] for name in PRESETS["paper-core"]}
    again = run_paper(clip[0], models, root / "serial", "serial", **ours)
    assert open_store(root / "serial/store").get("clip", again.run).keys["tracks"] == found.keys["tracks"]
    known = clip[1] != BLUE
    moving = masks(root / "serial/out/clip") > 0
    assert overlap(moving & known, (clip[1] > 0) & known) > 0.8, "our decision on the paper's front end"


def test_networks_run_on_the_workers_that_have_a_gpu(
    clip: tuple[Path, np.ndarray], models: Path, tmp_path: Path
) -> None:
    """Two workers of a cluster, one of which says that it has one: no session is ever opened on the other."""
    from distributed import Client, Nanny, Scheduler, SpecCluster

    plain = {
        "cls": Nanny,
        "options": {"nthreads": 1, "dashboard_address": ":0", "env": {"ZSMOSEG_MODELS": str(models)}},
    }
    spec = {"gpu": {**plain, "options": {**plain["options"], "resources": {"GPU": 1}}}, "plain": plain}
    scheduler = {"cls": Scheduler, "options": {"host": "127.0.0.1", "dashboard_address": ":0"}}
    with SpecCluster(spec, scheduler) as cluster, Client(cluster) as client:
        client.wait_for_workers(2, timeout=60)
        segment(clip[0], tmp_path, ALONE, scheduler=client, until=["labels"])
        opened = client.run(_sessions)
        resources = {w: bool(about["resources"]) for w, about in client.scheduler_info(-1)["workers"].items()}
    assert {worker: count > 0 for worker, count in opened.items()} == resources
    assert sorted(resources.values()) == [False, True]


def _sessions() -> int:
    from zsmoseg.networks.session import open_network

    return open_network.cache_info().currsize
