"""Results for other tools: one file or folder a video and cue, which appears whole or not at all."""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from zsmoseg.errors import FormatError, OutputError, SettingsError, StoreError
from zsmoseg.formats.mots import PER_CLASS
from zsmoseg.stores import files
from zsmoseg.workflows.export.painting import number_tables
from zsmoseg.workflows.export.writers import CUE_WRITERS, WRITERS, Choice, Writer
from zsmoseg.workflows.result import Result

IDS = ("davis", "npz", "coco", "ytvis", "mots")
KEEP = ("colmap", "nerfstudio")
CUES = ("npy", "png")
COPIES = ("netcdf", "zarr")
ENDINGS = {"npz": ".npz", "coco": ".json", "ytvis": ".json", "mots": ".txt", "netcdf": ".nc", "zarr": ".zarr"}


def choose(
    format: str,
    what: str | None = None,
    when: Literal["ever", "now"] | None = None,
    dilate: int | None = None,
    cues: Sequence[str] | None = None,
) -> Choice:
    """A format and its options; None where one was not given.

    Raises
    ------
    SettingsError
        If an option would do nothing for the format, or is out of range.
    """
    for option, given, where in (
        ("--what", what, (*IDS, *COPIES)),
        ("--when", when, (*IDS, *KEEP, *COPIES)),
        ("--dilate", dilate, KEEP),
        ("--cue", cues, (*CUES, *COPIES)),
    ):
        if given is not None and format not in where:
            raise SettingsError(
                f"{option} does nothing for {format}; leave it out (it is for {', '.join(where)})"
            )
    if when is not None and what == "object":
        raise SettingsError(f"--when {when} does nothing for --what object: all are painted; leave it out")
    if dilate is not None and dilate < 0:
        raise SettingsError(f"--dilate {dilate}: must be 0 px or more")
    return Choice(
        format, what or "group", when or "ever", dilate or 0, tuple(dict.fromkeys(cues or ["flow"]))
    )


def export(results: Sequence[Result], out: Path, choice: Choice) -> Iterator[Path]:
    """Write what is chosen of some videos.

    Yields
    ------
    Each file or folder when it is there.

    Raises
    ------
    OutputError
        If one of them is there already, before anything is written.
    StoreError
        If a run has not what is asked for.
    """
    jobs = [job for result in results for job in _jobs(result, out, choice)]
    if (out / "zsmoseg.json").exists() or (out.exists() and not out.is_dir()):
        raise OutputError(f"{out}: is {'a store' if out.is_dir() else 'a file'}; give another folder (-o)")
    for path, _, _ in jobs:
        if path.exists():
            raise OutputError(f"{path}: is there already; nothing is written over: give another folder (-o)")
    for path, write, result in jobs:
        with appearing(path) as partial:
            write(result, partial, choice)
        yield path


Job = tuple[Path, Writer, Result]


def _jobs(result: Result, out: Path, choice: Choice) -> list[Job]:
    """Every file or folder of one video, and what writes it."""
    if choice.format in (*CUES, *COPIES, "flo"):
        _check_cues(result, choice.cues)
    name, format = result.name, choice.format
    if format in (*CUES, "flo"):
        return [(out / cue / name, CUE_WRITERS[cue], result) for cue in choice.cues]
    if format == "mots" and number_tables(result, choice.what, choice.when).max(initial=0) >= PER_CLASS:
        raise FormatError(f"{name}: MOTS text numbers at most {PER_CLASS - 1} objects; use another format")
    return [(out / f"{name}{ENDINGS.get(format, '')}", WRITERS[format], result)]


def _check_cues(result: Result, cues: Sequence[str]) -> None:
    for cue in cues:
        if not result.artifact(cue).arrays:
            raise StoreError(
                f"{result.name}: this run has no {cue}; run it with one, or leave out --cue {cue}"
            )


@contextmanager
def appearing(path: Path) -> Iterator[Path]:
    """A path to write to; what is there at the end takes the name ``path``, after an error it is removed.

    Raises
    ------
    OutputError
        If the disk is full or the folder closed.
    """
    partial = path.with_name(f".{path.name}.{uuid.uuid4().hex}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield partial
        partial.rename(path)
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written ({error.strerror or error}); give another folder (-o)"
        ) from error
    finally:
        files.remove(partial)
