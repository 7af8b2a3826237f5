"""Small clips with known truth, and runs of them that several tests look at."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

cv2.setNumThreads(1)
SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"


def textured(rng: np.random.Generator, height: int, width: int, colour: tuple[int, int, int]) -> np.ndarray:
    """A picture with detail at several scales around one colour."""
    out = np.zeros((height, width, 3))
    for sigma, strength in ((1.0, 60), (3.0, 90), (8.0, 120)):
        noise = cv2.GaussianBlur(rng.normal(size=(height, width)), (0, 0), sigma)
        out += (strength / 4 * noise / noise.std())[..., None]
    return np.clip(out + np.array(colour), 0, 255).astype(np.uint8)


def draw_clip(
    seed: int = 0, frames: int = 10, height: int = 120, width: int = 160, mover: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """A panning camera and, if wanted, one disc that moves by itself: frames (T, H, W, 3), truth (T, H, W)."""
    rng = np.random.default_rng(seed)
    world = textured(rng, height + 40, width + 80, (110, 130, 90))
    skin = textured(rng, 60, 60, (60, 60, 200))
    images, truth = [], []
    for t in range(frames):
        image = world[10 + t // 2 : 10 + t // 2 + height, 2 * t : 2 * t + width].copy()
        mask = np.zeros((height, width), np.uint8)
        if mover:
            centre = (width // 3 + 3 * t, height // 2 + t)
            cv2.circle(mask, centre, 18, 1, -1)
            patch = np.zeros((height + 120, width + 120, 3), np.uint8)
            x, y = centre[0] + 30, centre[1] + 30
            patch[y : y + 60, x : x + 60] = skin
            image[mask > 0] = patch[60:-60, 60:-60][mask > 0]
        images.append(image)
        truth.append(mask > 0)
    return np.stack(images), np.stack(truth)


def write_mp4(path: Path, images: np.ndarray) -> Path:
    """A video file of frames (T, H, W, 3)."""
    with av.open(str(path), "w", format="mp4") as container:
        stream = container.add_stream("mpeg4", rate=25)
        stream.width, stream.height, stream.pix_fmt = images.shape[2], images.shape[1], "yuv420p"
        for image in images:
            for packet in stream.encode(av.VideoFrame.from_ndarray(image, "bgr24")):
                container.mux(packet)
        for packet in stream.encode(None):
            container.mux(packet)
    return path


def write_folder(folder: Path, images: np.ndarray) -> Path:
    """Frames as PNG."""
    folder.mkdir(parents=True, exist_ok=True)
    for t, image in enumerate(images):
        cv2.imwrite(str(folder / f"{t:05d}.png"), image)
    return folder


@pytest.fixture(scope="session")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of ten frames with one mover."""
    return write_folder(tmp_path_factory.mktemp("clips") / "disc", draw_clip()[0])


@pytest.fixture(scope="session")
def davis() -> Path:
    """Real sequences with truth."""
    folder = SHARED / "DAVIS"
    if not folder.is_dir():
        pytest.skip("the DAVIS sequences are not beside the checkout")
    return folder


@pytest.fixture(autouse=True, scope="session")
def _as_if_alone(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """No store from outside, no rates of other runs; no waiting for the disk; no line that time alone brings."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        patch.delenv("ZSMOSEG_STORE", raising=False)
        patch.setattr(os, "fsync", lambda _: None)
        patch.setattr("zsmoseg.workflows.running.progress.EVERY", float("inf"))
        yield


@pytest.fixture(autouse=True, scope="session")
def _ports_are_taken() -> Iterator[None]:
    """The ports that Dask takes where it is not told another, as on a machine where somebody works with it."""
    with ExitStack() as stack:
        for port in (8786, 8787):
            taken = stack.enter_context(socket.socket())
            with suppress(OSError):  # somebody has it already
                taken.bind(("", port))
                taken.listen()
        yield
