"""Stage ``tags``: what is in the frames that networks look at, in words; nothing where no words are asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.networks.tags import tag_scores
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table
from zsmoseg.workflows.stage import Part, Stage, reach
from zsmoseg.workflows.stages.cues.flow import Flow
from zsmoseg.workflows.stages.proposed.looks import looks, span_of
from zsmoseg.workflows.stages.proposed.naming import tag_list


@dataclass(frozen=True)
class Tags(Arrays):
    """Scores of all tags, before thresholds."""

    look: NDArray[np.int64] = table("row", dtype="int64", meaning="frame that is looked at")
    probability: NDArray[np.float32] = table("row", "tag", dtype="float32", meaning="that the tag is there")


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    flow: Flow = reach()


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    looks: settings.Looks
    tags: settings.Tags


def _labels(s: Sections) -> Mapping[str, Sequence[str]]:
    names = tag_list(s.tags)
    return {"tag": names} if names else {}


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Tags]:
    """Tags of one chunk; those of a prompt are there for certain."""
    if not tag_list(s.tags):
        return
    seen = looks(inputs.flow, part.start, part.stop, span_of(s))
    if s.tags.prompt:
        scores = np.ones((len(seen), len(tag_list(s.tags))), np.float32)
    else:
        network = part.network(s.tags.model)
        rows = []
        for t in map(int, seen):
            with part.at_frame(t):
                rows.append(tag_scores(network, part.read(t)))
        scores = np.stack(rows).astype(np.float32)
    yield Tags(start=part.start, stop=part.stop, look=seen, probability=scores)


STAGE = Stage("tags", 1, task, Inputs, Sections, Tags, labels=_labels, span=span_of, cost=(50.0, 1.0))
