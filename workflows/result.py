"""The Python face: ``segment`` a video, ``open_store`` what is finished, read it lazily."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from zsmoseg.errors import StageError, StoreError
from zsmoseg.remote.url import folder
from zsmoseg.settings import resolve
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.dataset import open_dataset
from zsmoseg.stores.location import Store
from zsmoseg.stores.runs import DONE, entries, latest
from zsmoseg.video.probe import Probe
from zsmoseg.workflows.running.request import Request
from zsmoseg.workflows.running.run import run
from zsmoseg.workflows.running.summary import MEASURED
from zsmoseg.workflows.stages.front_end import Labels
from zsmoseg.workflows.stages.motion.affinity import Affinity
from zsmoseg.workflows.stages.motion.groups import Groups, moving_objects
from zsmoseg.workflows.stages.proposed.objects import MaskObjects, object_names

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from numpy.typing import NDArray


BLOCK = 16
"""Frames that a lazy mask reads at once."""
COLUMNS = ("object", "group", "instance", "frames", "area", "excess", "tolerance", "world")
"""Of the table of objects."""
LAST = "masks"
"""What a run to the end reaches."""


def segment(
    source: str | PurePath,
    groups: int | Literal["auto"] = "auto",
    *,
    out: str | PurePath = "zsmoseg-out",
    store: str | PurePath = "zsmoseg-store",
    preset: str = "embedded",
    settings: dict[str, Any] | None = None,
    scheduler: Any = "serial",
) -> Result:
    """Segment one video.

    Parameters
    ----------
    source : video file, folder of frames, or glob of images; a path or a URL.
    groups : number of groups, the static one included, or ``"auto"``.
    out, store : where the masks and the artifacts go: folders, or URLs as ``s3://bucket/name``.
    preset, settings : a preset, and settings by dotted name on top of it.
    scheduler : ``"serial"``, ``"local"``, the address of a Dask scheduler, or a ``distributed.Client``.

    Raises
    ------
    ZsmosegError
        Bad input, or a part that failed.
    """
    chosen = resolve(preset, None, {"groups.count": groups, **(settings or {})})
    report = run(Request([str(source)], folder(out), folder(store), chosen, scheduler))
    if report.failures:
        raise StageError(next(iter(report.failures.values())))
    return open_store(store).get(report.names[0], report.run)


@dataclass(frozen=True)
class Result:
    """One finished video in a store."""

    store: Store
    name: str
    video: str
    keys: dict[str, str]

    def artifact(self, stage: str) -> Artifact:
        """The artifact of one stage."""
        if stage not in self.keys:
            raise StoreError(f"{self.name}: the run stopped before {stage} (--until); run it to the end")
        return self.store.artifact(self.video, stage, self.keys[stage])

    @property
    def probe(self) -> Probe:
        """Times, names and size of the frames."""
        looked = self.store.video(self.video).probe(self.keys["frames"])
        if looked is None:
            raise StoreError(f"{self.name}: its probe is gone or damaged; run the same command again")
        return Probe.from_json(looked)

    @property
    def tree(self) -> xr.DataTree:
        """Every array of every stage, labelled, in physical units, read lazily: ``tree["flow/forward"]``.

        A stage that left no array (a depth that is constant) has no node.
        """
        import xarray as xr

        found = {stage: self.artifact(stage) for stage in self.keys}
        parts = {name: open_dataset(artifact) for name, artifact in found.items() if artifact.description}
        return xr.DataTree.from_dict({n: d for n, d in parts.items() if d.variables}, name=self.name)

    def masks(self, kind: Literal["moving", "group", "instance"] = "moving") -> xr.DataArray:
        """Masks (frame, y, x), read when used: ``moving`` bool, ``group`` and ``instance`` integers, 0 = static."""
        import xarray as xr

        labels = open_dataset(self.artifact("labels"))["label"]
        groups = self.groups
        number: NDArray[np.int64] = groups.instance if kind == "instance" else groups.group
        lookup = number > 0 if kind == "moving" else number
        chunked = labels.chunk(frame=BLOCK)
        masks: xr.DataArray = xr.apply_ufunc(
            lambda label: lookup[label], chunked, dask="parallelized", output_dtypes=[lookup.dtype]
        )

        return masks

    @property
    def groups(self) -> Groups:
        """What the stage ``groups`` left: arrays by object, by frame and object, by shot."""
        return Groups.read(self.artifact("groups"))

    @property
    def affinity(self) -> Affinity:
        """What the stage ``affinity`` left: how alike objects move, who is static, the evidence pair by pair."""
        return Affinity.read(self.artifact("affinity"))

    @property
    def labels(self) -> Labels:
        """What the stage ``labels`` left: the object of every pixel."""
        return Labels.read(self.artifact("labels"))

    @property
    def categories(self) -> list[str]:
        """What networks call each object, empty where they have no word for it; no list where nothing is named."""
        return object_names(self.artifact("objects")) if "detections" in self.keys else []

    @property
    def objects(self) -> pd.DataFrame:
        """One row an object: object, group, instance, frames, area, excess (px), tolerance (px), world, and the evidence.

        ``world`` is the affinity with the static world, tolerance / (tolerance + excess): one half = at the tolerance.
        The evidence: visibility; geometry, whether it obeys that of the static world, or why that is not known; what was
        measured of it: front, error, parallax, foot; counts, whether its evidence counts beside what obeys.
        Of proposed masks also ``origin``, the id in the files, and ``category`` where a network named them.
        """
        import pandas as pd

        groups = self.groups
        columns = {name: getattr(groups, name) for name in COLUMNS}
        affinity, count = self.affinity, len(groups.group)
        columns |= {name: affinity.by_object(name, count) for name in MEASURED}
        columns["geometry"] = np.array(affinity.geometries(count))
        columns["counts"] = affinity.by_object("counts", count)
        if "proposals" in self.keys:
            columns["origin"] = MaskObjects.read(self.artifact("objects")).origin
            if self.categories:
                columns["category"] = np.array(self.categories)
        return pd.DataFrame({name: column[groups.area > 0] for name, column in columns.items()})

    def moving(self) -> NDArray[np.bool_]:
        """(frame, object) whether each object moves at each frame."""
        return moving_objects(self.groups, 0, len(self.probe.times))


class OpenStore:
    """The finished videos of a store: ``open_store(path)["goat"]``."""

    def __init__(self, path: str | PurePath) -> None:
        self.store = Store.open(path, create=False)

    def __getitem__(self, name: str) -> Result:
        return self.get(name)

    def __iter__(self) -> Iterator[str]:
        return iter(latest(self.store))

    def get(self, name: str, run: str | None = None) -> Result:
        """One video: of the run ``run``, else of the latest finished one, to the end if there is one.

        Raises
        ------
        StoreError
            There is no such run.
        """
        found = [entry for entry in reversed(entries(self.store, name)) if entry.outcome == DONE]
        found = [entry for entry in found if run in (None, entry.run)]
        found.sort(key=lambda entry: LAST not in entry.keys)
        for entry in found:
            return Result(self.store, name, entry.video, dict(entry.keys))
        raise StoreError(
            f"{self.store.path}: no finished run {run + ' ' if run else ''}of {name!r}; "
            "zsmoseg status and zsmoseg runs list what is there"
        )


def open_store(path: str | PurePath) -> OpenStore:
    """Open a store for reading."""
    return OpenStore(path)
