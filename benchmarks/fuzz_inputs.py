"""Every kind of file that zsmoseg reads: sound examples of it, and the reader that users reach it by."""

from __future__ import annotations

import io
import json
import shutil
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, suppress
from dataclasses import dataclass
from functools import cache
from io import StringIO
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from clips import tiny_videos
from PIL import Image
from scipy.io import savemat

from zsmoseg.datasets.fbms59 import fbms_sequence
from zsmoseg.datasets.motion_times import read_motion_times
from zsmoseg.datasets.point_tracks import read_tracks
from zsmoseg.formats import open_depth, open_flow, open_masks, rle
from zsmoseg.formats.flow_files import encode_kitti
from zsmoseg.networks.contract import load_contract
from zsmoseg.painting.palette import encode_png
from zsmoseg.settings import resolve
from zsmoseg.stores.imports import brought_before
from zsmoseg.stores.location import Store
from zsmoseg.video.frames import read
from zsmoseg.video.ignore import read_ignore
from zsmoseg.video.probe import Excerpt, probe
from zsmoseg.workflows.cli import main as zsmoseg
from zsmoseg.workflows.evaluate.array_frames import open_volume
from zsmoseg.workflows.result import open_store

SIZE, FRAMES = (48, 64), 4
Seeds = Callable[[], list[bytes]]


@dataclass(frozen=True)
class Kind:
    """One kind of file.

    Attributes
    ----------
    file : its name.
    seeds : sound examples.
    read : reads the folder that holds it.
    beside : writes what else belongs into the folder.
    wrap : makes a file of damaged bytes, so that a checksum does not hide them from what lies behind it.
    share : of the inputs, those of most kinds are 1.
    """

    file: str
    seeds: Seeds
    read: Callable[[Path], None]
    beside: Callable[[Path], None] = lambda _: None
    wrap: Callable[[bytes], bytes] = lambda content: content
    share: float = 1.0


# ---------------------------------------------------------------------- examples
@cache
def images() -> np.ndarray:
    """(frames, H, W, 3)."""
    rng = np.random.default_rng(0)
    texture = cv2.GaussianBlur(rng.integers(0, 256, (*SIZE, 3), np.uint8), (0, 0), 2)
    return np.stack([np.roll(texture, t, 1) for t in range(FRAMES)])


@cache
def labels() -> np.ndarray:
    """(frames, H, W) ids."""
    found = np.zeros((FRAMES, *SIZE), np.uint8)
    for t in range(FRAMES):
        found[t, 8:20, 10 + t : 24 + t], found[t, 30:40, 40:50] = 1, 3
    return found


def _video(container: str, codec: str, **options: str) -> bytes:
    out = io.BytesIO()
    with av.open(out, "w", format=container) as file:
        stream = file.add_stream(codec, rate=25, options=options)
        stream.width, stream.height = SIZE[::-1]
        stream.pix_fmt = "rgb8" if codec == "gif" else "yuvj420p" if codec == "mjpeg" else "yuv420p"
        for image in images():
            file.mux(stream.encode(av.VideoFrame.from_ndarray(image, "bgr24")))
        file.mux(stream.encode(None))
    return out.getvalue()


VIDEOS = {
    "mp4": [("mp4", "mpeg4"), ("mp4", "libx264")],
    "mkv": [("matroska", "libx264"), ("matroska", "ffv1")],
    "webm": [("webm", "libvpx"), ("webm", "libvpx-vp9")],
    "avi": [("avi", "mpeg4"), ("avi", "mjpeg")],
    "mov": [("mov", "libx264")],
    "mpg": [("mpegts", "libx264"), ("mpeg", "mpeg2video")],
    "m4v": [("h264", "libx264")],
}
"""Container and codec, by the ending of the file."""


def _image(format: str, mode: str = "RGB", **options: Any) -> bytes:
    out = io.BytesIO()
    if mode == "I;16":
        Image.fromarray(images()[0, ..., 0].astype(np.uint16) * 257).save(out, format, **options)
    else:
        Image.fromarray(images()[0, ..., ::-1]).convert(mode).save(out, format, **options)
    return out.getvalue()


def _label_images() -> list[bytes]:
    return [
        encode_png(labels()[0]),
        encode_png(labels()[0].astype(np.uint16) * 300),
        _image("PNG", "P"),
        _image("PNG", "L"),
    ]


def _turned() -> bytes:
    exif = Image.Exif()
    exif[0x0112] = 6
    return _image("JPEG", exif=exif)


def _npy(array: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.save(out, array)
    return out.getvalue()


def _npz(**arrays: Any) -> bytes:
    out = io.BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def member(name: str) -> Callable[[bytes], bytes]:
    """Wraps bytes as a member of a sound zip."""

    def wrap(content: bytes) -> bytes:
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w") as archive:
            archive.writestr(name, content)
        return out.getvalue()

    return wrap


def sound_png(content: bytes) -> bytes:
    """The same PNG with checksums that fit, as far as it has chunks."""
    out, place = bytearray(content), 8
    while place + 12 <= len(out):
        (length,) = struct.unpack_from(">I", out, place)
        end = place + 8 + length
        if end + 4 > len(out):
            break
        struct.pack_into(">I", out, end, zlib.crc32(bytes(out[place + 4 : end])))
        place = end + 4
    return bytes(out)


def _flow() -> np.ndarray:
    return np.random.default_rng(0).normal(0, 3, (FRAMES - 1, 2, *SIZE)).astype(np.float32)


def _flo() -> bytes:
    head = b"PIEH" + np.array(SIZE[::-1], "<i4").tobytes()
    return head + np.moveaxis(_flow()[0], 0, 2).astype("<f4").tobytes()


def _exr() -> bytes:
    """An uncompressed OpenEXR of one channel; OpenCV is often built without a writer."""
    height, width = SIZE

    def attribute(name: str, kind: str, value: bytes) -> bytes:
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value

    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    channel = b"Y\0" + struct.pack("<iB3xii", 2, 0, 1, 1) + b"\0"
    head = b"\x76\x2f\x31\x01\x02\0\0\0"
    head += attribute("channels", "chlist", channel) + attribute("compression", "compression", b"\0")
    head += attribute("dataWindow", "box2i", window) + attribute("displayWindow", "box2i", window)
    head += attribute("lineOrder", "lineOrder", b"\0") + attribute(
        "pixelAspectRatio", "float", struct.pack("<f", 1)
    )
    head += attribute("screenWindowCenter", "v2f", bytes(8)) + attribute(
        "screenWindowWidth", "float", struct.pack("<f", 1)
    )
    head += b"\0"
    row = 8 + 4 * width
    table = b"".join(struct.pack("<Q", len(head) + 8 * height + y * row) for y in range(height))
    rows = b"".join(
        struct.pack("<ii", y, 4 * width) + np.full(width, 1 + y, "<f4").tobytes() for y in range(height)
    )
    return head + table + rows


def _coco(kind: str) -> bytes:
    names = [f"{t:05d}.png" for t in range(FRAMES)]
    listed = [{"id": t, "file_name": n, "height": SIZE[0], "width": SIZE[1]} for t, n in enumerate(names)]
    found = []
    for t in range(FRAMES):
        square = [10 + t, 8, 24 + t, 8, 24 + t, 20, 10 + t, 20]
        mask = rle.encode(labels()[t] == 1)
        runs = {"size": list(SIZE), "counts": rle.run_lengths(mask["counts"])}
        segmentation: Any = {"polygon": [square], "string": mask, "list": runs}[kind]
        found.append({"id": t, "image_id": t, "category_id": 1, "segmentation": segmentation, "iscrowd": int(kind == "list"),
                      "score": 0.5, "attributes": {"track_id": 1}})  # fmt: skip
    return json.dumps(
        {"images": listed, "annotations": found, "categories": [{"id": 1, "name": "thing"}]}
    ).encode()


def _ytvis() -> bytes:
    names = [f"goat/{t:05d}.png" for t in range(FRAMES)]
    video = {"id": 1, "file_names": names, "height": SIZE[0], "width": SIZE[1], "length": FRAMES}
    tracks = [
        {
            "id": n,
            "video_id": 1,
            "category_id": 1,
            "score": 0.5,
            "segmentations": [rle.encode(frame == n) for frame in labels()],
        }
        for n in (1, 3)
    ]
    return json.dumps({"videos": [video], "annotations": tracks, "categories": []}).encode()


def _detections() -> dict[str, np.ndarray]:
    masks = np.packbits((labels() == 1).reshape(FRAMES, -1), axis=1)
    return {
        "frame": np.arange(FRAMES),
        "score": np.linspace(0.1, 0.9, FRAMES),
        "packed": masks,
        "size": np.array(SIZE),
    }


def _tracks() -> dict[str, np.ndarray]:
    return {"points": np.zeros((5, FRAMES, 2)), "visible": np.ones((5, FRAMES), bool), "label": np.arange(5)}


def _mat() -> bytes:
    out = io.BytesIO()
    data = {
        "ySparse": np.zeros((3, 5, FRAMES)),
        "visibleSparse": np.ones((5, FRAMES)),
        "GtLabel": np.arange(5),
    }
    savemat(out, {"Data": data})
    return out.getvalue()


TOML = b"""
[flow]
stride = 5
source = "dis"
[groups]
count = "auto"
[video]
start = "1.5"
fps = 25.0
"""
CONTRACT = b"""
name = "own"
task = "depth"
licence = "MIT"
[graph.main]
file = "own.onnx"
inputs = { image = "image" }
outputs = { depth = "depth" }
[input]
colour_order = "RGB"
mean = [0.5, 0.5, 0.5]
std = [0.5, 0.5, 0.5]
scale = 0.0039
[input.resize]
rule = "stretch"
height = 64
width = 64
interpolation = "linear"
[output]
role = "depth"
meaning = "inverse-depth"
"""
FBMS = b"""Total number of regions: 2
Scale of region 0:
0
Scale of region 1:
65280
Confidence:
Total number of labeled frames for this shot:
1
Frame number:
0
File name:
00000_gt.png
Input file name:
00000.png
"""


# ---------------------------------------------------------------------- readers
def _read_video(path: Path) -> None:
    for allow in (False, True):
        found = probe(str(path), Excerpt("", "", 1, 25.0, allow))
        for _ in read(found, 0, len(found.times)):
            pass


def _masks(path: Path) -> None:
    source = open_masks(path, "goat")
    for index in range(min(source.count, 100)):
        source.read(index)


def _pairs(path: Path) -> None:
    source = open_flow(path)
    for index in range(min(source.count, 100)):
        source.read(index)
        if source.has_backward:
            source.read(index, "backward")


def _depth(path: Path) -> None:
    source = open_depth(path)
    for index in range(min(source.count, 100)):
        source.read(index)


def _volume(path: Path) -> None:
    rows = open_volume(path)
    for index in range(min(rows.shape[0], 100)):
        rows.read(index)


def _fbms(folder: Path) -> None:
    truth = fbms_sequence(folder)
    for index in range(len(truth.files)):
        truth.labels(index)


def _imports(folder: Path) -> None:
    (folder / "disc-0").mkdir(exist_ok=True)
    shutil.move(folder / "imports.json", folder / "disc-0" / "imports.json")
    brought_before(Store(folder), "disc-0")


def _sound_frames(file: str, ending: str) -> Callable[[Path], None]:
    """Sound images before and behind the damaged one."""

    def write(folder: Path) -> None:
        for name in ("00000", "00002"):
            cv2.imwrite(str(folder / f"{name}{ending}"), images()[0])

    return write


STORE: dict[str, bytes] = {}


def store() -> dict[str, bytes]:
    """The files of a store with one finished run, by their path."""
    if STORE:
        return STORE
    with tempfile.TemporaryDirectory() as place:
        root = Path(place)
        (source,) = tiny_videos(root, 1)
        words = [
            str(source),
            "-o",
            str(root / "out"),
            "--store",
            str(root / "store"),
            "--scheduler",
            "serial",
        ]
        with redirect_stderr(StringIO()):
            if zsmoseg(["run", *words]):
                raise RuntimeError("the example cannot be made")
        files = [path for path in sorted((root / "store").rglob("*")) if path.is_file()]
        STORE.update({str(path.relative_to(root)): path.read_bytes() for path in files})
    return STORE


def _put_store(folder: Path) -> None:
    for name, content in store().items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def _read_store(folder: Path) -> None:
    result = open_store(folder / "store")["v00000"]
    tree, masks = result.tree, result.masks()
    with suppress(Exception):  # what xarray reads later, it reads without us: whatever it raises, it ends
        tree.load()
    with suppress(Exception):
        masks.load()
    _ = result.objects


def _read_state(folder: Path) -> None:
    """The commands that look at all of a store."""
    for words in (["status"], ["runs"], ["verify"], ["explain", "v00000"]):
        if zsmoseg([*words, "--store", str(folder / "store")]) not in (0, 1, 2):
            raise RuntimeError("another exit code")


def kinds() -> Iterator[tuple[str, Kind]]:
    """Every kind by name."""
    for ending, made in VIDEOS.items():
        name = f"clip.{ending}"
        yield (
            f"video {ending}",
            Kind(
                name,
                lambda made=made: [_video(*one) for one in made],
                lambda f, name=name: _read_video(f / name),
            ),
        )
    pictures: dict[str, Seeds] = {
        ".jpg": lambda: [_image("JPEG"), _image("JPEG", "L"), _turned(), _image("JPEG", progressive=True)],
        ".png": lambda: [_image("PNG", mode) for mode in ("RGB", "RGBA", "L", "P", "I;16", "1")],
        ".tif": lambda: [_image("TIFF"), _image("TIFF", "I;16"), _image("TIFF", compression="tiff_lzw")],
        ".bmp": lambda: [_image("BMP"), _image("BMP", "P")],
        ".webp": lambda: [_image("WEBP"), _image("WEBP", lossless=True)],
    }
    for ending, seeds in pictures.items():
        file = f"00001{ending}"
        yield f"frame {ending}", Kind(file, seeds, _read_video, _sound_frames(file, ending))
    yield (
        "frame .png, checksums mended",
        Kind("00001.png", pictures[".png"], _read_video, _sound_frames("00001.png", ".png"), sound_png),
    )
    yield (
        "ignore mask",
        Kind("i.png", pictures[".png"], lambda f: void(read_ignore(str(f / "i.png"), *SIZE)), wrap=sound_png),
    )
    for name, wrap in {"masks png": lambda c: c, "masks png, checksums mended": sound_png}.items():
        yield name, Kind("00000.png", _label_images, _masks, wrap=wrap)
    ids = labels().astype(np.uint16)
    yield (
        "masks npy",
        Kind(
            "a.npy",
            lambda: [_npy(ids), _npy(np.asfortranarray(ids)), _npy(ids > 0)],
            lambda f: _masks(f / "a.npy"),
        ),
    )
    yield (
        "masks npz",
        Kind("a.npz", lambda: [_npz(a=ids), _npz(**_detections())], lambda f: _masks(f / "a.npz")),
    )
    yield (
        "masks npz, inside",
        Kind("a.npz", lambda: [_npy(ids)], lambda f: _masks(f / "a.npz"), wrap=member("a.npy")),
    )
    yield (
        "proposals npz",
        Kind(
            "proposals_0.npz",
            lambda: [
                _npz(packed=_detections()["packed"], shape=np.array([FRAMES, *SIZE]), score=np.ones(FRAMES))
            ],
            _masks,
        ),
    )
    for how in ("polygon", "string", "list"):
        yield (
            f"masks coco {how}",
            Kind("a.json", lambda how=how: [_coco(how)], lambda f: _masks(f / "a.json")),
        )
    yield "masks ytvis", Kind("a.json", lambda: [_ytvis()], lambda f: _masks(f / "a.json"))
    yield "flow flo", Kind("00000.flo", lambda: [_flo()], _pairs)
    for name, wrap in {"flow kitti": lambda c: c, "flow kitti, checksums mended": sound_png}.items():
        yield name, Kind("00000.png", lambda: [encode_kitti(_flow()[0], "")], _pairs, wrap=wrap)
    yield (
        "flow npy",
        Kind(
            "a.npy",
            lambda: [_npy(_flow()), _npy(_flow()[0]), _npy(np.moveaxis(_flow(), 1, 3))],
            lambda f: _pairs(f / "a.npy"),
        ),
    )
    yield (
        "flow npz",
        Kind(
            "a.npz",
            lambda: [_npz(forward=_flow(), backward=_flow()), _npz(a=_flow())],
            lambda f: _pairs(f / "a.npz"),
        ),
    )
    deep = np.tile(np.linspace(1, 9, SIZE[1], dtype=np.float32), (FRAMES, SIZE[0], 1))
    yield "depth png", Kind("00000.png", pictures[".png"], _depth, wrap=sound_png)
    yield (
        "depth npy",
        Kind(
            "a.npy",
            lambda: [_npy(deep), _npy(deep.astype(np.float16)), _npy(deep.astype(">f8"))],
            lambda f: _depth(f / "a.npy"),
        ),
    )
    yield "depth npz", Kind("a.npz", lambda: [_npz(a=deep)], lambda f: _depth(f / "a.npz"))
    yield "depth exr", Kind("00000.exr", lambda: [_exr()], _depth)
    yield "settings", Kind("a.toml", lambda: [TOML], lambda f: void(resolve(config=f / "a.toml")))
    yield "contract", Kind("contract.toml", lambda: [CONTRACT], lambda f: void(load_contract(f)))
    yield (
        "imports",
        Kind(
            "imports.json",
            lambda: [json.dumps({"flow": {"path": "/a", "fingerprint": "b", "kind": ""}}).encode()],
            _imports,
        ),
    )
    yield "predictions", Kind("a.npz", lambda: [_npz(segmentation=ids)], lambda f: _volume(f / "a.npz"))
    yield "tracks npz", Kind("a.npz", lambda: [_npz(**_tracks())], lambda f: void(read_tracks(f / "a.npz")))
    yield "tracks mat", Kind("a.mat", lambda: [_mat()], lambda f: void(read_tracks(f / "a.mat")))
    yield (
        "motion times",
        Kind(
            "a.csv",
            lambda: [b"sequence,object,start,stop\ngoat,1,0,5\ngoat,2,3,9\n"],
            lambda f: void(read_motion_times(f / "a.csv")),
        ),
    )
    yield (
        "fbms",
        Kind(
            "GroundTruth/a.dat",
            lambda: [FBMS],
            _fbms,
            lambda f: void((f / "GroundTruth/00000_gt.png").write_bytes(_image("PNG"))),
        ),
    )
    for name in sorted(store()):
        short = "/".join(part for part in Path(name).parts[1:] if not part.startswith("v00000"))
        for what, reader in {"store": _read_store, "commands": _read_state}.items():
            yield (
                f"{what} {short}",
                Kind(name, lambda name=name: [store()[name]], reader, _put_store, share=1 / 20),
            )


def void(_: Any) -> None:
    """What is read is not looked at."""
