"""Which number every object is painted with at a frame."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray


def paint_table(
    number: NDArray[np.int64], moving: NDArray[np.bool_] | None, when: Literal["ever", "now"]
) -> NDArray[np.uint16]:
    """The look-up table from object to painted number at one frame.

    Parameters
    ----------
    number : (objects,) group or instance of every object, 0 = static, at most 65535.
    moving : (objects,) whether it moves at this frame; needed for ``when = "now"``.
    when : paint a mover wherever it is seen, or only while it moves.
    """
    painted = number if when == "ever" or moving is None else np.where(moving, number, 0)
    return painted.astype(np.uint16)
