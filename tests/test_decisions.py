"""What decided about an object never contradicts the evidence that is told."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import draw_clip, write_folder
from runs import segment

from zsmoseg import open_store
from zsmoseg.grouping.affinity import ShotAffinity, shot_affinity
from zsmoseg.grouping.core import Core, group_arrays, shot_pairs
from zsmoseg.grouping.decisions import BORDER, Reason
from zsmoseg.grouping.groups import ShotGroups, group_shot
from zsmoseg.grouping.instances import movers_torn_from
from zsmoseg.grouping.pieces import Pieces, measure_pieces
from zsmoseg.grouping.remarks import NO_WORLD, NOTHING, RESTING, together
from zsmoseg.motion.models import MODELS
from zsmoseg.settings import resolve
from zsmoseg.synthetic import flow_scene
from zsmoseg.workflows.sentences import MOVES, RESTS, of_piece
from zsmoseg.workflows.stages.embedded import objects as embedded
from zsmoseg.workflows.stages.embedded.objects import wholes_of
from zsmoseg.workflows.stages.motion import groups as stage
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


def test_what_is_torn_off_goes_back_to_the_mover_it_is_most_like() -> None:
    group = np.array([0, 1, 2, 0, 0, 0, 0, 0])
    whole = np.array([0, 1, 1, 1, 1, 1, 6, 7])
    support = np.array([0, 50, 40, 10, 45, 10, 10, 0.0])
    affinity = np.full((8, 8), 0.5)
    affinity[3, 2] = affinity[2, 3] = 0.9  # a limb of 2
    affinity[4, 1:3] = 0.2, np.nan  # as large as 2: one of 1 only
    affinity[0, 5] = 1.0  # stands on the ground
    affinity[0, 3] = np.nan
    assert movers_torn_from(group, whole, affinity, support).tolist() == [0, 1, 2, 2, 1, 5, 6, 7]
    still = movers_torn_from(np.zeros(8, np.int64), whole, affinity, support)
    assert still.tolist() == list(range(8))


def test_what_is_torn_off_moves_with_its_mover_and_its_reason_is_told() -> None:
    scene = flow_scene(4, n_movers=1, n_objects=3, n_pairs=4, shape=(120, 214), min_contrast=0.4)
    core = resolve().parameters(Core)
    shots = shot_pairs(
        scene.labels, scene.flow, scene.inverse_depth, MODELS["affine"], core.statistics, None, None
    )
    count = int(scene.labels.max()) + 1
    found = shot_affinity(lambda: iter(shots), (len(scene.flow), count), MODELS["affine"], core.affinity)
    pieces = measure_pieces(scene.labels, scene.pictures, np.arange(count))
    velocity = np.zeros((2, count, 2))

    def answer(whole: np.ndarray) -> ShotGroups:
        return group_shot(found, pieces, velocity, whole, scene.labels.shape[1:], core.groups)

    alone = answer(np.arange(count))
    mover, still = int(alone.group.argmax()), int(np.flatnonzero(alone.group[1:] == 0)[0]) + 1
    whole = np.arange(count)
    whole[still] = whole[mover]
    pieces = replace(
        pieces, area=np.where(np.arange(count) == still, np.minimum(pieces.area, 1), pieces.area)
    )
    found = replace(found, affinity=np.minimum(found.affinity, 0.99))
    torn = answer(whole)
    assert torn.group[still] == torn.group[mover] == 1
    assert torn.instance[still] == torn.instance[mover] == mover
    assert (torn.moving[:, still] == torn.moving[:, mover]).all()
    assert torn.reason[still] == Reason.TORN
    assert torn.reason[mover] == Reason.EVIDENCE


def test_what_is_torn_off_joins_no_two_instances(monkeypatch: pytest.MonkeyPatch) -> None:
    """A scrap of one car between two cars that move alike."""
    affinity = np.array([[1.0, 0.1, 0.1, 0.6], [0.1, 1, 0.9, 0.5], [0.1, 0.9, 1, 0.5], [0.6, 0.5, 0.5, 1]])
    found = ShotAffinity(
        affinity=affinity,
        agreement=affinity[None],
        together=np.ones((1, 4, 4)),
        pairs=np.full((4, 4), 9),
        static=np.array([True, False, False, True]),
        excess=np.tile([0.0, 9, 9, 0.6], (9, 1)),
        tolerance=np.ones((9, 4)),
        weight=np.ones((9, 4)),
    )
    box = np.array([[np.nan] * 4, [0, 0, 40, 40], [300, 0, 340, 40], [45, 0, 295, 10]], np.float32)
    pieces = Pieces(
        np.tile(np.int32([1, 1600, 1500, 900]), (10, 1)), np.tile(box, (10, 1, 1)), np.ones((4, 8), np.int64)
    )
    for count in ("auto", 2):
        grouping = resolve(overrides={"groups.count": count}).parameters(Core).groups
        answer = group_shot(found, pieces, np.zeros((2, 4, 2)), np.array([0, 1, 2, 1]), (120, 400), grouping)
        assert answer.group.tolist() == [0, 1, 1, 1], count
        assert answer.instance.tolist() == [0, 1, 2, 1], count
        assert answer.reason[3] == Reason.TORN


@pytest.mark.parametrize(
    ("together", "first", "last", "expected"),
    [
        ({}, 1, 3, [1, 2, 3]),
        ({(1, 7): 5, (2, 7): 9, (3, 8): 2}, 1, 3, [2, 2, 3]),
        ({(4, 1): 5, (5, 1): 5, (5, 2): 4}, 4, 6, [4, 4, 6]),
        ({(1, 1): 3, (1, 2): 6, (2, 2): 4, (3, 1): 1}, 1, 3, [1, 1, 3]),
    ],
    ids=["nothing", "two of three", "a tie, a later shot", "most counts"],
)
def test_a_whole_is_called_by_its_largest_object(
    together: dict[tuple[int, int], int], first: int, last: int, expected: list[int]
) -> None:
    assert wholes_of(together, first, last).tolist() == expected


def test_the_grouping_of_every_shot_is_told_the_wholes_of_its_objects(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[np.ndarray] = []

    def note(found: ShotAffinity, pieces: Pieces, velocity: np.ndarray, whole: np.ndarray, *more: Any) -> Any:
        told.append(whole)
        return group_shot(found, pieces, velocity, whole, *more)

    monkeypatch.setattr(embedded, "wholes_of", lambda _, first, last: np.full(last + 1 - first, last))
    monkeypatch.setattr(stage, "group_shot", note)
    frames = np.concatenate([draw_clip(seed, 6, 96, 128)[0] for seed in (0, 3)])
    segment(write_folder(tmp_path / "two", frames), tmp_path, until=["groups"])
    tree = open_store(tmp_path / "store")["two"].tree
    lasts = tree["objects/last_object"].values.tolist()
    assert len(lasts) == len(told) == 2
    assert 0 < lasts[0] < lasts[1]
    for whole, first, last in zip(told, [0, lasts[0]], lasts, strict=True):
        assert whole.tolist() == [0, *[last] * (last - first)]


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
