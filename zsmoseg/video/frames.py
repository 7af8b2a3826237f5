"""The used frames of a video by index."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import VideoError
from zsmoseg.video.decoding import decoder
from zsmoseg.video.pixels import pixels, unreadable
from zsmoseg.video.probe import Probe


def read(probe: Probe, start: int, stop: int) -> Iterator[NDArray[np.uint8]]:
    """Frames ``start`` to ``stop - 1`` of the used ones: (H, W, 3) blue green red, 8 bit, as displayed.

    Of 16-bit images the largest value that their bits can hold becomes 255; grey is repeated, alpha is dropped.

    Raises
    ------
    VideoError
        At the first frame that cannot be read.
    """
    if probe.files:
        for file in probe.files[start:stop]:
            yield _read_image(file, probe)
        return
    images = decoder(probe.source, probe.way).frames(probe.pts[start:stop])
    for number in range(start, stop):
        index = probe.indices[number] if probe.indices else int(probe.names[number])
        try:
            image = next(images)
        except VideoError as error:
            raise VideoError(
                f"{probe.source}: frame {index} ({probe.times[number]:.2f} s) cannot be decoded; "
                f"--end {index}f stops before it"
            ) from error
        if image.shape[:2] != (probe.height, probe.width):
            raise VideoError(
                f"{probe.source}: its size changes at frame {index} ({probe.times[number]:.2f} s) from {probe.width} x "
                f"{probe.height} to {image.shape[1]} x {image.shape[0]}; --end {index}f stops before it"
            )
        yield image


def _read_image(file: str, probe: Probe) -> NDArray[np.uint8]:
    image = pixels(file)
    if image is None:
        raise unreadable(file, "cannot be read as an image, or is cut off")
    if image.dtype not in (np.uint8, np.uint16):
        raise unreadable(file, f"has {image.dtype} pixels, expected 8 or 16 bit")
    if image.shape[:2] != (probe.height, probe.width):
        raise VideoError(
            f"{file}: is {image.shape[1]} x {image.shape[0]}, expected {probe.width} x {probe.height}; "
            "all frames of a video must have one size"
        )
    if image.dtype == np.uint8:
        return image
    largest = (1 << probe.bits) - 1
    return np.minimum((image.astype(np.uint32) * 255 + largest // 2) // largest, 255).astype(np.uint8)
