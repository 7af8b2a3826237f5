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
    below_strongest: float = setting(0.9, "the threshold stays below this part of the strongest", gt=0, le=1)
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
    least_pairs: int = setting(2, "fewer pairs than this prove nothing", "pairs", ge=1)
    weak: float = setting(
        0.5, "part of the threshold above which a hidden instance may come back", ge=0, le=1
    )
    reach: float = setting(1.0, "near: boxes closer than this many sizes of the larger object", ge=0)
    gap: int = setting(12, "frames that an instance may be out of sight", "frames", ge=1)
    colour: float = setting(0.5, "histogram intersection that bridges a gap", ge=0, le=1)
    overlap: float = setting(
        0.5, "part of its life up to which an object may be seen beside its successor", ge=0, le=1
    )
    state_window: int = setting(5, "pairs of the median of the motion state", "pairs", ge=1)
    state_low: float = setting(0.7, "thresholds below which a mover rests", gt=0)
    state_high: float = setting(1.3, "thresholds above which it moves again", gt=0)
