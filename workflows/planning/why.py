"""Why two keys of one stage differ, in words: what is different about the stage itself, and about what it is made from.

Keys are hashes; what they were made of is written beside each artifact. So two of them can be compared as long as their
artifacts are there, or are in a plan.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from zsmoseg.workflows.planning.differences import differences

Description = Mapping[str, Any]
"""What is written beside an artifact: stage, version, key, settings, inputs."""
Find = Callable[[str, str], Description | None]
"""The description of a stage with a key; None where nobody knows it any more."""


def why(old: Description, new: Description, find_old: Find, find_new: Find) -> list[str]:
    """A line for each difference, the nearest first; none where the keys are equal.

    Parameters
    ----------
    old, new
        Descriptions of one stage.
    find_old, find_new
        Where those of its inputs are.
    """
    found: dict[str, None] = {}
    seen: set[str] = set()

    def compare(stage: str, before: Description, after: Description) -> None:
        if before["key"] == after["key"] or stage in seen:
            return
        seen.add(stage)
        inputs = list(_inputs(before, after))
        own = list(_own(before, after))
        if not own and not inputs:
            own = ["the source, or a file that a setting names, has other content"]
        found.update(dict.fromkeys(f"{stage}: {line}" for line in own))
        for name, key_before, key_after in inputs:
            one, other = find_old(name, key_before), find_new(name, key_after)
            if one and other:
                compare(name, one, other)
            else:
                found[f"{stage}: made from another {name}; what that was made of is gone"] = None

    compare(str(new["stage"]), old, new)
    return list(found)


def _own(before: Description, after: Description) -> Iterator[str]:
    yield from differences(before.get("settings", {}), after["settings"])
    if before.get("version") != after["version"]:
        yield f"stage version: {before.get('version')} -> {after['version']}"
    gone, come = before["inputs"].keys() - after["inputs"], after["inputs"].keys() - before["inputs"]
    if gone or come:
        yield f"made from {', '.join(after['inputs'])}, before from {', '.join(before['inputs'])}"


def _inputs(before: Description, after: Description) -> Iterator[tuple[str, str, str]]:
    """The inputs that both have, with other keys."""
    for name, key in after["inputs"].items():
        if name in before["inputs"] and before["inputs"][name] != key:
            yield name, before["inputs"][name], key
