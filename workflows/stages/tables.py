"""Stage ``tables``: what is measured on the superpixels and between them."""

from __future__ import annotations

from zsmoseg.flow import STATES
from zsmoseg.proposals.embedded.measuring import Links, measure
from zsmoseg.workflows.reading import read_states
from zsmoseg.workflows.stage import Left, Stage, Task


def task(task: Task) -> Left:
    """The tables of one chunk; the frame after it is read for the last pair only."""
    inputs, stop = task.inputs, task.last_pair + 1
    state = read_states(task.inputs["flow"], task.start, task.last_pair)
    features = measure(
        inputs["frames"].read("frame", task.start, stop),
        inputs["segments"].read("segment", task.start, stop),
        inputs["flow"].read("forward", task.start, task.last_pair),
        inputs["flow"].read("backward", task.start, task.last_pair),
        [STATES[i] for i in state],
        task.stop - task.start,
        task.ignored,
        task.settings.tables.group(Links),
    )
    return Left(tables=features.arrays())


STAGE = Stage(
    "tables",
    2,
    task,
    inputs={"frames": 1, "segments": 1, "flow": 0},
    sections=("tables", "ignore"),
    cost=(7.7, 154.9),
)
