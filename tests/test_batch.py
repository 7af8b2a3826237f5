"""Whole datasets: which videos are meant, what happens to those that fail, what is told, how to go on."""

from __future__ import annotations

import errno
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from closed import skip_where_all_is_open, without_privileges
from conftest import draw_clip, write_folder, write_mp4
from runs import segment

from zsmoseg.errors import AccessError, SettingsError, SpaceError, VideoError, system_errors_in_words
from zsmoseg.settings import resolve
from zsmoseg.stores import files
from zsmoseg.stores.location import Store
from zsmoseg.stores.output import Output
from zsmoseg.stores.runs import Entry, RunRecord
from zsmoseg.workflows.cli import main
from zsmoseg.workflows.cli.run import again
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.running.choosing import choose, nothing_left
from zsmoseg.workflows.running.progress import Bars, Lines, failure_lines
from zsmoseg.workflows.running.request import Choice, Quiet, Report, Request
from zsmoseg.workflows.running.run import found_in, run

ROOT = Path(__file__).parents[1]
NAMES = ("ant", "bee", "cat", "dog")
SMALL = {"chunk.length": 4}


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Two videos of five frames."""
    for seed, name in enumerate(NAMES[:2]):
        write_folder(tmp_path / "data" / name, draw_clip(seed, 5, 96, 128)[0])
    return tmp_path / "data"


def batch(root: Path, watcher: Quiet | None = None, **more: Any) -> Report:
    settings = resolve(overrides=SMALL)
    return run(
        Request([str(root / "data")], root / "out", root / "store", settings, "serial", **more), watcher
    )


def one_line(text: str, *parts: str) -> None:
    assert "\n" not in text
    assert "Traceback" not in text
    assert "unexpected" not in text
    for part in parts:
        assert part in text, text


# ------------------------------------------------------------------ which videos
VIDEOS = [(f"/data/{name}", name) for name in NAMES]


def chosen(store: Store, **more: Any) -> str:
    return " ".join(name for _, name in choose(VIDEOS, Choice(**more), store))


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store.open(tmp_path / "store", create=True)


def test_videos_are_chosen_by_name_and_pattern_in_their_own_order(store: Store) -> None:
    assert chosen(store) == "ant bee cat dog"
    assert chosen(store, only=["dog", "b*"]) == "bee dog"
    assert chosen(store, limit=2) == "ant bee"
    assert chosen(store, only=["[bd]*"], limit=1) == "bee"


def test_a_name_of_no_video_is_refused_with_those_there_are(store: Store) -> None:
    with pytest.raises(
        SettingsError, match=r"--only cow: no video has this name; there are ant, bee, cat, dog"
    ):
        chosen(store, only=["ant", "cow"])


@pytest.mark.parametrize("n", [1, 2, 3, 4, 7])
def test_every_video_is_in_exactly_one_share_whatever_the_order(n: int, store: Store) -> None:
    for videos in (VIDEOS, VIDEOS[::-1]):
        shares = [{v for _, v in choose(videos, Choice(share=(i, n)), store)} for i in range(1, n + 1)]
        assert sorted(name for share in shares for name in share) == sorted(NAMES)
        assert max(map(len, shares)) - min(map(len, shares)) <= 1
        assert shares == [set(chosen(store, share=(i, n)).split()) for i in range(1, n + 1)]


def remember(store: Store, outcome: str | None, failures: dict[str, str], *names: str) -> None:
    record = RunRecord.begin(store, {}, [*names, *(name for name in failures if name not in names)])
    for name in names:
        state = "failed" if name in failures else "done" if outcome else "running"
        record.note(
            Entry(record.id, name, f"{name}-0123456789abcdef", outcome=state, failure=failures.get(name, ""))
        )
    if outcome:
        record.end(outcome, {name: why for name, why in failures.items() if name not in names}, {})


def test_the_last_run_of_each_video_says_whether_it_failed(store: Store) -> None:
    assert chosen(store, retry_failed=True) == ""
    remember(store, "failed", {"bee": "torn", "dog": "never planned"}, "ant", "bee")
    assert chosen(store, retry_failed=True) == "bee dog"
    remember(store, "done", {}, "bee")  # another share of the same array
    assert chosen(store, retry_failed=True) == "dog"
    remember(store, None, {}, "cat")  # killed
    assert chosen(store, retry_failed=True) == "cat dog"
    RunRecord.begin(store, {}, ["ant"])  # killed before it came to any
    assert chosen(store, retry_failed=True) == "ant cat dog"


def note(store: Store, source: str, out: str, outcome: str) -> None:
    """A run with one video; of ``lost`` only the run itself tells."""
    name = Path(source).name
    record = RunRecord.begin(store, {}, [name], [source], out)
    if outcome != "lost":
        video = f"{name}-{zlib.crc32(source.encode()):016x}"
        record.note(Entry(record.id, name, video, source, f"{out}/{name}", outcome=outcome))
    record.end("failed", {name: "torn"} if outcome == "lost" else {}, {})


@pytest.mark.parametrize(
    ("then", "again"),
    [
        ([("/data/ant", "/o", "failed"), ("/other/ant", "/p", "done")], True),
        ([("/data/ant", "/o", "lost"), ("/other/ant", "/p", "done")], True),
        ([("/data/ant", "/o", "done"), ("/other/ant", "/p", "failed")], False),
        ([("/data/ant", "/o", "done"), ("/other/ant", "/p", "lost")], False),
        ([("/data/ant", "/o", "failed"), ("/data/ant", "/p", "done")], True),
        ([("/data/ant", "/o", "done"), ("/data/ant", "/p", "failed")], False),
        ([("/data/ant", "/p", "failed")], True),
        ([("/data/ant", "/p", "done")], False),
        ([("/before/ant", "/o", "failed")], True),
        ([("/before/ant", "/o", "failed"), ("/data/ant", "/o", "done")], False),
        ([("/other/ant", "/p", "failed")], False),
    ],
)
def test_what_failed_is_known_by_its_source_and_its_output_folder(
    then: list[tuple[str, str, str]], again: bool, store: Store
) -> None:
    for source, out, outcome in then:
        note(store, source, out, outcome)
    left = choose(VIDEOS, Choice(retry_failed=True), store, Path("/o"))
    assert left == ([("/data/ant", "ant")] if again else [])


def test_shares_do_not_move_while_others_mend_what_failed(store: Store) -> None:
    remember(store, "failed", dict.fromkeys(NAMES, "torn"), *NAMES)
    before = [chosen(store, share=(i, 2), retry_failed=True) for i in (1, 2)]
    remember(store, "done", {}, *before[0].split())
    assert chosen(store, share=(2, 2), retry_failed=True) == before[1] != ""


@pytest.mark.parametrize(("found", "words"), [(1, "of 1 video none"), (2, "of 2 videos none")])
def test_one_video_is_no_videos(found: int, words: str) -> None:
    assert words in nothing_left(found, Choice(retry_failed=True))
    assert nothing_left(found, Choice(share=(2, 3))).endswith(words[3:-5])


def outputs(root: Path) -> None:
    """What two runs left, and a video beside it."""
    for name in ("out/ant", "out/bee"):
        for folder in ("masks", "objects"):
            write_folder(root / name / folder, draw_clip(0, 3, 96, 128)[0])
        write_mp4(root / name / "overlay.mp4", draw_clip(0, 3, 96, 128)[0])
        (root / name / ".zsmoseg.json").write_text("{}")
    write_mp4(root / "cat.mp4", draw_clip(1, 3, 96, 128)[0])
    write_folder(root / "data" / "dog", draw_clip(2, 3, 96, 128)[0])


@pytest.mark.parametrize(
    ("given", "found"),
    [
        (["cat.mp4", "data/dog", "out"], ["cat.mp4", "data/dog"]),
        (["data/*", "out/*", "out/*/masks/*.png"], ["data/dog"]),
        (["out/*/objects", "cat.mp4"], ["cat.mp4"]),
        (["out/ant/", "data"], ["data/dog"]),
    ],
)
def test_what_runs_have_left_is_passed_over_with_a_line(
    given: list[str], found: list[str], tmp_path: Path
) -> None:
    outputs(tmp_path)
    request, notes = Request([str(tmp_path / name) for name in given]), list[str]()
    assert [source for source, _ in found_in(request, notes.append)] == [
        str(tmp_path / name) for name in found
    ]
    (line,) = notes
    one_line(line, str(tmp_path / "out"), "output of zsmoseg", "passed over")


@pytest.mark.parametrize("given", ["out", "out/ant", "out/*/masks", "out/ant/*.mp4"])
def test_what_holds_nothing_but_output_is_refused(given: str, tmp_path: Path) -> None:
    outputs(tmp_path)
    with pytest.raises(VideoError, match="output of zsmoseg; give the videos that it was made from"):
        found_in(Request([str(tmp_path / given)]))


@pytest.mark.parametrize("given", ["out/ant/overlay.mp4", "out/bee/masks", "out/bee/objects/"])
def test_what_is_named_itself_is_meant(given: str, tmp_path: Path) -> None:
    outputs(tmp_path)
    assert len(found_in(Request([str(tmp_path / given), str(tmp_path / "cat.mp4")]))) == 2


def test_a_share_without_videos_is_no_failure(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", str(data), "-o", str(tmp_path / "out"), "--scheduler", "serial"]
    assert main([*words, "--slice", "5/9"]) == 0
    assert "share 5 of 9 holds none of the 2 videos" in capsys.readouterr().err
    assert main([*words, "--retry-failed", "--dry-run"]) == 0
    assert "nothing to retry" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--slice", "0/4"], "expected i/n with i from 1 to n"),
        (["--slice", "5/4"], "expected i/n with i from 1 to n"),
        (["--slice", "two"], "expected i/n with i from 1 to n"),
        (["--limit", "0"], "expected 1 or more"),
        (["--limit", "many"], "expected 1 or more"),
        (["--patience", "inf"], "expected seconds"),
        (["--patience", "soon"], "expected seconds"),
    ],
)
def test_options_that_make_no_sense_are_refused(
    words: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["run", "x", *words])
    assert caught.value.code == 2
    one_line(capsys.readouterr().err.strip(), expected)


# ------------------------------------------------------------------ how it ends
def test_one_torn_video_fails_by_name_and_the_command_printed_mends_it(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    frame = data / "bee" / "00003.png"
    whole = frame.read_bytes()
    frame.write_bytes(whole[: len(whole) // 2])
    words = ["run", str(data), "-o", str(tmp_path / "out"), "--scheduler", "serial"]
    assert main(words) == 1
    err = capsys.readouterr().err.splitlines()
    at = err.index("zsmoseg: 1 of 2 videos failed; what was finished is kept")
    one_line(err[at + 1], "bee", "00003.png")
    command = err[at + 2].removeprefix("  again: zsmoseg ")
    assert command == f"{' '.join(words)} --retry-failed"
    assert (tmp_path / "out" / "ant" / "summary.json").exists()
    frame.write_bytes(whole)
    assert main(command.split()) == 0
    assert (tmp_path / "out" / "bee" / "summary.json").exists()
    assert "ant" not in capsys.readouterr().err


def test_the_command_to_go_on_can_be_pasted() -> None:
    assert again(["run", "a b", "--set", "x=1"]) == "zsmoseg run 'a b' --set x=1 --retry-failed"
    assert again(["run", "a", "--retry-failed"]) == "zsmoseg run a --retry-failed"
    for words in (
        ["run", "a", "--from", "flow", "--until", "x"],
        ["run", "a", "--from=flow", "--until", "x"],
    ):
        assert again(words) == "zsmoseg run a --until x --retry-failed"
        assert again(words, laid_out=False) == shlex.join(["zsmoseg", *words, "--retry-failed"])


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("run -o o -- a b", "run -o o --retry-failed -- a b"),
        ("run -- --from x", "run --retry-failed -- --from x"),
        ("run --from flow -- -a", "run --retry-failed -- -a"),
        ("run --retry-failed -- --from=x", "run --retry-failed -- --from=x"),
    ],
)
def test_the_command_to_go_on_leaves_what_stands_behind_two_dashes(words: str, told: str) -> None:
    assert again(words.split()) == f"zsmoseg {told}"


def test_videos_that_failed_for_one_reason_share_a_row() -> None:
    failures = {f"v{n}": "not finished: the scheduler is gone" for n in range(40)} | {"w": "torn"}
    lines = failure_lines(failures, 100, "zsmoseg run")
    assert len(lines) == 4
    assert "v5 and 34 more" in lines[1]
    assert failure_lines({}, 3, "") == []


# ------------------------------------------------------------------ what is told
@pytest.mark.parametrize("terminal", [True, False])
def test_a_batch_says_how_far_it_is(
    terminal: bool, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (data / "ant" / "00003.png").write_bytes(b"\x89PNG torn")
    with Bars() if terminal else Lines() as watcher:
        batch(tmp_path, watcher)
        if terminal:
            assert isinstance(watcher, Bars)
            (task,) = watcher.progress.tasks
            assert task.completed == pytest.approx(1.0) == task.total
    assert (watcher.course.finished, watcher.course.failed) == (1, 1)
    if not terminal:
        assert "1 of 2 videos, 1 failed" in capsys.readouterr().err


def read_events(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_events_tell_all_that_happens_in_order(data: Path, tmp_path: Path) -> None:
    (data / "bee" / "00003.png").write_bytes(b"\x89PNG torn")
    path = tmp_path / "events.jsonl"
    words = ["run", str(data), "-o", str(tmp_path / "out"), "--scheduler", "serial", "--events", str(path)]
    main(words)
    events = read_events(path)
    kinds = [event["event"] for event in events]
    assert kinds[:3] == ["planned", "failed", "estimated"]
    assert kinds[-1] == "ended"
    assert sorted(event["time"] for event in events) == [event["time"] for event in events]
    parts = [event for event in events if event["event"] == "part"]
    assert len(parts) == events[0]["parts"]
    assert all(part["state"] == "done" and part["seconds"] >= 0 and part["memory_mb"] > 0 for part in parts)
    assert parts[0] | {"seconds": 0, "memory_mb": 0, "time": ""} == {
        "time": "",
        "event": "part",
        "video": "ant",
        "stage": "frames",
        "part": 0,
        "frames": [0, 4],
        "state": "done",
        "seconds": 0,
        "memory_mb": 0,
    }
    (failed,) = [event for event in events if event["event"] == "failed"]
    assert failed["video"] == "bee"
    (finished,) = [event for event in events if event["event"] == "finished"]
    assert finished["out"] == str(tmp_path / "out" / "ant")
    assert (events[2]["videos"], events[2]["looked"], events[2]["seconds"] > 0) == (2, 2, True)
    assert (events[-1]["finished"], events[-1]["failed"]) == (1, 1)
    main(words)
    assert len(read_events(path)) > len(events), "a second run appends"


def test_a_disk_without_room_for_events_does_not_stop_the_run(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", str(data), "-o", str(tmp_path / "out"), "--scheduler", "serial"]
    assert main([*words, "--events", "/dev/full"]) == 0
    assert "no more events are written" in capsys.readouterr().err
    assert main([*words, "--events", str(tmp_path / "no" / "folder.jsonl")]) == 2
    one_line(capsys.readouterr().err.strip(), "--events", "folder.jsonl")


# ------------------------------------------------------------------ errors that are not ours
class Notes(Quiet):
    """What is said of the run as a whole."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def note(self, text: str) -> None:
        self.texts.append(text)


class When(Quiet):
    """Does something once when a stage of a video is through."""

    def __init__(self, stage: str, do: Callable[[VideoPlan], Any]) -> None:
        self.stage, self.do, self.done = stage, do, False

    def planned(self, plan: VideoPlan) -> None:
        self.happens("", plan)

    def part(self, plan: VideoPlan, stage: str, part: int, outcome: Any) -> None:
        self.happens(stage, plan)

    def happens(self, stage: str, plan: VideoPlan) -> None:
        if stage == self.stage and not self.done:
            self.done = True
            self.do(plan)


def file_in_place_of_out(plan: VideoPlan) -> None:
    shutil.rmtree(plan.output.path)
    plan.output.path.write_text("")


@pytest.mark.parametrize(
    ("stage", "what", "said"),
    [
        ("", lambda plan: shutil.rmtree(plan.source), "ant"),
        ("features", lambda plan: shutil.rmtree(plan.source), "ant"),
        ("features", file_in_place_of_out, "out/ant"),
        ("masks", file_in_place_of_out, "out/ant"),
        ("features", lambda plan: shutil.rmtree(plan.stages["features"].artifact.path), "features"),
    ],
    ids=["source-early", "source", "out", "out-late", "artifact"],
)
def test_what_vanishes_in_a_run_fails_its_video_and_no_other(
    stage: str, what: Callable[[VideoPlan], Any], said: str, data: Path, tmp_path: Path
) -> None:
    report = batch(tmp_path, When(stage, what))
    assert report.finished == ["bee"]
    one_line(report.failures["ant"], said)
    assert not report.traces


def test_a_store_that_vanishes_in_a_run_stops_it_and_is_not_made_anew(data: Path, tmp_path: Path) -> None:
    report = batch(tmp_path, When("features", lambda _: shutil.rmtree(tmp_path / "store")))
    assert sorted(report.failures) == ["ant", "bee"]
    assert report.started
    for message in report.failures.values():
        one_line(message, "the store is gone", "run the same command again")
    assert not (tmp_path / "store").exists()


class Refusing:
    """A disk that refuses a file of one video."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, name: str, code: int) -> None:
        self.name, self.code, self.victim, self.whole = name, code, "ant", files.write_whole
        monkeypatch.setattr(files, "write_whole", self.write)

    def write(self, path: Path, content: bytes, sync: bool = False) -> None:
        if path.name == self.name and any(part.split("-")[0] == self.victim for part in path.parts):
            with files.errors_in_words(path):
                raise OSError(self.code, os.strerror(self.code), str(path))
        self.whole(path, content, sync)


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("summary.json", errno.EACCES),
        (".zsmoseg.json", errno.EPERM),
        ("00004.png", errno.EIO),
        ("done.json", errno.EIO),
    ],
)
def test_a_disk_that_refuses_a_file_of_one_video_fails_that_video_only(
    name: str, code: int, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = Refusing(monkeypatch, name, code)
    report = batch(tmp_path)
    assert report.finished == ["bee"]
    one_line(report.failures["ant"], name)
    disk.victim = "nobody"
    assert batch(tmp_path, choice=Choice(retry_failed=True)).finished == ["ant"]


@pytest.mark.parametrize(
    "code", [errno.ENOSPC, errno.EDQUOT, errno.EROFS], ids=["full", "quota", "read-only"]
)
@pytest.mark.parametrize("name", ["summary.json", "00004.png", "done.json"])
def test_a_disk_that_is_full_or_read_only_stops_the_run_and_what_was_finished_is_kept(
    name: str, code: int, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for seed, more in enumerate(NAMES[2:]):
        write_folder(data / more, draw_clip(seed + 2, 5, 96, 128)[0])
    disk, counter = Refusing(monkeypatch, name, code), Notes()
    disk.victim = "bee"
    report = batch(tmp_path, counter)
    assert report.finished == ["ant"]
    assert report.started
    assert sorted(report.failures) == ["bee", "cat", "dog"]
    (message,) = set(report.failures.values())
    one_line(message, name, "not finished")
    disk.victim = "nobody"
    assert batch(tmp_path, choice=Choice(retry_failed=True)).finished == ["bee", "cat", "dog"]


def test_a_disk_that_is_full_before_anything_is_started_is_an_error_of_the_run(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Refusing(monkeypatch, ".zsmoseg.json", errno.ENOSPC)
    with pytest.raises(SpaceError, match="no space left"):
        batch(tmp_path)


def test_a_list_of_files_that_cannot_be_written_fails_its_video(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    add = Output.add

    def refusing(self: Output, sizes: Any, key: str) -> None:
        if self.path.name == "ant" and "overlay.mp4" in sizes:
            raise PermissionError(errno.EACCES, "Permission denied", str(self.path))
        add(self, sizes, key)

    monkeypatch.setattr(Output, "add", refusing)
    report = batch(tmp_path)
    assert report.finished == ["bee"]
    one_line(report.failures["ant"], "out/ant: Permission denied", "run the same command again")


def test_a_video_whose_name_is_no_text_fails_or_runs_and_the_others_go_on(data: Path, tmp_path: Path) -> None:
    (data / "ant").rename(Path(os.fsdecode(os.fsencode(data) + b"/caf\xe9")))
    report = batch(tmp_path)
    assert "bee" in report.finished
    for message in report.failures.values():
        one_line(message, "another encoding than UTF-8")
    assert len(report.failures) + len(report.finished) == 2


def test_what_nobody_expected_keeps_its_trace_in_the_record_and_stays_with_its_video(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from zsmoseg.workflows.running import first_look as module

    probe = module.probe

    def broken(source: str, excerpt: Any) -> Any:
        if source.endswith("ant"):
            raise ZeroDivisionError("a fault of ours")
        return probe(source, excerpt)

    monkeypatch.setattr(module, "probe", broken)
    report = batch(tmp_path)
    assert report.finished == ["bee"]
    assert "unexpected ZeroDivisionError: a fault of ours" in report.failures["ant"]
    record = json.loads((tmp_path / "store" / "runs" / f"{report.run}.json").read_text())
    assert "in broken" in record["traces"]["ant"]


def closed(tmp_path: Path, where: str, mode: int) -> tuple[int, list[str]]:
    """The command in its own process after ``where`` was closed; exit code and lines."""
    place = tmp_path / where
    before = place.stat().st_mode
    place.chmod(mode)
    try:
        skip_where_all_is_open(place)
        words = ["run", "data", "-o", "out", "--store", "store", "--scheduler", "serial"]
        found = subprocess.run(
            [
                sys.executable,
                "-c",
                "import sys; from zsmoseg.workflows.cli import main; sys.exit(main())",
                *words,
            ],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            preexec_fn=without_privileges,
            capture_output=True,
            text=True,
        )
    finally:
        place.chmod(before)
    assert "Traceback" not in found.stderr, found.stderr
    return found.returncode, found.stderr.splitlines()


@pytest.mark.parametrize(
    ("where", "mode", "code"),
    [
        ("data/ant/00002.png", 0, 1),
        ("data/ant", 0, 1),
        ("data", 0, 2),
        ("store", 0o500, 2),
        ("out", 0o500, 2),
        ("out/ant", 0o500, 1),
    ],
)
def test_what_is_closed_to_us_ends_in_a_line_that_names_it(
    where: str, mode: int, code: int, data: Path, tmp_path: Path
) -> None:
    for folder in ("store", "out/ant"):
        (tmp_path / folder).mkdir(parents=True, exist_ok=True)
    if where == "out":
        (tmp_path / "out" / "ant").rmdir()
    found, lines = closed(tmp_path, where, mode)
    assert found == code, lines
    assert any(where in line and "ermission denied" in line for line in lines), lines
    assert (tmp_path / "out" / "bee" / "summary.json").exists() == (code == 1)


def test_a_batch_system_that_ends_the_job_is_obeyed_like_ctrl_c(data: Path, tmp_path: Path) -> None:
    words = ["run", str(data), "-o", str(tmp_path / "out"), "--scheduler", "local", "--workers", "1"]
    slow = "import zsmoseg.workflows.running.run as r; r.SMALL = 0.0; from zsmoseg.workflows.cli import main"
    script = f"import sys\n{slow}\nif __name__ == '__main__': sys.exit(main())\n"
    (tmp_path / "script.py").write_text(script)
    with subprocess.Popen(
        [sys.executable, str(tmp_path / "script.py"), *words],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if "frames done" in line:
                process.send_signal(signal.SIGTERM)
                break
        rest = process.stderr.read()
    assert process.wait() == 130
    assert rest.splitlines()[-1] == "zsmoseg: interrupted; what was finished is kept"
    assert "Traceback" not in rest


def test_a_batch_of_which_nothing_can_be_planned_was_not_started(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("ant", "bee"):
        (data / name / "00003.png").write_bytes(b"")
    assert main(["run", str(data), "-o", str(tmp_path / "out"), "--scheduler", "serial"]) == 2
    one_line(capsys.readouterr().err.strip(), "none of the 2 videos can be run; the first:", "ant/00003.png")


def test_sources_that_cannot_be_make_no_store(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for word in ("no.mp4", "a\0b", "*.mp4"):
        assert main(["run", word]) == 2
        one_line(capsys.readouterr().err.strip())
    assert not list(tmp_path.iterdir())


# ------------------------------------------------------------------ settings of others
@pytest.mark.parametrize(
    ("content", "said"),
    [
        ('[tags]\nprompt = "caf\xe9"\n'.encode("latin-1"), "is not UTF-8"),
        ("[flow]\nstride = 5\n".encode("utf-16"), "is not UTF-8"),
        (b"a = " + b"[" * 100_000, "is nested too deep"),
        (b"a = " + b"[" * 1_000 + b"]" * 1_000, "is nested too deep"),
        (b"[flow]\na = " + b"{a = " * 2_000 + b"1" + b"}" * 2_000, "is nested too deep"),
        (b".".join([b"a"] * 400) + b" = 1", "a.a is a table; expected one value"),
        (b".".join([b"a"] * 3_000) + b" = 1", "has a line of over 500 dots"),
        (b"[flow]\nstride = inf\n", "flow.stride = inf: expected a finite number"),
        (b"[segments]\npitch = nan\n", "segments.pitch = nan: expected a finite number"),
        (b"[video]\nfps = -inf\n", "video.fps = -inf: expected a finite number"),
        (b"[video]\nfps = 1e-320\n", "video.fps = 1e-320: expected"),
        (b"[video]\nstart = '" + b"9" * 5_000 + b"f'\n", "video.start = '9"),
        (b"[chunk]\nlength = " + b"9" * 5_000, "holds a number or a name that cannot be read"),
        (b"[chunk]\nlength = 0x" + b"f" * 5_000, "chunk.length has more digits than any setting takes"),
        (b'[ignore]\nmask = "a\\u0000b"\n', "ignore.mask = 'a\\x00b': holds a null byte"),
        (b'[proposals]\npath = "\\u0000"\n', "proposals.path = '\\x00': holds a null byte"),
    ],
)
def test_settings_that_no_file_should_hold_end_in_one_line(
    content: bytes, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "s.toml").write_bytes(content)
    assert main(["run", str(tmp_path), "--config", str(tmp_path / "s.toml")]) == 2
    one_line(capsys.readouterr().err.strip(), said)


def test_settings_saved_with_a_byte_order_mark_are_read(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_bytes(b"\xef\xbb\xbf[flow]\nstride = 6\n")
    assert resolve(config=tmp_path / "s.toml").flat()["flow.stride"] == 6


@pytest.mark.parametrize("value", ["9" * 5_000, "[" * 3_000])
def test_a_word_of_the_command_line_that_python_cannot_read_ends_in_one_line(
    value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "x", "--set", f"chunk.length={value}"]) == 2
    one_line(capsys.readouterr().err.strip(), "--set chunk.length:")


def test_errors_of_the_system_are_told_from_ours() -> None:
    with pytest.raises(AccessError, match=r"/a/b: Permission denied; mend that"), system_errors_in_words():
        raise PermissionError(errno.EACCES, "Permission denied", "/a/b")
    with pytest.raises(AccessError, match="null byte"), system_errors_in_words():
        os.stat("a\0b")
    with pytest.raises(ValueError, match="ours"), system_errors_in_words():
        raise ValueError("ours")
    with pytest.raises(BrokenPipeError), system_errors_in_words():
        raise BrokenPipeError


# ------------------------------------------------------------------ URLs and colons
def test_colons_in_the_names_of_video_output_and_store_are_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """FFmpeg takes what stands before a colon for a protocol."""
    from zsmoseg.workflows.cli.demo import write_clip

    monkeypatch.chdir(tmp_path)
    write_clip(Path("clip:1.mp4"), draw_clip(0, 5, 96, 128)[0])
    assert Path("clip:1.mp4").exists()
    assert main(["run", "clip:1.mp4", "-o", "run:2", "--store", "s:t", "--scheduler", "serial"]) == 0
    assert (tmp_path / "run:2" / "clip_1" / "overlay.mp4").stat().st_size > 0
    _, counter = segment(tmp_path / "clip:1.mp4", tmp_path, {"overlay.write": False}, out=tmp_path / "run:3")
    assert "masks" in counter.stages
