"""A short fuzz of all readers: a damaged file is read or refused in one line, soon, and in little memory."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from test_bounds import png

from zsmoseg.errors import FormatError, VideoError
from zsmoseg.formats import open_flow, open_masks
from zsmoseg.video.pixels import pixels

ROOT = Path(__file__).parents[1]
BROUGHT = "^(?!store|commands)"
"""What users bring; stores are damaged in test_faults.py."""


def test_five_hundred_damaged_files_of_all_kinds_are_read_or_refused() -> None:
    words = [
        sys.executable,
        str(ROOT / "benchmarks" / "fuzz_readers.py"),
        "--inputs",
        "500",
        "--seed",
        "1",
        "--only",
        BROUGHT,
    ]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=500, check=False)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
    assert ", 0 failures" in done.stdout


# ---------------------------------------------------------------------- what the fuzz found
@pytest.mark.parametrize("stated", [0x1FFFFF7F, 0xFFFFFFFF, 0x7FFFFFFF, 4000])
@pytest.mark.parametrize("chunk", [b"IDAT", b"IEND"])
def test_a_png_whose_chunk_states_more_than_there_is_takes_no_memory(
    stated: int, chunk: bytes, tmp_path: Path
) -> None:
    """OpenCV took 4 GB."""
    path = png(tmp_path / "00000.png", 64, 48, 16, 2)
    content = bytearray(path.read_bytes())
    place = content.index(chunk) - 4
    content[place : place + 4] = stated.to_bytes(4)
    path.write_bytes(content)
    assert pixels(str(path)) is None
    with pytest.raises(FormatError, match=r"00000\.png: cannot be read .a chunk states"):
        open_flow(tmp_path).read(0)


@pytest.mark.parametrize(
    "head",
    [
        b"{'descr': '<u2', 'shape': (4,",
        b"{'descr': '<u2'\0}",
        b"\xff\xfe",
        b"",
        b"(" * 300,
        b"{" + b" " * 20_000 + b"}",
    ],
)
@pytest.mark.parametrize("ending", [".npy", ".npz"])
def test_a_damaged_head_of_an_array_is_one_line(head: bytes, ending: str, tmp_path: Path) -> None:
    """Python's tokeniser raised its own, and numpy wrote three lines."""
    content = b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + bytes(64)
    path = tmp_path / f"a{ending}"
    if ending == ".npy":
        path.write_bytes(content)
    else:
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("a.npy", content)
    with pytest.raises(FormatError) as found:
        open_masks(path)
    assert "\n" not in str(found.value)
    assert str(path) in str(found.value)


def test_an_error_is_one_line_whatever_a_name_holds() -> None:
    assert str(VideoError("a\nb.mp4: is\r\n  damaged\u2028here")) == "a b.mp4: is damaged here"
