"""What every tracker of masks does: it starts with masks and gives the masks of the next frame, frame by frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from zsmoseg.tracking.carrying import Flow, Label

Frame = NDArray[np.uint8]
"""(H, W, 3) blue green red."""


@dataclass(frozen=True)
class Step:
    """One frame further, and the flow between it and the frame before, if somebody has it."""

    frame: Frame
    """(H, W, 3) blue green red."""
    backward: Flow | None = None
    """(2, h, w) from this frame to the one before, px of the working grid; None in the first frame of a shot."""
    forward: Flow | None = None
    """(2, h, w) from the frame before to this one, px of the working grid; None in the first frame of a shot."""


class Tracker(Protocol):
    """Objects from their masks in one frame, followed through the frames after it, within one shot.

    A tracker holds its state in the memory of the host; it does not grow with the number of frames.
    """

    def start(self, frame: Frame, label: Label) -> None:
        """Forget everything and begin with the objects of a frame.

        Parameters
        ----------
        frame
            (H, W, 3) blue green red.
        label
            (H, W) object of each pixel: 1 to n without gaps, 0 = none; n >= 1.
        """

    def step(self, step: Step) -> Label:
        """The objects in the next frame.

        Returns
        -------
        (H, W)
            Numbers as given; an object without pixels is not seen in this frame.
        """

    def add(self, frame: Frame, label: Label) -> None:
        """Go on from corrected masks of the last frame, with objects that were not there.

        Parameters
        ----------
        frame
            (H, W, 3) the frame of the last ``step`` or ``start``.
        label
            (H, W) all objects that are to go on: known ones with their numbers, new ones with the numbers after those.
            A known object without pixels need not be found again.
        """


Factory = Callable[[], Tracker]
"""A tracker of its own, for one span; those of a network share its sessions."""
