"""Stage ``overlay``: the video with the moving groups in colour."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace

import av
import numpy as np

from zsmoseg.painting.numbers import paint_table
from zsmoseg.painting.overlay import overlay
from zsmoseg.video.frames import read
from zsmoseg.video.probe import Probe
from zsmoseg.workflows.stage import ALL, Left, Stage, Task
from zsmoseg.workflows.stages.masks import moving_objects

BLOCK = 16
"""Frames held in memory at once."""


def files(probe: Probe, start: int, stop: int, settings: SimpleNamespace) -> list[str]:
    """The one file, unless it is not wanted."""
    return ["overlay.mp4"] if settings.overlay.write else []


def task(task: Task) -> Left:
    """Decode the source, colour what moves, encode H.264 that browsers play."""
    if not task.settings.overlay.write:
        return Left(facts={"files": {}})
    path = Path(task.out) / "overlay.mp4"
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(".overlay.partial.mp4")
    table = task.inputs["groups"].read_table(0)
    with av.open(str(partial), "w", options={"movflags": "faststart"}) as container:
        stream = container.add_stream("libx264", rate=_rate(task.probe))
        stream.width, stream.height = task.probe.width // 2 * 2, task.probe.height // 2 * 2
        stream.pix_fmt = "yuv420p"
        stream.options = {"preset": "ultrafast", "crf": "23", "threads": "1"}
        images = read(task.probe, task.start, task.stop)
        for first in range(task.start, task.stop, BLOCK):
            last = min(first + BLOCK, task.stop)
            labels = task.inputs["labels"].read("label", first, last)
            moving = moving_objects(task.inputs["groups"], first, last, len(table["group"]))
            for label, state in zip(labels, moving, strict=True):
                mask = paint_table(table["group"], state, task.settings.masks.when)[label]
                image = overlay(next(images), mask)
                even = image[: stream.height, : stream.width]
                for packet in stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(even), "bgr24")):
                    container.mux(packet)
        for packet in stream.encode(None):
            container.mux(packet)
    partial.replace(path)
    return Left(facts={"files": {"overlay.mp4": path.stat().st_size}})


def _rate(probe: Probe) -> Fraction:
    """Frames per second, from the median distance of the frames."""
    step = float(np.median(np.diff(probe.times))) if len(probe.times) > 1 else 0.04
    return Fraction(1 / max(step, 1e-3)).limit_denominator(1001)


STAGE = Stage(
    "overlay",
    1,
    task,
    inputs={"labels": ALL, "groups": ALL},
    sections=("masks", "overlay"),
    scope="video",
    files=files,
    cost=(5.6, 25.0),
)
