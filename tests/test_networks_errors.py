"""What a model, a contract or a network can do wrong ends in one line that says what, and what to do."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from conftest import write_folder
from graphs import coloured_clip, write_depth, write_detector, write_instances, write_segmenter, write_tagger
from onnx import TensorProto, helper
from runs import segment

from zsmoseg.errors import ModelError, NetworkError, SettingsError, ZsmosegError
from zsmoseg.networks.batches import run_frames
from zsmoseg.networks.contract import Resize, load_contract
from zsmoseg.networks.depth import kind_of, network_depth
from zsmoseg.networks.image import geometry
from zsmoseg.networks.instance_masks import network_instances
from zsmoseg.networks.session import Network, OutOfMemory
from zsmoseg.settings import resolve
from zsmoseg.workflows.cli import main
from zsmoseg.workflows.running.request import Quiet, Request
from zsmoseg.workflows.running.run import run

FRAME = np.zeros((60, 80, 3), np.uint8)


@pytest.fixture
def depth(tmp_path: Path) -> Path:
    return write_depth(tmp_path / "depth")


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_folder(tmp_path_factory.mktemp("clips") / "clip", coloured_clip(6, 96, 128)[0])


def edit(folder: Path, old: str, new: str) -> Path:
    path = folder / "contract.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    return folder


def first_run(folder: Path) -> str:
    """What is said when a network first runs."""
    with pytest.raises(ZsmosegError) as caught:
        list(run_frames(Network(load_contract(folder)), [FRAME], ["depth"]))
    return str(caught.value)


# ------------------------------------------------------------------------ contracts
@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('colour_order = "RGB"', 'color_order = "RGB"', "input.c"),
        ('colour_order = "RGB"', 'colour_order = "rgb"', "input.colour_order"),
        ('rule = "stretch"', 'rule = "squeeze"', "input.resize.rule"),
        ('task = "depth"', 'task = "smell"', "task"),
        ('name = "ramp-depth"', 'name = "../ramp"', "name"),
        ('file = "depth.onnx"', 'file = "../depth.onnx"', "file"),
        ('task = "depth"', "task = ", "is not TOML"),
        ('task = "depth"', 'task = ["depth"]', "task"),
        ("multiple_of = 16", "multiple_of = 100000", "multiple_of"),
        ("multiple_of = 16", "pad_value = [1.0]", "pad_value"),
        ("std = [0.229", "std = [0.0", "std"),
        ("std = [0.229", "std = [nan", "std"),
    ],
)
def test_a_contract_that_says_what_no_rule_knows(depth: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(ModelError, match=r"contract.toml") as caught:
        load_contract(edit(depth, old, new))
    assert words in str(caught.value)


def test_a_contract_without_the_meaning_of_depth_is_refused_before_anything_runs(
    depth: Path, clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    edit(depth, 'meaning = "inverse-depth"', 'meaning = "what it is"')
    where = ["-o", str(tmp_path / "out"), "--store", str(tmp_path / "store")]
    assert main(["run", str(clip), "--set", f"depth.model={depth}", *where]) == 2
    assert "larger = farther" in capsys.readouterr().err


def test_a_network_of_another_task(clip: Path, depth: Path, tmp_path: Path) -> None:
    with pytest.raises(
        ModelError, match=r"its task is depth; proposals.model takes instance-masks or box-masks"
    ):
        segment(clip, tmp_path, {"proposals.model": str(depth)})


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"depth.source": "network"}, "depth.model"),
        ({"tracking.source": "network", "proposals.model": "x"}, "tracking.model"),
        ({"proposals.source": "network"}, "proposals.boxes and proposals.masks"),
        ({"proposals.boxes": "x", "proposals.masks": "x"}, "tags.model"),
        ({"proposals.boxes": "x", "proposals.masks": "x", "tags.prompt": " , . "}, "no phrase"),
        ({"proposals.model": "x", "tags.prompt": "dog"}, "tags are for proposals.boxes"),
        ({"proposals.model": "x", "proposals.path": "y"}, "leave one of them out"),
        ({"depth.source": "ground", "depth.model": "x"}, "leave one of them out"),
        ({"tags.prompt": "dog"}, "tags.prompt is given and no network proposes anything"),
        ({"proposals.masks": "x"}, "proposals.masks is given and no network"),
        ({"tracking.model": "x"}, "tracking.model is given and no network"),
        ({"selection.deny": ["sky"]}, "selection.deny is given and no network"),
        (
            {"proposals.model": "x", "tracking.source": "flow", "tracking.model": "x"},
            "tracking.source = flow",
        ),
    ],
)
def test_networks_that_make_no_front_end(
    settings: dict[str, Any], words: str, clip: Path, tmp_path: Path
) -> None:
    with pytest.raises(SettingsError) as caught:
        segment(clip, tmp_path, settings)
    assert words in str(caught.value)


# ------------------------------------------------------------------------ files
def test_a_graph_that_was_exchanged(depth: Path, tmp_path: Path) -> None:
    other = write_instances(tmp_path / "other")
    (depth / "depth.onnx").write_bytes((other / "instances.onnx").read_bytes())
    assert "its contract says" in first_run(depth)


@pytest.mark.parametrize("keep", [0, 100])
def test_a_truncated_graph_is_found_before_the_run(
    depth: Path, clip: Path, tmp_path: Path, keep: int
) -> None:
    graph = depth / "depth.onnx"
    graph.write_bytes(graph.read_bytes()[:keep])
    with pytest.raises(ModelError, match=rf"has {keep} bytes, its contract says"):
        segment(clip, tmp_path, {"depth.model": str(depth)})


@pytest.mark.parametrize("when", ["before the plan", "after it"])
def test_a_flipped_bit_is_found_before_a_graph_is_used(
    depth: Path, clip: Path, tmp_path: Path, when: str
) -> None:
    graph = depth / "depth.onnx"

    def flip() -> None:
        content = bytearray(graph.read_bytes())
        content[len(content) // 2] ^= 1
        graph.write_bytes(content)

    class Meddler(Quiet):
        def planned(self, plan: Any) -> None:
            flip()

    settings = resolve(overrides={"depth.model": str(depth)})
    request = Request([str(clip)], tmp_path / "out", tmp_path / "store", settings, "serial")
    if when == "after it":
        assert "sha256 is" in run(request, Meddler()).failures["clip"]
    else:
        flip()
        with pytest.raises(ModelError, match="sha256 is"):
            run(request)


def test_a_contract_that_changes_after_the_plan_is_not_used_under_the_old_key(
    clip: Path, tmp_path: Path
) -> None:
    """What a worker reads of a contract beside the graph, too: thresholds, names."""
    for name, write in (
        ("tagger", write_tagger),
        ("detector", write_detector),
        ("segmenter", write_segmenter),
    ):
        write(tmp_path / "models" / name)
    thresholds = tmp_path / "models/tagger/thresholds.txt"

    class Meddler(Quiet):
        def planned(self, plan: Any) -> None:
            thresholds.write_text("\n".join(["1"] * 6))
            edit(tmp_path / "models/tagger", *digests(thresholds))

    def digests(path: Path) -> tuple[str, str]:
        import hashlib
        import re

        text = (path.parent / "contract.toml").read_text()
        old = re.search(r'thresholds = \{[^}]*sha256 = "(\w+)"', text)
        assert old is not None
        return old[1], hashlib.sha256(path.read_bytes()).hexdigest()

    settings = {
        "proposals.boxes": str(tmp_path / "models/detector"),
        "proposals.masks": str(tmp_path / "models/segmenter"),
        "tags.model": str(tmp_path / "models/tagger"),
    }
    request = Request(
        [str(clip)], tmp_path / "out", tmp_path / "store", resolve(overrides=settings), "serial"
    )
    with pytest.raises(ModelError, match=r"is another model than when the run was planned|sha256 is"):
        run(request, Meddler())


def test_a_missing_graph(depth: Path, clip: Path, tmp_path: Path) -> None:
    (depth / "depth.onnx").unlink()
    with pytest.raises(ModelError, match=r"is missing; the model is not whole"):
        segment(clip, tmp_path, {"depth.model": str(depth)})


def test_a_missing_model_names_the_command_that_gets_it(clip: Path, tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"zsmoseg models fetch depth-anything-v2-small"):
        segment(clip, tmp_path, {"depth.model": "depth-anything-v2-small"})
    assert not (tmp_path / "out").exists()


def own_graph(folder: Path, opset: int = 17, op: str = "Identity", **tensors: Any) -> Path:
    """A depth network of one node, whose contract is right for what ``tensors`` say."""
    shape = tensors.get("shape", [1, 3, "height", "width"])
    graph = helper.make_graph(
        [helper.make_node(op, [tensors.get("input", "image")], ["depth"])],
        "own",
        [helper.make_tensor_value_info(tensors.get("input", "image"), TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info("depth", TensorProto.FLOAT, None)],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)
    content = model.SerializeToString()
    folder.mkdir()
    (folder / "own.onnx").write_bytes(content)
    import hashlib

    (folder / "contract.toml").write_text(
        f'name = "own"\ntask = "depth"\nfile = "own.onnx"\nsha256 = "{hashlib.sha256(content).hexdigest()}"\n'
        '[input]\ntensor = "image"\ncolour_order = "RGB"\nshape = [1, 3, "height", "width"]\n'
        '[input.resize]\nrule = "none"\n[output]\ntensor = "depth"\nmeaning = "depth"\n'
    )
    return folder


@pytest.mark.parametrize(
    ("graph", "words"),
    [
        ({"input": "pixels"}, ["has no input image", "the graph has pixels"]),
        ({"shape": [1, 3, 8]}, ["image is [1, 3, 8]", "says [1, 3, 'height', 'width']"]),
        ({"shape": [1, 1, 8, 8]}, ["image is [1, 1, 8, 8]", "says [1, 3,"]),
        ({"opset": 99}, ["opset is newer than ONNX Runtime"]),
        ({"op": "Sniff"}, ["ONNX Runtime cannot load it"]),
        ({}, ["depth is one number a pixel"]),
    ],
    ids=["name", "rank", "size", "opset", "operator", "output"],
)
def test_graph_and_contract_differ(graph: dict[str, Any], words: list[str], tmp_path: Path) -> None:
    folder = own_graph(tmp_path / "own", **graph)
    if "op" in graph or graph:
        text = first_run(folder)
    else:
        from zsmoseg.networks.depth import network_depth

        with pytest.raises(ModelError) as caught:
            list(network_depth(Network(load_contract(folder)), [FRAME], (30, 40)))
        text = str(caught.value)
    for word in words:
        assert word in text


def test_external_data_that_is_missing_is_said_so(tmp_path: Path) -> None:
    folder = own_graph(tmp_path / "own")
    model = onnx.load(folder / "own.onnx")
    weights = helper.make_tensor("weights", TensorProto.FLOAT, [1], [1.0])
    weights.ClearField("float_data")
    weights.data_location = TensorProto.EXTERNAL
    weights.external_data.add(key="location", value="weights.bin")
    model.graph.initializer.append(weights)
    model.graph.node[0].CopyFrom(helper.make_node("Mul", ["image", "weights"], ["depth"]))
    content = model.SerializeToString()
    (folder / "own.onnx").write_bytes(content)
    import hashlib
    import re

    path = folder / "contract.toml"
    path.write_text(
        re.sub(r'sha256 = "\w+"', f'sha256 = "{hashlib.sha256(content).hexdigest()}"', path.read_text())
    )
    assert "external data is missing" in first_run(folder)


# ------------------------------------------------------------------------ runs
def test_numbers_that_are_not_finite_name_the_frame_and_other_videos_go_on(
    clip: Path, tmp_path: Path
) -> None:
    """The root of a negative number is none: on black frames the normalised colours are negative."""
    folder = own_graph(tmp_path / "own", op="Log")
    edit(folder, 'colour_order = "RGB"\n', 'colour_order = "RGB"\nmean = [9.0, 9.0, 9.0]\n')
    images = np.stack([FRAME] * 4)
    bad = write_folder(tmp_path / "videos" / "bad", images)
    settings = resolve(overrides={"depth.model": str(folder), "chunk.length": 4})
    report = run(Request([str(bad)], tmp_path / "out", tmp_path / "store", settings, "serial"))
    assert "frame 00000: own: its output depth is not finite" in report.failures["bad"]


def test_a_provider_that_is_not_there_is_refused_before_anything_runs(
    depth: Path, clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The path of CUDA on a machine without it."""
    where = ["-o", str(tmp_path / "out"), "--store", str(tmp_path / "store"), "--set", f"depth.model={depth}"]
    for provider in ("cuda", "coreml"):
        assert main(["run", str(clip), *where, "--set", f"networks.provider={provider}"]) == 2
        told = capsys.readouterr().err
        assert f"networks.provider = {provider}: this onnxruntime has" in told
        assert "networks.provider=cpu" in told
    with pytest.raises(SettingsError, match="onnxruntime-gpu"):
        list(run_frames(Network(load_contract(depth), provider="cuda"), [FRAME], ["depth"]))


def test_a_batch_that_is_too_large_for_the_memory_is_halved(depth: Path) -> None:
    edit(depth, 'tensor = "pixel_values"', 'tensor = "pixel_values", batch_verified = true')
    calls = []

    class Small(Network):
        """A device that holds two frames."""

        def run(self, graph: str, feeds: Any, wanted: Any = None) -> Any:
            count = len(feeds["image"])
            calls.append(count)
            if count > 2:
                raise OutOfMemory("too much")
            return {"depth": feeds["image"][:, :1]}

    frames = [np.full((32, 32, 3), k, np.uint8) for k in range(6)]
    found = list(run_frames(Small(load_contract(depth)), frames, ["depth"], 6))
    assert calls == [6, 3, 1, 2, 3, 1, 2]
    alone = [
        one["depth"]
        for k in range(6)
        for one, _ in run_frames(Small(load_contract(depth)), [frames[k]], ["depth"])
    ]
    for one, (other, _) in zip(alone, found, strict=True):
        np.testing.assert_array_equal(one, other["depth"])


def test_a_network_is_never_pickled(depth: Path) -> None:
    import pickle

    with pytest.raises(TypeError, match="reference"):
        pickle.dumps(Network(load_contract(depth)))


def test_no_tags_and_no_boxes_are_an_empty_answer_and_no_error(tmp_path: Path) -> None:
    for name, write in (
        ("tagger", write_tagger),
        ("detector", write_detector),
        ("segmenter", write_segmenter),
    ):
        write(tmp_path / "models" / name)
    grey = write_folder(tmp_path / "grey", np.full((5, 96, 128, 3), 127, np.uint8))
    models = {
        "proposals.boxes": str(tmp_path / "models/detector"),
        "proposals.masks": str(tmp_path / "models/segmenter"),
    }
    for words in ({"tags.model": str(tmp_path / "models/tagger")}, {"tags.prompt": "green square"}):
        report, _ = segment(grey, tmp_path / str(len(words)), {**models, **words})
        assert report.summaries["grey"]["objects"] == 0


def test_what_is_not_finite_is_an_error_of_the_network() -> None:
    assert issubclass(OutOfMemory, NetworkError)


def test_a_tracker_that_fails_names_the_frame_that_it_is_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from zsmoseg.tracking.by_flow import FlowTracker

    calls = iter(range(100))

    def step(self: FlowTracker, step: Any) -> Any:
        if next(calls) == 2:
            raise NetworkError("its output is not finite")
        return self.label

    monkeypatch.setattr(FlowTracker, "step", step)
    clip = write_folder(tmp_path / "clip", coloured_clip(8, 96, 128)[0])
    settings = resolve(overrides={"proposals.model": str(write_instances(tmp_path / "instances"))})
    report = run(Request([str(clip)], tmp_path / "out", tmp_path / "store", settings, "serial"))
    assert "frame 00003: its output is not finite" in report.failures["clip"]


def test_the_depth_of_two_outputs_is_the_one_that_has_the_role(tmp_path: Path) -> None:
    """What stands first in a contract is not what counts."""
    folder = write_depth(tmp_path / "depth")
    edit(
        folder,
        'output = { tensor = "predicted_depth", meaning = "inverse-depth" }',
        'output = [{ tensor = "sure", meaning = "depth confidence" }, '
        '{ tensor = "predicted_depth", role = "depth", meaning = "inverse-depth" }]',
    )
    assert kind_of(load_contract(folder)) == "inverse-depth"


@pytest.mark.parametrize("value", [0.0, -2.0])
def test_depth_that_is_nowhere_above_zero_is_no_depth(value: float, depth: Path) -> None:
    class Flat(Network):
        """Says one number."""

        def run(self, graph: str, feeds: Any, wanted: Any = None) -> Any:
            return {"depth": np.full((1, 1, *feeds["image"].shape[2:]), value, np.float32)}

    with pytest.raises(NetworkError, match="its depth is nowhere above 0"):
        list(network_depth(Flat(load_contract(depth)), [FRAME], (30, 40)))


def test_a_very_elongated_frame_goes_in_or_is_refused(tmp_path: Path) -> None:
    thin = np.zeros((2, 4000, 3), np.uint8)
    network = Network(load_contract(write_instances(tmp_path / "instances")))
    (raw,) = network_instances(network, [thin])
    assert raw.box.shape[1:] == (4,)
    rule = Resize(rule="short-side", short_side=512)
    with pytest.raises(ModelError, match="px go into a network"):
        geometry((2, 40000), rule)


def test_denied_categories_are_known_ones_and_their_case_does_not_matter(clip: Path, tmp_path: Path) -> None:
    model = {"proposals.model": str(write_instances(tmp_path / "instances"))}
    with pytest.raises(SettingsError, match=r"no network of this run names 'rad'; did you mean red"):
        segment(clip, tmp_path, {**model, "selection.deny": ["rad"]})
    segment(clip, tmp_path, {**model, "selection.deny": ["RED", "Green"]})
    summary = json.loads((tmp_path / "out/clip/summary.json").read_text())
    assert {e["category"] for e in summary["evidence"]} <= {"blue", "yellow"}
