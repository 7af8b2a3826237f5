"""How an image is held: what is turned as it is decoded, and its size before that."""

from __future__ import annotations

import struct
import zlib
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from zsmoseg.errors import VideoError
from zsmoseg.video.orientation import orientation
from zsmoseg.video.pixels import image_size, pixels

TURNED = (
    b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    b'<rdf:Description xmlns:tiff="http://ns.adobe.com/tiff/1.0/" tiff:Orientation="6"/></rdf:RDF></x:xmpmeta>'
)


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def _png(text: PngInfo | None = None) -> bytes:
    file = BytesIO()
    Image.fromarray(np.zeros((6, 8), np.uint8)).save(file, "png", pnginfo=text)
    return file.getvalue()


def _saved(kind: str, **tags: Any) -> bytes:
    file = BytesIO()
    Image.fromarray(np.zeros((6, 8), np.uint8)).save(file, kind, **tags)
    return file.getvalue()


def _ways_to_say_how_it_is_held() -> dict[str, bytes]:
    """Images of 8 x 6 px that say 6, "turn me", here and there."""
    tags = Image.Exif()
    tags[0x0112] = 6
    said, xmp = tags.tobytes(), TURNED
    profile, packet = PngInfo(), PngInfo()
    profile.add_text("Raw profile type exif", f"\nexif\n{len(said):8d}\n{said.hex()}\n")
    packet.add_itxt("XML:com.adobe.xmp", xmp.decode())
    chunk, plain = _chunk(b"eXIf", said[6:]), _png()
    return {
        "before.png": plain[:33] + chunk + plain[33:],
        "behind.png": plain[:-12] + chunk + plain[-12:],
        "profile.png": _png(profile),
        "xmp.png": _png(packet),
        **{f"exif.{kind}": _saved(kind, exif=tags) for kind in ("jpeg", "webp", "tiff")},
        **{f"xmp.{kind}": _saved(kind, xmp=xmp) for kind in ("jpeg", "webp")},
    }


@pytest.mark.parametrize(("name", "content"), _ways_to_say_how_it_is_held().items())
def test_an_image_is_held_as_its_exif_says_whatever_else_speaks_of_it(
    name: str, content: bytes, tmp_path: Path
) -> None:
    """XMP and old text chunks are not asked, by none of the readers: those that differ would fail every frame."""
    (tmp_path / name).write_bytes(content)
    file = str(tmp_path / name)
    turned = name.split(".")[0] in ("exif", "before", "behind")
    assert image_size(file) == ((6, 8) if turned else (8, 6))
    found = pixels(file)
    assert found is not None
    assert found.shape[1::-1] == image_size(file)
    assert orientation(file) == (6 if turned else 1)


def test_of_a_png_the_size_is_read_without_its_pixels(tmp_path: Path) -> None:
    """Of a video of 5,000 frames they would be decoded before the plan is shown."""
    whole, file = _png(), tmp_path / "0.png"
    pixels = whole.index(b"IDAT") + 4
    file.write_bytes(whole[:pixels] + bytes(len(whole) - 16 - pixels) + whole[-16:])
    assert image_size(str(file)) == (8, 6)
    file.write_bytes(whole[:-20])
    with pytest.raises(VideoError, match=r"0\.png: cannot be read as an image"):
        image_size(str(file))
