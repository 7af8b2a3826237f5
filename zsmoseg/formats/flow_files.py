"""Files of optical flow: .flo, KITTI png, .npy, .npz.

Conventions (README of Middlebury's flow-code; devkit of KITTI 2015): x to the right, then y down, in pixels
of the grid; .flo: float32, a component above 1e9, or NaN as many write it, is unknown; KITTI: 16 bits, ``(value - 32768) / 64``, third
channel 0 where unknown.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import FormatError
from zsmoseg.formats.names import SIDES
from zsmoseg.formats.npy import DAMAGED, Array, damaged, keys, load, only_key
from zsmoseg.formats.overlaps import text
from zsmoseg.video.bounds import TooLarge, check_png, check_size, open_image

Flow = NDArray[np.float32]

MAGIC, HEAD = b"PIEH", 12
"""Of .flo files: how they begin, and bytes before the numbers."""

UNKNOWN = 1e9
"""Components of .flo files above it are unknown, and what is no number."""

ZERO, STEP = 32768, 64
"""KITTI: what stands for no motion, and steps a pixel."""


def sides(path: Path) -> dict[str, str]:
    """Which array of a file is which direction."""
    names = [""] if path.suffix.lower() == ".npy" else keys(path)
    if "forward" in names:
        return {side: side for side in SIDES if side in names}
    return {"forward": only_key(path, ", or two called forward and backward")}


def read_flow(path: Path, side: str = "forward") -> Flow:
    """One file of flow, (2, H, W); ``side`` chooses where it holds both.

    Raises
    ------
    FormatError
        If it cannot be used.
    """
    ending = path.suffix.lower()
    if ending == ".flo":
        return _read_flo(path)
    if ending == ".png":
        return _read_kitti(path)
    if ending not in (".npy", ".npz"):
        raise FormatError(f"{path}: is no file of flow; give .flo, .png, .npy or .npz")
    names = sides(path)
    return as_flow(load(path)[names.get(side, names["forward"])], str(path))


def _read_flo(path: Path) -> Flow:
    try:
        with path.open("rb") as file:
            head, size = file.read(HEAD), path.stat().st_size
            width, height = np.frombuffer(head[4:].ljust(HEAD - 4, b"\0"), "<i4").tolist()
            if not head.startswith(MAGIC) or size != HEAD + 8 * height * width:
                raise ValueError(f"{size} bytes, {height} x {width} by its head")
            check_size(height, width)
            found = np.frombuffer(file.read(), "<f4").reshape(height, width, 2)
    except TooLarge as error:
        raise FormatError(f"{path}: {error}; make it smaller") from error
    except DAMAGED as error:
        raise FormatError(f"{path}: is damaged, or no .flo ({error}); make the file anew") from error
    unknown = ~(np.abs(found) <= UNKNOWN)  # NaN too
    flow = as_flow(np.where(unknown, 0, found), str(path))
    flow[:, unknown.any(-1)] = np.nan
    return flow


def _read_kitti(path: Path) -> Flow:
    try:
        with open_image(path):
            content = path.read_bytes()
        check_png(content)
    except DAMAGED as error:
        raise damaged(path, error) from error
    try:
        stored = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        stored = None
    if stored is None:
        raise FormatError(f"{path}: cannot be read; make the file anew")
    if stored.dtype != np.uint16 or stored.ndim != 3 or stored.shape[2] != 3:
        raise FormatError(
            f"{path}: is no flow as KITTI has it (16 bits, three channels), but {text(stored.shape)} {stored.dtype}"
        )
    valid, y, x = np.moveaxis(stored, 2, 0)
    flow = (np.stack([x, y]).astype(np.float32) - ZERO) / STEP
    flow[:, valid == 0] = np.nan
    return np.asarray(flow, np.float32)


def as_flow(values: Array, where: str) -> Flow:
    """(2, H, W) float32 from (H, W, 2) or (2, H, W); ``where`` begins the errors.

    Raises
    ------
    FormatError
        If it is of another shape, no floats, or not finite.
    """
    if values.ndim != 3 or (values.shape[0] == 2) == (values.shape[2] == 2):
        raise FormatError(f"{where}: is {text(values.shape)}; flow is (y, x, 2) or (2, y, x)")
    if values.dtype.kind != "f":
        raise FormatError(f"{where}: holds {values.dtype} numbers; flow is in pixels, save it as float32")
    if not np.isfinite(values).all():
        raise FormatError(
            f"{where}: holds NaN or infinity; fill what is unknown, or give .flo or KITTI png, which can say so"
        )
    planar = values if values.shape[0] == 2 else np.moveaxis(values, 2, 0)
    with np.errstate(over="ignore"):  # beyond float32 is infinite
        return np.array(planar, np.float32, order="C")


def write_flo(path: Path, flow: NDArray[Any]) -> None:
    """Write (2, H, W) as .flo; NaN as unknown.

    Raises
    ------
    OSError
        If it cannot be written; OpenCV does not say why.
    """
    known = np.nan_to_num(np.moveaxis(flow, 0, 2), nan=10 * UNKNOWN).astype(np.float32)
    if not cv2.writeOpticalFlow(str(path), np.ascontiguousarray(known)):
        raise OSError(0, "no space, or no permission", str(path))


def encode_kitti(flow: NDArray[Any], where: str) -> bytes:
    """A KITTI png of (2, H, W), in steps of 1/64 px; NaN as not valid. ``where`` begins the error.

    Raises
    ------
    FormatError
        If a pixel moves by 512 px or more.
    """
    valid = np.isfinite(flow).all(0)
    stored = np.rint(np.where(valid, flow, 0) * STEP + ZERO)
    if stored.min() < 0 or stored.max() > 2 * ZERO - 1:
        largest = np.abs(flow[:, valid]).max()
        raise FormatError(
            f"{where}: a pixel moves by {largest:.0f} px, KITTI png holds up to 512; use another format"
        )
    channels = np.stack([valid, stored[1], stored[0]], 2).astype(np.uint16)
    return cv2.imencode(".png", channels)[1].tobytes()
