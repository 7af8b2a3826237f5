"""All settings, by section."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeVar, get_type_hints

from pydantic import BaseModel, ConfigDict

from zsmoseg.settings.grouping import Affinity, Groups, Motion, Statistics, Trajectories
from zsmoseg.settings.inputs import Depth, Flow, Frames, Ignore, Video
from zsmoseg.settings.networks import Linking, Looks, Networks, Selection, Tags, Tracking
from zsmoseg.settings.outputs import Chunk, Masks, Overlay
from zsmoseg.settings.proposals import Labels, Objects, Proposals, Segments

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")


class Settings(BaseModel):
    """All settings, by section."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    video: Video = Video()
    ignore: Ignore = Ignore()
    frames: Frames = Frames()
    flow: Flow = Flow()
    depth: Depth = Depth()
    proposals: Proposals = Proposals()
    looks: Looks = Looks()
    tags: Tags = Tags()
    selection: Selection = Selection()
    linking: Linking = Linking()
    tracking: Tracking = Tracking()
    segments: Segments = Segments()
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
    networks: Networks = Networks()

    def flat(self) -> dict[str, Any]:
        """``{"flow.stride": 4, ...}``."""
        return {
            f"{s}.{n}": v for s, fields in self.model_dump(mode="json").items() for n, v in fields.items()
        }

    def parameters(self, kind: type[T]) -> T:
        """The parameters ``kind`` of several sections: a frozen dataclass with a dataclass a section, named like it."""
        hints = get_type_hints(kind)
        return kind(**{f.name: getattr(self, f.name).parameters(hints[f.name]) for f in fields(kind)})


@lru_cache
def defaults() -> Mapping[str, Any]:
    """Dotted name to default."""
    return Settings().flat()
