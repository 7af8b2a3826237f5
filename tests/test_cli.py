"""The command line: what it prints, and what bad input gets: one line, exit code 2, nothing lost."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import draw_clip, write_folder

from zsmoseg.workflows.cli import COMMANDS, main
from zsmoseg.workflows.running import scheduler

QUICK = ["--scheduler", "serial"]


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of the command line: clip, out and store in one folder."""
    root = tmp_path_factory.mktemp("cli")
    clip = write_folder(root / "disc", draw_clip(0, 8)[0])
    assert main(["run", str(clip), "-o", str(root / "out"), *QUICK]) == 0
    return root


def say(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    code = main(arguments)
    out, err = capsys.readouterr()
    return code, out, err


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a command makes by default lies in the folder that it is called in: not in the checkout."""
    monkeypatch.chdir(tmp_path)


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The one line that is printed on bad input."""
    code, _, err = say(arguments, capsys)
    lines = [line for line in err.splitlines() if line.startswith("zsmoseg:")]
    assert code == 2
    assert len(lines) == 1, err
    assert "Traceback" not in err
    return lines[0]


# ------------------------------------------------------------------ what good input gets
def test_a_run_says_where_the_masks_are(done: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = say(["run", str(done / "disc"), "-o", str(done / "out"), *QUICK], capsys)
    assert code == 0, err
    assert "nothing to do" in err
    assert f"masks: {done / 'out' / 'disc' / 'masks'}" in err


def test_a_dry_run_names_setting_old_and_new_value_and_writes_nothing(
    done: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(p for p in done.rglob("*"))
    arguments = ["run", str(done / "disc"), "-o", str(done / "out"), "--set", "flow.stride=5", "--dry-run"]
    code, out, _ = say(arguments, capsys)
    assert code == 0, out
    assert "setting flow.stride: 4 -> 5" in out
    assert "done: frames" in out
    assert sorted(p for p in done.rglob("*")) == before


def test_status_runs_explain_and_verify_tell_what_is_there(
    done: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = ["--store", str(done / "zsmoseg-store")]
    assert "done" in say(["status", *store], capsys)[1]
    assert "1 video: disc" in say(["runs", *store], capsys)[1]
    code, out, _ = say(["explain", "disc", *store], capsys)
    assert code == 0, out
    assert "with the world, below the border of 0.50; so it moves" in out
    assert "group 1" in out
    assert say(["verify", *store], capsys)[0] == 0


def everything(root: Path) -> dict[str, tuple[bytes, int]]:
    """Content and time of change of every file."""
    return {str(p): (p.read_bytes(), p.stat().st_mtime_ns) for p in root.rglob("*") if p.is_file()}


def test_verify_finds_a_flipped_byte_exits_with_1_and_changes_nothing_and_repair_mends_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = write_folder(tmp_path / "disc", draw_clip(0, 5)[0])
    main(["run", str(clip), "-o", str(tmp_path / "out"), *QUICK])
    shard = next((tmp_path / "zsmoseg-store").rglob("flow/*.zip"))
    data = bytearray(shard.read_bytes())
    data[len(data) // 2] ^= 1
    shard.write_bytes(bytes(data))
    capsys.readouterr()
    before, store = everything(tmp_path), ["--store", str(tmp_path / "zsmoseg-store")]
    code, out, _ = say(["verify", *store], capsys)
    assert code == 1
    assert "has other content than was written" in out
    assert "zsmoseg repair --yes" in out
    code, out, _ = say(["repair", *store], capsys)
    assert (code, "give --yes" in out) == (1, True)
    assert everything(tmp_path) == before
    assert say(["repair", *store, "--yes"], capsys)[0] == 0
    assert main(["run", str(clip), "-o", str(tmp_path / "out"), *QUICK]) == 0
    capsys.readouterr()
    assert say(["verify", "--store", str(tmp_path / "zsmoseg-store")], capsys)[0] == 0


def test_gc_removes_what_no_remembered_run_reaches(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = write_folder(tmp_path / "disc", draw_clip(0, 5)[0])
    store = ["--store", str(tmp_path / "zsmoseg-store")]
    main(["run", str(clip), "-o", str(tmp_path / "out"), *QUICK, "--set", "flow.stride=5"])
    main(["run", str(clip), "-o", str(tmp_path / "out"), *QUICK])
    capsys.readouterr()
    first = say(["runs", *store], capsys)[1].split()[0]
    assert "0 artifacts" in say(["gc", *store], capsys)[1]
    flows = tmp_path / "zsmoseg-store"
    assert len(list(flows.glob("disc-*/flow/*"))) == 2
    assert "--yes removes" in say(["gc", *store, "--forget", first], capsys)[1]
    assert len(list(flows.glob("disc-*/flow/*"))) == 2
    assert say(["gc", *store, "--forget", first, "--yes"], capsys)[0] == 0
    assert len(list(flows.glob("disc-*/flow/*"))) == 1
    assert main(["run", str(clip), "-o", str(tmp_path / "out"), *QUICK, "--dry-run"]) == 0
    assert "nothing to do" in capsys.readouterr().out


def test_gc_by_settings_keeps_what_they_reach_and_nothing_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = write_folder(tmp_path / "disc", draw_clip(0, 5)[0])
    place = tmp_path / "zsmoseg-store"
    store = ["--store", str(place)]
    for stride in (4, 5, 6):
        main(
            ["run", str(clip), "-o", str(tmp_path / f"out{stride}"), *QUICK, "--set", f"flow.stride={stride}"]
        )
        (tmp_path / f"{stride}.toml").write_text(f"[flow]\nstride = {stride}\n")
    before = everything(tmp_path)
    two = ["--config", str(tmp_path / "4.toml"), "--config", str(tmp_path / "6.toml")]
    code, said, _ = say(["gc", *store, *two], capsys)
    assert code == 0
    assert everything(tmp_path) == before
    flows = {path.name for path in place.glob("disc-*/flow/*")}
    assert sum(f"/flow/{name}\n" in said for name in flows) == 1
    assert say(["gc", *store, *two, "--yes"], capsys)[0] == 0
    assert len(list(place.glob("disc-*/flow/*"))) == 2
    assert say(["verify", *store], capsys)[0] == 0, "no run speaks of what is gone"
    for stride in (4, 6):
        again = ["--set", f"flow.stride={stride}", "--dry-run"]
        assert main(["run", str(clip), "-o", str(tmp_path / f"out{stride}"), *QUICK, *again]) == 0
        assert "nothing to do" in capsys.readouterr().out
    clip.rename(tmp_path / "elsewhere")
    said = say(["gc", *store, "--preset", "embedded", "--yes"], capsys)[1]
    assert "disc: all of it is kept" in said
    assert len(list(place.glob("disc-*/flow/*"))) == 2


def test_settings_are_listed_with_default_unit_and_meaning(capsys: pytest.CaptureFixture[str]) -> None:
    out = say(["settings"], capsys)[1]
    assert "flow.stride = 4" in out
    assert "groups.count = 'auto'" in out
    assert "--preset paper-core" in out


def test_the_paper_preset_gives_exactly_two_groups(done: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["run", str(done / "disc"), "-o", str(done / "paper"), "--store", str(done / "zsmoseg-store")]
    assert main([*arguments, "--preset", "paper-core", *QUICK]) == 0
    assert json.loads((done / "paper" / "disc" / "summary.json").read_text())["groups"] == 2


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_every_command_is_there_and_loads_nothing_heavy(command: str) -> None:
    script = (
        "import sys; from zsmoseg.workflows.cli import main\n"
        f"try: main(['{command}', '--help'])\nexcept SystemExit as e: assert e.code == 0\n"
        "heavy = {'numpy', 'zarr', 'xarray', 'dask', 'cv2', 'pydantic'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert "usage: zsmoseg" in found.stdout


# ------------------------------------------------------------------ what bad input gets
def test_a_source_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused(["run", str(tmp_path / "no.mp4"), "-o", str(tmp_path / "out")], capsys)
    assert "no.mp4: no such file" in line
    assert not (tmp_path / "out").exists()


def test_all_wrong_settings_are_named_at_once(done: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wrong = ["flow.strid=3", "flow.stride=0", "segments.pitch=wide", "groups.count=0", "masks.when=never"]
    line = refused(["run", str(done / "disc"), *(w for s in wrong for w in ("--set", s))], capsys)
    for part in (
        "flow.strid is unknown; did you mean flow.stride?",
        "flow.stride = 0: expected an integer >= 1 and <= 8",
        "segments.pitch = 'wide': expected a number",
        "groups.count = 0: expected auto or an integer >= 1",
        "masks.when = 'never': expected ever, now",
    ):
        assert part in line


def test_an_unknown_preset_stage_or_config(
    done: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = str(done / "disc")
    assert "preset 'best' is unknown; there are embedded, paper-core, paper, permissive" in refused(
        ["run", clip, "--preset", "best"], capsys
    )
    out = ["-o", str(tmp_path / "out")]
    assert "--from dreams: no such stage" in refused(["run", clip, *out, "--from", "dreams"], capsys)
    assert "cannot be read" in refused(["run", clip, "--config", str(tmp_path / "no.toml")], capsys)
    (tmp_path / "bad.toml").write_text("[flow\nstride=1")
    assert "is not TOML" in refused(["run", clip, "--config", str(tmp_path / "bad.toml")], capsys)


def test_settings_from_toml_are_used(done: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "s.toml").write_text("[flow]\nstride = 6\n")
    arguments = [
        "run",
        str(done / "disc"),
        "-o",
        str(done / "out"),
        "--config",
        str(tmp_path / "s.toml"),
        "--dry-run",
    ]
    assert "setting flow.stride: 4 -> 6" in say(arguments, capsys)[1]


def test_a_folder_that_is_not_a_store(done: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("dear")
    arguments = ["run", str(done / "disc"), "-o", str(tmp_path / "out"), "--store", str(tmp_path / "mine")]
    assert "is not a store" in refused(arguments, capsys)
    assert [p.name for p in (tmp_path / "mine").iterdir()] == ["thesis.tex"]
    assert "there is no store" in refused(["status", "--store", str(tmp_path / "none")], capsys)


def test_a_store_of_a_newer_version(done: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "store").mkdir()
    (tmp_path / "store" / "zsmoseg.json").write_text('{"format": 99}')
    arguments = ["run", str(done / "disc"), "-o", str(tmp_path / "out"), "--store", str(tmp_path / "store")]
    assert "is a store of format 99" in refused(arguments, capsys)


def test_an_output_folder_of_somebody_else(
    done: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out" / "disc").mkdir(parents=True)
    (tmp_path / "out" / "disc" / "holiday.png").write_bytes(b"x")
    line = refused(["run", str(done / "disc"), "-o", str(tmp_path / "out"), *QUICK], capsys)
    assert "was not made by zsmoseg" in line
    assert (tmp_path / "out" / "disc" / "holiday.png").read_bytes() == b"x"


def test_an_output_folder_of_another_source(
    done: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = write_folder(tmp_path / "disc", draw_clip(5, 4)[0])
    before = (done / "out" / "disc" / "masks" / "00000.png").read_bytes()
    line = refused(["run", str(other), "-o", str(done / "out"), *QUICK], capsys)
    assert "holds the result of another source" in line
    assert (done / "out" / "disc" / "masks" / "00000.png").read_bytes() == before


def test_two_sources_with_one_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for suffix in ("mp4", "avi"):
        (tmp_path / f"walk.{suffix}").write_bytes(b"0")
    line = refused(["run", str(tmp_path / "walk.mp4"), str(tmp_path / "walk.avi")], capsys)
    assert "have one name" in line


def test_a_bad_image_in_the_middle_is_named_with_its_frame(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = write_folder(tmp_path / "disc", draw_clip(0, 6)[0])
    whole = (clip / "00003.png").read_bytes()
    (clip / "00003.png").write_bytes(whole[: len(whole) // 2])
    code, _, err = say(["run", str(clip), "-o", str(tmp_path / "out"), *QUICK], capsys)
    assert code == 2
    assert "00003.png" in err
    assert "Traceback" not in err


def test_one_bad_video_does_not_stop_the_others(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good = write_folder(tmp_path / "good", draw_clip(0, 5)[0])
    write_folder(tmp_path / "bad", draw_clip(0, 5)[0][:1])
    code, _, err = say(["run", str(good), str(tmp_path / "bad"), "-o", str(tmp_path / "out"), *QUICK], capsys)
    assert code == 1
    assert "failed: bad" in err
    assert (tmp_path / "out" / "good" / "masks" / "00000.png").exists()


def test_a_full_disk_is_said_and_the_next_run_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from zsmoseg.stores import files

    whole = files.write_whole

    def full(path: Path, content: bytes, sync: bool = False) -> None:
        if path.suffix == ".zip":
            with files.errors_in_words(path):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        whole(path, content, sync)

    clip = write_folder(tmp_path / "disc", draw_clip(0, 5)[0])
    arguments = ["run", str(clip), "-o", str(tmp_path / "out"), *QUICK]
    with monkeypatch.context() as patch:
        patch.setattr(files, "write_whole", full)
        code, _, err = say(arguments, capsys)
    assert code == 1
    assert "no space left on the disk" in err
    assert main(arguments) == 0


def test_too_small_a_disk_is_refused_before_the_first_task(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import shutil

    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=1000))
    clip = write_folder(tmp_path / "disc", draw_clip(0, 5)[0])
    line = refused(["run", str(clip), "-o", str(tmp_path / "out"), *QUICK], capsys)
    assert "MB are free" in line


# ------------------------------------------------------------------ defined results
def warned(
    root: Path, images: np.ndarray, capsys: pytest.CaptureFixture[str], *more: str
) -> tuple[dict, str]:
    clip = write_folder(root / "clip", images)
    code, _, err = say(["run", str(clip), "-o", str(root / "out"), *QUICK, *more], capsys)
    assert code == 0, err
    return json.loads((root / "out" / "clip" / "summary.json").read_text()), err


def test_a_still_picture_has_one_group_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    still = np.repeat(draw_clip(0, 1)[0], 6, axis=0)
    summary, err = warned(tmp_path, still, capsys)
    assert summary["groups"] == 1
    assert summary["moving_pixels_percent"] == 0
    assert "warning: " in err
    assert "no object" in err


def test_the_whole_frame_moving_as_one_is_static(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    summary, _ = warned(tmp_path, draw_clip(0, 8, mover=False)[0], capsys)
    assert summary["groups"] == 1


def test_more_groups_than_objects_warns_and_gives_what_there_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    summary, err = warned(tmp_path, draw_clip(0, 8)[0], capsys, "--groups", "9")
    assert "9 groups asked for" in err
    assert 1 < summary["groups"] < 9


def test_an_ignored_region_is_never_painted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mask = np.zeros((120, 160), np.uint8)
    mask[:, 60:100] = 255
    cv2.imwrite(str(tmp_path / "ignore.png"), mask)
    warned(tmp_path, draw_clip(0, 8)[0], capsys, "--ignore", str(tmp_path / "ignore.png"))
    for path in (tmp_path / "out" / "clip" / "masks").glob("*.png"):
        assert not (cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[:, 60:100] > 0).any()


def test_runs_lists_the_settings_in_which_they_differ(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = write_folder(tmp_path / "disc", draw_clip(0, 5)[0])
    store = ["--store", str(tmp_path / "store")]
    words = ["run", str(clip), "-o", str(tmp_path / "out"), *store, "--scheduler", "serial"]
    main([*words, "--until", "frames"])
    capsys.readouterr()
    assert len(say(["runs", *store], capsys)[1].splitlines()) == 1, "one run differs from none"
    main([*words, "--until", "frames", "--set", "flow.stride=5"])
    main([*words, "--until", "frames", "--groups", "3"])
    capsys.readouterr()
    lines = say(["runs", *store], capsys)[1].splitlines()
    assert [set(line.strip().split(", ")) for line in lines[1::2]] == [
        {"flow.stride=4", "groups.count=auto"},
        {"flow.stride=5", "groups.count=auto"},
        {"flow.stride=4", "groups.count=3"},
    ]


REFUSED = {
    "stage": ["--from", "dreams"],
    "scheduler": ["--scheduler", "tcp://127.0.0.1:9"],
    "name": ["--only", "cat"],
    "proposals": ["--proposals", "nowhere"],
    "end": ["--set", "video.start=3f", "--set", "video.end=3f"],
    "output": [],
}


@pytest.mark.parametrize("why", REFUSED)
def test_a_run_that_is_refused_leaves_no_store_and_takes_none_away(
    why: str,
    done: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(scheduler, "CONNECT", 0.5)
    if why == "output":
        (tmp_path / "out" / "disc").mkdir(parents=True)
        (tmp_path / "out" / "disc" / "holiday.png").write_bytes(b"x")
    arguments = ["run", str(done / "disc"), "-o", str(tmp_path / "out"), *QUICK, *REFUSED[why]]
    refused(arguments, capsys)
    assert not (tmp_path / "zsmoseg-store").exists()
    mine = tmp_path / "mine"
    mine.mkdir()
    refused([*arguments, "--store", str(mine)], capsys)
    assert mine.exists(), "it was there before"
    (mine / "notes.txt").write_text("dear")
    refused([*arguments, "--store", str(mine)], capsys)
    assert (mine / "notes.txt").read_text() == "dear"
    before = set(everything(done / "zsmoseg-store"))
    refused([*arguments, "--store", str(done / "zsmoseg-store")], capsys)
    assert before <= set(everything(done / "zsmoseg-store"))
