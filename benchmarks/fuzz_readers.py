"""Damaged files of every kind are read: each is read, or refused in one line, in a while and in little memory.

    python benchmarks/fuzz_readers.py [--inputs 20000] [--seed 0] [--only WORD]

Hypothesis draws a sound file of a kind and damages it: cut off, bits flipped, numbers written over, runs of bytes taken out, doubled,
or spliced in from another; of JSON, values exchanged for others. The reader runs in a process of its own. A failure is

- *traceback*: an error that is not one of ours (zsmoseg/errors.py), or not one line;
- *hang*: no answer within 10 s;
- *memory*: the process grew by more than 2 GB;
- *crash*: the process is gone.

Hypothesis makes each failure as small as it can. The exit code is 1 if there is one.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import resource
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from contextlib import redirect_stdout, suppress
from io import StringIO
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from fuzz_inputs import STORE, Kind, kinds, store
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from zsmoseg.errors import ZsmosegError, system_errors_in_words

SECONDS, BYTES, SHOWN = 10.0, 2 << 30, 300
NUMBERS = [
    bytes(4),
    b"\xff" * 4,
    b"\x7f\xff\xff\xff",
    b"\xff\xff\xff\x7f",
    b"\x80\0\0\0",
    b"\0\1\0\0",
    b"\xff" * 8,
    b"\0",
]
VALUES: list[Any] = [None, True, 0, -1, 0.5, 1 << 31, 1 << 70, float("nan"), float("inf"), "", "a", "../..", "\0", "9" * 400,
                     [], [[]], [1], [None], {}, {"size": [1, 1], "counts": "0"}, [[1, 2]], [[[]]]]  # fmt: skip


# ---------------------------------------------------------------------- damage
@st.composite
def damaged(draw: st.DrawFn, seeds: list[bytes]) -> bytes:
    """A file that was sound."""
    content = draw(st.sampled_from(seeds))
    if content[:1] == b"{" and draw(st.booleans()):
        content = json.dumps(draw(exchanged(json.loads(content)))).encode()
    for _ in range(draw(st.integers(0 if content not in seeds else 1, 4))):
        content = draw(harmed(content, seeds))
    return content


@st.composite
def harmed(draw: st.DrawFn, content: bytes, seeds: list[bytes]) -> bytes:
    """One harm more."""
    place, end = sorted(draw(st.tuples(*[st.integers(0, len(content))] * 2)))
    how = draw(st.sampled_from(["cut", "flip", "number", "take", "double", "splice", "text"]))
    if how == "cut":
        return content[:place]
    if how == "flip":
        bit = 1 << draw(st.integers(0, 7))
        return content[:place] + bytes(b ^ bit for b in content[place : place + 1]) + content[place + 1 :]
    if how == "number":
        number = draw(st.sampled_from(NUMBERS))
        return content[:place] + number + content[place + len(number) :]
    if how == "take":
        return content[:place] + content[end:]
    if how == "double":
        return content[:end] + content[place:]
    if how == "splice":
        other = draw(st.sampled_from(seeds))
        return content[:place] + other[draw(st.integers(0, len(other))) :]
    return content[:place] + draw(st.binary(max_size=12)) + content[end:]


@st.composite
def exchanged(draw: st.DrawFn, value: Any) -> Any:
    """JSON with some values exchanged, taken out or doubled."""
    for _ in range(draw(st.integers(1, 3))):
        value = draw(_exchanged_once(value))
    return value


@st.composite
def _exchanged_once(draw: st.DrawFn, value: Any) -> Any:
    if not isinstance(value, dict | list) or not value or draw(st.integers(0, 5)) == 0:
        return draw(st.sampled_from(VALUES))
    key = draw(st.sampled_from(sorted(value) if isinstance(value, dict) else range(len(value))))
    rest = dict(value) if isinstance(value, dict) else list(value)
    if draw(st.integers(0, 7)) == 0:
        del rest[key]
    else:
        rest[key] = draw(_exchanged_once(value[key]))
    return rest


# ---------------------------------------------------------------------- reading
def serve(connection: Connection, folder: str, examples: dict[str, bytes]) -> None:
    """In the child: read what comes, say how it went."""
    STORE.update(examples)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    known, before = dict(kinds()), 0
    while True:
        name, content = connection.recv()
        place = Path(folder) / "given"
        shutil.rmtree(place, ignore_errors=True)
        connection.send(_answer(known[name], content, place))
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        before = before or grown
        connection.send(grown - before)


def _answer(kind: Kind, content: bytes, place: Path) -> str:
    """``read``, ``refused``, or what went wrong."""
    place.mkdir(parents=True)
    path = place / kind.file
    path.parent.mkdir(parents=True, exist_ok=True)
    kind.beside(place)
    path.write_bytes(content)
    try:
        with redirect_stdout(StringIO()), system_errors_in_words():
            kind.read(place)
    except ZsmosegError as error:
        words = str(error)
        return "refused" if words and "\n" not in words else f"not one line: {words!r}"
    except BaseException:
        return traceback.format_exc()
    return "read"


class Reader:
    """A child that reads; a new one where it hung, grew or died."""

    def __init__(self, folder: str) -> None:
        self._folder = folder
        self._start()

    def _start(self) -> None:
        self._end, other = multiprocessing.Pipe()
        context = multiprocessing.get_context("spawn")
        self._process = context.Process(target=serve, args=(other, self._folder, store()), daemon=True)
        self._process.start()
        other.close()
        self._fresh = True

    def read(self, name: str, content: bytes) -> str:
        """As ``_answer``, or ``hang``, ``memory``, ``crash``."""
        self._end.send((name, content))
        found = self._receive(120 if self._fresh else SECONDS)
        self._fresh = False
        if isinstance(found, str) and found not in ("hang", "crash"):
            grown = self._receive(SECONDS)
            if not isinstance(grown, int) or grown <= BYTES:
                return found
            found = f"memory: {grown / 1e9:.1f} GB"
        self.stop()
        self._start()
        return str(found)

    def _receive(self, seconds: float) -> Any:
        try:
            return self._end.recv() if self._end.poll(seconds) else "hang"
        except (EOFError, ConnectionError):
            return "crash"

    def stop(self) -> None:
        """Let the child go."""
        self._process.kill()
        self._process.join()


def hunt(name: str, kind: Kind, inputs: int, number: int, reader: Reader, tally: Counter[str]) -> str:
    """Read damaged files of a kind; the smallest that fails and how, or nothing."""
    seeds, told = kind.seeds(), [""]

    @seed(number)
    @settings(
        max_examples=inputs, database=None, deadline=None, suppress_health_check=list(HealthCheck),
        phases=[Phase.generate, Phase.shrink], print_blob=False,
    )  # fmt: skip
    @given(damaged(seeds))
    def never_fails(content: bytes) -> None:
        answer = reader.read(name, kind.wrap(content))
        tally[answer if answer in ("read", "refused") else "failed"] += 1
        if answer not in ("read", "refused"):
            told[0] = (
                f"{name}: {answer.strip()}\n  file, {len(content)} bytes: {kind.wrap(content)[:SHOWN]!r}"
            )
            raise AssertionError(answer.strip().splitlines()[-1])

    with suppress(AssertionError), warnings.catch_warnings(action="ignore"):
        never_fails()
    return told[0]


def main() -> int:
    """All kinds, the inputs shared among them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--inputs", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", metavar="WORD", help="kinds whose name holds this")
    options = parser.parse_args()
    chosen = {name: kind for name, kind in kinds() if options.only in name}
    tally: Counter[str] = Counter()
    shares, failures = sum(kind.share for kind in chosen.values()), []
    with tempfile.TemporaryDirectory(dir="/dev/shm" if os.path.isdir("/dev/shm") else None) as folder:
        reader = Reader(folder)
        for name, kind in chosen.items():
            begun, before = time.monotonic(), tally.total()
            failure = hunt(
                name, kind, math.ceil(options.inputs * kind.share / shares), options.seed, reader, tally
            )
            failures += [failure] if failure else []
            print(
                f"{name:<40} {tally.total() - before:>6} inputs {time.monotonic() - begun:>6.1f} s {'FAILED' if failure else ''}",
                flush=True,
            )
        reader.stop()
    for failure in failures:
        print(f"\n{failure}")
    print(
        f"{tally.total()} inputs of {len(chosen)} kinds: {tally['read']} read, {tally['refused']} refused, {len(failures)} failures"
    )
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
