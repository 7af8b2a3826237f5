"""A run from frames to masks, through the real store and both executors."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import draw_clip, write_folder
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from runs import data_bytes, masks, segment

from zsmoseg.metrics.tracks import track_scores


@pytest.fixture(scope="module")
def finished(clip: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("finished")
    segment(clip, root)
    return root


def test_the_disc_that_moves_is_found(finished: Path) -> None:
    _, truth = draw_clip()
    found = masks(finished / "out" / "disc")
    assert track_scores(zip(truth.astype(int), found, strict=True)).fu > 85


def test_summary_names_groups_evidence_and_settings(finished: Path) -> None:
    summary = json.loads((finished / "out" / "disc" / "summary.json").read_text())
    assert summary["groups"] == 2
    assert summary["frames"] == 10
    assert summary["settings"]["chunk.length"] == 4
    assert any(
        e["group"] == 1 and e["excess_px"] > e["tolerance_px"] and e["affinity_with_world"] < 0.5
        for e in summary["evidence"]
    )


@pytest.mark.parametrize(
    ("size", "encoded"),
    [
        ((1, 1), (2, 2)),
        ((64, 1), (64, 2)),
        ((1, 33), (2, 32)),
        ((3, 5), (2, 4)),
        ((266, 17000), (256, 16384)),
        ((16386, 257), (16384, 256)),
    ],
)
def test_the_overlay_of_frames_of_any_size_is_one_that_can_be_encoded(
    size: tuple[int, int], encoded: tuple[int, int], tmp_path: Path
) -> None:
    import av

    write_folder(tmp_path / "clip", np.random.default_rng(0).integers(0, 255, (2, *size, 3), np.uint8))
    report, _ = segment(tmp_path / "clip", tmp_path, {"segments.pitch": 24})
    assert not report.failures
    with av.open(str(tmp_path / "out" / "clip" / "overlay.mp4")) as container:
        frames = [frame.to_ndarray(format="bgr24").shape for frame in container.decode(video=0)]
    assert frames == [(*encoded, 3)] * 2
    notes = json.loads((tmp_path / "out" / "clip" / "summary.json").read_text())["notes"]
    told = [note for note in notes if note.startswith("overlay: scaled to")]
    assert told == ([told[0]] if max(size) > 16384 else [])


def test_the_overlay_has_every_frame(finished: Path) -> None:
    import av

    with av.open(str(finished / "out" / "disc" / "overlay.mp4")) as container:
        assert sum(1 for _ in container.decode(video=0)) == 10


def test_a_second_run_computes_nothing(clip: Path, finished: Path) -> None:
    _, counter = segment(clip, finished)
    assert counter.parts == []


def test_the_bytes_are_the_same_with_dask_whatever_the_workers(
    clip: Path, finished: Path, tmp_path: Path
) -> None:
    expected = data_bytes(finished)
    for workers in (1, 2):
        root = tmp_path / str(workers)
        from zsmoseg.workflows.running import run as module

        module_small, module.SMALL = module.SMALL, 0.0
        try:
            _, counter = segment(clip, root, scheduler="local", workers=workers)
        finally:
            module.SMALL = module_small
        assert "flow" in counter.stages
        assert data_bytes(root) == expected


@pytest.fixture(scope="module")
def reference(clip: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    root = tmp_path_factory.mktemp("reference")
    segment(clip, root, {"chunk.length": 64})
    return {kind: masks(root / "out" / "disc", kind) for kind in ("masks", "objects")}


@settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(length=st.integers(1, 11))
def test_chunk_length_changes_nothing(
    length: int,
    clip: Path,
    reference: dict[str, np.ndarray],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    root = tmp_path_factory.mktemp("chunks")
    segment(clip, root, {"chunk.length": length, "overlay.write": False})
    for kind, expected in reference.items():
        np.testing.assert_array_equal(masks(root / "out" / "disc", kind), expected)


def test_two_shots_glued_together_give_the_masks_of_each_alone(tmp_path: Path) -> None:
    one, two = draw_clip(1, 8)[0], draw_clip(2, 9)[0]
    alone = []
    for name, images in (("one", one), ("two", two)):
        segment(write_folder(tmp_path / name, images), tmp_path / f"run-{name}")
        alone.append(masks(tmp_path / f"run-{name}" / "out" / name) > 0)
    segment(write_folder(tmp_path / "both", np.concatenate([one, two])), tmp_path / "run-both")
    both = masks(tmp_path / "run-both" / "out" / "both") > 0
    assert all(part.any() for part in alone)
    np.testing.assert_array_equal(both, np.concatenate(alone))


def test_changing_the_number_of_groups_touches_nothing_before_them(clip: Path, finished: Path) -> None:
    _, counter = segment(clip, finished, {"groups.count": 1}, out=finished / "one-group")
    assert counter.stages == {"groups", "masks", "overlay"}
    assert not masks(finished / "one-group" / "disc").any()


def test_going_back_to_old_settings_repaints_only(clip: Path, tmp_path: Path) -> None:
    segment(clip, tmp_path)
    before = masks(tmp_path / "out" / "disc")
    segment(clip, tmp_path, {"groups.count": 1})
    _, counter = segment(clip, tmp_path)
    assert counter.stages == {"masks", "overlay"}
    np.testing.assert_array_equal(masks(tmp_path / "out" / "disc"), before)


def test_until_stops_after_a_stage_and_the_next_run_goes_on(clip: Path, tmp_path: Path) -> None:
    _, first = segment(clip, tmp_path, until=["flow"])
    assert first.stages == {"frames", "flow"}
    assert not (tmp_path / "out").exists()
    _, second = segment(clip, tmp_path)
    assert not {"frames", "flow"} & second.stages


def test_from_computes_a_stage_and_what_hangs_on_it_again(clip: Path, tmp_path: Path) -> None:
    segment(clip, tmp_path)
    before = data_bytes(tmp_path)
    _, counter = segment(clip, tmp_path, start_from="statistics")
    assert {"statistics", "groups", "masks"} <= counter.stages
    assert not {"frames", "flow", "labels"} & counter.stages
    assert data_bytes(tmp_path) == before
