"""Objects behind URLs: read, list, write, remove; every failure an ``OSError`` that names the URL and holds no secret.

The one file that knows obstore. Retries, with longer and longer pauses, and time limits are its own. Credentials are
found by it in the environment, or by boto3, where that is installed, in a profile; they are handed to nobody.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from datetime import timedelta
from functools import lru_cache
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple, TypeVar

from zsmoseg.remote.url import READABLE, URL
from zsmoseg.remote.refusals import in_words

if TYPE_CHECKING:
    from obstore.store import RetryConfig

T = TypeVar("T")
RETRY: RetryConfig = {
    "max_retries": 10,
    "retry_timeout": timedelta(seconds=120),
    "backoff": {
        "init_backoff": timedelta(seconds=0.2),
        "max_backoff": timedelta(seconds=15),
        "base": 3,
    },
}
"""About half a minute of pauses in all: a server that is overloaded or restarted comes back, a wrong address does not."""
LIMITS = {"timeout": "60s", "connect_timeout": "10s"}
"""Of one request. Large files go in pieces, so a slow line is no reason for more."""
OPTIONS = ("allow_http", "allow_invalid_certificates", "connect_timeout", "proxy_ca_certificate", "proxy_excludes",
           "proxy_url", "timeout")  # fmt: skip
"""Of the connection, taken from the environment (``AWS_ALLOW_HTTP``, ``AZURE_PROXY_URL``)."""
PREFIXES = {"s3": "AWS_", "gs": "GOOGLE_", "az": "AZURE_"}
BATCH = 1000
"""Objects that one request names at most."""


class Stat(NamedTuple):
    """What a listing says of a file.

    Attributes
    ----------
    modified
        Time of its last change, ns, by the clock of where it lies.
    size
        Bytes.
    stamp
        Changes whenever the content does; on a server its ETag.
    """

    modified: int
    size: int
    stamp: str


def of(url: URL) -> Any:
    """The bucket or host of a URL, as obstore has it."""
    return _connect(url.scheme, url.bucket)


@lru_cache(maxsize=64)
def _connect(scheme: str, bucket: str) -> Any:
    from obstore.store import MemoryStore, from_url

    if scheme == "memory":
        return MemoryStore()
    root = URL(f"{scheme}:/{bucket}")
    options: dict[str, Any] = dict(LIMITS)
    if scheme == "http":
        options["allow_http"] = True
    for name in OPTIONS:
        value = os.environ.get(PREFIXES.get(scheme, "HTTP_") + name.upper())
        if value:
            options[name] = value.lower() == "true" if name.startswith("allow") else value
    connect: Any = from_url
    more = {"credential_provider": found} if scheme == "s3" and (found := _profile()) else {}
    return _ask(root, lambda: connect(str(root), client_options=options, retry_config=RETRY, **more))


def _profile() -> Any:
    """Credentials of a profile, by boto3; None where the environment has some, or nothing is configured."""
    told = ("AWS_ACCESS_KEY_ID", "AWS_WEB_IDENTITY_TOKEN_FILE", "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI")
    files = (Path(os.environ.get(f"AWS_{kind}_FILE") or f"~/.aws/{name}").expanduser()
             for kind, name in (("CONFIG", "config"), ("SHARED_CREDENTIALS", "credentials")))  # fmt: skip
    if any(name in os.environ for name in told) or not any(map(Path.is_file, files)):
        return None
    try:
        from obstore.auth.boto3 import Boto3CredentialProvider

        return Boto3CredentialProvider()
    except (
        Exception
    ):  # no boto3, no such profile, no credentials in it: what obstore finds by itself, or its error
        return None


def _ask(url: URL, call: Callable[[], T]) -> T:
    """What ``call`` gives; what storage raises becomes an ``OSError`` about ``url``."""
    from obstore.exceptions import BaseError

    try:
        return call()
    except (BaseError, OSError) as error:
        number, words = in_words(error)
        raise OSError(number, words, str(url)) from None


@contextmanager
def errors_in_words(url: URL) -> Iterator[None]:
    """Around what others (Zarr) do with a bucket: their errors become those of this file."""
    from obstore.exceptions import BaseError

    try:
        yield
    except BaseError as error:
        number, words = in_words(error)
        raise OSError(number, words, str(url)) from None


# ---------------------------------------------------------------------- one look
_looks = threading.local()


@contextmanager
def one_look() -> Iterator[None]:
    """Within the block this thread lists each folder once at most, and asks for no file in one that it listed.

    What it writes or removes meanwhile it knows; what others do it sees at its next look.
    """
    outer, _looks.seen = getattr(_looks, "seen", None), {}
    try:
        yield
    finally:
        _looks.seen = outer


def _seen(url: URL) -> tuple[URL, dict[str, Stat]] | None:
    """The listing, of this look, of a folder that holds ``url``, or of ``url`` itself."""
    seen: dict[URL, dict[str, Stat]] | None = getattr(_looks, "seen", None)
    if not seen:
        return None
    return next(((place, seen[place]) for place in (url, *url.parents) if place in seen), None)


def _note(url: URL, stat: Stat | None) -> None:
    """What this thread did to a file."""
    for place in url.parents:
        listed = (getattr(_looks, "seen", None) or {}).get(place)
        if listed is not None:
            name = str(url.relative_to(place))
            if stat is None:
                listed.pop(name, None)
            else:
                listed[name] = stat


def listing(url: URL) -> Mapping[str, Stat]:
    """Every file below a folder, by relative path; in one request for each thousand."""
    found = _seen(url)
    if found:
        place, files = found
        front = "" if place == url else f"{url.relative_to(place)}/"
        return {name[len(front) :]: stat for name, stat in files.items() if name.startswith(front)}
    if url.scheme in READABLE:
        return {}
    files = _ask(url, lambda: _list(url))
    if getattr(_looks, "seen", None) is not None:
        _looks.seen[url] = files
    return dict(files)


def _list(url: URL) -> dict[str, Stat]:
    import obstore

    skip = len(url.key) + 1 if url.key else 0
    return {
        meta["path"][skip:]: _stat(meta)
        for batch in obstore.list(of(url), prefix=url.key or None, chunk_size=BATCH)
        for meta in batch
    }


def _stat(meta: Any) -> Stat:
    modified = int(meta["last_modified"].timestamp() * 1e9)
    return Stat(modified, meta["size"], meta["e_tag"] or f"{meta['size']}-{modified}")


def stat(url: URL) -> Stat | None:
    """Of a file; None where there is none."""
    import obstore

    found = _seen(url)
    if found:
        return found[1].get(str(url.relative_to(found[0])))
    if not url.key:
        return None
    try:
        return _stat(_ask(url, lambda: obstore.head(of(url), url.key)))
    except FileNotFoundError:
        return None


def is_folder(url: URL) -> bool:
    """Whether something lies below it."""
    import obstore

    if _seen(url) or url.scheme in READABLE:
        return bool(listing(url))
    pages = obstore.list(of(url), prefix=url.key or None, chunk_size=1)
    return _ask(url, lambda: next(iter(pages), None)) is not None


def inside(url: URL) -> list[tuple[str, bool]]:
    """The names in a folder, in order, and whether each is a folder itself."""
    import obstore

    if _seen(url) or url.scheme in READABLE:
        names = {name.partition("/")[::2] for name in listing(url)}
        return sorted({(name, bool(rest)) for name, rest in names})
    found = _ask(url, lambda: obstore.list_with_delimiter(of(url), prefix=url.key or None))
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

    def ask() -> tuple[bytes, Stat]:
        try:
            options: Any = {"if_none_match": known} if known else None
            found = obstore.get(of(url), url.key, options=options)
            return bytes(found.bytes()), _stat(found.meta)
        except NotModifiedError:
            return b"", Stat(0, 0, known or "")

    try:
        return _ask(url, ask)
    except FileNotFoundError:
        return None


def get_range(url: URL, offset: int, length: int) -> bytes | None:
    """``length`` bytes from ``offset`` on, fewer at the end of the file; None where there is none."""
    import obstore

    try:
        return bytes(_ask(url, lambda: obstore.get_range(of(url), url.key, start=offset, length=length)))
    except FileNotFoundError:
        return None
    except OSError:
        found = stat(url)
        if found is not None and offset >= found.size:
            return b""
        raise


def put(url: URL, content: bytes | Path | IO[bytes]) -> Stat:
    """Write a file, which appears whole or not at all; what is large in pieces."""
    import obstore

    done = _ask(url, lambda: obstore.put(of(url), url.key, content))
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

    def ask() -> Any:
        try:
            return obstore.put(of(url), url.key, content, mode=mode)
        except (AlreadyExistsError, PreconditionError, FileNotFoundError) as error:
            if isinstance(error, FileNotFoundError) and not stamp:
                raise  # no such bucket
            return None

    done = _ask(url, ask)
    if done is not None:
        return _written(url, done, len(content))
    found = get(url)
    return found[1] if found and found[0] == content else None


def _written(url: URL, done: Any, size: int) -> Stat:
    from time import time_ns

    stat = Stat(time_ns(), size, done["e_tag"] or "")
    _note(url, stat)
    return stat


def delete(url: URL) -> None:
    """Remove a file, and all that lies below it as a folder."""
    import obstore

    below = [url / name for name in listing(url)]
    gone = [url, *below] if url.key else below
    for first in range(0, len(gone), BATCH):
        batch = gone[first : first + BATCH]
        _ask(url, lambda batch=batch: obstore.delete(of(url), [one.key for one in batch]))  # type: ignore[misc]
    for one in gone:
        _note(one, None)
