"""What stays in the store: ``run --keep``, ``gc --keep-cues``, ``--older-than``, and what forgetting a run would free."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from conftest import draw_clip, write_folder
from runs import data_bytes, segment

from zsmoseg.stores.location import Store
from zsmoseg.stores.runs import run_ids
from zsmoseg.stores.upkeep import freed
from zsmoseg.workflows.cli import main
from zsmoseg.workflows.result import open_store
from zsmoseg.workflows.running.request import KEPT, RESULTS

OUTPUTS = {"masks", "overlay"}
ONE = {"chunk.length": 64}


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    return write_folder(tmp_path / "disc", draw_clip(0, 6, 64, 96)[0])


def stages(root: Path) -> set[str]:
    """Those with an artifact in the store."""
    store = Store.open(root / "store", create=False)
    return {a.path.parent.name for video in store.videos() for a in store.video(video).artifacts()}


@pytest.mark.parametrize("keep", ["masks", "cues"])
@pytest.mark.parametrize("length", [3, 64], ids=["folders", "archives"])
def test_what_is_not_kept_is_gone_results_are_read_and_the_same_run_does_nothing(
    keep: str, length: int, clip: Path, tmp_path: Path
) -> None:
    settings = {"chunk.length": length}
    segment(clip, tmp_path / "all", settings)
    segment(clip, tmp_path / "less", settings, keep=keep)
    assert stages(tmp_path / "less") == stages(tmp_path / "all") & KEPT[keep]
    assert data_bytes(tmp_path / "less" / "out") == data_bytes(tmp_path / "all" / "out")
    found = open_store(tmp_path / "less" / "store")["disc"]
    assert found.masks("moving").values.any()
    assert len(found.objects) == 2
    assert "groups" in found.tree
    store = ["--store", str(tmp_path / "less" / "store")]
    assert main(["explain", "disc", *store, "--object", "1"]) == 0
    assert main(["verify", *store]) == 0
    for _ in range(2):
        _, again = segment(clip, tmp_path / "less", settings, keep=keep)
        assert again.parts == []
        assert stages(tmp_path / "less") == stages(tmp_path / "all") & KEPT[keep]


def test_what_another_setting_needs_is_made_again(clip: Path, tmp_path: Path) -> None:
    segment(clip, tmp_path, keep="masks")
    _, other = segment(clip, tmp_path, {"groups.count": 2}, keep="masks")
    assert {"frames", "flow", "statistics", "groups"} <= other.stages
    assert not {"segments", "features", "objects", "labels", "affinity"} & other.stages, (
        "groups needs none of them"
    )
    assert stages(tmp_path) == RESULTS
    _, back = segment(clip, tmp_path, {"groups.count": 2}, out=tmp_path / "elsewhere")
    assert back.stages == OUTPUTS, "nothing that is gone is needed to paint"


@pytest.mark.parametrize(("before", "after"), [(2, 64), (64, 2), (2, 3), (3, 4)])
def test_what_is_gone_is_made_again_in_chunks_of_another_length(
    before: int, after: int, clip: Path, tmp_path: Path
) -> None:
    segment(clip, tmp_path, {"chunk.length": before}, keep="masks")
    _, again = segment(clip, tmp_path, {"chunk.length": after}, start_from="flow")
    assert {"statistics", "affinity"} <= again.stages
    segment(clip, tmp_path / "one", {"chunk.length": after})
    assert data_bytes(tmp_path / "out") == data_bytes(tmp_path / "one" / "out")


def test_an_export_of_what_is_gone_says_how_to_get_it(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    segment(clip, tmp_path, keep="masks")
    words = ["disc", "--store", str(tmp_path / "store")]
    assert main(["export", *words, "--format", "flo", "-o", str(tmp_path / "flow")]) == 2
    advice = capsys.readouterr().err.partition("make it again with zsmoseg ")[2].strip()
    assert advice == f"run {clip} --store {tmp_path / 'store'} -o {tmp_path / 'out'} --from flow"
    assert main(["explain", "disc", "flow", *words[1:], "--set", "chunk.length=4"]) == 0
    assert "flow: not kept; made again where something reads it" in capsys.readouterr().out
    assert main([*shlex.split(advice), "--scheduler", "serial", "--set", "chunk.length=4"]) == 0
    assert main(["export", *words, "--format", "flo", "-o", str(tmp_path / "flow")]) == 0


def test_what_another_run_has_stays(clip: Path, tmp_path: Path) -> None:
    segment(clip, tmp_path)
    before = stages(tmp_path)
    segment(clip, tmp_path, keep="masks")
    assert stages(tmp_path) == before


def test_a_damaged_result_is_made_again_with_all_that_it_needs(clip: Path, tmp_path: Path) -> None:
    segment(clip, tmp_path / "all", ONE)
    segment(clip, tmp_path / "less", ONE, keep="masks")
    (archive,) = (tmp_path / "less" / "store").rglob("affinity/*.zip")
    archive.unlink()
    _, counter = segment(clip, tmp_path / "less", ONE, keep="masks")
    assert {"frames", "flow", "statistics", "affinity"} <= counter.stages
    assert stages(tmp_path / "less") == RESULTS
    assert data_bytes(tmp_path / "less" / "out") == data_bytes(tmp_path / "all" / "out")


# ------------------------------------------------------------------------ gc
def told(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    capsys.readouterr()
    assert main(["gc", *words]) == 0
    return capsys.readouterr().out


def test_gc_says_what_forgetting_each_run_would_free_and_that_is_what_it_frees(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    segment(clip, tmp_path, {"flow.stride": 5})
    segment(clip, tmp_path)
    segment(clip, tmp_path, {"groups.count": 2})
    store, place = Store.open(tmp_path / "store", create=False), ["--store", str(tmp_path / "store")]
    found, runs = freed(store), run_ids(store)
    assert list(found) == runs
    assert found[runs[0]] > found[runs[2]] > 0
    lines = re.findall(r"--forget (\S+) would free", told(capsys, *place))
    assert lines == runs
    size = re.search(r"([\d.]+) MB", told(capsys, *place, "--forget", runs[0]))
    assert size is not None
    assert float(size.group(1)) == pytest.approx(found[runs[0]] / 1e6, abs=0.1)


def test_gc_keeps_cues_of_the_latest_runs_and_results_of_all(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    segment(clip, tmp_path, ONE | {"flow.stride": 5})
    segment(clip, tmp_path, ONE)
    store = ["--store", str(tmp_path / "store")]
    flows = lambda: len(list((tmp_path / "store").rglob("flow/*.zip")))  # noqa: E731
    assert "nothing removed" in told(capsys, *store, "--keep-cues", "1")
    assert flows() == 2
    told(capsys, *store, "--keep-cues", "1", "--yes")
    assert flows() == 1
    runs = run_ids(Store.open(tmp_path / "store", create=False))
    assert open_store(tmp_path / "store").get("disc", runs[0]).masks("moving").values.any()
    _, counter = segment(clip, tmp_path, ONE)
    assert counter.parts == []
    told(capsys, *store, "--keep-cues", "0", "--yes")
    assert stages(tmp_path) == RESULTS
    _, counter = segment(clip, tmp_path, ONE)
    assert counter.parts == []


def test_gc_drops_runs_older_than_an_age(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    segment(clip, tmp_path)
    store = ["--store", str(tmp_path / "store")]
    assert "would free" in told(capsys, *store, "--older-than", "1d")
    assert "--yes removes" in told(capsys, *store, "--older-than", "0h")
    told(capsys, *store, "--older-than", "0h", "--yes")
    assert stages(tmp_path) == set()


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("--older-than", "soon"), "12h, 30d, 2w"),
        (("--older-than", "99999w"), "at most"),
        (("--keep-cues", "-1"), "expected 0 or more"),
    ],
)
def test_ages_and_numbers_that_mean_nothing_are_refused(
    words: tuple[str, str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as refused:
        main(["gc", words[0], words[1]])
    assert refused.value.code == 2
    assert line in capsys.readouterr().err
