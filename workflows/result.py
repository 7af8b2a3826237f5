"""What is finished, in Python: ``open_store``, and everything of a video, read lazily."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from zsmoseg.errors import SettingsError, StoreError, ZsmosegError
from zsmoseg.remote.url import given_path
from zsmoseg.stores import files
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.dataset import open_dataset
from zsmoseg.stores.location import Store
from zsmoseg.stores.output import SUMMARY
from zsmoseg.stores.records import as_json, read_json
from zsmoseg.stores.runs import DONE, Entry, entries, latest, read_run
from zsmoseg.video.probe import Probe
from zsmoseg.workflows.object_numbers import objects, objects_of_pieces
from zsmoseg.workflows.shown import as_html, as_text
from zsmoseg.workflows.stages.front_end import Labels
from zsmoseg.workflows.stages.motion.affinity import Affinity
from zsmoseg.workflows.stages.motion.groups import Groups, moving_objects
from zsmoseg.workflows.stages.proposed.objects import MaskObjects, object_names
from zsmoseg.workflows.warned import warnings_of
from zsmoseg.workflows.wording import counted

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from numpy.typing import NDArray


Kind = Literal["moving", "group", "instance"]
"""What masks tell apart."""
MEANING: dict[Kind, str] = {
    "moving": "whether the pixel moves by itself",
    "group": "motion group, 0 = static",
    "instance": "object that moves, 0 = static",
}
BLOCK = 16
"""Frames that a lazy mask reads at once."""
EVIDENCE = ("excess", "tolerance", "world")
"""Columns of the tables of objects and of pieces."""
READ = "masks(), moving(), objects, pieces, tree, groups, affinity, labels, categories, warnings, settings, summary"
"""What a result is asked for."""
MOST = 20
"""Videos of a store that are named."""
LAST = "masks"
"""What a run to the end reaches."""


@dataclass(frozen=True)
class Result:
    """One finished video in a store, of the run ``run``; its files are in ``out``."""

    store: Store
    name: str
    video: str
    keys: dict[str, str]
    run: str
    out: str

    @classmethod
    def of(cls, store: Store, entry: Entry) -> Result:
        """What a run left of a video."""
        return cls(store, entry.name, entry.video, dict(entry.keys), entry.run, entry.out)

    def __repr__(self) -> str:
        return as_text(f"{self.name}, run {self.run} in {self.store.path}", self._told())

    def _repr_html_(self) -> str:
        table = self.objects.to_html(index=False, border=0) if LAST in self.keys else ""
        return as_html(f"{self.name}, run {self.run} in {self.store.path}", self._told(), table)

    def _told(self) -> list[str]:
        """What came out, in lines; what is damaged says so."""
        try:
            probe = self.probe
            frames = counted(len(probe.times), "frame")
            about = f"{frames} of {probe.width} x {probe.height} px from {probe.source}"
            if "groups" not in self.keys:
                return [about, f"stopped early (--until), has {', '.join(self.keys)}: tree, artifact(stage)"]
            groups = self.groups
            seen = np.unique(objects_of_pieces(groups)[groups.area > 0])
            objects = counted(int(np.count_nonzero(seen)), "object")
            moving = counted(len(np.unique(groups.group[groups.group > 0])), "moving group")
            return [about, f"{objects}, {moving}", *(f"warning: {text}" for text in self.warnings), READ]
        except ZsmosegError as error:
            return [str(error)]

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

    def masks(self, kind: Kind = "moving") -> xr.DataArray:
        """Masks (frame, y, x) called ``kind``, read when used.

        ``moving`` is bool; ``group`` and ``instance`` (objects) are the smallest unsigned integers that hold them, 0 = static.

        Raises
        ------
        SettingsError
            There is no such kind.
        """
        import xarray as xr

        if kind not in get_args(Kind):
            raise SettingsError(f"masks({kind!r}): expected one of {', '.join(get_args(Kind))}")
        labels = open_dataset(self.artifact("labels"))["label"]
        groups = self.groups
        number: NDArray[Any] = groups.instance if kind == "instance" else groups.group
        number = number > 0 if kind == "moving" else number.astype(np.min_scalar_type(number.max(initial=0)))
        chunked = labels.chunk(frame=BLOCK)
        masks: xr.DataArray = xr.apply_ufunc(
            lambda label: number[label], chunked, dask="parallelized", output_dtypes=[number.dtype]
        )
        return masks.rename(kind).assign_attrs(long_name=MEANING[kind])

    @property
    def warnings(self) -> list[str]:
        """What the result warns of; empty where it has nothing to warn of."""
        groups = self.artifact("groups")
        record = groups.part(0)
        if record is None:
            raise StoreError(f"{self.name}: its groups are gone or damaged; run the same command again")
        return warnings_of(
            record.facts["warnings"], groups, self.artifact("objects") if "proposals" in self.keys else None
        )

    @property
    def settings(self) -> dict[str, Any]:
        """Every setting of the run, by dotted name; ``segment(..., settings=result.settings)`` repeats it."""
        record = read_run(self.store, self.run)
        if record is None:
            raise StoreError(f"{self.store.path}: the record of the run {self.run} is gone or damaged")
        return dict(record["settings"])

    @property
    def summary(self) -> dict[str, Any]:
        """``summary.json`` of the output folder."""
        path = files.folder(self.out) / SUMMARY if self.out else None
        found = read_json(path) if path is not None else None
        if found is None or found.get("keys") != as_json(self.keys):
            raise StoreError(
                f"{self.name}: {path or 'its run'} has no summary of this result (any more); run the same command again"
            )
        return found

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
        """One row an object: object, group, pieces, frames, frames_moving, area, then what is known of its main piece.

        That is excess (px), tolerance (px), world and visibility: see ``pieces``. Object 0 is the background; numbers are
        those of ``objects/``, ``motion.csv``, ``summary.json`` and exports.
        """
        import pandas as pd

        found = list(objects(self.groups, self.labels))
        pieces = self.pieces.set_index("piece").loc[[thing.number for thing in found]].reset_index(drop=True)
        own = pd.DataFrame(
            {
                "object": [thing.number for thing in found],
                "group": pieces["group"],
                "pieces": [tuple(thing.pieces) for thing in found],
                "frames": [thing.frames for thing in found],
                "frames_moving": [thing.frames_moving for thing in found],
                "area": [thing.area for thing in found],
            }
        )
        return own.join(pieces.drop(columns=own.columns, errors="ignore"))

    @property
    def pieces(self) -> pd.DataFrame:
        """One row a piece, as it was proposed: piece, the object that it belongs to, group, frames, area, evidence.

        ``world`` is the affinity with the static world, tolerance / (tolerance + excess): one half = at the tolerance.
        ``reason``: what decided (``zsmoseg.grouping.decisions``). ``geometry``: whether it obeys that of the static world, or
        why that is not known, with what was measured: ``front``, ``error``, ``parallax``, ``foot``, ``beside``; ``counts``: whether its
        evidence counts beside what obeys. Of proposed masks also ``origin``, the id in the files, and
        ``category`` where a network named them.
        """
        import pandas as pd

        groups = self.groups
        columns = {
            "piece": groups.object,
            "object": objects_of_pieces(groups),
            **{name: getattr(groups, name) for name in ("group", "frames", "frames_moving", "area")},
            **{name: getattr(groups, name) for name in (*EVIDENCE, "reason")},
            **self.affinity.evidence(len(groups.group)),
        }
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
        self.store = Store.open(given_path(path, "path"), create=False)

    def __getitem__(self, name: str) -> Result:
        return self.get(name)

    def __iter__(self) -> Iterator[str]:
        for name, entry in latest(self.store).items():
            if entry.outcome == DONE or self._finished(name):
                yield name

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and bool(self._finished(name))

    def __repr__(self) -> str:
        return as_text(*self._told())

    def _repr_html_(self) -> str:
        return as_html(*self._told())

    def _told(self) -> tuple[str, list[str]]:
        names = list(self)
        more = [f"... and {len(names) - MOST} more"] if len(names) > MOST else []
        title = f"store {self.store.path}, {counted(len(names), 'finished video')}"
        return title, [*(f"[{name!r}]" for name in names[:MOST]), *more]

    def _ipython_key_completions_(self) -> list[str]:
        """What Tab offers in ``store["``."""
        return list(self)

    def _finished(self, name: str) -> list[Entry]:
        """What finished runs left of a video, the latest first, those to the end before others."""
        found = [entry for entry in reversed(entries(self.store, name)) if entry.outcome == DONE]
        return sorted(found, key=lambda entry: LAST not in entry.keys)

    def get(self, name: str, run: str | None = None) -> Result:
        """One video: of the run ``run``, else of the latest finished one, to the end if there is one.

        Raises
        ------
        StoreError
            There is no such run.
        SettingsError
            The name is no text.
        """
        if not isinstance(name, str):
            raise SettingsError(
                f"the name of a video is of type {type(name).__name__}; give one of those that list(store) has, as text"
            )
        for entry in self._finished(name):
            if run in (None, entry.run):
                return Result.of(self.store, entry)
        raise StoreError(
            f"{self.store.path}: no finished run {f'{run} ' if run else ''}of {name!r}; "
            "zsmoseg status and zsmoseg runs list what is there"
        )


def open_store(path: str | PurePath) -> OpenStore:
    """Open a store for reading."""
    return OpenStore(path)
