"""A model that runs: one ONNX Runtime session a graph, made when it is first needed from bytes that were verified."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import ModelError, NetworkError, SettingsError
from zsmoseg.networks.agreement import check_graph
from zsmoseg.networks.contract import NAME, Contract, File, Graph
from zsmoseg.networks.references import contract_at

Array = NDArray[Any]

PROVIDERS = {"cpu": "CPUExecutionProvider", "cuda": "CUDAExecutionProvider"}
"""Short names; others are written like ``coreml`` for CoreMLExecutionProvider."""
MEMORY_WORDS = ("failed to allocate memory", "out of memory", "bfcarena", "cuda_error_out_of_memory")


class OutOfMemory(NetworkError):
    """The device has no memory for one call; fewer frames at once may fit."""


@dataclass
class Network:
    """A model that runs. Never pickled: workers open their own (``open_network``).

    Attributes
    ----------
    provider
        ``auto`` (CUDA where it is there, else CPU), ``cpu``, ``cuda``, or the name of another execution provider.
    threads
        Within one call.
    warm_up
        Seconds that opening took, and the first call of each graph beyond its second: no part of what a frame takes.
    """

    contract: Contract
    provider: str = "auto"
    threads: int = 1
    warm_up: float = 0.0
    _sessions: dict[str, Any] = field(default_factory=dict, repr=False)
    _first: dict[str, float | None] = field(default_factory=dict, repr=False)
    _lock: Any = field(default_factory=Lock, repr=False)

    def __reduce__(self) -> Any:
        raise TypeError("a network is opened where it runs, never sent there: send its reference")

    # -------------------------------------------------------------------- what the graph says
    def inputs(self, graph: str) -> list[str]:
        """The roles of the tensors that a graph takes."""
        named = _roles(self._graph(graph).inputs)
        return [named.get(tensor.name, tensor.name) for tensor in self._session(graph).get_inputs()]

    def outputs(self, graph: str) -> list[str]:
        """The roles of the tensors that a graph leaves."""
        named = _roles(self._graph(graph).outputs)
        return [named.get(tensor.name, tensor.name) for tensor in self._session(graph).get_outputs()]

    def shape(self, graph: str, role: str) -> list[int | str]:
        """The declared shape of a tensor by role: numbers, and names of what is free."""
        declared = self._graph(graph)
        session = self._session(graph)
        tensors = {t.name: t for t in (*session.get_inputs(), *session.get_outputs())}
        name = declared.inputs.get(role, declared.outputs.get(role, role))
        return list(tensors[name].shape)

    # -------------------------------------------------------------------- calls
    def run(
        self, graph: str, feeds: Mapping[str, Array], wanted: Sequence[str] | None = None
    ) -> dict[str, Array]:
        """One call: tensors by role in, tensors by role out.

        Raises
        ------
        ModelError
            The graph takes other tensors than those that are given, or cannot be loaded.
        NetworkError
            Something came out that is not finite, or the call failed; ``OutOfMemory`` where memory was too small.
        """
        session, declared = self._session(graph), self._graph(graph)
        given = {declared.inputs.get(role, role): value for role, value in feeds.items()}
        taken = [tensor.name for tensor in session.get_inputs()]
        if set(given) != set(taken):
            raise ModelError(
                f"{self._where(graph)}: takes {', '.join(taken)}; its contract and task give {', '.join(sorted(given))}"
            )
        roles = list(wanted) if wanted is not None else self.outputs(graph)
        # reading the clock takes longer than it should on some machines: only while the first calls are told apart
        timing = self._first.get(graph, 0.0) is not None
        clock = time.process_time() if timing else 0.0
        try:
            found = session.run([declared.outputs.get(role, role) for role in roles], given)
        except Exception as error:
            raise _failed(self._where(graph), error) from error
        if timing:
            self._time(graph, time.process_time() - clock)
        for role, value in zip(roles, found, strict=True):
            # -inf is how networks say never in logits that are masked; all else that is not finite is a failure
            lowest = -np.inf if role == "logits" else np.finfo(np.float32).min
            if (
                value.dtype.kind == "f"
                and value.size
                and not (value.min() >= lowest and value.max() < np.inf)
            ):
                raise NetworkError(
                    f"{self.contract.name}: its output {role} is not finite; is the input range of its contract right?"
                )
        full = [value.astype(np.float32) if value.dtype == np.float16 else value for value in found]
        return dict(zip(roles, full, strict=True))

    def _time(self, graph: str, seconds: float) -> None:
        """Count what the first call took beyond the second."""
        if graph not in self._first:
            self._first[graph] = seconds
        elif (first := self._first[graph]) is not None:
            self.warm_up += max(first - seconds, 0.0)
            self._first[graph] = None

    # -------------------------------------------------------------------- opening
    def _graph(self, name: str) -> Graph:
        if name not in self.contract.graph:
            raise ModelError(
                f"{self.contract.folder / NAME}: has no graph {name}; a model of the task {self.contract.task} needs it"
            )
        return self.contract.graph[name]

    def _where(self, graph: str) -> str:
        return str(self.contract.folder / self._graph(graph).file)

    def _session(self, graph: str) -> Any:
        with self._lock:
            if graph not in self._sessions:
                clock = time.process_time()
                self._sessions[graph] = self._open(graph)
                self.warm_up += time.process_time() - clock
            return self._sessions[graph]

    def _open(self, name: str) -> Any:
        import onnxruntime

        graph, where = self._graph(name), self._where(name)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = self.threads
        options.inter_op_num_threads = 1
        options.log_severity_level = 4
        # workers share the cores: a thread that waits must not burn one
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        content = verified(self.contract.folder, graph)
        for data in graph.data:
            kept = verified(self.contract.folder, data)
            options.add_external_initializers_from_files_in_memory([data.file], [kept], [len(kept)])
        provider = chosen_provider(self.provider)
        try:
            session = onnxruntime.InferenceSession(content, options, providers=[provider])
        except Exception as error:
            raise _unloadable(where, error) from error
        if session.get_providers()[0] != provider:
            raise SettingsError(
                f"networks.provider = {self.provider}: {provider} is in this onnxruntime and does not start on this "
                "machine; install its libraries, or set networks.provider=cpu"
            )
        check_graph(session, graph, where, self.contract)
        return session


@lru_cache(maxsize=16)
def open_network(reference: str, provider: str, threads: int) -> Network:
    """The network of a pinned reference, one a process.

    Raises
    ------
    ModelError
        The model is no longer there, or no longer the one that was planned with.
    """
    return Network(contract_at(reference), provider, threads)


def verified(folder: Path, file: File) -> bytes:
    """The bytes of a file of a model, which are what is used.

    Raises
    ------
    ModelError
        Missing, truncated, or of another sha256 than the contract says.
    """
    path = folder / file.file
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ModelError(
            f"{path}: cannot be read ({error.strerror}); the model is not whole, zsmoseg models fetch or add it again"
        ) from error
    if file.bytes is not None and len(content) != file.bytes:
        raise ModelError(
            f"{path}: has {len(content)} bytes, its contract says {file.bytes}; fetch it again (zsmoseg models fetch)"
        )
    found = hashlib.sha256(content).hexdigest()
    if found != file.sha256:
        raise ModelError(
            f"{path}: sha256 is {found}, its contract says {file.sha256 or 'none'}; fetch it again (zsmoseg models fetch)"
        )
    return content


def chosen_provider(name: str) -> str:
    """The execution provider that a word stands for.

    Raises
    ------
    SettingsError
        This onnxruntime has none of that name.
    """
    import onnxruntime

    there: list[str] = onnxruntime.get_available_providers()
    if name == "auto":
        return next(p for p in (PROVIDERS["cuda"], PROVIDERS["cpu"]) if p in there)
    wanted = PROVIDERS.get(name, name)
    found = [p for p in there if p.lower() in (wanted.lower(), f"{wanted}ExecutionProvider".lower())]
    if not found:
        hint = "install onnxruntime-gpu in place of onnxruntime, or " if name == "cuda" else ""
        raise SettingsError(
            f"networks.provider = {name or 'nothing'}: this onnxruntime has {', '.join(there)}; {hint}set networks.provider=cpu"
        )
    return found[0]


def _roles(tensors: Mapping[str, str]) -> dict[str, str]:
    """Tensor to role."""
    return {tensor: role for role, tensor in tensors.items()}


def _failed(where: str, error: Exception) -> NetworkError:
    text = " ".join(str(error).split())
    if any(word in text.lower() for word in MEMORY_WORDS):
        return OutOfMemory(
            f"{where}: out of memory; use smaller inputs (its contract's size), fewer workers, or networks.provider=cpu"
        )
    return NetworkError(f"{where}: ONNX Runtime could not run it ({text[:300]})")


def _unloadable(where: str, error: Exception) -> ModelError:
    import onnxruntime

    text = " ".join(str(error).split())
    hint = "fetch or export it again"
    if "opset" in text.lower():
        hint = f"its opset is newer than ONNX Runtime {onnxruntime.__version__} knows; export it with an older one"
    elif "external data" in text.lower() or "external_data" in text.lower() or "External initializer" in text:
        hint = f"its external data is missing: name the files as data of the graph in {NAME}"
    return ModelError(f"{where}: ONNX Runtime cannot load it ({text[:300]}); {hint}")
