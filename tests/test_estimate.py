"""What is said before and during a run: how long, how much, how far; measured rates are kept from run to run."""

from __future__ import annotations

import io
import json
import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import draw_clip, write_folder
from runs import Counter, segment

from zsmoseg.stores.location import Store
from zsmoseg.workflows.planning import compiled, rates
from zsmoseg.workflows.planning.estimate import EACH_PART, Estimate, estimate, estimate_lines
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.planning.rates import Rates, Taken, Use, kept_work, name_of, work
from zsmoseg.workflows.running.course import Course
from zsmoseg.workflows.running.jobs import Outcome
from zsmoseg.workflows.running.progress import Lines, Tally, tally_lines
from zsmoseg.workflows.stages.graph import GRAPHS
from zsmoseg.workflows.wording import duration, megabytes


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine that has run nothing."""
    monkeypatch.setattr(rates, "place", lambda: tmp_path / "rates" / "rates.json")
    return tmp_path / "rates" / "rates.json"


class Watching(Counter):
    """What was estimated, and what it took."""

    def __init__(self) -> None:
        super().__init__()
        self.guess = Estimate()
        self.tally = Tally()

    def estimated(self, guess: Estimate) -> None:
        self.guess = guess

    def part(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        super().part(plan, stage, part, outcome)
        self.tally.add(plan, stage, part, outcome)


def watched(clip: Path, root: Path, monkeypatch: pytest.MonkeyPatch, **settings: object) -> Watching:
    monkeypatch.setattr("runs.Counter", Watching)
    _, counter = segment(clip, root, {name.replace("__", "."): value for name, value in settings.items()})
    assert isinstance(counter, Watching)
    return counter


@pytest.mark.parametrize(("height", "width", "frames"), [(120, 160, 12), (240, 320, 6)])
def test_the_second_run_of_a_machine_is_estimated_by_the_first(
    height: int, width: int, frames: int, clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rates, "LEAST", 0.1)
    first = watched(clip, tmp_path / "first", monkeypatch)
    assert not first.guess.measured
    other = write_folder(tmp_path / "other", draw_clip(3, frames, height, width)[0])
    second = watched(other, tmp_path / "second", monkeypatch, groups__count=2)
    assert second.guess.measured, "also of stages whose settings are others"
    assert second.guess.compiles == frozenset()
    took = sum(second.tally.seconds.values())
    assert took / 4 < second.guess.seconds < took * 4, "loosely: machines are shared"
    store = Store.open(tmp_path / "second" / "store", create=False)
    size = sum(path.stat().st_size for path in Path(store.path).rglob("*") if path.is_file())
    size += sum(p.stat().st_size for p in (tmp_path / "second" / "out").rglob("*") if p.is_file())
    assert size / 2 < second.guess.size < size * 2


def test_a_thumbnail_tells_nothing_of_a_film(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clip = write_folder(tmp_path / "thumbnail", draw_clip(3, 6, 48, 64)[0])
    before = watched(clip, tmp_path / "first", monkeypatch)
    again = watched(clip, tmp_path / "second", monkeypatch)
    assert not again.guess.measured
    assert again.guess.seconds == pytest.approx(before.guess.seconds)
    parts = sum(len(stage.parts) for stage in again.plans[0].stages.values())
    assert again.guess.seconds > EACH_PART * parts, "what each part takes however small it is counts"


def test_what_frames_leave_is_of_the_grid_and_what_they_take_of_the_picture(
    clip: Path, tmp_path: Path
) -> None:
    _, counter = segment(clip, tmp_path)
    (plan,) = counter.plans
    large = replace(plan, probe=replace(plan.probe, width=4 * 854, height=4 * 480))
    frames, masks = large.stages["frames"], large.stages["masks"]
    assert work(large, frames, 1) == pytest.approx(16)
    assert kept_work(large, frames, 1) == pytest.approx(1, rel=0.05)
    assert kept_work(large, masks, 1) == work(large, masks, 1) == pytest.approx(16)


def test_rates_are_those_of_the_same_settings_else_of_others_else_typical_at_the_speed_of_the_machine(
    clip: Path, tmp_path: Path
) -> None:
    _, counter = segment(clip, tmp_path)
    (plan,) = counter.plans
    flow, masks = plan.stages["flow"], plan.stages["masks"]
    known = Rates()
    assert known.of(flow).processor == flow.stage.cost[0] / 1e3
    known.stages = {f"flow {flow.stage.version} other": Taken(10.0, 20.0, 5.0, 7.0, 1.0)}
    assert known.of(flow) == rates.Rate(2.0, 4.0, 7.0, True)
    assert known.of(masks).processor == pytest.approx(masks.stage.cost[0] / flow.stage.cost[0] * 2.0)
    assert not known.of(masks).measured
    known.stages[name_of(flow)] = Taken(1.0, 1.0, 1.0)
    assert known.of(flow).processor == 1.0
    assert known.of(flow).size == flow.stage.cost[1] * 1e3
    assert work(plan, masks, 2) == pytest.approx(2 * 160 * 120 / rates.DISPLAYED)


def test_sums_of_earlier_runs_fade_and_other_runs_are_not_lost(cache: Path) -> None:
    for _ in range(2):
        Rates(new={"flow 2 a": Taken(2.0, 2.0, 1.0)}).keep()
    Rates(new={"masks 2 b": Taken(1.0, 1.0, 1.0)}, uses={"local": Use(3.0, 5.0, 10.0)}).keep()
    found = Rates.load()
    assert found.stages["flow 2 a"] == Taken(3.0, 3.0, 1.5)
    assert found.stages.keys() == {"flow 2 a", "masks 2 b"}
    assert found.use("local").share == 0.5


@pytest.mark.parametrize("harm", [b"", b"{}", b'{"checksum": "00000000", "stages": 3}', b"\xff" * 9])
def test_a_damaged_record_counts_for_nothing(harm: bytes, cache: Path) -> None:
    Rates(new={"flow 2 a": Taken(2.0, 2.0, 1.0)}).keep()
    cache.write_bytes(harm)
    assert Rates.load() == Rates()
    Rates(new={"flow 2 a": Taken(2.0, 2.0, 1.0)}).keep()
    assert Rates.load().stages


def test_nothing_breaks_where_the_record_cannot_be_written(clip: Path, tmp_path: Path, cache: Path) -> None:
    cache.parent.write_text("a file where the folder should be")
    report, _ = segment(clip, tmp_path / "run")
    assert report.finished == ["disc"]
    assert Rates.load() == Rates()


def test_parts_that_another_run_had_done_tell_nothing_about_time(clip: Path, tmp_path: Path) -> None:
    segment(clip, tmp_path)
    before = Rates.load().stages
    segment(clip, tmp_path, {"groups.count": 2})
    assert {n: t for n, t in Rates.load().stages.items() if n.startswith("flow ")} == {
        n: t for n, t in before.items() if n.startswith("flow ")
    }


# ------------------------------------------------------------------------ words
def test_the_estimate_tells_time_by_the_clock_from_that_of_the_processor() -> None:
    guess = Estimate(700.0, 800.0, 30.0, int(2.5e9), 4e8, True, frozenset("abc"), 2, 2)
    told = estimate_lines(guess.with_workers(4, Use(10.0)))
    assert told == [
        "estimate: about 4 min with 4 workers, 12 min of processor time, 2.5 GB on disk (measured on this machine), "
        "at most about 400 MB of memory a worker",
        "compiling, once, about 1 s",
    ]
    (alone,) = estimate_lines(replace(guess, compiles=frozenset(), looked=1))
    assert alone.startswith("estimate: 12 min of processor time, "), "nobody knows how many workers there are"
    assert "by the first 1 of 2 videos" in alone
    assert estimate_lines(Estimate()) == ["nothing to do"]


def test_what_cannot_be_done_at_once_bounds_the_time() -> None:
    guess = Estimate(100.0, 100.0, 60.0)
    assert guess.with_workers(50, Use(1.0)).lasts == 61.0
    assert guess.with_workers(1, Use(1.0, 50.0, 100.0)).lasts == 201.0


@pytest.mark.parametrize(
    ("seconds", "words"), [(0.2, "1 s"), (119, "119 s"), (125, "2 min"), (9000, "2.5 h")]
)
def test_durations_are_read_by_people(seconds: float, words: str) -> None:
    assert duration(seconds) == words


@pytest.mark.parametrize(("size", "words"), [(3e5, "0.3 MB"), (5e7, "50 MB"), (1.5e9, "1.5 GB")])
def test_sizes_are_read_by_people(size: float, words: str) -> None:
    assert megabytes(size) == words


def test_the_table_tells_compiling_apart_from_what_a_frame_takes() -> None:
    tally = Tally()
    tally.seconds["flow"], tally.warm_up = 2.0, 16.0
    lines = tally_lines(tally, 20.0)
    assert lines[-2].split()[:2] == ["start-up", "16.00"]
    assert lines[-1].split() == [
        "all",
        "18.00",
        "of",
        "processor",
        "time,",
        "in",
        "20.0",
        "s",
        "by",
        "the",
        "clock",
    ]


# ------------------------------------------------------------------------ compiling
def test_functions_are_missing_until_numba_has_kept_them_as_the_code_is_now(
    clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    segment(clip, tmp_path)
    modules = [stage.task.__module__ for stage in GRAPHS["embedded-flow"].values()]
    assert set().union(*map(compiled.missing, modules)) == set()
    functions = {n: f for module in modules for n, f in compiled._functions(module).items()}
    assert len(functions) > 20
    assert not compiled._functions(GRAPHS["embedded-flow"]["masks"].task.__module__)
    kept = compiled.Path
    monkeypatch.setattr(
        compiled, "Path", lambda place: kept(tmp_path / "empty") if "__pycache__" in place else kept(place)
    )
    assert set().union(*map(compiled.missing, modules)) == functions.keys()


# ------------------------------------------------------------------------ the course of a run
class Fake:
    """Plans of a stage of two parts, for frames that take a second each."""

    def __init__(self, clip: Path, tmp_path: Path, name: str) -> None:
        _, counter = segment(clip, tmp_path / name, {"chunk.length": 5}, until=["frames"])
        (plan,) = counter.plans
        stage = plan.stages["frames"]
        stage.todo = list(range(len(stage.parts)))
        self.plan = replace(plan, name=name, stages={"frames": stage})


def test_frames_videos_and_time_are_told(clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one, two = (Fake(clip, tmp_path, name).plan for name in ("one", "two"))
    now = [0.0]
    monkeypatch.setattr("zsmoseg.workflows.running.course.time.monotonic", lambda: now[0])
    course = Course()
    course.plan(one)
    course.estimated(Estimate(videos=4, lasts=90.0))
    now[0] = 10.0
    assert course.words() == "0 of 4 videos, 0 of about 40 frames, about 80 s left"
    course.part(one, "frames", 0)
    assert course.words() == "0 of 4 videos, 5 of about 40 frames, about 70 s left"
    course.plan(two)
    course.part(one, "frames", 1)
    course.finish(one)
    course.fail("three")
    assert course.words() == "1 of 4 videos, 1 failed, 10 of about 30 frames, about 20 s left"
    course.fail("two")
    course.fail("four")
    assert course.words() == "1 of 4 videos, 3 failed, 10 of 20 frames"


def test_a_video_with_nothing_to_do_counts_as_done(clip: Path, tmp_path: Path) -> None:
    plan = Fake(clip, tmp_path, "one").plan
    plan.stages["frames"].todo.clear()
    course = Course()
    course.plan(plan)
    course.finish(plan)
    assert course.words() == "1 of 1 video, 10 of 10 frames"


def test_lines_say_how_far_a_run_is_while_one_task_goes_on(
    clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zsmoseg.workflows.running.progress.EVERY", 0.0)
    monkeypatch.setattr("zsmoseg.workflows.running.progress.TICK", 0.01)
    stream, plan = io.StringIO(), Fake(clip, tmp_path, "one").plan
    with Lines(stream) as lines:
        lines.planned(plan)
        lines.estimated(Estimate(1.0, 1.0, videos=3, looked=1, lasts=3e4))
        until = time.monotonic() + 30
        while stream.getvalue().count("0 of 3 videos") < 3 and time.monotonic() < until:
            time.sleep(0.01)
    told = [line for line in stream.getvalue().splitlines() if line.startswith("0 of 3 videos")]
    assert len(told) >= 3
    assert re.fullmatch(r"0 of 3 videos, 0 of about 30 frames, about 8\.\d h left", told[0])
    after = stream.getvalue()
    time.sleep(0.05)
    assert stream.getvalue() == after, "nothing is said once the run is over"


def test_records_have_seconds_without_compiling(clip: Path, tmp_path: Path) -> None:
    segment(clip, tmp_path)
    summary = json.loads((tmp_path / "out" / "disc" / "summary.json").read_text())
    assert all(stage["seconds"] < 30 for stage in summary["stages"].values())
    assert np.isfinite([stage.get("warm_up_seconds", 0.0) for stage in summary["stages"].values()]).all()


def test_an_estimate_adds_up_over_videos(clip: Path, tmp_path: Path) -> None:
    plan = Fake(clip, tmp_path, "one").plan
    single, double = (estimate([plan] * n, Rates()) for n in (1, 2))
    assert double.seconds == pytest.approx(2 * single.seconds)
    assert double.chain == single.chain
    assert single.chain == pytest.approx(single.wall / 2), "two parts at once"
