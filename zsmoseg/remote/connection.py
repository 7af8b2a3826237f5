"""Connections to what lies behind URLs, and their failures as ``OSError`` that name the URL and hold no secret.

Retries, with longer and longer pauses, and time limits are obstore's. Credentials are found by it in the environment,
or by boto3, where that is installed, in a profile; they are handed to nobody.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from zsmoseg.remote.refusals import in_words
from zsmoseg.remote.url import URL

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


def of(url: URL) -> Any:
    """The bucket or host of a URL, as obstore has it."""
    return connect(url.scheme, url.bucket)


@lru_cache(maxsize=64)
def connect(scheme: str, bucket: str) -> Any:
    """A bucket or host; made once, with the environment of that moment."""
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
    make: Any = from_url
    more = {"credential_provider": found} if scheme == "s3" and (found := _profile()) else {}
    return ask(root, lambda: make(str(root), client_options=options, retry_config=RETRY, **more))


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


def ask(url: URL, call: Callable[[], T]) -> T:
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
