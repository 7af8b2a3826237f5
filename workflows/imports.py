"""Masks, flow and depth that users bring: where they are for each video, whether they fit, what was brought before.

``zsmoseg import`` notes in ``VIDEO/imports.json`` what it brought, and a later run with ``source = auto`` takes
that. In a key the fingerprint of the files stands for their path.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings as sections
from zsmoseg.depth.relative import relative
from zsmoseg.errors import FormatError, SettingsError, StoreError
from zsmoseg.flow.warp import inverted, resized
from zsmoseg.formats.depth import DepthSource, inverse_depth, open_depth
from zsmoseg.formats.flow import FlowSource, open_flow
from zsmoseg.formats.mask_formats import FrameMasks, MaskSource, open_masks
from zsmoseg.formats.names import find_for_video, match_frames
from zsmoseg.stores.location import Store
from zsmoseg.stores.records import read_record, write_record
from zsmoseg.video.probe import Probe
from zsmoseg.video.sources import image_files, title

KINDS = {"proposals": "embedded", "flow": "dis", "depth": "constant"}
"""What can be brought, and what ``auto`` means without an import."""
RECORD = "imports.json"


@dataclass(frozen=True)
class Brought:
    """One cue that was brought for a video."""

    path: str
    fingerprint: str
    kind: str = ""


def brought_before(store: Store, video: str) -> dict[str, Brought]:
    """What ``zsmoseg import`` brought for a video of the store, by kind.

    Raises
    ------
    StoreError
        The record of it is damaged: without it other cues would be used.
    """
    path = store.video(video).path / RECORD
    found = read_record(path)
    if found is None and path.exists():
        raise StoreError(
            f"{path}: is damaged; zsmoseg import again what you had imported, or remove the file"
        )
    return {name: Brought(**entry) for name, entry in (found or {}).items()}


def remember(store: Store, video: str, brought: Mapping[str, Brought]) -> None:
    """Note what was brought; what was brought before of the same kind gives way."""
    known = {**brought_before(store, video), **brought}
    write_record(store.video(video).path / RECORD, {name: asdict(entry) for name, entry in known.items()})


def settle(
    settings: sections.Settings, store: Store, name: str, video: str, alone: bool = True
) -> tuple[sections.Settings, dict[str, Brought]]:
    """The settings for one video, with every ``auto`` source decided, and what is brought.

    Files of one video are no files of several: unless the video is ``alone``, a path must hold something for it.

    Raises
    ------
    SettingsError
        A path whose source says otherwise; ``imported`` where nothing was; depth without the word for it.
    FormatError
        Nothing for this video at the path.
    """
    before = brought_before(store, video)
    brought: dict[str, Brought] = {}
    update: dict[str, Any] = {}
    for kind, plain in KINDS.items():
        section = getattr(settings, kind)
        found = _brought(section, kind, store, name, before.get(kind), alone)
        if found is None:
            update[kind] = section.model_copy(
                update={"source": plain if section.source == "auto" else section.source}
            )
        else:
            brought[kind] = found
            told = {"kind": found.kind} if "kind" in type(section).model_fields else {}
            update[kind] = section.model_copy(update={"source": "imported", "path": found.path, **told})
    if "flow" in brought and settings.video.every != 1:
        raise SettingsError(
            f"video.every = {settings.video.every}: imported flow leads from each frame to the next; use --every 1"
        )
    depth = update["depth"].source != "constant"
    update["motion"] = settings.motion.model_copy(update={"model": settings.motion.chosen(depth)})
    return settings.model_copy(update=update), brought


def _brought(
    section: Any, kind: str, store: Store, name: str, before: Brought | None, alone: bool
) -> Brought | None:
    if section.source not in ("auto", "imported"):
        if section.path:
            raise SettingsError(
                f"{kind}.path is given but {kind}.source = {section.source}; leave one of them out"
            )
        return None
    if not section.path:
        if section.source == "imported" and before is None:
            raise SettingsError(
                f"{kind}.source = imported: nothing was imported for {name}; give --{kind} PATH, or zsmoseg import first"
            )
        return before
    if kind == "depth" and not section.kind:
        raise SettingsError(
            f"{section.path}: say what the numbers are: --depth-is depth (larger = farther) or inverse-depth"
        )
    path = find_for_video(Path(section.path), name).absolute()
    if not alone and path == Path(section.path).absolute() and path.suffix != ".json":
        raise FormatError(
            f"{section.path}: holds nothing for {name}; with several videos it must hold one entry for each"
        )
    word = getattr(section, "kind", "")
    if word == "auto":
        word = "ids" if open_masks(path, name).ids else "masks"
    return Brought(str(path), fingerprint(store, path), word)


def fingerprint(store: Store, path: Path) -> str:
    """Hash of names and content of a file or folder; known again while no file was touched."""
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    stats = [(str(p), s.st_size, s.st_mtime_ns, s.st_ino) for p in files for s in [p.stat()]]

    def compute() -> str:
        whole = hashlib.sha256()
        for file in files:
            with file.open("rb") as stream:
                whole.update(
                    f"{file.relative_to(path.parent)} {hashlib.file_digest(stream, 'sha256').hexdigest()}\n".encode()
                )
        return whole.hexdigest()[:20]

    return store.fingerprint_of(f"import {stats}", compute)


# ------------------------------------------------------------------ what is in the files
def masks_of(s: sections.Proposals, probe: Probe, start: int, stop: int) -> Iterator[FrameMasks | None]:
    """The masks of the frames ``start`` to ``stop - 1``, at the displayed size; None where a frame has none.

    Raises
    ------
    FormatError
        A file that cannot be used: unreadable, of other size, of other names.
    """
    source = open_masks(Path(s.path), title(probe.source))
    for name, place in list(zip(probe.names, _places(source, s.path, probe), strict=True))[start:stop]:
        masks = None if place is None else source.read(place)
        if masks is not None and masks.label.shape != (probe.height, probe.width):
            raise FormatError(_other_size(f"{s.path}: the masks of frame {name}", masks.label.shape, probe))
        yield masks


def flow_of(
    s: sections.Flow, probe: Probe, start: int, stop: int, grid: tuple[int, int]
) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """Flow there and back (2, h, w) of the pairs ``start`` to ``stop - 1``, px of the working grid; NaN = unknown.

    Where the files have one direction only the other is its inverse.

    Raises
    ------
    FormatError
        A file that cannot be used: unreadable, missing, of other size, not finite.
    """
    source = open_flow(Path(s.path))
    places = _places(source, s.path, probe)
    for pair in range(start, stop):
        place = places[pair]
        if place is None:
            raise FormatError(
                f"{s.path}: no flow for frame {probe.names[pair]}; every frame but the last needs one"
            )
        there = _fitting(source.read(place, "forward"), s.path, probe, pair, grid)
        if source.has_backward:
            yield there, _fitting(source.read(place, "backward"), s.path, probe, pair, grid)
        else:
            yield there, inverted(there)


def depth_of(
    s: sections.Depth, probe: Probe, start: int, stop: int, grid: tuple[int, int]
) -> Iterator[NDArray[np.float32]]:
    """Relative inverse depth (h, w) of the frames ``start`` to ``stop - 1``, of mean 1; NaN = unknown.

    Raises
    ------
    FormatError
        A file that cannot be used: unreadable, missing, of another shape.
    """
    source = open_depth(Path(s.path))
    places = _places(source, s.path, probe)
    for frame in range(start, stop):
        place = places[frame]
        if place is None:
            raise FormatError(f"{s.path}: no depth for frame {probe.names[frame]}; every frame needs one")
        values = source.read(place)
        if abs(values.shape[1] / values.shape[0] * probe.height / probe.width - 1) > 0.05:
            raise FormatError(
                _other_size(f"{s.path}: the depth of frame {probe.names[frame]}", values.shape, probe)
            )
        assert s.kind != ""
        inverse = relative(inverse_depth(values, s.kind), grid)
        if not np.isfinite(inverse).any():
            raise FormatError(
                f"{s.path}: the depth of frame {probe.names[frame]} is unknown everywhere; leave it out"
            )
        yield inverse


def check(
    store: Store, kind: str, brought: Brought, section: Any, probe: Probe, grid: tuple[int, int]
) -> None:
    """Read all that a cue needs of its files, so that nothing is imported in part, and nothing under a wrong key.

    Raises
    ------
    FormatError
        At the first file that cannot be used, or if they are not those that were imported.
    """
    if not Path(brought.path).exists() or fingerprint(store, Path(brought.path)) != brought.fingerprint:
        raise FormatError(f"{brought.path}: is gone or has changed since it was imported; import it again")
    frames = len(probe.times)
    if kind == "proposals":
        if not [
            masks for masks in masks_of(section, probe, 0, frames) if masks is not None and masks.label.any()
        ]:
            raise FormatError(
                f"{section.path}: has no mask in any of the {frames} frames; names must be those of the frames"
            )
    elif kind == "flow":
        for _ in flow_of(section, probe, 0, frames - 1, grid):
            pass
    else:
        for _ in depth_of(section, probe, 0, frames, grid):
            pass


def _places(source: MaskSource | FlowSource | DepthSource, path: str, probe: Probe) -> list[int | None]:
    """Which entry of the files belongs to each used frame; entries of frames that are not used are passed over.

    Flow may have one entry less than there are frames.
    """
    entries = source.entries if isinstance(source, MaskSource) else source.frames or source.count
    used, everything = list(probe.names), _source_names(probe)
    if isinstance(entries, int):
        for names, chosen in ((everything, list(probe.indices)), (used, list(range(len(used))))):
            short = isinstance(source, FlowSource) and entries == len(names) - 1
            if entries == len(names) - short:
                return [i if i < entries else None for i in chosen]
        return [*match_frames(entries, used, path)]
    found = match_frames(entries, everything, path)
    return [found[i] for i in probe.indices]


def _source_names(probe: Probe) -> list[str]:
    """The names of all frames of the source, used or not."""
    if probe.files:
        return [Path(file).stem for file in image_files(probe.source)]
    return [f"{i:05d}" for i in range(probe.total)]


def _fitting(
    flow: NDArray[np.float32], path: str, probe: Probe, pair: int, grid: tuple[int, int]
) -> NDArray[np.float32]:
    """A flow of the displayed size, or of the working grid already, on the working grid."""
    if flow.shape[1:] not in ((probe.height, probe.width), grid):
        raise FormatError(
            _other_size(f"{path}: the flow of frame {probe.names[pair]}", flow.shape[1:], probe)
        )
    return resized(flow, grid)


def _other_size(what: str, shape: tuple[int, ...], probe: Probe) -> str:
    return f"{what}: {shape[1]} x {shape[0]}, the frame is {probe.width} x {probe.height}; give them at that size"
