"""The sections of what comes out, and of how the work is cut."""

from __future__ import annotations

from typing import Literal

from zsmoseg.settings.section import Section, setting


class Masks(Section):
    """What is painted."""

    when: Literal["ever", "now"] = setting(
        "ever", "paint a mover wherever it is seen, or only while it moves"
    )


class Overlay(Section):
    """The overlay video."""

    write: bool = setting(True, "write overlay.mp4")


class Chunk(Section):
    """How work is cut. Changes no value and is in no key."""

    length: int = setting(32, "frames of a chunk", "frames", ge=1, le=4096)
