"""Results for other tools: one file or folder a video and cue, which appears whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import Literal

from zsmoseg.errors import OutputError, SettingsError, StoreError
from zsmoseg.metrics.registries import entry
from zsmoseg.stores import files
from zsmoseg.workflows.export.registry import FORMATS, Choice, taking
from zsmoseg.workflows.result import Result


def choose(
    format: str,
    what: str | None = None,
    when: Literal["ever", "now"] | None = None,
    dilate: int | None = None,
    cues: Sequence[str] | None = None,
    images: str | None = None,
) -> Choice:
    """A format and its options; None where one was not given.

    Raises
    ------
    SettingsError
        If there is no such format, or an option would do nothing for it or is out of range.
    """
    options = entry(FORMATS, "format", format).options
    told = {"what": what, "when": when, "dilate": dilate, "cue": cues, "images": images}
    for option, given in told.items():
        if given is not None and option not in options:
            raise SettingsError(
                f"--{option} does nothing for {format}; leave it out (it is for {taking(option)})"
            )
    if when is not None and what == "object":
        raise SettingsError(f"--when {when} does nothing for --what object: all are painted; leave it out")
    if dilate is not None and dilate < 0:
        raise SettingsError(f"--dilate {dilate}: must be 0 px or more")
    chosen = tuple(dict.fromkeys(cues or ["flow"]))
    return Choice(format, what or "group", when or "ever", dilate or 0, chosen, images or "")


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
    format = entry(FORMATS, "format", choice.format)
    jobs = [job for result in results for job in _jobs(result, out, choice)]
    if files.is_link(out):
        raise OutputError(f"{out}: is a link; give the folder itself (-o)")
    if (out / "zsmoseg.json").exists() or (out.exists() and not out.is_dir()):
        raise OutputError(f"{out}: is {'a store' if out.is_dir() else 'a file'}; give another folder (-o)")
    for path, _, _ in jobs:
        if path.exists():
            raise OutputError(f"{path}: is there already; nothing is written over: give another folder (-o)")
    for path, result, part in jobs:
        try:
            with files.appearing(path) as partial:
                format.write(result, partial, part)
        except OSError as error:
            raise OutputError(
                f"{path}: cannot be written ({error.strerror or error}); give another folder (-o)"
            ) from error
        yield path


Job = tuple[Path, Result, Choice]


def _jobs(result: Result, out: Path, choice: Choice) -> list[Job]:
    """Every file or folder of one video, and what is in it."""
    format = entry(FORMATS, "format", choice.format)
    if format.cues != "none":
        _check_cues(result, choice.cues)
    if format.check is not None:
        format.check(result, choice)
    parts = [replace(choice, cues=(cue,)) for cue in choice.cues] if format.cues == "each" else [choice]
    return [(format.path(out, result.name, part.cues[0]), result, part) for part in parts]


def _again(result: Result) -> str:
    """The command that runs the video once more, into the same folders."""
    told = {"--store": result.store.path, "-o": files.folder(result.out).parent if result.out else None}
    given = [f"{option} {quote(str(path))}" for option, path in told.items() if path is not None]
    return " ".join(["zsmoseg run", quote(result.probe.source), *given])


def _check_cues(result: Result, cues: Sequence[str]) -> None:
    for cue in cues:
        if not result.artifact(cue).exists:
            raise StoreError(
                f"{result.name}: its {cue} is not in the store (any more); make it again with "
                f"{_again(result)} --from {cue}"
            )
        if not result.artifact(cue).arrays:
            raise StoreError(
                f"{result.name}: this run has no {cue}; run it with one, or leave out --cue {cue}"
            )
