"""``zsmoseg status`` for programs; why a stage will run, and how two keys of it differ."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from conftest import draw_clip, write_folder
from runs import segment

from zsmoseg.stores.location import Store
from zsmoseg.workflows.cli import main


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One clip with two settings, and one of which the last part is missing."""
    folder = tmp_path_factory.mktemp("reasons")
    clips = [write_folder(folder / name, draw_clip(seed, 6)[0]) for seed, name in enumerate(("ant", "bee"))]
    segment(clips[0], folder, {"frames.width": 64})
    segment(clips, folder, {"chunk.length": 3})
    (bee,) = [video for video in Store.open(folder / "store", create=False).videos() if "bee" in video]
    for path in (folder / "store" / bee / "groups").iterdir():
        (path / "records" / "done.json").unlink()
    return folder


def say(root: Path, capsys: pytest.CaptureFixture[str], *words: str) -> list[str]:
    assert main([words[0], *words[1:], "--store", str(root / "store")]) == 0
    return capsys.readouterr().out.splitlines()


def test_status_for_programs(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ant, bee = map(json.loads, say(root, capsys, "status", "--json"))
    assert (ant["video"], ant["state"], ant["stages"]) == ("ant", "done", {})
    assert Path(ant["out"]) == root / "out" / "ant"
    assert (bee["state"], bee["stages"]) == ("unfinished", {"groups": [0, 1]})
    words = say(root, capsys, "status")
    assert words[0].split()[:3] == ["ant", "done", "done"]
    assert "unfinished: groups 0 of 1" in words[1]


def test_what_is_done_says_so(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    done, key = say(root, capsys, "explain", "ant", "groups", "--set", "chunk.length=3")
    assert done == "groups: done, nothing to do"
    assert key.startswith("its key is that of the latest run: ")


@pytest.mark.parametrize(
    ("setting", "nearest", "cause"),
    [
        ("groups.share=0.4", "groups: setting groups.share: ", "groups: setting groups.share: "),
        ("flow.stride=5", None, "flow: setting flow.stride: "),
    ],
)
def test_why_a_stage_will_run_leads_to_the_setting_that_differs(
    setting: str, nearest: str | None, cause: str, root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    todo, key, *lines = say(root, capsys, "explain", "ant", "groups", "--set", setting)
    assert "parts to do: " in todo
    assert "in the latest run" in key
    assert any(line.strip().startswith(cause) for line in lines)
    if nearest:
        assert lines == [f"  {nearest}0.001 -> 0.4"] or lines[0].strip().startswith(nearest)


def test_two_keys_are_compared_by_what_they_were_made_of(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = Store.open(root / "store", create=False)
    (ant,) = [video for video in store.videos() if "ant" in video]
    groups = [a for a in store.video(ant).artifacts() if a.path.parent.name == "groups"]
    keys = {(a.description or {})["settings"]["frames"]["width"]: a.path.name for a in groups}
    lines = say(root, capsys, "explain", "ant", "groups", "--keys", keys[64][:6], keys[427][:6])
    assert "frames: setting frames.width: 64 -> 427" in lines
    same = say(root, capsys, "explain", "ant", "groups", "--keys", keys[64], keys[64])
    assert same == [f"groups: both are {keys[64]}"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["cow", "groups"], "no run came to 'cow'"),
        (["ant", "proposals"], "no stage proposals with these settings; there are frames"),
        (["ant", "groups", "--keys", "zz", "zz"], "0 keys of groups begin with zz; there are"),
        (["ant", "--keys", "a", "b"], "--keys compares two keys of one stage"),
    ],
)
def test_what_is_not_there_is_said_in_a_line(
    words: list[str], message: str, root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", *words, "--store", str(root / "store")]) == 2
    assert message in capsys.readouterr().err
