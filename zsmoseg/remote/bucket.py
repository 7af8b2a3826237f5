"""Files in buckets and on web servers: listed, read, written, removed."""

from __future__ import annotations

import errno
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from itertools import islice
from pathlib import Path
from shutil import disk_usage
from time import time_ns
from typing import IO, Any

from zsmoseg.remote.connection import ask, of
from zsmoseg.remote.looks import Stat, asked, keep, listed, looking, note
from zsmoseg.remote.url import READABLE, URL

PIECE = 1 << 23
"""Bytes of a file that are in memory at once while it is fetched."""
BATCH = 1000
"""Objects that one request names at most."""
READ_WHOLE = 2**18
"""Bytes of a file that is read whole where pieces of it are asked for: no more than what a request takes to be answered."""


def listing(url: URL) -> Mapping[str, Stat]:
    """Every file below a folder, by relative path; in one request for each thousand."""
    found = listed(url)
    if found:
        place, files = found
        front = "" if place == url else f"{url.relative_to(place)}/"
        return {name[len(front) :]: stat for name, stat in files.items() if name.startswith(front)}
    if url.scheme in READABLE:
        return {}
    files = ask(url, lambda: _list(url))
    keep(url, files)
    return dict(files)


def glance(url: URL) -> None:
    """List a folder if one request tells all that is in it; else what is asked of it is asked file by file."""
    if listed(url) or url.scheme in READABLE:
        return
    files = ask(url, lambda: _list(url, most=1))
    if len(files) < BATCH:
        keep(url, files)


def _list(url: URL, most: int | None = None) -> dict[str, Stat]:
    """What is below a folder, or in its first ``most`` batches."""
    import obstore

    skip = len(url.key) + 1 if url.key else 0
    batches = obstore.list(of(url), prefix=url.key or None, chunk_size=BATCH)
    return {meta["path"][skip:]: _stat(meta) for batch in islice(batches, most) for meta in batch}


def _stat(meta: Any) -> Stat:
    modified = int(meta["last_modified"].timestamp() * 1e9)
    return Stat(modified, meta["size"], meta["e_tag"] or f"{meta['size']}-{modified}")


def stat(url: URL) -> Stat | None:
    """Of a file; None where there is none."""
    import obstore

    found = listed(url, itself=False)
    if found:
        return found[1].get(str(url.relative_to(found[0])))

    def head() -> Stat | None:
        try:
            return _stat(ask(url, lambda: obstore.head(of(url), url.key)))
        except FileNotFoundError:
            return None

    return asked(url, head) if url.key else None


def is_folder(url: URL) -> bool:
    """Whether something lies below it."""
    import obstore

    if listed(url) or url.scheme in READABLE:
        return bool(listing(url))
    pages = obstore.list(of(url), prefix=url.key or None, chunk_size=1)
    return ask(url, lambda: next(iter(pages), None)) is not None


def inside(url: URL) -> list[tuple[str, bool]]:
    """The names in a folder, in order, and whether each is a folder itself."""
    import obstore

    if listed(url) or url.scheme in READABLE:
        names = {name.partition("/")[::2] for name in listing(url)}
        return sorted({(name, bool(rest)) for name, rest in names})
    found = ask(url, lambda: obstore.list_with_delimiter(of(url), prefix=url.key or None))
    below = [(name, True) for name in found["common_prefixes"]] + [
        (o["path"], False) for o in found["objects"]
    ]
    return sorted((name.rpartition("/")[2], is_one) for name, is_one in below)


# ---------------------------------------------------------------------- content
def get(url: URL, known: str | None = None) -> tuple[bytes, Stat] | None:
    """Content of a file, and what it is; None where there is none.

    Parameters
    ----------
    known
        A stamp: where the file has it, nothing is read, and the content is empty.
    """
    import obstore
    from obstore.exceptions import NotModifiedError

    def read() -> tuple[bytes, Stat]:
        try:
            options: Any = {"if_none_match": known} if known else None
            found = obstore.get(of(url), url.key, options=options)
            return bytes(found.bytes()), _stat(found.meta)
        except NotModifiedError:
            return b"", Stat(0, 0, known or "")

    try:
        return ask(url, read)
    except FileNotFoundError:
        return None


def fetch(url: URL, to: Path, known: str | None = None) -> str:
    """Write the content of a file to a local one; its stamp. Where it is ``known`` nothing is written.

    Raises
    ------
    OSError
        If there is none, or it cannot be read, or the disk has no room for what the server states.
    """
    import obstore
    from obstore.exceptions import NotModifiedError

    def begin() -> Any:
        options: Any = {"if_none_match": known} if known else None
        try:
            return obstore.get(of(url), url.key, options=options)
        except NotModifiedError:
            return None

    found = ask(url, begin)
    if found is None:
        return known or ""
    size, free = found.meta["size"], disk_usage(to.parent).free
    if size > free:
        raise OSError(
            errno.EFBIG,
            f"the server states {size / 1e9:.1f} GB, {to.parent} has room for {free / 1e9:.1f} GB; set TMPDIR to another disk",
            str(url),
        )

    def write() -> str:
        with to.open("xb") as file:
            for piece in found.stream(min_chunk_size=PIECE):
                file.write(piece)
        return _stat(found.meta).stamp

    return ask(url, write)


def get_range(url: URL, offset: int, length: int) -> bytes | None:
    """``length`` bytes from ``offset`` on, fewer at the end of the file; None where there is none.

    Within a look a small file is read once: of tables and shards of short videos one asks for piece after piece.
    """
    import obstore

    known = stat(url) if looking() else None
    if known is not None and known.size <= READ_WHOLE:
        content = _small(url, known)
        return content and content[offset : offset + length]
    try:
        return bytes(ask(url, lambda: obstore.get_range(of(url), url.key, start=offset, length=length)))
    except FileNotFoundError:
        return None
    except OSError:
        found = stat(url)
        if found is not None and offset >= found.size:
            return b""
        raise


@lru_cache(maxsize=64)
def _small(url: URL, known: Stat) -> bytes | None:
    found = get(url)
    return found[0] if found else None


def put(url: URL, content: bytes | Path | IO[bytes]) -> Stat:
    """Write a file, which appears whole or not at all; what is large in pieces."""
    import obstore

    done = ask(url, lambda: obstore.put(of(url), url.key, content))
    if isinstance(content, bytes):
        size = len(content)
    else:
        size = content.stat().st_size if isinstance(content, Path) else content.tell()
    return _written(url, done, size)


def put_if(url: URL, content: bytes, stamp: str | None) -> Stat | None:
    """Write a file if it still has ``stamp`` (None: is not there yet); None where somebody was faster.

    A request that was carried out although its answer was lost is sent again, and refused then: so ``content`` has to
    be nobody else's.
    """
    import obstore
    from obstore.exceptions import AlreadyExistsError, PreconditionError

    mode: Any = {"e_tag": stamp} if stamp else "create"

    def write() -> Any:
        try:
            return obstore.put(of(url), url.key, content, mode=mode)
        except (AlreadyExistsError, PreconditionError, FileNotFoundError) as error:
            if isinstance(error, FileNotFoundError) and not stamp:
                raise  # no such bucket
            return None

    done = ask(url, write)
    if done is not None:
        return _written(url, done, len(content))
    found = get(url)
    return found[1] if found and found[0] == content else None


def _written(url: URL, done: Any, size: int) -> Stat:
    stat = Stat(time_ns(), size, done["e_tag"] or "")
    note(url, stat)
    return stat


def unlink(url: URL) -> None:
    """Remove a file, if it is there."""
    import obstore

    with suppress(FileNotFoundError):
        ask(url, lambda: obstore.delete(of(url), url.key))
    note(url, None)


def delete(url: URL) -> None:
    """Remove a file, and all that lies below it as a folder."""
    import obstore

    gone = [url / name for name in listing(url)]
    # without a look a file is not asked for, but removed whether it is there or not
    if url.key and (not listed(url, itself=False) or stat(url)):
        gone.append(url)
    for first in range(0, len(gone), BATCH):
        batch = gone[first : first + BATCH]
        ask(url, lambda batch=batch: obstore.delete(of(url), [one.key for one in batch]))  # type: ignore[misc]
    for one in gone:
        note(one, None)
