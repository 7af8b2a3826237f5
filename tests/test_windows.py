"""Long shots: windows that look at some frames at once, and what goes on from one to the next."""

from __future__ import annotations

import subprocess
import sys
import tracemalloc
from collections import defaultdict
from importlib.util import module_from_spec, spec_from_file_location
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from conftest import draw_clip, write_folder
from runs import data_bytes, masks, segment

from zsmoseg.grouping.groups import ShotGroups
from zsmoseg.grouping.numbering import carried_groups
from zsmoseg.proposals.embedded import objects as proposals
from zsmoseg.stores import sealing
from zsmoseg.synthetic.street import street
from zsmoseg.workflows.cli import main
from zsmoseg.workflows.result import open_store
from zsmoseg.workflows.running import executors
from zsmoseg.workflows.running.jobs import Job, Outcome, run_job
from zsmoseg.workflows.stages import windows
from zsmoseg.workflows.stages.embedded import objects as embedded_objects
from zsmoseg.workflows.stages.graph import GRAPHS
from zsmoseg.workflows.stages.motion.groups import Known
from zsmoseg.workflows.stages.proposed.objects import named_objects
from zsmoseg.workflows.stages.proposed.proposals import Proposals

SMALL = {"frames.width": 64, "overlay.write": False, "chunk.length": 8}


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows of twelve frames that share four."""
    monkeypatch.setattr(windows, "LENGTH", 12)
    monkeypatch.setattr(windows, "OVERLAP", 4)


def street_folder(root: Path, frames: int) -> Path:
    return write_folder(root / f"street{frames}", np.stack([frame for frame, _ in street(frames)]))


@pytest.mark.parametrize("frames", [*range(12, 60), 1200])
@pytest.mark.usefixtures("short")
def test_windows_hold_all_frames_and_share_enough(frames: int) -> None:
    spans = windows.spans_of(5, 5 + frames)
    assert spans[0][0] == 5
    assert spans[-1][1] == 5 + frames
    assert {b - a for a, b in spans} == {12}
    assert all(4 <= b - c < 12 for (_, b), (c, _) in pairwise(spans))
    assert len(spans) == max(1, -(-(frames - 4) // 8))


def test_a_shot_of_one_window_has_no_border() -> None:
    assert windows.spans_of(7, 7 + windows.LENGTH) == [(7, 7 + windows.LENGTH)]
    assert len(windows.spans_of(7, 8 + windows.LENGTH)) == 2


def test_numbers_go_on_in_what_shares_most() -> None:
    def gone_on(number: list[int], before: list[int], weight: list[float]) -> list[int]:
        return carried_groups(np.array(number), np.array(before), np.array(weight), 7).tolist()

    assert gone_on([1, 2, 0], [0, 0, 0], [9, 3, 1]) == [8, 9, 0], "nothing is known: numbers go on counting"
    assert gone_on([1, 1, 2], [4, 0, 2], [1, 5, 1]) == [4, 4, 2], "what is new takes the number of its group"
    assert gone_on([1, 1, 2], [4, 5, 5], [3, 2, 1]) == [4, 4, 5], (
        "two that are one now: the larger share counts"
    )
    assert gone_on([1, 2, 0], [4, 4, 4], [1, 2, 9]) == [8, 4, 0], (
        "one that is two now: a number is given once"
    )
    assert gone_on([0, 0], [4, 0], [1, 1]) == [0, 0]


@pytest.mark.usefixtures("short")
def test_a_mover_is_one_object_of_one_group_through_all_windows(tmp_path: Path) -> None:
    images, truth = draw_clip(frames=30, height=96, width=200)
    report, _ = segment(write_folder(tmp_path / "disc", images), tmp_path, SMALL | {"frames.width": 100})
    assert report.summaries["disc"]["moving_groups"] == 1
    for kind in ("masks", "objects"):
        painted = masks(tmp_path / "out" / "disc", kind)
        assert len(np.unique(painted)) == 2
        both, either = ((painted > 0) & truth).sum((1, 2)), ((painted > 0) | truth).sum((1, 2))
        assert (both / either).min() > 0.6
    groups = open_store(tmp_path / "store")["disc"].groups
    assert len(groups.window) == 4
    assert int(groups.frames_moving.max()) == 30


def test_a_shot_as_long_as_a_window_is_what_it_was_without_windows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clip = street_folder(tmp_path, 24)
    segment(clip, tmp_path / "without", SMALL | {"affinity.cues": "both"})
    monkeypatch.setattr(windows, "LENGTH", 24)
    segment(clip, tmp_path / "as_long", SMALL | {"affinity.cues": "both"})
    assert data_bytes(tmp_path / "as_long") == data_bytes(tmp_path / "without")


@pytest.mark.usefixtures("short")
@pytest.mark.parametrize("cues", ["flow", "both"])
def test_windows_do_not_depend_on_chunks(cues: str, tmp_path: Path) -> None:
    clip, found = street_folder(tmp_path, 40), []
    for length in (5, 16):
        root = tmp_path / str(length)
        segment(clip, root, SMALL | {"chunk.length": length, "affinity.cues": cues})
        found.append(root / "out" / clip.name)
    for kind in ("masks", "objects"):
        np.testing.assert_array_equal(masks(found[0], kind), masks(found[1], kind))
    assert (found[0] / "motion.csv").read_bytes() == (found[1] / "motion.csv").read_bytes()


def benchmark(name: str) -> ModuleType:
    """A script of ``benchmarks/``."""
    spec = spec_from_file_location(name, Path(__file__).resolve().parents[1] / "benchmarks" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def told(group: list[int], excess: list[float], frames: int = 3) -> ShotGroups:
    """The answer of a window in which what has a group moves all the time."""
    number, odd = np.array(group), np.array(excess)
    moving = np.tile(number > 0, (frames, 1))
    return ShotGroups(
        number, number, moving, moving.astype(np.float32), odd, np.ones(len(group)), odd, number
    )


def test_what_rests_at_first_and_moves_later_is_of_the_group_in_which_it_moves() -> None:
    known = Known.of(6)
    for objects, group, excess in (
        ([0, 1, 2], [0, 1, 0], [0.0, 5.0, 0.5]),
        ([0, 1, 2, 4], [0, 0, 1, 1], [0.0, 0.6, 7.0, 8.0]),
        ([0, 2, 4, 5], [0, 0, 2, 1], [0.0, 0.1, 9.0, 9.5]),
    ):
        answer = told(group, excess)
        known.add(np.array(objects), answer, np.ones(len(objects)), answer.moving)
    assert known.group.tolist() == [0, 1, 2, 0, 2, 3]
    assert known.instance.tolist() == [0, 1, 2, 0, 2, 5], "by an object in it, not counted"
    assert known.frames_moving.tolist() == [0, 3, 3, 0, 6, 3]
    assert known.excess.tolist()[:3] == [0.0, 5.0, 7.0]
    assert np.isnan(known.excess[3])
    assert known.excess.tolist()[4:] == [8.0, 9.5]


@pytest.fixture(scope="module")
def lengths(tmp_path_factory: pytest.TempPathFactory) -> dict[int, tuple[dict[str, float], list[int]]]:
    """Of streets of 80 and of 240 frames: bytes alive in tasks of each stage, and the largest tables of windows."""
    found, root = {}, tmp_path_factory.mktemp("lengths")
    with pytest.MonkeyPatch.context() as patch:
        for module in (windows, proposals):
            patch.setattr(module, "LENGTH", 40)
        patch.setattr(windows, "OVERLAP", 10)
        patch.setattr(proposals, "MARGIN", 8)
        # what is joined for readers after the last part is bounded by these, not by the stage
        patch.setattr(sealing, "LARGEST", 1)
        patch.setattr(sealing, "LONGEST", 1)
        for frames in (80, 240):
            clip = street_folder(root, frames)
            twice = [measured(clip, root / f"{frames}-{n}", patch) for n in range(2)]
            # the less of both: now and then Python's table of interned names grows, by 8 MB, whoever adds the next one
            peaks = {stage: min(peaks[stage] for peaks, _ in twice) for stage in twice[0][0]}
            found[frames] = peaks, twice[0][1]
    return found


def measured(clip: Path, root: Path, patch: pytest.MonkeyPatch) -> tuple[dict[str, float], list[int]]:
    peaks: dict[str, float] = defaultdict(float)

    def traced(job: Job, *before: Outcome) -> Outcome:
        if GRAPHS[job.graph][job.stage].scope == "chunk":
            return run_job(job, *before)
        tracemalloc.start()
        outcome = run_job(job, *before)
        peaks[job.stage] = max(peaks[job.stage], tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        return outcome

    patch.setattr(executors, "run_job", traced)
    chosen = SMALL | {"affinity.cues": "both", "objects.window": 2, "chunk.length": 40}
    segment(clip, root, chosen, until=["groups"])
    result = open_store(root / "store")[clip.name]
    tables = [
        int(np.prod(entry.shape))
        for name in ("affinity", "epipolar", "groups", "objects", "trajectories")
        for block in result.artifact(name).blocks(0)
        for entry in block.tables.values()
        if len(entry.shape) > 1
    ]
    return peaks, tables


def test_no_table_grows_with_the_shot(lengths: dict[int, tuple[dict[str, float], list[int]]]) -> None:
    (_, short), (_, long) = lengths.values()
    assert len(long) > 2.5 * len(short)
    assert max(long) < 1.5 * max(short)


def test_tables_too_large_to_be_joined_are_left_in_their_blocks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clip = street_folder(tmp_path, 24)
    segment(clip, tmp_path / "all", SMALL)
    monkeypatch.setattr(sealing, "LONGEST", 3000)
    objects = len(open_store(tmp_path / "all" / "store")[clip.name].groups.group)
    monkeypatch.setattr(sealing, "LARGEST", 8 * objects)
    segment(clip, tmp_path / "some", SMALL)
    whole, some = (open_store(tmp_path / root / "store")[clip.name] for root in ("all", "some"))
    left_out = {
        f"{stage}/{name}"
        for stage, node in whole.tree.items()
        for name in node.data_vars
        if name not in some.tree[stage]
    }
    assert {"statistics/gram", "affinity/affinity"} <= left_out
    assert not left_out & {"statistics/valid", "groups/group", "labels/label"}
    np.testing.assert_array_equal(some.affinity.affinity, whole.affinity.affinity)
    for kind in ("masks", "objects"):
        a, b = (masks(tmp_path / root / "out" / clip.name, kind) for root in ("all", "some"))
        np.testing.assert_array_equal(a, b)
    assert main(["verify", "--store", str(tmp_path / "some" / "store")]) == 0


KEPT = 1e5
"""Bytes: records of parts that are kept parsed, up to a number of them."""


def test_nothing_that_is_alive_in_a_task_grows_with_the_shot(
    lengths: dict[int, tuple[dict[str, float], list[int]]],
) -> None:
    (short, _), (long, _) = lengths.values()
    assert long.keys() == {"objects", "trajectories", "epipolar", "affinity", "groups"}
    assert {stage: peak for stage, peak in long.items() if peak > 1.5 * short[stage] + KEPT} == {}


def test_the_plan_says_what_a_worker_takes_and_a_longer_video_takes_no_more(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = []
    for frames in (700, 1400):
        clip = write_folder(tmp_path / f"long{frames}", np.zeros((frames, 48, 64, 3), np.uint8))
        options = ["--dry-run", "-o", str(tmp_path / "out"), "--store", str(tmp_path / "store")]
        assert main(["run", str(clip), *options]) == 0
        told.append(capsys.readouterr().out.split("at most about ")[1].split(" MB of memory a worker")[0])
    assert told[0] == told[1]
    assert 350 < int(told[0]) < 400


def test_a_task_takes_what_its_stage_declares(tmp_path: Path) -> None:
    """In a process of its own: what is there before counts."""
    clip = write_folder(tmp_path / "street", np.stack([f for f, _ in street(64, 180, 240)]))
    script = Path(__file__).resolve().parents[1] / "benchmarks" / "stage_memory.py"
    command = [sys.executable, str(script), str(clip), "frames.width=240", "overlay.write=false"]
    table = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[1:-1]
    told = {name: (float(declared), float(taken)) for name, taken, declared, *_ in map(str.split, table)}
    large = {name: sizes for name, sizes in told.items() if max(sizes) > 10}
    assert {"frames", "flow", "segments", "features", "objects", "statistics"} <= large.keys()
    assert {n: sizes for n, sizes in large.items() if not 0.5 < sizes[0] / sizes[1] < 2} == {}


@pytest.mark.parametrize("seed", range(20))
def test_the_category_of_an_object_is_that_of_most_score(seed: int) -> None:
    rng = np.random.default_rng(seed)
    objects, names, masks = 6, 4, int(rng.integers(0, 30))
    of, category = rng.integers(0, objects, masks), rng.integers(0, names, masks)
    score = (rng.integers(0, 3, masks) / 2).astype(np.float32)
    proposals = Proposals(start=0, stop=1, score=score, category_of=category)
    found = named_objects(proposals, of, objects, names)
    for n in range(objects):
        votes = [float(score[(of == n) & (category == c)].sum()) for c in range(names)]
        best = int(np.argmax(votes))
        if n == 0 or votes[best] == 0:
            assert found["category_of"][n] == -1
            assert np.isnan(found["score"][n])
        else:
            assert found["category_of"][n] == best
            assert found["score"][n] == pytest.approx(score[(of == n) & (category == best)].mean())
    assert found["named"].sum() == (found["category_of"] >= 0).sum()


def test_more_objects_than_a_label_holds_end_in_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(embedded_objects, "MOST", 1)
    clip = street_folder(tmp_path, 60)
    options = ["-o", str(tmp_path / "out"), "--store", str(tmp_path / "store"), "--scheduler", "serial"]
    assert main(["run", str(clip), *options, "--set", "frames.width=64"]) == 1
    assert "more than 1 objects up to frame 59, more than a label image holds" in capsys.readouterr().err
