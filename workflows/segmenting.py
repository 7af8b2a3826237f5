"""``segment``: one video from Python, as ``zsmoseg run`` does it."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from numbers import Integral
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, Literal

from zsmoseg.errors import SettingsError, StageError, VideoError
from zsmoseg.remote.url import folder, given_path
from zsmoseg.settings import Settings, resolve
from zsmoseg.workflows.result import Result, open_store
from zsmoseg.workflows.running.callback import Progress, Told
from zsmoseg.workflows.running.progress import make_watcher
from zsmoseg.workflows.running.request import Quiet, Request, Watcher
from zsmoseg.workflows.running.run import found_in, run

if TYPE_CHECKING:
    from distributed import Client


def segment(
    source: str | PurePath,
    groups: int | Literal["auto"] = "auto",
    *,
    out: str | PurePath = "zsmoseg-out",
    store: str | PurePath = "zsmoseg-store",
    preset: str = "embedded",
    settings: Mapping[str, Any] | None = None,
    scheduler: str | Client | None = None,
    workers: int | None = None,
    progress: bool | Progress = True,
) -> Result:
    """Segment one video.

    Parameters
    ----------
    source : video file, folder of frames, or glob of images; a path or a URL.
    groups : number of groups, the static one included, or ``"auto"``.
    out, store : where the masks and the artifacts go: folders, or URLs as ``s3://bucket/name``.
    preset, settings : a preset, and settings by dotted name on top of it.
    scheduler : ``"serial"``, ``"local"``, the address of a Dask scheduler, or a ``distributed.Client``; without it
        ``"local"`` where ``workers`` are asked for, else ``"serial"``.
    workers : processes on this machine.
    progress : ``True``: bars on a terminal, lines elsewhere, on stderr; ``False``: nothing; or a function that is called
        with the parts done, the parts in all, and the stage that was done last.

    Raises
    ------
    ZsmosegError
        Bad input, or a part that failed.
    """
    source, out, store = (
        given_path(value, name) for value, name in ((source, "source"), (out, "out"), (store, "store"))
    )
    where = scheduler if scheduler is not None else "serial" if workers is None else "local"
    if workers is not None and not (isinstance(workers, int) and workers >= 1 and where == "local"):
        raise SettingsError(f"workers = {workers!r}: expected 1 or more, with scheduler 'local' or none")
    chosen = _settings(groups, preset, {} if settings is None else settings)
    request = Request([str(source)], folder(out), folder(store), chosen, where, workers)
    found = [name for _, name in found_in(request)]
    if len(found) > 1:
        raise VideoError(
            f"{source}: holds {len(found)} videos, {', '.join(found[:2])}, ...; give segment one of them, or all to zsmoseg run"
        )
    with ExitStack() as stack:
        report = run(request, _watcher(progress, stack))
    if report.failures:
        raise StageError(next(iter(report.failures.values())))
    return open_store(store).get(report.names[0], report.run)


def _settings(groups: int | str, preset: str, given: Mapping[str, Any]) -> Settings:
    """All settings; ``groups`` is one of them by a shorter name."""
    if not isinstance(given, Mapping):
        raise SettingsError(
            f"settings are of type {type(given).__name__}; give a mapping, as {{'groups.count': 2}}"
        )
    if not isinstance(groups, str | Integral):
        raise SettingsError(f"groups are of type {type(groups).__name__}; give a number or 'auto'")
    count = given.get("groups.count", groups)
    if groups not in ("auto", count):
        raise SettingsError(f"groups = {groups!r}: settings say groups.count = {count!r}; give one of them")
    return resolve(preset, None, {**given, "groups.count": count})


def _watcher(progress: bool | Progress, stack: ExitStack) -> Watcher:
    if callable(progress):
        return Told(progress)
    return stack.enter_context(make_watcher()) if progress else Quiet()
