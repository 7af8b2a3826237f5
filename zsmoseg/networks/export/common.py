"""What every export needs: weights read without pickle, a graph written and compared with torch, its contract."""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import tempfile
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from zsmoseg.errors import ModelError

OPSET = 17
"""Of all graphs: the first that has GridSample in every runtime in use; 20 changes its meaning in some."""
TOLERANCE = 1e-3
"""Largest difference between torch and ONNX Runtime, in parts of the largest value. Rounding stays below 1e-4 even
after twelve updates of RAFT; a size baked in by tracing is wrong in the first digit."""
LARGEST_FILE = 1_900_000_000
"""Bytes of weights in one ONNX file; protobuf ends at 2 GiB, what is more stands beside it."""
WRAPPERS = ("state_dict", "model", "model_state_dict", "ema_model", "params")
"""Under which name training scripts put the weights, the usual first."""


def require(*packages: str) -> None:
    """Refuse to begin where a package of the extra ``zsmoseg[export]`` is not installed.

    Raises
    ------
    ModelError
        Naming what is missing.
    """
    missing = [name for name in (*packages, "torch", "onnx", "tomli_w") if find_spec(name) is None]
    if missing:
        raise ModelError(f"models export needs {', '.join(missing)}; pip install 'zsmoseg[export]'")


def load_weights(path: Path) -> dict[str, Any]:
    """The tensors of a checkpoint by name; nothing in the file is run.

    A ``.safetensors`` file is read as one, everything else by ``torch.load(weights_only=True)``. Weights that stand
    beside an optimiser's state are found, and the ``module.`` that data-parallel training puts before each name is
    taken off.

    Raises
    ------
    ModelError
        If there is no such file, or it is damaged, or it holds more than plain tensors.
    """
    require()
    import torch

    if not path.is_file():
        raise ModelError(f"{path}: no such file; give the checkpoint that the network's authors publish")
    try:
        if path.suffix == ".safetensors":
            from safetensors.torch import load_file

            content: Any = load_file(path)
        else:
            content = torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        raise ModelError(
            f"{path}: holds Python objects beside weights, which could run code, so it is not opened; "
            "save its state_dict alone, best as .safetensors"
        ) from error
    except Exception as error:  # torch and safetensors raise a dozen classes for damaged files
        line = (str(error) or type(error).__name__).splitlines()[0].split(". ")[0]
        raise ModelError(f"{path}: cannot be read as weights ({line}); get it again") from error
    return _without_prefix(_tensors(content, path))


def _tensors(content: Any, path: Path) -> dict[str, Any]:
    import torch

    def plain(value: Any) -> bool:
        return isinstance(value, Mapping) and bool(value) and all(map(torch.is_tensor, value.values()))

    if plain(content):
        return dict(content)
    inner = {k: v for k, v in content.items() if plain(v)} if isinstance(content, Mapping) else {}
    for name in (*WRAPPERS, *inner):
        if name in inner:
            return dict(inner[name])
    raise ModelError(f"{path}: no weights in it; save the network's state_dict")


def _without_prefix(weights: dict[str, Any], prefix: str = "module.") -> dict[str, Any]:
    if all(name.startswith(prefix) for name in weights):
        return {name.removeprefix(prefix): value for name, value in weights.items()}
    return weights


def fill(module: Any, weights: Mapping[str, Any], path: Path) -> Any:
    """The torch module with ``weights``, every one of them used and none missing.

    Raises
    ------
    ModelError
        If names or shapes are not those of the network; the first that differs is named.
    """
    wanted = module.state_dict()
    for name in sorted(wanted.keys() | weights.keys()):
        if name not in weights:
            # torch has counted batches of batch normalisation since 0.4.1; older files do not, nothing reads it.
            if not name.endswith("num_batches_tracked"):
                raise ModelError(f"{path}: has no {name}; it is the checkpoint of another network")
        elif name not in wanted:
            raise ModelError(f"{path}: has a {name}, which the network has not; it is of another network")
        elif wanted[name].shape != weights[name].shape:
            there, here = (tuple(x[name].shape) for x in (weights, wanted))
            raise ModelError(
                f"{path}: {name} is {there}, the network's {here}; it is of another size of network"
            )
    module.load_state_dict({**wanted, **weights})
    return module.eval()


def load_folder(kind: Any, folder: Path) -> Any:
    """A model of the transformers class ``kind`` from a folder that the user has; nothing is fetched, no code is run.

    Raises
    ------
    ModelError
        If ``config.json`` or ``model.safetensors`` is not there, of another kind of model, or lacks weights.
    """
    require("transformers")
    import torch

    try:
        found = json.loads((folder / "config.json").read_text(encoding="utf-8")).get("model_type")
    except (OSError, ValueError, AttributeError) as error:
        raise ModelError(
            f"{folder}: no readable config.json; give the folder with config.json and model.safetensors"
        ) from error
    if found != kind.config_class.model_type:
        raise ModelError(f"{folder}: is a model of type {found}, wanted {kind.config_class.model_type}")
    try:
        model, info = kind.from_pretrained(
            folder,
            local_files_only=True,
            use_safetensors=True,
            trust_remote_code=False,
            output_loading_info=True,
            dtype=torch.float32,
        )
    except Exception as error:  # transformers lets through what each of its loaders raises
        line = (str(error) or type(error).__name__).splitlines()[0]
        raise ModelError(f"{folder}: cannot be read as a model ({line})") from error
    if lacking := sorted(info["missing_keys"]):
        raise ModelError(f"{folder}: has no {lacking[0]} ({len(lacking)} weights are missing)")
    return model.eval()


def as_module(forward: Callable[..., Any], *parts: Any) -> Any:
    """A torch module whose forward is a function; ``parts`` are the modules that hold its weights."""
    import torch

    class Wrapped(torch.nn.Module):  # type: ignore[misc, unused-ignore]
        def __init__(self) -> None:
            super().__init__()
            self.parts = torch.nn.ModuleList(parts)

        def forward(self, *tensors: Any) -> Any:
            return forward(*tensors)

    return Wrapped().eval()


def modules_of(network: Any, cuts: Mapping[str, Callable[..., Any]]) -> dict[str, Any]:
    """A torch module for every graph that a network is cut into: each a function of the network and its tensors."""
    return {graph: as_module(partial(function, network), network) for graph, function in cuts.items()}


def export_graph(
    module: Any,
    args: Sequence[Any],
    path: Path,
    input_names: Sequence[str],
    output_names: Sequence[str],
    dynamic_axes: Mapping[str, Mapping[int, str]] | None = None,
) -> None:
    """An ONNX graph of a torch module, traced with ``args``, checked, and compared with torch on them.

    By the TorchScript exporter: the newer one takes minutes for the same graphs and knows no better which sizes are
    dynamic. Weights above ``LARGEST_FILE`` stand in ``<name>.onnx.data`` beside the graph.

    Raises
    ------
    ModelError
        If the graph is not valid, or ONNX Runtime gives other values than torch.
    """
    import torch

    module.eval()
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".export-") as folder:
        traced = Path(folder) / path.name
        # The tracer warns of every Python branch on a size; whether one matters is what the comparison tells.
        with warnings.catch_warnings(), torch.no_grad():
            warnings.simplefilter("ignore")
            torch.onnx.export(
                module,
                tuple(args),
                str(traced),
                input_names=list(input_names),
                output_names=list(output_names),
                dynamic_axes={name: dict(axes) for name, axes in (dynamic_axes or {}).items()},
                opset_version=OPSET,
                dynamo=False,
            )
        save_graph(_loaded(traced), path)
    error = largest_error(module, path, args)
    if not error <= TOLERANCE:
        raise ModelError(
            f"{path}: its values differ from torch's by {error:.1e} of the largest; not exported right"
        )


def _loaded(path: Path) -> Any:
    import onnx

    return onnx.load(str(path))


def save_graph(graph: Any, path: Path, largest: int = LARGEST_FILE) -> None:
    """An ``onnx.ModelProto`` as a file that passes onnx's full check; large weights in one file beside it."""
    import onnx

    data = path.with_name(path.name + ".data")
    data.unlink(missing_ok=True)
    if sum(len(tensor.raw_data) for tensor in graph.graph.initializer) > largest:
        onnx.save_model(graph, str(path), save_as_external_data=True, location=data.name, size_threshold=1024)
    else:
        onnx.save_model(graph, str(path))
    try:
        onnx.checker.check_model(str(path), full_check=True)  # by path: by value it ends at 2 GiB, too
    except Exception as error:
        raise ModelError(f"{path}: not a valid graph ({str(error).splitlines()[0]})") from error


def largest_error(module: Any, path: Path, args: Sequence[Any]) -> float:
    """How far ONNX Runtime is from torch on ``args``, in parts of the largest value of each output.

    Infinite where a shape differs, a value is not finite, or ONNX Runtime does not run the graph at all.
    """
    import onnxruntime
    import torch

    with torch.no_grad():
        wanted = module.eval()(*[a.clone() for a in args])  # cloned: some networks scale their input in place
    outputs = [wanted] if torch.is_tensor(wanted) else list(wanted)
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 4
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        names = [i.name for i in session.get_inputs()]
        got = session.run(None, dict(zip(names, (a.numpy() for a in args), strict=True)))
    except Exception:  # onnxruntime's classes have no public common base
        return float("inf")
    return max(_difference(w.numpy(), g) for w, g in zip(outputs, got, strict=True))


def _difference(wanted: Any, got: Any) -> float:
    if wanted.shape != got.shape:
        return float("inf")
    if not wanted.size:
        return 0.0
    a, b = wanted.astype(np.float64), got.astype(np.float64)
    error = float(np.abs(a - b).max() / (np.abs(a).max() + 1e-3))
    return error if np.isfinite(error) else float("inf")


def verified_dynamic(module: Any, path: Path, examples: Iterable[Sequence[Any]]) -> bool:
    """Whether the graph gives torch's values at other sizes, too: only then may a contract call it dynamic.

    Parameters
    ----------
    examples
        Inputs of the module, each at a size other than that of the export; at least one.
    """
    errors = [largest_error(module, path, args) for args in examples]
    return bool(errors) and max(errors) <= TOLERANCE


def noise(count: int, size: tuple[int, int], seed: int = 0) -> Any:
    """An example of input: ``count`` images (count, 3, h, w) of numbers from 0 to 1, the same every time."""
    import torch

    return torch.rand(count, 3, *size, generator=torch.Generator().manual_seed(seed))


def write_contract(folder: Path, content: Mapping[str, Any]) -> Path:
    """``contract.toml`` of the graphs in ``folder``; returns its path.

    Each table of ``content["graph"]`` gets ``sha256`` and ``bytes`` of its ``file``, and ``data`` (a list of file,
    sha256, bytes) where weights stand beside it. What is None is left out.
    """
    import tomli_w

    graphs = {role: _measured(folder, graph) for role, graph in content["graph"].items()}
    path = folder / "contract.toml"
    half = path.with_suffix(".toml.half")
    half.write_text(tomli_w.dumps(_known({**content, "graph": graphs})), encoding="utf-8")
    os.replace(half, path)
    return path


def _measured(folder: Path, graph: Mapping[str, Any]) -> dict[str, Any]:
    beside = [sized(folder, name) for name in external_files(folder / graph["file"])]
    return {**graph, **sized(folder, graph["file"]), "data": beside or None}


def sized(folder: Path, name: str) -> dict[str, Any]:
    """Name, digest and bytes of a file in a folder, as contracts name files."""
    with (folder / name).open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return {"file": name, "sha256": digest, "bytes": (folder / name).stat().st_size}


def external_files(path: Path) -> list[str]:
    """Names of the files beside a graph that hold its weights."""
    import onnx

    graph = onnx.load(str(path), load_external_data=False)
    held = {e.value for t in graph.graph.initializer for e in t.external_data if e.key == "location"}
    return sorted(held)


def _known(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: _known(v) for k, v in value.items() if v is not None}
    return [_known(v) for v in value] if isinstance(value, list | tuple) else value
