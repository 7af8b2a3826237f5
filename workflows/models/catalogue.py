"""The registry: contracts of known networks, where their files are to be had, and who may use them.

An entry is a contract (``entries/NAME.toml``, copied into the cache as it is) and a line of
``catalogue.toml`` for what is no property of the network: an archive its files are in, a base address
without a pinned revision, the exporter that makes it from a checkpoint.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from zsmoseg.networks.contract import File
from zsmoseg.workflows.models.contract_text import files_of, parse

HERE = files("zsmoseg.workflows.models")


@dataclass(frozen=True)
class Archive:
    """A zip file that holds the files of a model.

    Attributes
    ----------
    url, sha256, size
        As of any file; size in bytes.
    unpacked
        The most that its wanted files may have together, in bytes.
    """

    url: str
    sha256: str
    size: int
    unpacked: int

    @property
    def file(self) -> str:
        """Name of the archive."""
        return self.url.rsplit("/", 1)[-1]


@dataclass(frozen=True)
class Entry:
    """What the registry knows of one model.

    Attributes
    ----------
    name, text
        Its name, and the text of its contract.
    tables
        The contract, parsed.
    files
        The files that the contract names.
    archive
        The zip file that they are in, if they are.
    about_bytes
        Its rough size, where the contract has no exact one.
    base
        An address that has the files but whose revision is not pinned; digests are, so that it can be
        given to ``fetch --from``.
    exporter
        Module of ``zsmoseg/networks/export`` and function that make it from a checkpoint, and the name given.
    checkpoint
        What the exporter takes, in words.
    """

    name: str
    text: str
    tables: Mapping[str, Any] = field(repr=False)
    files: tuple[File, ...]
    archive: Archive | None = None
    about_bytes: int | None = None
    base: str | None = None
    exporter: tuple[str, str, str] | None = None
    checkpoint: str | None = None

    @property
    def public(self) -> bool:
        """Whether ``fetch`` knows a pinned address of all files."""
        return self.archive is not None or all(f.url for f in self.files)

    @property
    def size(self) -> int | None:
        """Bytes to be had, None where a size is not known."""
        if self.archive is not None:
            return self.archive.size
        sizes = [f.bytes for f in self.files]
        return sum(s for s in sizes if s is not None) if all(sizes) else None

    def command(self) -> str:
        """The command that gets the model."""
        if self.public:
            return f"zsmoseg models fetch {self.name}"
        if self.base:
            return f"zsmoseg models fetch {self.name} --from {self.base}"
        return f"zsmoseg models export {self.name} CHECKPOINT ({self.checkpoint})"

    def size_words(self) -> str:
        """How much there is to be had, in words."""
        if self.size is None and self.about_bytes:
            return f"about {size_words(self.about_bytes).replace('.0 ', ' ')}"
        return size_words(self.size)

    def about(self) -> str:
        """Size and licence in words."""
        return f"{self.size_words()}, {licence_words(self.tables)}"


def size_words(size: int | None) -> str:
    """Bytes as people read them."""
    if size is None:
        return "unknown size"
    return f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{size / 1e6:.1f} MB"


def licence_words(tables: Mapping[str, Any]) -> str:
    """The licence, up to its first semicolon, marked where it forbids commercial use."""
    mark = ", commercial use unclear" if tables.get("commercial") is None else ""
    mark = ", non-commercial only" if tables.get("commercial") is False else mark
    return f"{tables.get('licence', 'licence unknown').split(';')[0]}{mark}"


@cache
def entries() -> Mapping[str, Entry]:
    """Every entry by name, sorted."""
    extra = tomllib.loads((HERE / "catalogue.toml").read_text(encoding="utf-8"))
    texts = {
        path.name.removesuffix(".toml"): path.read_text(encoding="utf-8")
        for path in (HERE / "entries").iterdir()
        if path.name.endswith(".toml")
    }
    return {name: _entry(name, texts[name], extra.get(name, {})) for name in sorted(texts)}


def _entry(name: str, text: str, extra: Mapping[str, Any]) -> Entry:
    place = Path("registry") / name
    tables = parse(text, place)
    archive = extra.get("archive")
    return Entry(
        name,
        text,
        tables,
        tuple(files_of(tables, place)),
        Archive(archive["url"], archive["sha256"], archive["bytes"], archive["unpacked"])
        if archive
        else None,
        extra.get("about_bytes"),
        extra.get("base"),
        _three(*extra["exporter"], name) if "exporter" in extra else None,
        extra.get("checkpoint"),
    )


def _three(module: str, function: str, *names: str) -> tuple[str, str, str]:
    return module, function, names[0]
