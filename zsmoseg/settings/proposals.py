"""The sections of the proposals: imported masks, or superpixels that stand out from the camera's motion."""

from __future__ import annotations

from typing import Literal

from zsmoseg.settings.section import Brought, Section, setting


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
