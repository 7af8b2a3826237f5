"""How the artifacts of a video were when a run had finished it: a plan knows them again by one listing, and reads nothing.

A digest of an artifact is made of names, sizes and stamps of its files (``files.stamp``: it changes whenever one is written,
moved or touched). Where it is another, or unknown, the records are looked at. Standard library only.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import PurePath

from zsmoseg.stores import files
from zsmoseg.stores.records import ARCHIVE, DESCRIPTION, PROBES

VIDEO = "video"
"""Under this name what is no artifact: who the video is, its probe, leases that a killed run left."""


def look(video: PurePath, keys: Mapping[str, str]) -> dict[str, str]:
    """The digests of those artifacts of a video that are there, by stage, and under ``VIDEO`` that of the rest.

    Parameters
    ----------
    video
        Its folder.
    keys
        By stage.
    """
    whose = {f"{stage}/{key}": stage for stage, key in keys.items()}
    whose |= {DESCRIPTION: VIDEO, f"{PROBES}/{keys['frames']}.json": VIDEO}
    found: dict[str, list[str]] = {}
    for name, stat in files.listing(video).items():
        place = "/".join(name.split("/")[:2])
        stage = (
            VIDEO
            if files.is_ours(name, leases=True)
            else whose.get(place) or whose.get(place.removesuffix(ARCHIVE))
        )
        if stage is not None:
            found.setdefault(stage, []).append(f"{name} {stat.size} {stat.stamp}")
    return {stage: _digest(lines) for stage, lines in found.items()}


def known(noted: Mapping[str, str], now: Mapping[str, str], keys: Mapping[str, str]) -> set[tuple[str, str]]:
    """The stages, each with its key, that are now as they were ``noted``; (``VIDEO``, "") for the rest."""
    return {(stage, keys.get(stage, "")) for stage, digest in now.items() if noted.get(stage) == digest}


def _digest(lines: list[str]) -> str:
    return hashlib.blake2b("\n".join(sorted(lines)).encode(), digest_size=10).hexdigest()
