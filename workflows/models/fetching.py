"""Models into the cache: got beside their place, checked, and moved there only when whole."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Collection
from pathlib import Path

from zsmoseg.errors import ModelError, SpaceError
from zsmoseg.networks.contract import NAME, File, contract_of
from zsmoseg.workflows.models.adding import check_graphs
from zsmoseg.workflows.models.catalogue import Entry, entries
from zsmoseg.workflows.models.checking import check_file, findings
from zsmoseg.workflows.models.contract_text import parse, refuse_pickle, sha256_of, with_digests
from zsmoseg.workflows.models.downloading import NotThere, Watch, download
from zsmoseg.workflows.models.place import known_entry, models_folder, plain_name
from zsmoseg.workflows.models.settling_in import put_together, settle
from zsmoseg.workflows.models.unpacking import unpack


class UnknownDigests(ModelError):
    """Files are here whose sha256 nobody states; ``found`` has them by name."""

    def __init__(self, name: str, source: str | None, found: dict[str, str]) -> None:
        self.found = found
        listed = "; ".join(f"{file} has sha256 {digest}" for file, digest in found.items())
        repeat = f"{name} --from {source}" if source else name
        accepts = " ".join(f"--accept {digest}" for digest in found.values())
        super().__init__(
            f"model {name}: no publisher's sha256 is known, so you decide: {listed}. If you trust what arrived: "
            f"zsmoseg models fetch {repeat} {accepts} (nothing is fetched twice)"
        )


def fetch(name: str, source: str | None, accept: Collection[str], watch: Watch) -> Path:
    """Get a model of the registry into the cache.

    Parameters
    ----------
    name
        An entry of the registry.
    source
        A folder or base address that has the same files by name; None: the addresses of the registry.
    accept
        Digests (sha256, hexadecimal) that the user takes where the registry knows none.
    watch
        Told of every piece of a download.

    Returns
    -------
    Path
        The model's folder; what was there and is whole stays as it is.

    Raises
    ------
    ModelError
        Unknown name, no address, a file that is not there, of another size or content; nothing of it
        gets a place in the cache.
    SpaceError
        The disk is too small.
    """
    target = models_folder() / plain_name(name)
    wrong = findings(target) if target.exists() else []
    if target.exists() and not wrong:
        return target
    if wrong and name not in entries():
        raise ModelError(f"{wrong[0]}; this model is no one of the registry: add it again from where it came")
    entry = known_entry(name)
    if source is None and not entry.public:
        raise ModelError(f"model {name}: no pinned address is known ({entry.about()}); {entry.command()}")
    with put_together(target, keep=True) as work:
        _keep_whole(target, work, entry)
        parts = _parts(entry)
        _room(parts, entry, work)
        for part in parts:
            _get(part, entry, source, work, watch)
        if entry.archive is not None:
            unpack(work / entry.archive.file, [f.file for f in entry.files], work, entry.archive.unpacked)
        _write_contract(entry, work, source, accept)
        settle(work, target, [f.file for f in entry.files])
    return target


def _parts(entry: Entry) -> list[File]:
    """What is fetched: the files, or the archive that has them."""
    if entry.archive is None:
        return list(entry.files)
    archive = entry.archive
    return [File(file=archive.file, sha256=archive.sha256, bytes=archive.size, url=archive.url)]


def _keep_whole(target: Path, work: Path, entry: Entry) -> None:
    """Files of a damaged model that are as they should be need not be fetched again."""
    for file in entry.files:
        there = target / file.file
        if file.sha256 and there.is_file() and not check_file(there, file):
            os.replace(there, work / file.file)


def _room(parts: list[File], entry: Entry, work: Path) -> None:
    """Whether the disk takes what is still to come."""
    here = sum(path.stat().st_size for path in work.iterdir())
    wanted = sum(part.bytes or 0 for part in parts) + (entry.archive.unpacked if entry.archive else 0)
    free = shutil.disk_usage(work).free
    if wanted - here > free:
        raise SpaceError(
            f"{work.parent}: model {entry.name} needs {wanted / 1e6:.0f} MB, {free / 1e6:.0f} MB are free; "
            "make room, or set ZSMOSEG_MODELS to another disk"
        )


def _get(part: File, entry: Entry, source: str | None, work: Path, watch: Watch) -> None:
    """One file into the work folder, checked."""
    there = work / part.file
    if there.is_file() and part.sha256 and not check_file(there, part):
        return
    if source is None:
        download(part, part.url, work, entry.name, watch)
    elif source.startswith(("http://", "https://")):
        _from_base(part, entry, source.rstrip("/"), work, watch)
    else:
        _from_folder(part, entry, Path(source).expanduser(), work)
    refuse_pickle(there)
    if wrong := check_file(there, part):
        there.unlink()
        raise ModelError(f"model {entry.name}: {wrong}; nothing was kept of it")


def _from_base(part: File, entry: Entry, base: str, work: Path, watch: Watch) -> None:
    """From ``BASE/FILE``, or ``BASE/NAME/FILE`` as a copy of a cache has it."""
    try:
        download(part, f"{base}/{part.file}", work, entry.name, watch)
    except NotThere:
        download(part, f"{base}/{entry.name}/{part.file}", work, entry.name, watch)


def _from_folder(part: File, entry: Entry, folder: Path, work: Path) -> None:
    """From ``FOLDER/FILE``, or ``FOLDER/NAME/FILE``."""
    places = [folder / part.file, folder / entry.name / part.file]
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        raise ModelError(
            f"{folder}: has no {part.file} (nor {entry.name}/{part.file}); see zsmoseg models list"
        )
    if wrong := check_file(found, part):
        raise ModelError(f"model {entry.name}: {wrong}; not taken")
    shutil.copyfile(found, work / part.file)


def _write_contract(entry: Entry, work: Path, source: str | None, accept: Collection[str]) -> None:
    """The contract beside the files, with the digests that the user accepted."""
    found = {f.file: (sha256_of(work / f.file), (work / f.file).stat().st_size) for f in entry.files}
    unknown = {} if entry.archive else {f.file: found[f.file][0] for f in entry.files if not f.sha256}
    taken = {digest.lower().removeprefix("sha256:") for digest in accept}
    if open_ones := {file: digest for file, digest in unknown.items() if digest not in taken}:
        raise UnknownDigests(entry.name, source, open_ones)
    text = with_tensors(with_digests(entry.text, found, work), work)
    (work / NAME).write_text(text, encoding="utf-8")
    check_graphs(work)


def with_tensors(text: str, work: Path) -> str:
    """The contract with the names of outputs that an entry knows by their shape alone: ``"shape 1x2x360x480"``.

    Some exporters number tensors, and the numbers are published nowhere.

    Raises
    ------
    ModelError
        Not just one output has the shape.
    """
    wanted = re.search(r'"shape ([0-9x]+)"', text)
    if wanted is None:
        return text
    import onnxruntime

    (graph,) = contract_of(parse(text, work), work).graph.values()
    session = onnxruntime.InferenceSession(str(work / graph.file), providers=["CPUExecutionProvider"])
    shape = [int(side) for side in wanted[1].split("x")]
    named = [tensor.name for tensor in session.get_outputs() if tensor.shape == shape]
    if len(named) != 1:
        there = ", ".join(f"{t.name} {t.shape}" for t in session.get_outputs())
        raise ModelError(f"{work / graph.file}: one output should have the shape {shape}; it has {there}")
    return text.replace(wanted[0], f'"{named[0]}"')
