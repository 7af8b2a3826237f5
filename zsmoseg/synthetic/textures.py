"""Noise, and pictures made of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.motion.models import Floats

SIZE = 384
"""px of a texture, before it repeats."""
SCALES = ((3, 0.6), (9, 1.0), (25, 1.0))
"""px of detail, from what optical flow needs to what the eye sees, and how strong it is."""
GREY, HUE = 0.9, 0.2
"""Part of the detail that is common to the colours, and of each colour's own."""
CORRELATED = 6
"""px over which half of the error of flow is correlated, as that of real flow is."""
MARGIN = 4
"""Cells cut off a field of noise, where its blur lacks neighbours."""
TINY = 1e-12
"""Instead of 0 as divisor."""


def smooth_noise(rng: np.random.Generator, shape: tuple[int, int], sigma: float) -> Floats:
    """Noise (h, w) of mean 0 and variance 1 with a Gaussian correlation of ``sigma`` px."""
    step = max(int(sigma / 2), 1)
    rows, columns = shape[0] // step + 2 * MARGIN, shape[1] // step + 2 * MARGIN
    field = cv2.GaussianBlur(rng.normal(size=(rows, columns)), (0, 0), sigma / step)
    field = cv2.resize(field, (columns * step, rows * step), interpolation=cv2.INTER_LINEAR)
    field = field[MARGIN * step :, MARGIN * step :][: shape[0], : shape[1]]
    return np.asarray((field - field.mean()) / max(float(field.std()), TINY))


def flow_noise(rng: np.random.Generator, shape: tuple[int, ...], noise: float) -> Any:
    """Error (pairs, 2, h, w) of flow of ``noise`` px rms: half of its variance white, half correlated over 6 px."""
    if noise == 0:
        return 0.0
    white = rng.normal(size=shape)
    soft = [[smooth_noise(rng, (shape[2], shape[3]), CORRELATED) for _ in range(2)] for _ in range(shape[0])]
    return noise * np.sqrt(0.5) * (white + np.array(soft))


def texture(rng: np.random.Generator, colour: Sequence[float] | Floats, strength: float) -> NDArray[np.uint8]:
    """A picture (SIZE, SIZE, 3) with detail at three scales around one colour, to be repeated both ways."""
    size = SIZE
    out = np.zeros((size, size, 3))
    for sigma, amount in SCALES:
        shared = endless_noise(rng, size, sigma)
        for c in range(3):
            out[..., c] += strength * amount * (GREY * shared + HUE * endless_noise(rng, size, sigma))
    picture: NDArray[np.uint8] = np.clip(out + np.asarray(colour), 0, 255).astype(np.uint8)
    return picture


def endless_noise(rng: np.random.Generator, size: int, sigma: float) -> Floats:
    """Noise (size, size) of variance 1 whose left and right, upper and lower edges fit."""
    frequency = np.fft.fftfreq(size)
    square = frequency[:, None] ** 2 + frequency[None, :] ** 2
    spectrum = np.fft.fft2(rng.normal(size=(size, size))) * np.exp(-2 * (np.pi * sigma) ** 2 * square)
    field = np.fft.ifft2(spectrum).real
    return np.asarray((field - field.mean()) / max(float(field.std()), TINY))
