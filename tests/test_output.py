"""The output folder: what is in it is what was written, and a list that was lost is made again."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from random import Random

import numpy as np
import pytest
from conftest import draw_clip, write_folder
from runs import masks, segment
from stores_help import delete, empty, flip, truncate

from zsmoseg.errors import OutputError
from zsmoseg.settings import resolve
from zsmoseg.stores import files
from zsmoseg.stores.location import Store
from zsmoseg.stores.output import LIST, Output
from zsmoseg.stores.upkeep import garbage, take_back, verify
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.running.jobs import Outcome
from zsmoseg.workflows.running.request import Quiet, Request
from zsmoseg.workflows.running.run import run

FILES = ("masks/00001.png", "objects/00002.png", "overlay.mp4", "summary.json", "motion.csv")
Harm = Callable[[Path], None]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("output")
    write_folder(root / "disc", draw_clip(0, 4, 96, 128)[0])
    segment(root / "disc", root)
    return root


@pytest.fixture
def root(finished: Path, tmp_path: Path) -> Path:
    """A copy in which the runs remember the folder of the copy."""
    shutil.copytree(finished, tmp_path / "r")
    segment(tmp_path / "r" / "disc", tmp_path / "r")
    return tmp_path / "r"


def found(root: Path) -> list[str]:
    damages = verify(Store.open(root / "store", create=False))
    return [d.path.relative_to(root / "out" / "disc").as_posix() for d in damages]


@pytest.mark.parametrize("harm", [delete, empty, truncate, flip])
def test_verify_finds_what_is_not_as_it_was_written_and_the_next_run_mends_it(harm: Harm, root: Path) -> None:
    assert found(root) == []
    before = masks(root / "out" / "disc")
    for name in FILES:
        harm(root / "out" / "disc" / name)
        assert found(root) == [name]
        segment(root / "disc", root)
        assert found(root) == []
    np.testing.assert_array_equal(masks(root / "out" / "disc"), before)


def test_a_bit_that_flips_on_the_disk_without_a_trace_is_found_by_verify_and_mended_after_repair(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, out = Store.open(root / "store", create=False), root / "out" / "disc"
    before = masks(out)
    monkeypatch.setattr(files, "stamp", lambda path: "always the same")
    segment(root / "disc", root, {"masks.when": "now"})  # all files get this stamp
    segment(root / "disc", root)
    for name in FILES[:3]:
        flip(out / name)
        assert found(root) == [name]
        _, counter = segment(root / "disc", root)
        assert counter.parts == [], "a run trusts what nobody touched"
        assert found(root) == [name], "verify changes nothing"
        assert [damage.path for damage in take_back(store)] == [out / name]
        _, counter = segment(root / "disc", root)
        assert counter.stages == {"overlay" if name == "overlay.mp4" else "masks"}
        assert found(root) == []
    np.testing.assert_array_equal(masks(out), before)


def test_a_run_with_nothing_to_do_reads_no_file_that_nobody_touched(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reads: list[str] = []
    read = files.read
    monkeypatch.setattr(files, "read", lambda path: (reads.append(path.name), read(path))[1])
    segment(root / "disc", root)
    assert not {"00001.png", "overlay.mp4"} & set(reads)
    os.utime(root / "out" / "disc" / FILES[0])
    segment(root / "disc", root)
    assert reads.count("00001.png") == 1, "one that was touched is compared by its content"
    _, counter = segment(root / "disc", root)
    assert reads.count("00001.png") == 1, "once"
    assert counter.parts == []


def test_what_killed_runs_left_unfinished_goes_with_a_later_run_when_it_is_old(root: Path) -> None:
    old, new = (root / "out" / "disc" / place / f".{'0' * 32}.tmp" for place in ("masks", "objects"))
    for path in (old, new):
        path.write_bytes(b"half")
    os.utime(old, (1, 1))
    segment(root / "disc", root)
    assert not old.exists()
    assert new.exists(), "somebody may be writing it"


@pytest.mark.parametrize("name", ["notes.tmp", "masks/keep.lease", "x.tmp", ".mine.tmp", ".lease", ".tmp"])
def test_what_the_user_keeps_there_stays_whatever_its_name_ends_with(name: str, root: Path) -> None:
    folders = [
        root / "out" / "disc",
        root / "store",
        root / "store" / "runs",
        root / "store" / "fingerprints",
    ]
    kept = [folder / name for folder in [*folders, *(root / "store").glob("disc-*")]]
    for path in kept:
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"mine")
        os.utime(path, (1, 1))
    segment(root / "disc", root, {"masks.when": "now"})
    assert all(path.exists() for path in kept)
    assert not {*kept} & {*garbage(Store.open(root / "store", create=False)).paths}


class Meddler(Quiet):
    """Does something to the output folder once the masks are there."""

    def __init__(self, meddle: Callable[[Path], None]) -> None:
        self.meddle = meddle

    def part(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        if stage == "masks" and part == 0:
            self.meddle(plan.output.path)


def link_elsewhere(out: Path) -> None:
    out.rename(out.with_name("before"))
    (out.parent.parent / "victim").mkdir()
    out.symlink_to(out.parent.parent / "victim")


@pytest.mark.parametrize(
    ("meddle", "words"),
    [
        (shutil.rmtree, "masks/00000.png: is gone"),
        (lambda out: shutil.rmtree(out / "masks"), "masks/00000.png: is gone"),
        (lambda out: delete(out / "objects" / "00002.png"), "objects/00002.png: is gone"),
        (lambda out: truncate(out / "masks" / "00003.png"), "masks/00003.png: was changed"),
        (link_elsewhere, "disc: is a link"),
    ],
)
def test_what_happens_to_the_folder_during_a_run_fails_the_video_and_the_next_run_mends_it(
    meddle: Callable[[Path], None], words: str, root: Path
) -> None:
    shutil.rmtree(root / "out")
    request = Request(
        [str(root / "disc")],
        root / "out",
        root / "store",
        resolve(overrides={"chunk.length": 4}),
        scheduler="serial",
    )
    report = run(request, Meddler(meddle))
    assert words in report.failures["disc"]
    assert not report.finished
    assert not (root / "victim").exists() or not list((root / "victim").iterdir())
    if meddle is link_elsewhere:
        (root / "out" / "disc").unlink()
    assert not segment(root / "disc", root)[0].failures
    assert found(root) == []


def test_a_lost_list_is_made_again_and_nothing_but_the_files_is(root: Path) -> None:
    out = root / "out" / "disc"
    before = masks(out)
    listed = Output(out, "").files.keys()
    for harm in (delete, empty, truncate, flip):
        harm(out / LIST)
        assert found(root) == [LIST]
        (out / "summary.json").unlink()
        _, counter = segment(root / "disc", root)
        assert counter.stages == {"masks", "overlay"}
        assert found(root) == []
        assert Output(out, "").files.keys() == listed
        np.testing.assert_array_equal(masks(out), before)


def test_a_folder_without_a_list_that_holds_what_the_run_would_not_write_stays_as_it_is(root: Path) -> None:
    out = root / "out" / "disc"
    (out / LIST).unlink()
    (out / "masks" / "notes.txt").write_text("mine")
    before = {p: p.read_bytes() for p in out.rglob("*") if p.is_file()}
    with pytest.raises(
        OutputError, match=r"\.zsmoseg\.json is lost or damaged, and it holds masks/notes\.txt"
    ):
        segment(root / "disc", root)
    assert {p: p.read_bytes() for p in out.rglob("*") if p.is_file()} == before


def test_a_folder_of_somebody_else_with_the_same_names_is_no_lost_result(root: Path, tmp_path: Path) -> None:
    """Truth lies in folders of such names."""
    other = tmp_path / "other" / "out" / "disc" / "masks"
    shutil.copytree(root / "out" / "disc" / "masks", other)
    with pytest.raises(OutputError, match="was not made by zsmoseg"):
        segment(root / "disc", tmp_path / "other")
    assert len(list(other.iterdir())) == 4


def test_a_list_of_another_folder_is_no_list(root: Path) -> None:
    """Exchanged by whoever copies results about."""
    write_folder(root / "more" / "disc", draw_clip(1, 4, 96, 128)[0])
    segment(root / "more" / "disc", root, out=root / "other")
    one, two = root / "out" / "disc" / LIST, root / "other" / "disc" / LIST
    before = {p: p.read_bytes() for p in root.rglob("o*/**/*.png")}
    one.rename(root / "list")
    two.rename(one)
    (root / "list").rename(two)
    damages = verify(Store.open(root / "store", create=False))
    assert {d.path for d in damages} == {one, two}
    assert all("lists the files of another source" in d.what for d in damages)
    segment(root / "disc", root)
    segment(root / "more" / "disc", root, out=root / "other")
    assert verify(Store.open(root / "store", create=False)) == []
    assert len(before) == 16
    assert {p: p.read_bytes() for p in before} == before


def test_whatever_becomes_of_the_files_is_found_and_mended(root: Path) -> None:
    """A campaign: some files at once are harmed, or exchanged with one another."""
    rng, out, harmed = Random(0), root / "out" / "disc", 0
    before = {p: p.read_bytes() for p in out.rglob("*.*") if p.suffix in (".png", ".mp4", ".csv")}
    for _ in range(12):
        for path in rng.sample(sorted(before), 8):
            harm = rng.choice([delete, empty, truncate, flip, exchange])
            if harm is exchange:
                other = next(p for p in rng.sample(sorted(before), len(before)) if p != path and p.exists())
                exchange(path, other)
            else:
                harm(path)
            harmed += 1
        wrong = {p for p, data in before.items() if not p.exists() or p.read_bytes() != data}
        store = Store.open(root / "store", create=False)
        assert {d.path for d in verify(store)} == wrong
        if rng.random() < 0.5:
            take_back(store)
        segment(root / "disc", root)
        assert {p: p.read_bytes() for p in before} == before
        assert verify(store) == []
    assert harmed == 96


def exchange(path: Path, other: Path) -> None:
    between = path.with_name("between")
    path.rename(between)
    other.rename(path)
    between.rename(other)


def test_a_result_that_was_taken_away_is_no_damage_and_neither_is_one_of_another_source(root: Path) -> None:
    shutil.move(root / "out" / "disc", root / "mine")
    assert verify(Store.open(root / "store", create=False)) == []
    write_folder(root / "more" / "disc", draw_clip(1, 4, 96, 128)[0])
    segment(root / "more" / "disc", root, out=root / "out")
    assert verify(Store.open(root / "store", create=False)) == []


def test_a_run_that_writes_no_files_remembers_no_folder(root: Path) -> None:
    write_folder(root / "out" / "clip", draw_clip(1, 4, 96, 128)[0])
    segment(root / "out" / "clip", root, out=root / "out", until=["flow"])
    assert verify(Store.open(root / "store", create=False)) == []


def test_what_is_written_beside_an_ablation_is_on_the_list(tmp_path: Path) -> None:
    output = Output(tmp_path / "tables", "ablation")
    output.refuse_foreign()
    output.claim({})
    output.write("steps.txt", b"table", "steps")
    again = Output(tmp_path / "tables", "ablation")
    again.refuse_foreign()
    assert again.problem(["steps.txt"], "steps") is None
    assert json.loads((tmp_path / "tables" / LIST).read_text())["files"]["steps.txt"]["crc32"] == files.crc32(
        b"table"
    )
    flip(tmp_path / "tables" / "steps.txt")
    assert again.problem(["steps.txt"], "steps") == "steps.txt was changed"


def test_what_is_computed_again_is_described_again(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Under the same keys it may be another result, by another version of a library."""
    from zsmoseg.workflows.stages.motion import groups

    before = json.loads((root / "out/disc/summary.json").read_text())

    def nothing(*given: object) -> groups.ShotGroups:
        return replace(group_shot(*given), group=np.zeros(len(given[0].static), np.int64))  # type: ignore[attr-defined, arg-type]

    group_shot = groups.group_shot
    monkeypatch.setattr(groups, "group_shot", nothing)
    segment(root / "disc", root, start_from="groups")
    after = json.loads((root / "out/disc/summary.json").read_text())
    assert before["moving_groups"]
    assert (after["moving_groups"], after["moving_pixels_percent"]) == (0, 0)
    assert not masks(root / "out/disc").any()
