"""The contract of a model: a TOML file beside its ONNX graphs that says what goes in and what comes out.

With it any network of the tasks below runs without a line of code. What the values depend on is typed and checked;
keys that no rule knows are refused, for a misspelt one would change the result in silence. Prose is welcome where it
cannot be taken for a rule: strings at the top, ``[notes]``, ``[export]``, ``[postprocess]``.
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError, model_validator

from zsmoseg.errors import ModelError

NAME = "contract.toml"
MAIN = "main"
"""The graph of a model that has one only."""

Task = Literal["depth", "flow", "tags", "text-boxes", "box-masks", "instance-masks", "tracker"]
TASKS: Mapping[str, str] = {"instance-segmentation": "instance-masks"}
"""Other words for tasks."""
ROLES: Mapping[str, str] = {"depth": "depth", "flow": "flow", "tags": "scores"}
"""What the one output of a task is."""
PROSE = ("notes", "export", "postprocess")
"""Tables that nothing reads."""
LARGEST = 8192
"""px, sides of an input."""
TABLES = ("tags", "text", "masks", "instances", "tracker")
"""Tables that the adapter of a task reads (``Contract.extra``)."""


class Table(BaseModel):
    """A table of a contract."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


T = TypeVar("T", bound=BaseModel)


class File(Table):
    """A file beside the contract."""

    file: str = Field(pattern=r"^[^/\\.][^/\\]*$")
    sha256: Annotated[str, StringConstraints(to_lower=True)] = Field("", pattern=r"^([0-9a-fA-F]{64})?$")
    bytes: int | None = Field(None, ge=0)
    url: str = ""


class Graph(File):
    """One ONNX file; ``inputs`` and ``outputs`` lead from roles to tensors, roles not listed are named like theirs.

    ``data`` are files with external data, ``shapes`` what is declared of tensors: numbers are checked, names are free.
    """

    inputs: dict[str, str] = {}
    outputs: dict[str, str] = {}
    shapes: dict[str, list[int | str]] = {}
    dtypes: dict[str, str] = {}
    data: list[File] = []


class Resize(Table):
    """How a frame gets the size of the network's input.

    ``none``: as it is; ``stretch``: to height and width, or each side to a multiple; ``short-side``, ``long-side``: that
    side to the number, the other in proportion (``long_side`` caps ``short-side``); ``letterbox``: as large as fits.
    Sides are rounded to multiples of ``multiple_of``, plus ``plus`` (AOT: 16 k + 1). With ``pad`` the picture lies in a
    canvas: of height and width, of ``long_side`` both ways, or of the next multiples.
    """

    rule: Literal["none", "stretch", "short-side", "long-side", "letterbox"]
    height: int | None = Field(None, ge=1, le=LARGEST)
    width: int | None = Field(None, ge=1, le=LARGEST)
    short_side: int | None = Field(None, ge=1, le=LARGEST)
    long_side: int | None = Field(None, ge=1, le=LARGEST)
    enlarge: bool = True
    multiple_of: int = Field(1, ge=1, le=1024)
    plus: int = Field(0, ge=0)
    rounding: Literal["nearest", "up", "down"] = "nearest"
    pad: Literal["none", "bottom-right", "centre"] = "none"
    pad_value: list[float] | None = Field(None, min_length=3, max_length=3)
    """Pixel values before scaling, a number a channel; None: zeros after it."""
    pad_mode: Literal["constant", "replicate"] = "constant"
    interpolation: Literal["linear", "cubic", "area", "antialias", "antialias-cubic"] = "linear"
    """``antialias``: as PIL and torchvision shrink; the others as OpenCV does."""
    on: Literal["uint8", "float32"] = "uint8"
    align_corners: bool = False
    keep_aspect_ratio: bool | None = None
    examples: list[Any] = []

    @model_validator(mode="before")
    @classmethod
    def _derived(cls, given: Any) -> Any:
        """The rule, where sides tell it; cubic works on numbers, for it leaves 0 to 255."""
        if not isinstance(given, dict):
            return given
        found = dict(given)
        if "rule" not in found:
            side = {"short_side": "short-side", "long_side": "long-side", "height": "stretch"}
            found["rule"] = next((rule for key, rule in side.items() if key in found), "none")
        if found.get("interpolation") == "cubic":
            found.setdefault("on", "float32")
        if found["rule"] == "letterbox":
            found.setdefault("pad", "centre")
        return found

    @model_validator(mode="after")
    def _sound(self) -> Self:
        """Refuse what contradicts itself."""
        needed = {"short-side": self.short_side, "long-side": self.long_side}
        if self.rule in needed and needed[self.rule] is None:
            raise ValueError(f"rule {self.rule} needs {self.rule.replace('-', '_')}")
        if self.rule == "letterbox" and not (self.long_side or (self.height and self.width)):
            raise ValueError("rule letterbox needs long_side, or height and width")
        if (self.height is None) != (self.width is None):
            raise ValueError("height and width go together")
        if self.keep_aspect_ratio is not None and self.keep_aspect_ratio == (self.rule == "stretch"):
            raise ValueError(f"keep_aspect_ratio = {self.keep_aspect_ratio} contradicts rule {self.rule}")
        if self.align_corners and self.interpolation != "linear":
            raise ValueError("align_corners goes with interpolation = linear only")
        return self


class Image(Table):
    """How a frame becomes a tensor: resized, colours in order, (x * scale - mean) / std, a batch of one."""

    tensor: str = ""
    dtype: Literal["float32", "float16", "uint8"] = "float32"
    shape: list[int | str] | None = None
    layout: Literal["NCHW", "HWC"] = "NCHW"
    colour_order: Literal["RGB", "BGR"]
    value_range: list[float] = []
    scale: float = 1.0
    mean: list[float] = Field([0.0, 0.0, 0.0], min_length=3, max_length=3)
    std: list[Annotated[float, Field(gt=0)]] = Field([1.0, 1.0, 1.0], min_length=3, max_length=3)
    resize: Resize
    dynamic_verified: bool = False
    """What its exporter says: other sizes than the export's were compared with the original network."""
    batch_verified: bool = False
    """Whether several frames at once were."""


class Output(Table):
    """What a tensor means."""

    tensor: str = ""
    role: str = ""
    dtype: str = "float32"
    shape: list[int | str] | None = None
    meaning: str = ""
    typical_range: list[float] = []
    align_corners: bool = False
    """Whether its authors resize it so, whatever they do with the frame."""


class Contract(BaseModel):
    """A model.

    Attributes
    ----------
    commercial
        Whether the licence of the weights allows commercial use; None: not said.
    graph
        By name; ``main`` where there is one only.
    tables
        Those of the task's adapter, as read.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    folder: Path
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._+-]*$")
    task: Task
    licence: str = ""
    commercial: bool | None = None
    source: str = ""
    revision: str = ""
    graph: dict[str, Graph]
    input: Image | None = None
    output: list[Output] = []
    memory_mb: float | None = None
    tables: dict[str, dict[str, Any]] = {}

    @property
    def image(self) -> Image:
        """How a frame becomes a tensor.

        Raises
        ------
        ModelError
            The contract does not say.
        """
        if self.input is None:
            raise ModelError(
                f"{self.folder / NAME}: lacks [input]; say how a frame becomes the network's input"
            )
        return self.input

    def meaning_of(self, role: str) -> Output:
        """What is said of the output with a role; nothing where nothing is said."""
        tensor = self.graph[MAIN].outputs.get(role, role) if MAIN in self.graph else role
        alone = self.output if len(self.output) == 1 else []
        said = [o for o in self.output if role in (o.role, o.tensor) or o.tensor == tensor]
        return (said or alone or [Output()])[0]

    def extra(self, name: str, kind: type[T]) -> T:
        """A table of the task's adapter.

        Raises
        ------
        ModelError
            It does not say what ``kind`` asks for.
        """
        try:
            return kind.model_validate(self.tables.get(name, {}))
        except ValidationError as error:
            raise ModelError(f"{self.folder / NAME}: [{name}] {_first(error)}") from error

    @property
    def files(self) -> list[File]:
        """Every file of the model but the contract."""
        named = [
            File.model_validate(value)
            for table in self.tables.values()
            for value in table.values()
            if isinstance(value, dict) and "file" in value
        ]
        return [part for graph in self.graph.values() for part in (graph, *graph.data)] + named

    @property
    def digest(self) -> str:
        """sha256 over all that the values depend on: graphs, files and rules; no path, no prose, no licence.

        Raises
        ------
        ModelError
            A file whose sha256 the contract does not say.
        """
        lacking = [file.file for file in self.files if not file.sha256]
        if lacking:
            raise ModelError(
                f"{self.folder / NAME}: no sha256 of {', '.join(lacking)}; zsmoseg models add {self.folder} fills it in"
            )
        prose = {"file", "bytes", "url", "shapes", "dtypes"}
        graphs = {
            name: graph.model_dump(exclude=prose | {"data"}) | {"data": [data.sha256 for data in graph.data]}
            for name, graph in self.graph.items()
        }
        image = self.input and self.input.model_dump(exclude={"shape": True, "value_range": True, "dtype": True,
                                                              "resize": {"examples", "keep_aspect_ratio"}})  # fmt: skip
        meaning = [o.model_dump(include={"tensor", "role", "meaning", "align_corners"}) for o in self.output]
        content = [self.task, graphs, image, meaning, self.tables]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def load_contract(folder: str | Path) -> Contract:
    """The contract of a model folder.

    Raises
    ------
    ModelError
        None is there, it is no TOML, or it says too little, too much, or what contradicts itself.
    """
    path = Path(folder) / NAME
    try:
        with path.open("rb") as file:
            content = tomllib.load(file)
    except OSError as error:
        raise ModelError(
            f"{path}: cannot be read ({error.strerror}); a model is a folder with a {NAME}"
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ModelError(f"{path}: is not TOML ({error})") from error
    return contract_of(content, Path(folder))


def contract_of(content: Mapping[str, Any], folder: Path) -> Contract:
    """The contract that a TOML file says; ``folder`` is where its files lie.

    Raises
    ------
    ModelError
        It says too little, too much, or what contradicts itself.
    """
    known = set(Contract.model_fields) - {"folder", "tables"} | set(File.model_fields)
    top = {
        name: value for name, value in content.items()
        if name in known or not (name in PROSE or name in TABLES or isinstance(value, str | int | float))
    }  # fmt: skip
    outputs = top.pop("output", [])
    top["output"] = outputs if isinstance(outputs, list) else [outputs]
    task = top.get("task", "")
    top["task"] = TASKS.get(task, task) if isinstance(task, str) else task
    tables = {name: content[name] for name in TABLES if name in content}
    single = {name: top.pop(name) for name in File.model_fields if name in top}
    if single and "graph" not in top:
        top["graph"] = {MAIN: single}
    try:
        found = Contract.model_validate({**top, "folder": folder, "tables": tables})
        assert found.files  # names of files in tables are validated here, not when they are used
        return _with_roles(found) if single else found
    except ValidationError as error:
        raise ModelError(f"{folder / NAME}: {_first(error)}") from error


def _with_roles(contract: Contract) -> Contract:
    """The roles of the tensors of a model with one graph, from ``[input]`` and ``[[output]]``."""
    graph = contract.graph[MAIN]
    inputs, outputs, shapes = {}, {}, {}
    dtypes: dict[str, str] = {}
    if contract.input is not None and contract.input.tensor:
        inputs["image"] = contract.input.tensor
        if contract.input.shape:
            shapes[contract.input.tensor] = contract.input.shape
        dtypes[contract.input.tensor] = contract.input.dtype
    for output in contract.output:
        if output.tensor:
            alone = ROLES.get(contract.task) if len(contract.output) == 1 else None
            outputs[output.role or alone or output.tensor] = output.tensor
            if output.shape:
                shapes[output.tensor] = output.shape
            dtypes[output.tensor] = output.dtype
    said = graph.model_copy(
        update={
            "inputs": {**inputs, **graph.inputs},
            "outputs": {**outputs, **graph.outputs},
            "shapes": {**shapes, **graph.shapes},
            "dtypes": {**dtypes, **graph.dtypes},
        }
    )
    return contract.model_copy(update={"graph": {MAIN: said}})


def _first(error: ValidationError) -> str:
    """What is wrong first, in words."""
    found = error.errors()[0]
    where = ".".join(str(part) for part in found["loc"])
    words = {
        "extra_forbidden": "is no key of a contract",
        "string_pattern_mismatch": f"{found['input']!r} is refused; a name has no path, a sha256 64 digits",
    }
    what = words.get(found["type"], found["msg"])
    return f"{where}: {what}" if where else what
