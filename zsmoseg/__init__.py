"""Zero-shot motion segmentation: what moves by itself in a video from a moving camera."""

__version__ = "0.1.0"
