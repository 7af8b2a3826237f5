"""From superpixels to pixels of the displayed size.

Upsampled by a guide: He, Sun, Tang, PAMI 2013, section on joint upsampling.
"""

from __future__ import annotations

import cv2
import numpy as np

from zsmoseg.proposals.embedded.aliases import Bools, Frames, Ids, Segments
from zsmoseg.proposals.embedded.guided_filter import GuidedFilter, guided_filter

REACH = 3
"""Radii of the filter around the objects beyond which it is 0: two windows, and one to spare."""
HALF = 0.5
"""Filtered mask from which a pixel is inside."""


def paint(
    frame: Frames, segment: Segments, ids: Ids, shape: tuple[int, int], parameters: GuidedFilter
) -> Segments:
    """The object of every pixel of one frame.

    Parameters
    ----------
    frame
        (h, w, 3) on the working grid, blue green red.
    segment
        (h, w) superpixels.
    ids
        (superpixels) object, 0 = none.
    shape
        Displayed height and width.
    parameters
        Of the filter that moves the masks to the edges of the picture.

    Returns
    -------
    (H, W): object, 0 = none.
    """
    if not ids.any():
        return np.zeros(shape, np.uint16)
    label = ids[segment]
    box = _box(label > 0, REACH * parameters.guide_radius)
    inside = label[box]
    soft = np.zeros(label.shape, np.float32)
    guide = frame[box].astype(np.float32) / np.float32(255)
    soft[box] = guided_filter(guide, (inside > 0).astype(np.float32), parameters)
    mask = cv2.resize(soft, shape[::-1], interpolation=cv2.INTER_LINEAR) > HALF
    label[box] = spread_ids(inside)
    full = cv2.resize(label, shape[::-1], interpolation=cv2.INTER_NEAREST_EXACT)
    return np.where(mask, full, 0).astype(np.uint16)


def _box(mask: Bools, margin: int) -> tuple[slice, slice]:
    """The smallest box around a mask that is not empty, and a margin."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return (
        slice(max(rows[0] - margin, 0), rows[-1] + margin + 1),
        slice(max(columns[0] - margin, 0), columns[-1] + margin + 1),
    )


def spread_ids(label: Ids) -> Ids:
    """(h, w) the nearest id above 0 at every pixel; there must be one."""
    empty = (label == 0).astype(np.uint8)
    _, nearest = cv2.distanceTransformWithLabels(empty, cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL)
    table = np.zeros(int(nearest.max()) + 1, np.int32)
    table[nearest[label > 0]] = label[label > 0]
    return table[nearest]
