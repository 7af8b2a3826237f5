"""Every setting: default, unit, range and meaning; presets; TOML.

A section is read by the stages that declare it (``workflows/stages``) and by nothing else. Names are
dotted, ``flow.stride``, and the same in ``--set``, in TOML, in Python and in the store. Lengths are
pixels of the working grid (``frames.width`` wide) unless a name says otherwise.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import fields
from difflib import get_close_matches
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from zsmoseg.errors import SettingsError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def setting(default: Any, meaning: str, unit: str = "", when: tuple[str, ...] = (), **limits: Any) -> Any:
    """One setting; ``when = (name, value, ...)``: it acts only while ``name`` of its section is such a value."""
    return Field(default, description=meaning, json_schema_extra={"unit": unit, "when": list(when)}, **limits)


T = TypeVar("T", bound="DataclassInstance")


class Section(BaseModel):
    """Settings that are read together."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)

    def active(self) -> dict[str, Any]:
        """The settings that act: those of a backend or rule that is not chosen are left out."""
        return {name: value for name, value in self.model_dump(mode="json").items() if self.acts(name)}

    def acts(self, name: str) -> bool:
        """Whether setting ``name`` can change anything now."""
        when = type(self).extra(name)["when"]
        return not when or getattr(self, when[0]) in when[1:]

    def group(self, kind: type[T]) -> T:
        """The parameters ``kind`` of a function of the science: a frozen dataclass, filled by name.

        Its fields that are no settings keep their defaults: they are constants.
        """
        known = {field.name: getattr(self, field.name) for field in fields(kind) if hasattr(self, field.name)}
        return kind(**known)

    @classmethod
    def extra(cls, name: str) -> dict[str, Any]:
        """Unit and condition of setting ``name``."""
        extra = cls.model_fields[name].json_schema_extra
        assert isinstance(extra, dict)
        return extra


class Video(Section):
    """Which frames of the source are used."""

    start: str = setting(
        "", "first frame used: seconds (12.5) or a frame number (300f)", pattern=r"^(\d+(\.\d+)?s?|\d+f)?$"
    )
    end: str = setting(
        "", "end of what is used, exclusive: seconds or a frame number", pattern=r"^(\d+(\.\d+)?s?|\d+f)?$"
    )
    every: int = setting(1, "use every n-th frame", "frames", ge=1)
    fps: float = setting(25.0, "frame rate of folders of images, which carry no times", "1/s", gt=0)
    allow_truncated: bool = setting(False, "use the part of a damaged video that can be decoded")
    fingerprint: Literal["content", "stat"] = setting(
        "content", "how the source is recognised: hash of its bytes, or size and time of change"
    )


class Ignore(Section):
    """Pixels that count for nothing: a car bonnet, a time stamp."""

    mask: str = setting("", "image whose non-zero pixels are kept out of every fit, table, border and mask")

    def active(self) -> dict[str, Any]:
        """The content of the mask counts, not its path."""
        try:
            return {"mask": sha256(Path(self.mask).read_bytes()).hexdigest() if self.mask else ""}
        except OSError as error:
            raise SettingsError(f"{self.mask}: the ignore mask cannot be read ({error.strerror})") from error


class Brought(Section):
    """A section whose cue may be brought by the user: a path, whose content counts in the key."""

    def active(self) -> dict[str, Any]:
        """What acts, without the path: ``zsmoseg.workflows.imports`` puts the fingerprint of its content there."""
        return {name: value for name, value in super().active().items() if name != "path"}


class Frames(Section):
    """The working grid."""

    width: int = setting(427, "width of the working grid; the height follows", "px", ge=32, le=4096)


class Flow(Brought):
    """Optical flow in both directions."""

    source: Literal["auto", "dis", "imported"] = setting(
        "auto", "dis: OpenCV DIS; imported: read from files; auto: imported where there is an import"
    )
    path: str = setting("", "files with the flow of one video, or a folder with one of them a video")
    finest_scale: int = setting(
        0, "finest level of the pyramid; 1 = half the working grid", "", ("source", "dis"), ge=0, le=4
    )
    stride: int = setting(4, "distance of the patches (8 px wide)", "px", ("source", "dis"), ge=1, le=8)
    descent: int = setting(12, "gradient descent steps of a patch", "", ("source", "dis"), ge=1, le=256)
    refinement: int = setting(0, "variational refinement steps", "", ("source", "dis"), ge=0, le=256)
    cut: float = setting(
        0.58, "share of pixels that the other frame does not explain above which a pair is a cut", gt=0, le=1
    )
    repeat: float = setting(
        4.0,
        "difference of local means up to which a frame is a repeat of the one before",
        "grey levels",
        ge=0,
    )


class Depth(Brought):
    """Pseudo depth."""

    source: Literal["auto", "ground", "constant", "imported"] = setting(
        "auto",
        "constant: no depth; ground: a plane that comes nearer towards the bottom; imported: read from files; "
        "auto: imported where there is an import, else constant",
    )
    path: str = setting("", "files with the depth of one video, or a folder with one of them a video")
    kind: Literal["", "depth", "inverse-depth"] = setting(
        "", "what the imported numbers are: larger = farther, or larger = nearer", "", ("source", "imported")
    )


class Proposals(Brought):
    """Where the objects come from."""

    source: Literal["auto", "embedded", "imported"] = setting(
        "auto",
        "embedded: superpixels that stand out from the camera's motion; imported: masks read from files; "
        "auto: imported where there is an import",
    )
    path: str = setting("", "masks of one video, or a folder with one of them a video")
    kind: Literal["auto", "ids", "masks"] = setting(
        "auto",
        "ids: a number is the same object in all frames; masks: every frame counts anew; auto: what the format says",
        "",
        ("source", "imported"),
    )
    link_overlap: float = setting(
        0.3,
        "intersection over union with an object carried along the flow from which a mask is that object",
        "",
        ("source", "imported"),
        gt=0,
        le=1,
    )
    link_gap: int = setting(
        3,
        "frames that an object may miss its mask and still be found again",
        "frames",
        ("source", "imported"),
        ge=1,
    )


class Segments(Section):
    """Superpixels of the embedded default."""

    pitch: float = setting(7.5, "distance of the superpixels", "px", ge=4, le=64)
    compactness: float = setting(10.0, "weight of place against colour", gt=0)
    passes: int = setting(2, "passes over the frame", ge=1, le=20)


class Tables(Section):
    """What is measured on the superpixels and between them."""

    link_least: int = setting(
        2, "pixels that the flow must carry, both ways, to link two superpixels", "px", ge=1
    )


class Objects(Section):
    """Which superpixels are foreground, and which objects they form."""

    top: float = setting(0.98, "quantile of a frame's motion that counts as full motion", gt=0, le=1)
    top_window: int = setting(8, "frames on both sides whose median full motion is used", "frames", ge=0)
    top_least: float = setting(1.0, "full motion is never less: what is slower stays weak", "px", gt=0)
    flow_noise: float = setting(0.1, "steps of the flow below this are no boundary", "px", ge=0)
    border_entry: float = setting(0.3, "cost of entering at the border per px of residual", ge=0)
    border_colour: float = setting(
        23.0, "colour path from the border that counts 63 % as closed", "Lab", gt=0
    )
    clean_error: float = setting(
        0.05, "error forth and back per px of motion at which it counts half as clean", gt=0
    )
    clean_pad: float = setting(0.5, "added to that motion", "px", gt=0)
    clean_top: float = setting(
        0.9, "quantile of the cleanness of what moves that stands for the cleanest", gt=0, le=1
    )
    clean_from: float = setting(0.85, "cleanest up to which no cleanness is demanded", ge=0, le=1)
    clean_full: float = setting(0.95, "cleanest from which all of it is demanded", ge=0, le=1)
    clean_half: float = setting(0.6, "share of the cleanest below which a thing is unclean", gt=0, le=1)
    unclean_from: float = setting(
        0.4, "unclean part of what moves up to which nothing is demanded", ge=0, le=1
    )
    unclean_full: float = setting(0.6, "unclean part from which cleanness is demanded", ge=0, le=1)
    clean_power: float = setting(1.5, "exponent of the demand", ge=0)
    trust_texture: float = setting(
        2.0, "slope of the grey level at which motion is half trusted", "grey levels / px", gt=0
    )
    trust_least: float = setting(0.05, "trust where there is no texture", gt=0, le=1)
    show_detail: float = setting(
        100.0, "squared change at which a node could show its motion half", "grey levels²", gt=0
    )
    show_excess: float = setting(
        1.0, "how much more its motion explains than it leaves, at which it counts half", gt=0
    )
    camera_rounds: int = setting(8, "re-weighted rounds of the fit of the camera's motion", ge=1, le=100)
    link_colour: float = setting(2.5, "colour distance at which a link loses 63 %", "Lab", gt=0)
    link_time: float = setting(10.0, "weight of links in time against links in space", gt=0)
    spread: float = setting(10.0, "strength of the diffusion along the links", ge=0)
    window: int = setting(20, "frames on both sides that a threshold looks at", "frames", ge=0)
    threshold_bins: int = setting(64, "levels tried as threshold", ge=2, le=4096)
    threshold_low: float = setting(0.15, "smallest threshold, share of the top value", ge=0, lt=1)
    threshold: float = setting(0.06, "smallest threshold", gt=0)
    threshold_sure: float = setting(0.26, "first threshold at which the score is 1", gt=0)
    score: float = setting(0.3, "a frame with less is empty", ge=0, le=1)
    contrast_colour: float = setting(10.0, "colour distance that is 63 % of full contrast", "Lab", gt=0)
    contrast_flow: float = setting(1.0, "flow distance that is 63 % of full contrast", "px", gt=0)
    softness: float = setting(0.4, "softness of the foreground, in log(saliency / threshold)", gt=0)
    vote_lightness: float = setting(6.0, "cell of the colour vote", "Lab", gt=0)
    vote_colour: float = setting(4.0, "cell of the colour vote", "Lab", gt=0)
    vote_place: float = setting(0.1, "cell of the colour vote, share of the width", gt=0)
    vote_frames: float = setting(20.0, "cell of the colour vote", "frames", gt=0)
    part_ratio: float = setting(
        2.5, "step of the flow over the median in the frame's foreground at which neighbours move apart", gt=0
    )
    part_least: float = setting(1.0, "steps below this never part neighbours", "px", gt=0)
    part_link: float = setting(0.25, "pull of a pixel that the flow carries on, over one of a boundary", gt=0)
    part_share: float = setting(
        0.05, "smallest part of a thing that is an object of its own, over the largest beside it", ge=0, le=1
    )
    smallest: float = setting(0.0005, "smallest piece, share of the frame", ge=0, lt=1)


class Labels(Section):
    """From superpixels to pixels."""

    guide_radius: int = setting(8, "radius of the guided filter", "px", ge=1, le=64)
    guide_eps: float = setting(1e-4, "edge sensitivity of the guided filter (squared colour, 0 to 1)", gt=0)


class Statistics(Section):
    """The one pass over the pixels."""

    border: int = setting(
        1, "pixels this close to a boundary between objects are left out", "px", ge=0, le=16
    )
    closure: float = setting(
        0.5,
        "pixels whose flow there and back ends farther than this from where it began are left out ...",
        "px",
        gt=0,
    )
    closure_part: float = setting(0.05, "... plus this part of the flow's length", ge=0)
    cells_y: int = setting(5, "rows of the grid of background cells", ge=1, le=32)
    cells_x: int = setting(8, "columns of the grid of background cells", ge=1, le=32)


class Motion(Section):
    """The motion model."""

    model: Literal[
        "auto",
        "screw",
        "screw-shift",
        "screw-printed",
        "screw-plane",
        "quadratic",
        "planar",
        "affine",
        "translation",
    ] = setting(
        "auto",
        "parametric flow of one object at one pair; auto: screw-shift where there is a depth, else affine",
    )

    def chosen(self, depth: bool) -> str:
        """The name of the model, with depth or without."""
        return self.model if self.model != "auto" else "screw-shift" if depth else "affine"


class Trajectories(Section):
    """Points followed along the flow, and the two-view geometry of objects through them."""

    spacing: int = setting(12, "distance at which points start", "px", ge=2, le=256)
    gaps: tuple[Annotated[int, Field(ge=1)], ...] = setting(
        (2, 4, 8), "frames between the two of a pair", "frames", min_length=1
    )


class Affinity(Section):
    """Similarity of objects from the residuals of all pairs."""

    cues: Literal["flow", "epipolar", "both"] = setting(
        "flow",
        "flow: residuals of the motion model; epipolar: of fundamental matrices through trajectories; both: fused",
    )
    fusion: Literal["sum", "coregularised"] = setting(
        "sum",
        "sum: of the affinities, sparsified; coregularised: embeddings drawn towards each other",
        "",
        ("cues", "both"),
    )
    columns: int = setting(
        2,
        "eigenvectors of each affinity that are co-regularised",
        "",
        ("fusion", "coregularised"),
        ge=1,
        le=64,
    )
    kernel: Literal["inlier", "ordered", "ordered-weighted"] = setting(
        "inlier",
        "inlier: residuals below a factor; ordered: the paper's truncated ranks; or all lengths, 1 / t",
    )
    factor: float = setting(
        1.4, "residual over own residual up to which a model fits", "", ("kernel", "inlier"), gt=0
    )
    floor: float = setting(0.15, "residual that is noise", "px", ("kernel", "inlier"), ge=0)
    share: float = setting(
        0.5, "part of the objects that each chooses (t / N)", "", ("kernel", "ordered"), gt=0, le=1
    )
    ranking: Literal["row", "column"] = setting(
        "row",
        "row: models rank objects (the paper); column: objects rank models",
        "",
        ("kernel", "ordered", "ordered-weighted"),
    )
    weight: Literal["area", "equal"] = setting(
        "area", "pairs count by the root of the smaller area, or all alike"
    )


class Groups(Section):
    """Which objects move together, and which do not move. Excess: root mean square, px of the working grid."""

    rule: Literal["calibrated", "spectral", "keep"] = setting(
        "calibrated",
        "calibrated: evidence against the background's own cells; spectral: cluster the affinity; "
        "keep: all proposals move, each by itself",
    )
    count: Literal["auto"] | Annotated[int, Field(ge=1)] = setting(
        "auto", "number of groups, the static one included, or auto"
    )
    equal: bool = setting(False, "objects count alike, whatever their size", "", ("rule", "spectral"))
    most_groups: int = setting(5, "most groups that auto tries", "", ("rule", "spectral"), ge=1, le=64)
    floor: float = setting(0.075, "excess below it is never motion: precision of the flow", "px", gt=0)
    quantile: float = setting(0.8, "quantile of the cells' excess that is the yardstick", ge=0, le=1)
    significant: float = setting(
        0.1, "the strongest is sought among objects of this part of the largest", ge=0, le=1
    )
    exist: float = setting(1.0, "something moves if the strongest exceeds this many largest cells", gt=0)
    clear: float = setting(0.5, "excess of proposals that are never all dropped ...", "px", ge=0)
    clear_cells: float = setting(0.35, "... if they also reach this many largest cells", ge=0)
    top_fraction: float = setting(
        0.55, "an object below this part of the strongest does not move ...", ge=0, le=1
    )
    small: float = setting(
        0.25, "an object with less than this part of the strongest's pixels, as leaks have, ...", ge=0, le=1
    )
    small_fraction: float = setting(
        0.7, "... does not move below this part of the strongest, unless it is certain", ge=0, le=1
    )
    certain: float = setting(
        10.0, "... unless its excess is this many yardsticks and above the largest cell", gt=0
    )
    coherent: float = setting(
        1.5, "excess over what an object's own motion leaves, below which it is no evidence ...", ge=0
    )
    coherent_part: float = setting(
        0.5, "... but no more than this part of what the strongest has", ge=0, le=1
    )
    keep: float = setting(0.9, "the threshold stays below this part of the strongest", gt=0, le=1)
    visible: float = setting(
        1.5,
        "image error of the static world's motion over that of the flow below which nothing visibly moves",
        ge=0,
    )
    rounds: int = setting(2, "passes; from the second on static objects belong to the world", ge=1, le=10)
    noise_area: float = setting(150.0, "area over which the error of the flow is correlated", "px^2", ge=0)
    same: float = setting(
        0.05, "two movers move together if one motion for both costs less than this ...", "px", gt=0
    )
    same_own: float = setting(0.65, "... plus this part of their own residual: limbs are not rigid", ge=0)
    share: float = setting(0.02, "pixels of the largest mover that make a group of its own", ge=0, le=1)
    frames: int = setting(2, "fewer pairs than this prove nothing", "pairs", ge=1)
    weak: float = setting(0.5, "part of the threshold above which a hidden thing may come back", ge=0, le=1)
    reach: float = setting(1.0, "near: boxes closer than this many sizes of the larger object", ge=0)
    gap: int = setting(12, "frames that a thing may be out of sight", "frames", ge=1)
    colour: float = setting(0.5, "histogram intersection that bridges a gap", ge=0, le=1)
    overlap: float = setting(
        0.5, "part of its life up to which an object may be seen beside its successor", ge=0, le=1
    )
    state_window: int = setting(5, "pairs of the median of the motion state", "pairs", ge=1)
    state_low: float = setting(0.7, "thresholds below which a mover rests", gt=0)
    state_high: float = setting(1.3, "thresholds above which it moves again", gt=0)


class Masks(Section):
    """What is painted."""

    when: Literal["ever", "now"] = setting(
        "ever", "paint a mover wherever it is seen, or only while it moves"
    )


class Overlay(Section):
    """The overlay video."""

    write: bool = setting(True, "write overlay.mp4")


class Chunk(Section):
    """How work is cut. Changes no value and is in no key."""

    length: int = setting(32, "frames of a chunk", "frames", ge=1, le=4096)


class Settings(BaseModel):
    """All settings, by section."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    video: Video = Video()
    ignore: Ignore = Ignore()
    frames: Frames = Frames()
    flow: Flow = Flow()
    depth: Depth = Depth()
    proposals: Proposals = Proposals()
    segments: Segments = Segments()
    tables: Tables = Tables()
    objects: Objects = Objects()
    labels: Labels = Labels()
    statistics: Statistics = Statistics()
    motion: Motion = Motion()
    trajectories: Trajectories = Trajectories()
    affinity: Affinity = Affinity()
    groups: Groups = Groups()
    masks: Masks = Masks()
    overlay: Overlay = Overlay()
    chunk: Chunk = Chunk()

    def flat(self) -> dict[str, Any]:
        """``{"flow.stride": 4, ...}``."""
        return {
            f"{s}.{n}": v for s, fields in self.model_dump(mode="json").items() for n, v in fields.items()
        }


PRESETS: Mapping[str, Mapping[str, Any]] = {
    "default": {},
    "paper-core": {
        "motion.model": "screw-printed",
        "affinity.kernel": "ordered",
        "affinity.ranking": "row",
        "affinity.weight": "equal",
        "groups.rule": "spectral",
        "groups.equal": True,
        "groups.count": 2,
    },
}
"""Named settings; ``paper-core`` is the paper to the letter from the proposals on."""


def resolve(
    preset: str = "default", config: Path | None = None, overrides: Mapping[str, Any] | None = None
) -> Settings:
    """Settings from a preset, then a TOML file, then ``overrides`` (dotted names).

    Raises
    ------
    SettingsError
        Unknown preset; unreadable TOML; every unknown, mistyped or out-of-range setting at once.
    """
    if preset not in PRESETS:
        raise SettingsError(f"preset {preset!r} is unknown; there are {', '.join(PRESETS)}")
    flat: dict[str, Any] = {
        **PRESETS[preset],
        **(_flatten(_toml(config)) if config else {}),
        **(overrides or {}),
    }
    problems = []
    tree: dict[str, dict[str, Any]] = {}
    known = defaults()
    for name, value in flat.items():
        if name not in known:
            near = get_close_matches(name, known, 1, 0.5)
            problems.append(
                f"{name} is unknown" + (f"; did you mean {near[0]}?" if near else "; see zsmoseg settings")
            )
        else:
            section, field = name.split(".", 1)
            tree.setdefault(section, {})[field] = value
    try:
        settings = Settings.model_validate(tree)
    except ValidationError as error:
        problems += _in_words(error)
    if problems:
        raise SettingsError("settings: " + " | ".join(problems))
    return settings


def parse_override(text: str) -> tuple[str, Any]:
    """``"flow.stride=4"`` as name and TOML value; what is not TOML is a string."""
    name, equals, value = text.partition("=")
    if not equals or not name.strip():
        raise SettingsError(f"--set {text}: expected section.name=value")
    try:
        return name.strip(), tomllib.loads(f"v = {value}")["v"]
    except tomllib.TOMLDecodeError:
        return name.strip(), value.strip()


@lru_cache
def defaults() -> Mapping[str, Any]:
    """Dotted name to default."""
    return Settings().flat()


def describe(name: str) -> dict[str, Any]:
    """Default, unit, allowed values and meaning of one setting, in words."""
    section, field = name.split(".", 1)
    model: type[Section] = type(getattr(Settings(), section))
    info = model.model_fields[field]
    extra = model.extra(field)
    condition = (
        f" (only with {section}.{extra['when'][0]} = {' or '.join(extra['when'][1:])})"
        if extra["when"]
        else ""
    )
    return {
        "name": name,
        "default": info.default,
        "unit": extra["unit"],
        "allowed": allowed(model, field),
        "meaning": f"{info.description}{condition}",
    }


def allowed(model: type[Section], field: str) -> str:
    """The allowed values of a field in words, from its JSON schema."""
    schema = model.model_json_schema()["properties"][field]
    return " or ".join(_schema_words(part) for part in schema.get("anyOf", [schema]))


_KINDS = {
    "integer": "an integer",
    "number": "a number",
    "string": "text",
    "boolean": "true or false",
    "array": "a list",
}


def _schema_words(schema: Mapping[str, Any]) -> str:
    if "enum" in schema:
        return ", ".join(map(str, schema["enum"]))
    if "const" in schema:
        return str(schema["const"])
    limits = [
        f"{sign} {schema[word]:g}"
        for word, sign in (
            ("minimum", ">="),
            ("exclusiveMinimum", ">"),
            ("maximum", "<="),
            ("exclusiveMaximum", "<"),
        )
        if word in schema
    ]
    if "pattern" in schema:
        limits.append(f"matching {schema['pattern']}")
    return " ".join([_KINDS.get(str(schema.get("type")), "a value"), " and ".join(limits)]).strip()


def _in_words(error: ValidationError) -> list[str]:
    """One sentence per wrong setting."""
    words: dict[str, str] = {}
    for item in error.errors():
        section, field = str(item["loc"][0]), str(item["loc"][1])
        model: type[Section] = type(getattr(Settings(), section))
        words[f"{section}.{field}"] = (
            f"{section}.{field} = {_value(error, section, field)!r}: expected {allowed(model, field)}"
        )
    return list(words.values())


def _value(error: ValidationError, section: str, field: str) -> Any:
    return next(e["input"] for e in error.errors() if e["loc"][:2] == (section, field))


def _toml(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            return tomllib.load(file)
    except OSError as error:
        raise SettingsError(
            f"{path}: cannot be read ({error.strerror}); give a TOML file to --config"
        ) from error
    except tomllib.TOMLDecodeError as error:
        raise SettingsError(f"{path}: is not TOML ({error})") from error


def _flatten(tree: Mapping[str, Any]) -> dict[str, Any]:
    return {
        f"{section}.{name}": value
        for section, fields in tree.items()
        for name, value in (fields.items() if isinstance(fields, dict) else [("", fields)])
    }
