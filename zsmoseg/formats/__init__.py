"""One file a format or family: bytes to arrays and back; the ``open_`` functions find which."""

from zsmoseg.formats.depth import inverse_depth, open_depth
from zsmoseg.formats.flow import open_flow
from zsmoseg.formats.frame_names import match_frames
from zsmoseg.formats.mask_formats import open_masks
from zsmoseg.formats.names import find_for_video

__all__ = ["find_for_video", "inverse_depth", "match_frames", "open_depth", "open_flow", "open_masks"]
