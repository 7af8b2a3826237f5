"""Scenes with known camera motion, depth and motion of every object: the ground truth of the tests.

``flow_scene``
    Labels, exact instantaneous flow (equation 1 of the paper) with noise, and inverse depth known up to
    scale and shift; no picture.
``video_scene``
    Textured bodies, a wall and a ground rendered frame by frame under finite motions, with labels, inverse
    depth and exact flow: real optical flow works on it.
``demo_scene``
    The clip of ``zsmoseg demo``.

Object 0 is the background. All lengths are px of the scene's own grid.
"""

from zsmoseg.synthetic.flow_scenes import Wishes, flow_scene
from zsmoseg.synthetic.rigid import Motion, rigid_flow
from zsmoseg.synthetic.scene import CAMERAS, Camera, Scene
from zsmoseg.synthetic.video_scenes import demo_scene, video_scene

__all__ = [
    "CAMERAS",
    "Camera",
    "Motion",
    "Scene",
    "Wishes",
    "demo_scene",
    "flow_scene",
    "rigid_flow",
    "video_scene",
]
