"""What a scene is: what is seen, how it moves, and what is true of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from zsmoseg.motion.models import Floats

Camera = Literal["still", "pan", "lateral", "forward", "general"]
CAMERAS: tuple[Camera, ...] = ("still", "pan", "lateral", "forward", "general")
"""How a camera moves: not; turning; sideways; along its axis; all of it."""

SHOWN = 48
"""px below which an object is too small for a scene's truth to ask for it."""


@dataclass(frozen=True)
class Scene:
    """One synthetic shot of T frames and N objects (0 = background)."""

    labels: NDArray[np.uint16]
    """(T, H, W) object of every pixel."""
    flow: NDArray[np.float32]
    """(T - 1, 2, H, W) px, x then y, to the next frame."""
    inverse_depth: NDArray[np.float32]
    """(T, H, W), up to scale (and shift)."""
    group: NDArray[np.int64]
    """(N,) true motion group, 0 = static."""
    moving: NDArray[np.bool_]
    """(T - 1, N) whether an object moves at a pair."""
    contrast: Floats
    """(N,) rms px of an object's flow that no single motion shares with the background."""
    camera: Camera
    frames: NDArray[np.uint8] | None = None
    """(T, H, W, 3) blue green red, if rendered."""

    @property
    def objects(self) -> int:
        """Number of objects, the background included."""
        return len(self.group)

    @property
    def truth(self) -> NDArray[np.int64]:
        """(T, H, W) true motion group of every pixel, 0 = static."""
        return self.group[self.labels]

    @property
    def pictures(self) -> NDArray[np.uint8]:
        """(T, H, W, 3) the frames; of a scene that was not rendered every object in a colour of its own."""
        if self.frames is not None:
            return self.frames
        palette = np.random.default_rng(0).integers(0, 256, (self.objects, 3), np.uint8)
        return palette[self.labels]

    def right(self, group: NDArray[np.integer[Any]]) -> tuple[bool, bool]:
        """Whether groups (N,) are the true ones but for names, and whether static and moving are.

        Objects with fewer than ``SHOWN`` px in all frames, or all but one, are not asked for.
        """
        pixels = np.stack([np.bincount(label.ravel(), minlength=self.objects) for label in self.labels[:-1]])
        shown = (pixels >= SHOWN).sum(0) >= 2
        found, true = group[shown], self.group[shown]
        both = bool(((found > 0) == (true > 0)).all())
        names = set(zip(found.tolist(), true.tolist(), strict=True))
        return both and len(names) == len(np.unique(found)) == len(np.unique(true)), both
