"""What decided about an object never contradicts the evidence that is told."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest

from zsmoseg.grouping.core import Core, group_arrays
from zsmoseg.grouping.decisions import BORDER, Reason
from zsmoseg.grouping.remarks import NO_WORLD, NOTHING, RESTING, together
from zsmoseg.settings import resolve
from zsmoseg.synthetic import flow_scene
from zsmoseg.workflows.sentences import MOVES, RESTS, of_piece
from zsmoseg.workflows.wording import counted

CHOICES: list[dict[str, Any]] = [
    {},
    {"groups.count": 1},
    {"groups.count": 5},
    {"groups.share": 0.6, "groups.reach": 0.01},
    {"groups.share": 0.6, "groups.reach": 30.0},
    {"groups.least_pairs": 5},
    {"affinity.kernel": "ordered"},
    {"affinity.visible": 9.0},
    {"groups.rule": "spectral"},
    {"groups.rule": "keep"},
    {"groups.rule": "keep", "groups.count": 3},
]
SEEN: Counter[Reason] = Counter()


@pytest.mark.parametrize("seed", [4, 6])
@pytest.mark.parametrize("choice", CHOICES, ids=str)
def test_the_answer_follows_from_the_evidence_or_from_the_reason_that_is_told(
    choice: dict[str, Any], seed: int
) -> None:
    scene = flow_scene(seed, n_movers=2, n_objects=8, n_pairs=4, shape=(120, 214), min_contrast=0.4)
    labels = scene.labels.copy()
    labels[2:][labels[2:] == 3] = 0
    core = resolve(overrides=choice).parameters(Core)
    found = group_arrays(labels, scene.pictures, scene.flow, scene.inverse_depth, "screw-shift", core)[0]
    world = found.tolerance / (found.tolerance + found.excess)
    for n in range(1, len(found.group)):
        reason, moves = Reason(int(found.reason[n])), bool(found.group[n])
        SEEN[reason] += 1
        assert reason in (MOVES if moves else RESTS)
        if reason is Reason.EVIDENCE:
            assert moves == (world[n] < BORDER)
        if reason is Reason.UNKNOWN:
            assert np.isnan(world[n])
        if reason in (Reason.SMALL, Reason.SHORT, Reason.REFITTED):
            assert world[n] < BORDER


@pytest.mark.parametrize("reason", [Reason.EVIDENCE, Reason.COUNT, Reason.JOINED, Reason.SMALL, Reason.CUES])
def test_the_scenes_above_had_every_kind(reason: Reason) -> None:
    if sum(SEEN.values()) < len(CHOICES):
        pytest.skip("the scenes were not run in this process")
    assert SEEN[reason]


@pytest.mark.parametrize("moving", [0, 1, 4])
def test_a_mover_that_rests_in_all_frames_is_said_to(moving: int) -> None:
    row = {
        "piece": 5,
        "object": 3,
        "group": 1,
        "frames": 4,
        "frames_moving": moving,
        "area": 1,
        "world": 0.6,
        "excess": 0.1,
        "tolerance": 0.15,
        "reason": Reason.JOINED,
        "visibility": 2.0,
        "geometry": "not asked",
    }
    told = of_piece(row, 1.5)
    assert ("resting in all" in told) == (moving == 0)
    assert "not below the border of 0.50; it moves all the same, for it is near" in told
    assert "1 pixel in all" in told


def test_one_is_not_many() -> None:
    assert [counted(n, "frame") for n in (0, 1, 2)] == ["0 frames", "1 frame", "2 frames"]


# ------------------------------------------------------------------------ warnings
def test_each_warning_is_given_once_with_the_frames_it_is_of() -> None:
    found = [([NO_WORLD], "frames 0 to 9"), ([], "frames 10 to 19"), ([NO_WORLD], "frames 20 to 29")]
    assert together(found) == [f"frames 0 to 9, frames 20 to 29: {NO_WORLD}"]
    assert together(found[:1]) == [NO_WORLD]


def test_that_nothing_moves_is_worth_a_word_where_nothing_moves_in_the_whole_video() -> None:
    assert together([([NOTHING], "a"), ([], "b")]) == []
    assert together([([NOTHING], "a"), ([RESTING], "b")]) == [RESTING]
    assert together([([NOTHING], "a"), ([NOTHING], "b")]) == [NOTHING]


@pytest.mark.parametrize("text", [NOTHING, NO_WORLD, RESTING])
def test_a_warning_says_what_to_do(text: str) -> None:
    assert "--" in text
