"""What is in the files that are brought, for the frames of a video; all of them read before anything is imported."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings as sections
from zsmoseg.depth.relative import relative
from zsmoseg.errors import FormatError
from zsmoseg.flow.warp import inverted, resized
from zsmoseg.formats.depth import DepthSource, inverse_depth, open_depth
from zsmoseg.formats.flow import FlowSource, open_flow
from zsmoseg.formats.frame_names import match_frames
from zsmoseg.formats.mask_formats import open_masks
from zsmoseg.formats.overlaps import FrameMasks, MaskSource, left_out_words
from zsmoseg.stores.imports import Brought
from zsmoseg.stores.location import Store
from zsmoseg.video.probe import Probe
from zsmoseg.video.sources import image_files, title
from zsmoseg.workflows.imports.fingerprints import fingerprint

Source = MaskSource | FlowSource | DepthSource

UNUSED = "entries of frames that are not used"
"""What is left out of files of more frames than a run has."""

SHAPE = 0.05
"""Share by which the shape of a depth map may differ from the frame's: networks round sides to multiples."""

FAR = 8
"""Longer sides of a frame: whoever writes flow beyond it, in x or y, means no motion but that none is known."""


OPEN: dict[str, Callable[[Any, Probe], Source]] = {
    "proposals": lambda s, probe: open_masks(Path(s.path), title(probe.source)),
    "flow": lambda s, probe: open_flow(Path(s.path)),
    "depth": lambda s, probe: open_depth(Path(s.path)),
}
"""How what is brought is opened, by its section."""


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
    """Flow forward and backward (2, h, w) of the pairs ``start`` to ``stop - 1``, px of the working grid; NaN = unknown.

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
        forward = _fitting(source.read(place, "forward"), s.path, probe, pair, grid)
        if source.has_backward:
            yield forward, _fitting(source.read(place, "backward"), s.path, probe, pair, grid)
        else:
            yield forward, inverted(forward)


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
        if abs(values.shape[1] / values.shape[0] * probe.height / probe.width - 1) > SHAPE:
            raise FormatError(
                _other_size(f"{s.path}: the depth of frame {probe.names[frame]}", values.shape, probe)
            )
        assert s.kind != ""
        inverse = relative(inverse_depth(values, s.kind), grid)
        if not np.isfinite(inverse).any():
            raise FormatError(
                f"{s.path}: the depth of frame {probe.names[frame]} is unknown everywhere; every frame needs one that is "
                "known somewhere: make it anew"
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
        left_out: Counter[str] = Counter()
        seen = 0
        for masks in masks_of(section, probe, 0, frames):
            if masks is not None:
                left_out += masks.left_out
                seen += bool(masks.label.any())
        if not seen:
            source = open_masks(Path(section.path), title(probe.source))
            words = left_out_words(left_out + source.left_out), *source.notes
            raise FormatError(
                f"{section.path}: has no mask in any of the {frames} frames{'; '.join(words)}; give masks that cover pixels of them"
            )
    elif kind == "flow":
        for _ in flow_of(section, probe, 0, frames - 1, grid):
            pass
    else:
        for _ in depth_of(section, probe, 0, frames, grid):
            pass


def passed_over(kind: str, section: Any, probe: Probe) -> dict[str, Any]:
    """What of the files is used for no frame, how many of what, and how they were understood: facts for a record."""
    source = OPEN[kind](section, probe)
    places = _places(source, section.path, probe)
    used = set(places[:-1] if kind == "flow" else places) - {None}
    left_out = source.left_out + Counter({UNUSED: source.count - len(used)})
    return {"left_out": dict(left_out), "notes": getattr(source, "notes", [])}


def count_unknown(facts: dict[str, Any], values: NDArray[np.float32]) -> None:
    """Add the pixels (h, w) of a cue to ``facts``, and those that are unknown."""
    facts["pixels"] = facts.get("pixels", 0) + values.size
    facts["unknown"] = facts.get("unknown", 0) + int(np.isnan(values).sum())


def _places(source: Source, path: str, probe: Probe) -> list[int | None]:
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
    """A flow of the displayed size, or of the working grid already, on the working grid; what is too far is unknown."""
    if flow.shape[1:] not in ((probe.height, probe.width), grid):
        raise FormatError(
            _other_size(f"{path}: the flow of frame {probe.names[pair]}", flow.shape[1:], probe)
        )
    far = np.abs(flow).max(axis=0) > FAR * max(flow.shape[1:])
    return resized(np.where(far, np.float32(np.nan), flow), grid)


def _other_size(what: str, shape: tuple[int, ...], probe: Probe) -> str:
    return f"{what}: {shape[1]} x {shape[0]}, the frame is {probe.width} x {probe.height}; give them at that size"
