"""Recipes of CONTRIBUTING, followed: what is added through its one place works from the command line on."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from conftest import draw_clip, write_folder
from numpy.typing import NDArray
from PIL import Image
from runs import masks, segment

import zsmoseg
from zsmoseg import settings
from zsmoseg.errors import SettingsError
from zsmoseg.metrics.clips import Clip, SequenceScore
from zsmoseg.metrics.protocols import PROTOCOLS, Protocol, Rules
from zsmoseg.metrics.registries import Deferred
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table
from zsmoseg.workflows.cli import main
from zsmoseg.workflows.evaluate.reports import REPORTS
from zsmoseg.workflows.export.painting import painted
from zsmoseg.workflows.export.registry import FORMATS, Choice, Format
from zsmoseg.workflows.result import Result
from zsmoseg.workflows.stage import Part, Stage, reach
from zsmoseg.workflows.stages.cues.flow import BACKENDS, Flow, Vectors
from zsmoseg.workflows.stages.cues.flow import Inputs as FlowInputs
from zsmoseg.workflows.stages.cues.flow import Sections as FlowSections
from zsmoseg.workflows.stages.cues.frames import Frames
from zsmoseg.workflows.stages.graph import GRAPHS


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    """Two sequences of four frames: a square in the left half of each."""
    for name in ("goat", "dog"):
        for number in range(4):
            path = tmp_path / "truth" / name / f"{number:05d}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(np.pad(np.ones((4, 4), np.uint8), ((0, 0), (0, 4)))).save(path)
    return tmp_path / "truth"


def scores(capsys: pytest.CaptureFixture[str], truth: Path, protocol: str) -> dict[str, dict[str, float]]:
    """Of each sequence, the truth taken for the prediction."""
    words = ["evaluate", f"same={truth}", "--truth", str(truth), "--protocol", protocol, "--format", "json"]
    assert main(words) == 0
    found: dict[str, dict[str, float]] = json.loads(capsys.readouterr().out)["methods"]["same"]["sequences"]
    return found


# ------------------------------------------------------------------ a metric
def share_found(truth: np.ndarray, prediction: np.ndarray) -> float:
    """Percent of the pixels of a frame that are predicted to move."""
    return 100.0 * float(np.mean(prediction != 0))


def test_a_metric_is_a_function_and_its_place_in_a_protocol(
    truth: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("moving", "davis-2017"):
        before = scores(capsys, truth, name)
        entry = replace(PROTOCOLS[name], more={"share": share_found})
        monkeypatch.setitem(PROTOCOLS, name, entry)
        assert scores(capsys, truth, name) == {s: v | {"share": 50.0} for s, v in before.items()}


# ------------------------------------------------------------------ a protocol
def score_frames(clip: Clip) -> SequenceScore:
    """How many frames there are, and their highest predicted id."""
    ids = [int(frame.prediction.max()) for frame in clip.frames]
    return SequenceScore({"frames": float(len(ids)), "id": float(max(ids))}, 1)


def test_a_protocol_is_one_entry(
    truth: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    entry = Protocol("frames and ids", score_frames, ("frames", "id"), "none")
    monkeypatch.setitem(PROTOCOLS, "toy", entry)
    assert scores(capsys, truth, "toy") == {name: {"frames": 4, "id": 1} for name in ("dog", "goat")}
    with pytest.raises(SystemExit):
        main(["evaluate", "--help"])
    assert "frames and ids" in capsys.readouterr().out
    options = ["evaluate", f"a={truth}", f"b={truth}", "--truth", str(truth), "--protocol", "toy"]
    assert main(options) == 0
    assert "b - a" in capsys.readouterr().out


def test_a_protocol_that_is_not_there_is_refused_in_one_line() -> None:
    with pytest.raises(SettingsError) as caught:
        Rules("davis-2018", None)
    assert "there is no protocol 'davis-2018'; choose one of davis-2016, " in str(caught.value)
    assert "\n" not in str(caught.value)


# ------------------------------------------------------------------ an export format
def write_areas(result: Result, path: Path, choice: Choice) -> None:
    """A line a frame: pixels that are painted."""
    areas = [int((ids > 0).sum()) for ids in painted(result, choice.what, choice.when)]
    path.write_text("\n".join(map(str, areas)))


def test_an_export_format_is_one_entry(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clip = write_folder(tmp_path / "disc", draw_clip()[0])
    segment(clip, tmp_path)
    toy = Format("areas", "OUT/VIDEO.area, pixels a frame", write_areas, ".area", ("what",))
    monkeypatch.setitem(FORMATS, toy.name, toy)
    words = ["export", "disc", "--store", str(tmp_path / "store"), "-o", str(tmp_path / "areas")]
    assert main([*words, "--format", "areas", "--dilate", "1"]) == 2
    assert "--dilate does nothing for areas" in capsys.readouterr().err
    assert main([*words, "--format", "areas", "--what", "instance"]) == 0
    found = (tmp_path / "areas" / "disc.area").read_text().split()
    assert found == [str(int((m > 0).sum())) for m in masks(tmp_path / "out" / "disc")]
    with pytest.raises(SystemExit):
        main(["export", "--help"])
    assert "OUT/VIDEO.area, pixels a frame" in capsys.readouterr().out


def test_every_function_that_a_registry_names_is_there() -> None:
    named = [
        *(f for p in PROTOCOLS.values() for f in (p.score, p.finish)),
        *(f for e in FORMATS.values() for f in (e.write, e.check)),
        *(report.write for report in REPORTS.values()),
    ]
    found = [f.load() for f in named if isinstance(f, Deferred)]
    assert len(found) > 20
    assert all(map(callable, found))


# ---------------------------------------------------------------------- a backend of flow
def still(part: Part, inputs: FlowInputs, s: FlowSections) -> Iterator[tuple[Vectors, Vectors]]:
    """A toy: nothing moves."""
    zero = np.zeros((2, *inputs.frames.image.shape[1:3]), np.float32)
    return ((zero, zero) for _ in range(part.start, part.last_pair))


@pytest.fixture
def one_more_source() -> Iterator[None]:
    """The value ``still`` of ``flow.source``, as an edit of the settings would add it."""
    field = settings.Flow.model_fields["source"]
    before = field.annotation
    field.annotation = Literal["auto", "dis", "imported", "still"]  # type: ignore[assignment]
    rebuild()
    yield
    field.annotation = before
    rebuild()


def rebuild() -> None:
    settings.Flow.model_rebuild(force=True)
    settings.Settings.model_rebuild(force=True)


def test_a_backend_of_flow_is_a_function_and_a_line_in_the_stage(
    clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, one_more_source: None
) -> None:
    monkeypatch.setitem(BACKENDS, "still", still)
    _, counter = segment(clip, tmp_path, {"flow.source": "still"})
    assert "flow" in counter.stages
    (plan,) = counter.plans
    flow = Flow.read(plan.stages["flow"].artifact)
    assert flow.forward.shape[0] == 9
    assert not flow.forward.any()
    assert not masks(tmp_path / "out" / "disc").any(), "where nothing flows nothing moves"


# ---------------------------------------------------------------------- a stage
@dataclass(frozen=True)
class Brightness(Arrays):
    """A toy: how bright each frame is."""

    level: NDArray[np.float32] = table(
        "frame", dtype="float32", meaning="mean grey level", unit="grey levels"
    )


@dataclass(frozen=True)
class BrightnessInputs:
    frames: Frames = reach()


@dataclass(frozen=True)
class BrightnessSections:
    frames: settings.Frames


def brightness(part: Part, inputs: BrightnessInputs, s: BrightnessSections) -> Iterator[Brightness]:
    level = inputs.frames.image.mean((1, 2, 3)).astype(np.float32)
    yield Brightness(start=part.start, stop=part.stop, level=level)


def test_a_stage_is_one_file_and_a_line_in_the_graph(
    clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage = Stage("brightness", 1, brightness, BrightnessInputs, BrightnessSections, Brightness)
    monkeypatch.setitem(GRAPHS, "embedded-flow", {**GRAPHS["embedded-flow"], "brightness": stage})
    _, counter = segment(clip, tmp_path)
    assert ("brightness", 2) in counter.parts, "cut into chunks as all others"
    result = zsmoseg.open_store(tmp_path / "store")["disc"]
    level = result.tree["brightness/level"]
    assert level.dims == ("frame",)
    assert level.attrs["units"] == "grey levels"
    expected = result.tree["frames/image"].mean(("y", "x", "channel"))
    np.testing.assert_allclose(level, expected, rtol=1e-5)
    assert level.sel(frame=3).coords["name"] == "00003"
    _, again = segment(clip, tmp_path)
    assert not again.parts, "and nothing is done twice"
    _, other = segment(clip, tmp_path, {"frames.width": 96})
    assert "brightness" in other.stages
