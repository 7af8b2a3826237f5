"""The sections of what comes in: the video, its frames, flow and depth."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path
from typing import Any, Literal

from zsmoseg.errors import SettingsError
from zsmoseg.settings.section import Brought, Section, setting

WHEN = (
    r"^(\d{1,12}(\.\d{1,12})?s?|(\d{1,4}:[0-5]?\d|\d{1,6}):[0-5]?\d(\.\d{1,12})?|\d{1,12}f)?$",
    "seconds (12.5), a time (0:01, 1:02:03.5) or a frame number (300f)",
)
"""Seconds, hours, minutes and seconds, or a frame number: the pattern, and its words."""


class Video(Section):
    """Which frames of the source are used."""

    start: str = setting("", f"first frame used: {WHEN[1]}", pattern=WHEN)
    end: str = setting("", f"end of what is used, exclusive: {WHEN[1]}", pattern=WHEN)
    every: int = setting(1, "use every n-th frame", "frames", ge=1)
    fps: float = setting(
        25.0, "frame rate of folders of images, which carry no times", "1/s", ge=1e-3, le=1e6
    )
    allow_truncated: bool = setting(False, "use the part of a damaged video that can be decoded")
    fingerprint: Literal["content", "stat"] = setting(
        "content", "how the source is recognised: hash of its bytes, or size and time of change"
    )


SEEN = b"alpha, palette, noise, marks: "
"""How masks are read, before their content in keys: another way of reading the same file is another mask."""


class Ignore(Section):
    """Pixels that count for nothing: a car bonnet, a time stamp."""

    mask: str = setting(
        "",
        "image of the shape of the frames; what is not black or transparent in it is kept out of every fit, table, border and mask",
    )

    def active(self) -> dict[str, Any]:
        """The content of the mask counts, not its path."""
        if self.mask and (path := Path(self.mask)).exists() and not path.is_file():
            raise SettingsError(
                f"{self.mask}: the ignore mask cannot be read (is no file); give a PNG to --ignore"
            )
        try:
            return {"mask": sha256(SEEN + Path(self.mask).read_bytes()).hexdigest() if self.mask else ""}
        except OSError as error:
            raise SettingsError(f"{self.mask}: the ignore mask cannot be read ({error.strerror})") from error


class Frames(Section):
    """The working grid."""

    width: int = setting(427, "width of the working grid; the height follows", "px", ge=32, le=4096)


class Flow(Brought):
    """Optical flow in both directions."""

    source: Literal["auto", "dis", "network", "imported"] = setting(
        "auto",
        "dis: OpenCV DIS; network: flow.model; imported: read from files; auto: what is brought or named, else dis",
    )
    path: str = setting("", "files with the flow of one video, or a folder with one of them a video")
    model: str = setting(
        "", "the network: its name (zsmoseg models) or folder", "", ("source", "network"), ("flow",)
    )
    finest_scale: int = setting(
        0, "finest level of the pyramid; 1 = half the working grid", "", ("source", "dis"), ge=0, le=4
    )
    stride: int = setting(4, "distance of the patches (8 px wide)", "px", ("source", "dis"), ge=1, le=8)
    descent: int = setting(12, "gradient descent steps of a patch", "", ("source", "dis"), ge=1, le=256)
    refinement: int = setting(0, "variational refinement steps", "", ("source", "dis"), ge=0, le=256)
    reach: int = setting(
        48,
        "how far away what moves too fast for that is searched; 0 = not",
        "px",
        ("source", "dis"),
        ge=0,
        le=256,
    )
    cut: float = setting(
        0.58, "share of pixels that the other frame does not explain above which a pair is a cut", gt=0, le=1
    )
    repeat: float = setting(
        4.0,
        "difference of local means up to which a frame is a repeat of the one before",
        "grey levels",
        ge=0,
    )


class Depth(Brought):
    """Pseudo depth."""

    source: Literal["auto", "ground", "constant", "network", "imported"] = setting(
        "auto",
        "constant: no depth; ground: a plane that comes nearer towards the bottom; network: depth.model; "
        "imported: read from files; auto: what is brought or named, else constant",
    )
    path: str = setting("", "files with the depth of one video, or a folder with one of them a video")
    model: str = setting(
        "", "the network: its name (zsmoseg models) or folder", "", ("source", "network"), ("depth",)
    )
    kind: Literal["", "depth", "inverse-depth", "disparity"] = setting(
        "",
        "what the imported numbers are: larger = farther; larger = nearer; the same, 0 and less unknown",
        "",
        ("source", "imported"),
    )
