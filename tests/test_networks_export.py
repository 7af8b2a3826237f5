"""Exports: what is missing is named, weights are read without pickle, a contract says dynamic only where it is true.

All but the first run where the extra ``zsmoseg[export]`` is installed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zsmoseg.errors import ModelError
from zsmoseg.networks.contract import load_contract
from zsmoseg.networks.export import common
from zsmoseg.networks.flow import network_flow
from zsmoseg.networks.session import Network

pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.fixture(scope="module")
def torch() -> Any:
    pytest.importorskip("tomli_w")
    return pytest.importorskip("torch")


def test_what_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(common, "find_spec", lambda name: None if name == "torch" else name)
    with pytest.raises(ModelError, match=r"models export needs torch; pip install 'zsmoseg\[export\]'"):
        common.load_weights(tmp_path / "weights.pth")


class Anything:
    """What no checkpoint needs."""


def test_a_checkpoint_with_more_than_weights_is_not_opened(torch: Any, tmp_path: Path) -> None:
    torch.save({"model": {"a": torch.ones(2)}, "extra": Anything()}, tmp_path / "a.pth")
    with pytest.raises(ModelError, match=r"a.pth: holds Python objects beside weights"):
        common.load_weights(tmp_path / "a.pth")


def test_a_truncated_checkpoint_is_refused_by_name(torch: Any, tmp_path: Path) -> None:
    torch.save({"a": torch.ones(2000)}, tmp_path / "a.pth")
    (tmp_path / "a.pth").write_bytes((tmp_path / "a.pth").read_bytes()[:3000])
    with pytest.raises(ModelError, match=r"a.pth: cannot be read as weights"):
        common.load_weights(tmp_path / "a.pth")


def test_weights_are_found_beside_an_optimiser_and_without_the_prefix_of_parallel_training(
    torch: Any, tmp_path: Path
) -> None:
    held = {"module.a": torch.ones(2), "module.b": torch.zeros(1)}
    torch.save({"optimizer": {"lr": 0.1}, "state_dict": held}, tmp_path / "a.pth")
    assert list(common.load_weights(tmp_path / "a.pth")) == ["a", "b"]


def test_weights_of_another_network_are_refused_with_the_first_that_differs(
    torch: Any, tmp_path: Path
) -> None:
    layer = torch.nn.Linear(2, 3)
    with pytest.raises(ModelError, match=r"x: has no bias"):
        common.fill(layer, {"weight": torch.ones(3, 2)}, Path("x"))
    with pytest.raises(ModelError, match=r"x: weight is \(2, 3\), the network's \(3, 2\)"):
        common.fill(layer, {"weight": torch.ones(2, 3), "bias": torch.ones(3)}, Path("x"))


def test_only_a_graph_that_follows_its_input_is_called_dynamic(torch: Any, tmp_path: Path) -> None:
    """The second casts the size to a number while it is traced."""
    from torch.nn.functional import interpolate

    layer = torch.nn.Conv2d(3, 2, 3)
    free, bound = (
        common.as_module(
            lambda x, k=kind: interpolate(layer(x), (k(x.shape[2]), k(x.shape[3])), mode="bilinear"), layer
        )
        for kind in (lambda side: side, int)
    )
    found = []
    for name, module in (("free", free), ("bound", bound)):
        path = tmp_path / f"{name}.onnx"
        axes = {"image": {2: "h", 3: "w"}, "out": {2: "h", 3: "w"}}
        common.export_graph(module, [common.noise(1, (16, 20))], path, ["image"], ["out"], axes)
        assert common.largest_error(module, path, [common.noise(1, (16, 20), 5)]) < 1e-5
        found.append(common.verified_dynamic(module, path, [[common.noise(1, (24, 18))]]))
    assert found == [True, False]


def test_weights_beside_the_graph_are_in_the_contract_and_are_loaded_from_there(
    torch: Any, tmp_path: Path
) -> None:
    import onnx

    layer = torch.nn.Conv2d(3, 2, 9, padding=4)
    path = tmp_path / "flow.onnx"
    module = common.as_module(lambda first, second: layer(first - second), layer)
    pair = (common.noise(1, (32, 40)), common.noise(1, (32, 40), 1))
    common.export_graph(module, pair, path, ["first", "second"], ["flow"])
    common.save_graph(onnx.load(str(path)), path, largest=100)
    content = {
        "name": "beside",
        "task": "flow",
        "graph": {"main": {"file": "flow.onnx", "outputs": {"flow": "flow"}}},
        "input": {"colour_order": "BGR", "scale": 1 / 255, "resize": {"rule": "none"}},
        "output": {"tensor": "flow", "meaning": "flow in pixels of the resized image"},
    }
    common.write_contract(tmp_path, content)
    (beside,) = load_contract(tmp_path).graph["main"].data
    assert beside.file == "flow.onnx.data"
    frames = np.random.default_rng(0).integers(0, 256, (2, 32, 40, 3), np.uint8)
    found = network_flow(Network(load_contract(tmp_path)), *frames)
    one, two = (torch.from_numpy(frame.transpose(2, 0, 1)[None] / np.float32(255)) for frame in frames)
    with torch.no_grad():
        wanted = module(one, two)[0].numpy()
    assert np.abs(found - wanted).max() < 1e-5
    (tmp_path / beside.file).write_bytes(b"other")
    with pytest.raises(ModelError, match=r"flow.onnx.data: has 5 bytes"):
        network_flow(Network(load_contract(tmp_path)), *frames)


def test_pwc_net_exports_from_the_ports_older_names_twice_to_the_same_bytes(
    torch: Any, tmp_path: Path
) -> None:
    from zsmoseg.networks.export import pwc_net

    torch.manual_seed(0)
    weights = pwc_net._parts().state_dict()
    assert sum(value.numel() for value in weights.values()) == 9_374_274
    older = {name.replace("net", "module"): value for name, value in weights.items()}
    torch.save(older, tmp_path / "network-default.pytorch")
    first, again = (
        pwc_net.export_pwc_net(tmp_path / "network-default.pytorch", tmp_path / name) for name in "ab"
    )
    assert first.read_bytes() == again.read_bytes()
    contract = load_contract(first.parent)
    assert contract.image.dynamic_verified
    assert contract.commercial is False
    frames = np.random.default_rng(0).integers(0, 256, (2, 70, 100, 3), np.uint8)
    assert network_flow(Network(contract), *frames).shape == (2, 70, 100)
    del older["moduleRefiner.moduleMain.0.bias"]
    torch.save(older, tmp_path / "less.pytorch")
    with pytest.raises(ModelError, match=r"less.pytorch: has no netRefiner.netMain.0.bias"):
        pwc_net.export_pwc_net(tmp_path / "less.pytorch", tmp_path / "c")
