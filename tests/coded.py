"""Pictures that show their number, and containers made of them as strangers' programs make them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import av
import numpy as np

from zsmoseg.settings import Video
from zsmoseg.video.frames import read
from zsmoseg.video.probe import Excerpt, Probe, probe


def excerpt(**chosen: Any) -> Excerpt:
    return Video(**chosen).parameters(Excerpt)


def coded(number: int, width: int = 160, height: int = 90) -> np.ndarray:
    """A picture that shows its number as six light or dark bars, top to bottom over a ramp."""
    image = np.full((height, width, 3), 40, np.uint8)
    image[:, : width // 4, 2] = 200
    for bit in range(6):
        if number >> bit & 1:
            image[height // 6 * bit : height // 6 * (bit + 1), width // 2 :] = 220
    return image


def decoded(image: np.ndarray) -> int:
    height, width = image.shape[:2]
    bars = [image[height // 6 * b + height // 12, width * 3 // 4].mean() > 128 for b in range(6)]
    return sum(1 << b for b, bar in enumerate(bars) if bar)


Change = Callable[[int, Any], None]


def write(
    path: Path,
    shown: Iterable[int] = range(40),
    codec: str = "libx264",
    size: tuple[int, int] = (160, 90),
    form: str | None = None,
    change: Change | None = None,
    **options: str,
) -> Path:
    """Pictures 40 ms apart as one stream; ``change`` may give every packet, by its number in the file, other times."""
    with av.open(str(path), "w", format=form) as container:
        add(container, shown, codec, size, change, **options)
    return path


def add(
    container: Any,
    shown: Iterable[int],
    codec: str = "libx264",
    size: tuple[int, int] = (160, 90),
    change: Change | None = None,
    **options: str,
) -> None:
    """One stream of pictures in a container that is being written."""
    quiet = {"x265-params": "log-level=none"} if codec == "libx265" else {}
    stream = container.add_stream(codec, rate=25, options={"g": "12", **quiet, **options})
    stream.width, stream.height = size
    stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
    made = []
    for n in shown:
        made += stream.encode(av.VideoFrame.from_ndarray(coded(n, *size), "bgr24"))
    for n, packet in enumerate(made + stream.encode(None)):
        if change is not None:
            change(n, packet)
        container.mux(packet)


def look(path: Path, **chosen: Any) -> Probe:
    return probe(str(path), excerpt(**chosen))


def numbers(looked: Probe) -> list[int]:
    """What the frames show."""
    return [decoded(image) for image in read(looked, 0, len(looked.times))]


def evenly(times: Sequence[float], step: float = 0.04) -> bool:
    return bool(np.allclose(np.diff(times), step, atol=1.1e-3))
