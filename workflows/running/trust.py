"""What was read must be what the key says: looked at after the reading, before a part counts as done.

A look before the reading would not do: a file may change between the look and the use. A file that nobody touched is
known again by its times, size and inode, so the look costs a stat; one that was touched is hashed.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zsmoseg.errors import FormatError, SettingsError, VideoError

if TYPE_CHECKING:
    from zsmoseg.stores.location import Store
    from zsmoseg.workflows.planning.plan import StagePlan, VideoPlan
    from zsmoseg.workflows.stage import Part

AGAIN = (
    "changed since the run was planned: nothing of it is kept under the old key; run the same command again"
)


def promised(plan: VideoPlan, stage: StagePlan, method: str) -> dict[str, str]:
    """What the key of a stage says of files that its tasks read: fingerprints, by what is read.

    Parameters
    ----------
    method
        How the source is recognised: ``video.fingerprint``.
    """
    brought = {kind: found.fingerprint for kind, found in plan.brought.items()}
    ignore = stage.acting.get("ignore", {}).get("mask", "")
    return {"source": plan.fingerprint, "method": method, "ignore": ignore, **brought}


def refuse_changed(promise: Mapping[str, str], stage: str, part: Part, sections: Any, store: Store) -> None:
    """Raise where something that a task has read is not what its key says.

    Parameters
    ----------
    promise
        See ``promised``.
    stage
        Its name: files that are brought are read by the stage that has the name of what they bring.
    sections
        The settings that the task read.

    Raises
    ------
    VideoError, FormatError, SettingsError
        The source, files that were brought, the ignore mask.
    """
    from zsmoseg.workflows.imports.fingerprints import fingerprint

    if (
        part.decoded
        and _now(lambda: store.fingerprint(part.probe.source, promise["method"])) != promise["source"]
    ):
        raise VideoError(f"{part.probe.source}: {AGAIN}")
    section = getattr(sections, stage, None)
    if stage in promise and section is not None and section.source == "imported":
        path = Path(section.path)
        if _now(lambda: fingerprint(store, path)) != promise[stage]:
            raise FormatError(f"{path}: {AGAIN}")
    ignore = getattr(sections, "ignore", None)
    if ignore is not None and ignore.mask and _now(lambda: str(ignore.active()["mask"])) != promise["ignore"]:
        raise SettingsError(f"{ignore.mask}: {AGAIN}")


def _now(look: Any) -> str:
    """What is there now; nothing where it cannot be read any more."""
    try:
        return str(look())
    except (OSError, SettingsError):
        return ""
