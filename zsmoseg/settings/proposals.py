"""The sections of the proposals: imported masks, or superpixels that stand out from the camera's motion."""

from __future__ import annotations

from typing import Literal

from zsmoseg.settings.section import Brought, Section, setting


class Proposals(Brought):
    """Where the objects come from."""

    source: Literal["auto", "embedded", "network", "imported"] = setting(
        "auto",
        "embedded: superpixels that stand out from the camera's motion; network: model, or boxes and masks; imported: "
        "masks read from files; auto: what is brought or named, else embedded",
    )
    path: str = setting("", "masks of one video, or a folder with one of them a video")
    kind: Literal["auto", "ids", "masks"] = setting(
        "auto",
        "ids: a number is the same object in all frames; masks: every frame counts anew; auto: what the format says",
        "",
        ("source", "imported"),
    )
    model: str = setting(
        "",
        "one network alone: instance masks, or masks of a grid of points (SAM); its name or folder",
        "",
        ("source", "network"),
        ("instance-masks", "box-masks"),
    )
    boxes: str = setting(
        "",
        "network of boxes from text: with the tags of tags.model or tags.prompt, and with masks",
        "",
        ("source", "network"),
        ("text-boxes",),
    )
    masks: str = setting("", "network of masks from these boxes", "", ("source", "network"), ("box-masks",))
    points: int = setting(
        16, "side of the grid of points for a network of masks alone", "", ("source", "network"), ge=1, le=64
    )


class Segments(Section):
    """Superpixels of the embedded default."""

    pitch: float = setting(
        7.5, "distance of the superpixels: smaller finds thinner objects and takes longer", "px", ge=4, le=64
    )
    compactness: float = setting(
        10.0,
        "weight of place against colour: larger makes superpixels rounder, smaller lets them follow edges",
        gt=0,
    )
    passes: int = setting(2, "passes over the frame: more follow edges better and take longer", ge=1, le=20)


class Objects(Section):
    """Which superpixels are foreground, and which objects they form: raise or lower one where the overlay is wrong."""

    top: float = setting(
        0.98,
        "quantile of a frame's motion that counts as full motion: lower where movers are large",
        gt=0,
        le=1,
    )
    top_window: int = setting(
        8,
        "frames on both sides whose median full motion is used: larger where motion comes in bursts",
        "frames",
        ge=0,
    )
    flow_noise: float = setting(
        0.1, "steps of the flow below this are no boundary: larger where the flow is rough", "px", ge=0
    )
    border_entry: float = setting(
        0.3,
        "what it costs objects to touch the border of the frame, per px of motion: larger keeps what is cut off",
        ge=0,
    )
    border_colour: float = setting(
        23.0,
        "path of colour from the border at which a place counts 63 % as enclosed: smaller keeps what is like its "
        "surroundings",
        "Lab",
        gt=0,
    )
    clean_error: float = setting(
        0.05,
        "error of the flow, forward and backward, per px of motion that counts half as clean: smaller tells waves "
        "and spray from objects more strictly",
        gt=0,
    )
    clean_top: float = setting(
        0.9, "quantile of the cleanness of what moves that stands for the cleanest", gt=0, le=1
    )
    clean_from: float = setting(
        0.85,
        "cleanest from which cleanness begins to be demanded of all: larger demands it in fewer frames",
        ge=0,
        le=1,
    )
    clean_full: float = setting(0.95, "cleanest from which it is demanded in full", ge=0, le=1)
    clean_half: float = setting(
        0.6,
        "share of the cleanest below which what moves counts as unclean, as waves and smoke do",
        gt=0,
        le=1,
    )
    unclean_from: float = setting(
        0.4, "unclean share of what moves from which cleanness begins to be demanded", ge=0, le=1
    )
    unclean_full: float = setting(0.6, "unclean share from which it is demanded in full", ge=0, le=1)
    clean_power: float = setting(
        1.5, "strength of that demand: 0 keeps waves, spray and smoke as objects", ge=0
    )
    trust_texture: float = setting(
        2.0,
        "slope of the grey level at which motion is half trusted: larger takes the word of textured places only",
        "grey levels / px",
        gt=0,
    )
    show_detail: float = setting(
        100.0,
        "squared change from which a place could show its motion: smaller drops more shadows and flat surroundings",
        "grey levels²",
        gt=0,
    )
    show_excess: float = setting(
        1.0, "how much better than the camera's its own motion must explain the picture to count half", gt=0
    )
    camera_rounds: int = setting(
        8,
        "re-weighted rounds of the fit of the camera's motion: more where movers fill the frame",
        ge=1,
        le=100,
    )
    link_colour: float = setting(
        2.5,
        "colour distance at which neighbours share 37 % of their evidence: larger joins across edges",
        "Lab",
        gt=0,
    )
    link_time: float = setting(
        10.0,
        "weight of links in time against links in space: larger steadies masks, smaller follows change",
        gt=0,
    )
    spread: float = setting(
        10.0, "how far evidence spreads to neighbours: larger fills objects and blurs borders", ge=0
    )
    window: int = setting(
        20, "frames on both sides that decide on a frame's threshold: larger is steadier", "frames", ge=0
    )
    threshold_low: float = setting(
        0.15,
        "smallest threshold, share of the largest saliency: larger drops weak movers beside strong ones",
        ge=0,
        lt=1,
    )
    contrast_colour: float = setting(
        10.0,
        "colour distance that is 63 % of full contrast at a boundary: smaller accepts faint boundaries",
        "Lab",
        gt=0,
    )
    softness: float = setting(
        0.4, "softness of the foreground, in log(saliency / threshold): larger lets colour decide more", gt=0
    )
    vote_lightness: float = setting(
        6.0,
        "difference in lightness up to which places vote together: larger for changing light",
        "Lab",
        gt=0,
    )
    vote_colour: float = setting(4.0, "difference in colour up to which places vote together", "Lab", gt=0)
    vote_place: float = setting(
        0.1,
        "distance up to which places vote together, share of the width: smaller where colours repeat",
        gt=0,
    )
    vote_frames: float = setting(20.0, "frames up to which places vote together", "frames", gt=0)


class Labels(Section):
    """From superpixels to pixels."""

    guide_radius: int = setting(
        8, "radius of the guided filter: larger smooths masks and loses thin parts", "px", ge=1, le=64
    )
