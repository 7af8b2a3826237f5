"""The sections of networks: where they run, what is named, which candidates are kept, how masks become objects."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from zsmoseg.settings.section import Section, setting


class Networks(Section):
    """Where networks run; in no key, for it is no part of what is asked for."""

    provider: str = setting(
        "auto", "execution provider of ONNX Runtime: auto (cuda where it is there, else cpu), cpu, cuda, ..."
    )
    threads: int = setting(0, "threads within a network; 0: the cores that a worker has", ge=0, le=1024)
    batch: int = setting(
        8,
        "frames at once, where the contract of a network says that its batch axis was verified",
        ge=1,
        le=256,
    )


class Looks(Section):
    """When networks of proposals look."""

    span: Literal["auto"] | Annotated[int, Field(ge=1)] = setting(
        "auto",
        "at the first frame of each span of so many, and behind cuts; masks are tracked through it; auto: 1 for a "
        "network of instance masks, else 10",
        "frames",
    )


class Tags(Section):
    """What is looked for, in words."""

    model: str = setting("", "network of tags (RAM): looks at the first frame of each span", tasks=("tags",))
    prompt: str = setting("", "a fixed list instead: person, dog")


class Selection(Section):
    """Which candidates of a network become masks; no network runs anew."""

    score: float = setting(0.25, "best score of a category above which a candidate counts", ge=0, le=1)
    quality: float = setting(
        0.8, "predicted overlap above which a mask of a grid of points counts", ge=0, le=1
    )
    stability: float = setting(
        0.9, "area of its sure part over its possible part above which such a mask counts", ge=0, le=1
    )
    overlap: float = setting(
        0.5, "intersection over union above which the weaker of two masks is the same again", gt=0, le=1
    )
    largest: float = setting(0.5, "part of the image above which a mask is no object", gt=0, le=1)
    deny: tuple[str, ...] = setting(
        (), 'categories that are no objects, whatever their case: ["sky", "road"]'
    )


class Linking(Section):
    """When a mask is an object that is known: masks of single frames, and those of one span and the next."""

    overlap: float = setting(
        0.3,
        "intersection over union with an object followed to its frame from which a mask is that object",
        gt=0,
        le=1,
    )
    gap: int = setting(3, "looks that an object may miss its mask and still be found again", "frames", ge=1)


class Tracking(Section):
    """How masks are followed through a span."""

    source: Literal["auto", "flow", "network"] = setting(
        "auto",
        "flow: along the flow, borders by colour; network: tracking.model; auto: the network if one is named",
    )
    model: str = setting("", "the tracker: its name or folder", "", ("source", "network"), ("tracker",))
    handover: int = setting(
        3,
        "frames of the next span through which objects are followed to be found again there",
        "frames",
        ge=1,
    )
    carry: bool = setting(True, "an object that the next span does not propose goes on while it is tracked")
