"""The sections of the grouping: measured motion, similarity of objects, what moves and with what."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from zsmoseg.settings.section import Section, setting


class Statistics(Section):
    """The one pass over the pixels."""

    border: int = setting(
        1, "pixels this close to a boundary between objects are left out", "px", ge=0, le=16
    )
    closure: float = setting(
        0.5,
        "pixels whose flow forward and backward ends farther than this from where it began are left out ...",
        "px",
        gt=0,
    )
    closure_part: float = setting(0.05, "... plus this part of the flow's length", ge=0)
    noise_lag: int = setting(
        12,
        "distance over which the error of the flow is taken as independent, to measure it",
        "px",
        ge=1,
        le=64,
    )


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
    """Similarity of objects from the residuals of all pairs. Costs: root mean square, px of the working grid."""

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
    kernel: Literal["merge", "ordered", "ordered-weighted"] = setting(
        "merge",
        "merge: what one motion for two costs; ordered: the paper's truncated ranks; or all lengths, 1 / t",
    )
    floor: float = setting(0.12, "cost that is never motion: precision of the flow", "px", gt=0)
    most: float = setting(
        15.0,
        "what costs the world more than this many times the mean square that its motion leaves (that of the object counts up to it) moves for sure",
        gt=0,
    )
    pair: float = setting(
        0.3, "two objects move as one up to this part of the mean squares that their own motions leave", ge=0
    )
    noise_area: float = setting(240.0, "area over which what a motion leaves is correlated", "px^2", ge=0)
    rounds: int = setting(3, "passes; from the second on what is static belongs to the world", ge=1, le=10)
    visible: float = setting(
        1.5,
        "image error of the static world's motion over that of the flow below which nothing visibly moves",
        ge=0,
    )
    geometry: bool = setting(
        True,
        "whether what obeys the geometry of the static world and stands on it is static, however it moves in the picture",
        "",
        ("kernel", "merge"),
    )
    error: float = setting(
        10.0,
        "what obeys it strays from its epipolar lines at most this many times as far as the world itself",
        "",
        ("geometry", True),
        gt=0,
    )
    parallax: float = setting(
        2.0,
        "what obeys it with more than this many times the parallax that nine tenths of the world stay below has to fit closer",
        "",
        ("geometry", True),
        gt=0,
    )
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
    """Which objects move together, and which do not move."""

    rule: Literal["linkage", "spectral", "keep"] = setting(
        "linkage",
        "linkage: what agrees with the world is static, the rest by average linkage; spectral: clusters of the "
        "affinity; keep: all proposals move, each by itself",
    )
    count: Literal["auto"] | Annotated[int, Field(ge=1)] = setting(
        "auto", "number of groups, the static one included, or auto"
    )
    equal: bool = setting(False, "objects count alike, whatever their size", "", ("rule", "spectral"))
    most_groups: int = setting(5, "most groups that auto tries", "", ("rule", "spectral"), ge=1, le=64)
    share: float = setting(
        0.02, "pixels of the largest mover that make a group of its own", "", ("rule", "linkage"), ge=0, le=1
    )
    least_pairs: int = setting(2, "fewer pairs than this prove nothing", "pairs", ("rule", "linkage"), ge=1)
    weak: float = setting(
        0.5,
        "odds against the world above which a hidden instance may come back",
        "",
        ("rule", "linkage"),
        ge=0,
        le=1,
    )
    reach: float = setting(1.0, "near: boxes closer than this many sizes of the larger object", ge=0)
    gap: int = setting(12, "frames that an instance may be out of sight", "frames", ge=1)
    colour: float = setting(0.5, "histogram intersection that bridges a gap", ge=0, le=1)
    overlap: float = setting(
        0.5, "part of its life up to which an object may be seen beside its successor", ge=0, le=1
    )
    state_window: int = setting(5, "pairs of the median of the motion state", "pairs", ge=1)
    state_low: float = setting(0.7, "part of the odds that it is held to, below which a mover rests", gt=0)
    state_high: float = setting(1.3, "times these, above which it moves again", gt=0)
