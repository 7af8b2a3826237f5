"""The Python face: ``segment`` a video, ``open_store`` what is finished, read it lazily."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from zsmoseg.errors import StageError, StoreError
from zsmoseg.settings import resolve
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.location import Store
from zsmoseg.stores.records import list_runs
from zsmoseg.video import Probe
from zsmoseg.workflows.run import Request, run
from zsmoseg.workflows.stages.masks import moving_objects

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from numpy.typing import NDArray


BLOCK = 16
"""Frames that a lazy mask reads at once."""
LAST = "masks"
"""What a run to the end reaches."""


def segment(
    source: str | Path,
    groups: int | Literal["auto"] = "auto",
    *,
    out: str | Path = "zsmoseg-out",
    store: str | Path = "zsmoseg-store",
    preset: str = "default",
    settings: dict[str, Any] | None = None,
    scheduler: Any = "serial",
) -> Result:
    """Segment one video.

    Parameters
    ----------
    source : video file, folder of frames, or glob of images.
    groups : number of groups, the static one included, or ``"auto"``.
    out, store : where the masks and the artifacts go.
    preset, settings : a preset, and settings by dotted name on top of it.
    scheduler : ``"serial"``, ``"local"``, the address of a Dask scheduler, or a ``distributed.Client``.

    Raises
    ------
    ZsmosegError
        Bad input, or a part that failed.
    """
    chosen = resolve(preset, None, {"groups.count": groups, **(settings or {})})
    report = run(Request([str(source)], Path(out), Path(store), chosen, scheduler))
    if report.failures:
        raise StageError(next(iter(report.failures.values())))
    (plan,) = report.plans
    return Result(
        Store.open(store, create=False), plan.name, plan.video, {n: s.key for n, s in plan.stages.items()}
    )


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
        described = self.artifact("frames").description
        if described is None:
            raise StoreError(f"{self.name}: artifact.json of frames is damaged; run the same command again")
        return Probe.from_json(described["probe"])

    @property
    def tree(self) -> xr.DataTree:
        """Every video array, labelled, in physical units, read lazily: ``tree["flow/forward"]``."""
        import xarray as xr

        probe = self.probe
        parts = {}
        for stage in self.keys:
            if (self.artifact(stage).path / "artifact.json").exists():
                parts[stage] = self.artifact(stage).dataset(list(probe.times), list(probe.names))
        return xr.DataTree.from_dict(parts, name=self.name)

    def masks(self, kind: Literal["moving", "group", "instance"] = "moving") -> xr.DataArray:
        """Masks (frame, y, x), read when used: ``moving`` bool, ``group`` and ``instance`` integers, 0 = static."""
        import xarray as xr

        labels = self.artifact("labels").dataset(self.probe.times, self.probe.names)["label"]
        table = self.artifact("groups").read_table(0)
        number: NDArray[np.int64] = table["instance" if kind == "instance" else "group"]
        lookup = number > 0 if kind == "moving" else number
        chunked = labels.chunk(frame=BLOCK)
        masks: xr.DataArray = xr.apply_ufunc(
            lambda label: lookup[label], chunked, dask="parallelized", output_dtypes=[lookup.dtype]
        )

        return masks

    @property
    def objects(self) -> pd.DataFrame:
        """One row an object: object, group, instance, frames, area, score (px), threshold (px), visibility.

        Of imported masks with ids also ``origin``, the id in the files.
        """
        import pandas as pd

        table = self.artifact("groups").read_table(0)
        seen = np.flatnonzero(table["area"] > 0)
        table |= {n: c for n, c in self.artifact("objects").read_table(0).items() if n == "origin"}
        columns = {n: c[seen] for n, c in table.items() if len(c) == len(table["group"])}
        return pd.DataFrame({"object": seen, **columns})

    def moving(self) -> NDArray[np.bool_]:
        """(frame, object) whether each object moves at each frame."""
        count = len(self.artifact("groups").read_table(0)["group"])
        return moving_objects(self.artifact("groups"), 0, len(self.probe.times), count)


class OpenStore:
    """The finished videos of a store: ``open_store(path)["goat"]``."""

    def __init__(self, path: str | Path) -> None:
        self.store = Store.open(path, create=False)

    def __getitem__(self, name: str) -> Result:
        return self.get(name)

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys(name for run in list_runs(self.store) for name in run["videos"]))

    def get(self, name: str, run: str | None = None) -> Result:
        """One video: of the run ``run``, else of the latest finished one, to the end if there is one.

        Raises
        ------
        StoreError
            There is no such run.
        """
        found = [
            record
            for record in reversed(list_runs(self.store))
            if name in record["videos"]
            and name not in record.get("failures", {})
            and record["outcome"] in ("done", "failed")
            and run in (None, record["id"])
        ]
        whole = [record for record in found if LAST in record["videos"][name]["keys"]]
        for record in [*whole, *found]:
            entry = record["videos"][name]
            return Result(self.store, name, entry["video"], entry["keys"])
        raise StoreError(
            f"{self.store.path}: no finished run {run + ' ' if run else ''}of {name!r}; "
            "zsmoseg status and zsmoseg runs list what is there"
        )


def open_store(path: str | Path) -> OpenStore:
    """Open a store for reading."""
    return OpenStore(path)
