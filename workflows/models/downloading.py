"""One file from an address: goes on where it was interrupted, never larger than said, checked before it is used."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from zsmoseg.errors import ModelError
from zsmoseg.networks.contract import File

Watch = Callable[[str, int, int | None], None]
"""Called with model and name of a file, its bytes so far and in all (None: not known)."""
TRIES = 5
"""Attempts without a new byte after which a download is given up; what is there is kept."""
PAUSE = 2.0
"""Seconds before the second attempt; each further one waits twice as long."""
TIMEOUT = 30.0
"""Seconds without an answer after which an attempt counts as failed."""
MOST_BYTES = 20_000_000_000
"""No file whose size nobody states may be larger."""
NO_HOST = "no such host; is this machine on the internet?"
CHUNK = 1 << 16
"""Bytes written at once; a piece that an interruption cuts is lost."""


class NotThere(ModelError):
    """The address has no such file."""


def download(wanted: File, url: str, folder: Path, model: str, watch: Watch) -> Path:
    """Get one file by way of pooch, which checks its sha256 before it gets its name.

    Parameters
    ----------
    wanted
        Its name, and what is known of it.
    url
        Where it is.
    folder
        Where it goes; what an earlier attempt left there (``NAME.part``) is gone on from.
    model
        Whose file it is, for messages.
    watch
        Told of every piece.

    Raises
    ------
    NotThere
        The address has no such file.
    ModelError
        The server has another size, another content, or stops answering.
    """
    import pooch

    if not url.startswith(("http://", "https://")):
        raise ModelError(f"{url}: only http and https addresses are fetched")
    pooch.get_logger().setLevel("ERROR")
    known = f"sha256:{wanted.sha256}" if wanted.sha256 else None
    for _ in range(2):
        pull = _Pull(wanted, folder / f"{wanted.file}.part", f"{model}/{wanted.file}", watch)
        try:
            return Path(pooch.retrieve(url, known, wanted.file, folder, downloader=pull))
        except ValueError as error:  # the digest: pooch has thrown the file away
            wrong = error
            if not pull.resumed:
                break
    raise ModelError(
        f"{model}/{wanted.file} from {url}: another content than the registry knows ({_both(wrong)}); nothing was kept"
    ) from wrong


def _both(error: ValueError) -> str:
    """The two digests in pooch's words, found first."""
    words = [w.strip("().',") for w in str(error).split()]
    digests = [w.removeprefix("sha256:") for w in words if len(w.removeprefix("sha256:")) == 64]
    return f"sha256 {digests[0]}, expected {digests[-1]}" if len(digests) >= 2 else str(error)


class _Pull:
    """A downloader of pooch that keeps what it has in ``part`` and goes on from there."""

    def __init__(self, wanted: File, part: Path, label: str, watch: Watch) -> None:
        self.wanted, self.part, self.label, self.watch = wanted, part, label, watch
        self.resumed = False

    def __call__(self, url: str, output_file: str, pooch: Any = None, check_only: bool = False) -> None:
        """Download ``url`` to ``output_file``."""
        from requests import RequestException

        tries = 0
        while True:
            before = self._have()
            try:
                self._attempt(url)
                break
            except RequestException as error:
                tries = 1 if self._have() > before else tries + 1
                if tries >= TRIES or _reason(error) == NO_HOST:
                    raise ModelError(
                        f"{self.label}: the download stopped at {self._have() / 1e6:.1f} MB "
                        f"({_reason(error)}); the same command goes on from there"
                    ) from error
                time.sleep(PAUSE * 2 ** (tries - 1))
        os.replace(self.part, output_file)

    def _have(self) -> int:
        return self.part.stat().st_size if self.part.exists() else 0

    def _attempt(self, url: str) -> None:
        """One request, from the byte on that is missing."""
        import requests

        have = self._have()
        if have and have == self.wanted.bytes:
            self.resumed = True
            return
        headers = {"Accept-Encoding": "identity"} | ({"Range": f"bytes={have}-"} if have else {})
        with requests.get(url, headers=headers, stream=True, timeout=TIMEOUT) as answer:
            if answer.status_code == 416:  # what is kept is no beginning of this file
                self.part.unlink()
                raise requests.ConnectionError("the kept beginning does not fit; started anew")
            if answer.status_code in (403, 404, 410):
                raise NotThere(f"{url}: the server has no such file ({answer.status_code})")
            if 400 <= answer.status_code < 500 and answer.status_code not in (408, 429):
                raise ModelError(f"{url}: the server refuses ({answer.status_code} {answer.reason})")
            answer.raise_for_status()
            goes_on = answer.headers.get("Content-Range", "").startswith(f"bytes {have}-")
            if not (have and answer.status_code == 206 and goes_on):
                have = 0
            self.resumed = self.resumed or have > 0
            self._write(answer, have, self._whole(answer, have, url))

    def _whole(self, answer: Any, have: int, url: str) -> int | None:
        """Bytes of the whole file as the server states them, which must be those of the registry."""
        length = answer.headers.get("Content-Length")
        whole = have + int(length) if length is not None else None
        if whole is not None and self.wanted.bytes not in (None, whole):
            raise ModelError(
                f"{self.label}: {url} has {whole} bytes, the registry says {self.wanted.bytes}; not fetched"
            )
        return whole if whole is not None else self.wanted.bytes

    def _write(self, answer: Any, have: int, whole: int | None) -> None:
        """Append what comes, up to the size that is known."""
        import requests

        most = whole if whole is not None else MOST_BYTES
        with self.part.open("ab" if have else "wb") as file:
            for chunk in answer.iter_content(CHUNK):
                have += len(chunk)
                if have > most:
                    file.truncate(0)
                    raise ModelError(f"{self.label}: the server sends more than {most} bytes; not kept")
                file.write(chunk)
                self.watch(self.label, have, whole)
        if whole is not None and have < whole:
            raise requests.ConnectionError(f"{whole - have} bytes are missing")


def _reason(error: Exception) -> str:
    """What went wrong, without the addresses of objects in memory."""
    text = str(error)
    known = {"timed out": "no answer in time", "refused": "connection refused", "resolve": NO_HOST}
    return next((words for sign, words in known.items() if sign in text), type(error).__name__)
