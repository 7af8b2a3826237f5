"""Masks, flow and depth that users bring: what is taken from them, keys, and what bad files get."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import draw_clip, write_folder
from runs import masks, segment
from stores_help import delete, empty, flip, truncate

from zsmoseg.errors import FormatError, SettingsError
from zsmoseg.formats.flow_files import write_flo
from zsmoseg.painting.palette import encode_png
from zsmoseg.settings import resolve
from zsmoseg.stores.records import read_record, write_record
from zsmoseg.video.probe import Excerpt, probe
from zsmoseg.workflows.cli import main
from zsmoseg.workflows.imports.contents import count_unknown, depth_of, flow_of
from zsmoseg.workflows.result import Result, open_store
from zsmoseg.workflows.running.request import Request
from zsmoseg.workflows.running.run import dry_run
from zsmoseg.workflows.stages.cues.depth import Depth
from zsmoseg.workflows.stages.cues.flow import Flow
from zsmoseg.workflows.stages.proposed.objects import MaskObjects
from zsmoseg.workflows.stages.proposed.proposals import Proposals

FRAMES = 8


def result_of(report: Any, root: Path) -> Result:
    return open_store(root / "store").get(report.names[0], report.run)


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    """(T, H, W) the disc as id 7, and a still patch as id 3."""
    disc = draw_clip(0, FRAMES)[1]
    ids = np.where(disc, 7, 0).astype(np.uint8)
    for t, image in enumerate(ids):
        patch = image[80:110, 120 - 2 * t : 150 - 2 * t]
        patch[patch == 0] = 3
    return ids


@pytest.fixture(scope="module")
def brought(tmp_path_factory: pytest.TempPathFactory, truth: np.ndarray) -> Path:
    """A clip and, beside it, masks, flow of DIS and a depth for it."""
    root = tmp_path_factory.mktemp("brought")
    write_folder(root / "disc", draw_clip(0, FRAMES)[0])
    write_masks(root / "masks" / "disc", truth)
    report, _ = segment(root / "disc", root / "own")
    flow = Flow.read(result_of(report, root / "own").artifact("flow"))
    (root / "flow").mkdir()
    both = {"forward": flow.forward, "backward": flow.backward}
    np.savez(root / "flow" / "disc.npz", **both)
    (root / "depth").mkdir()
    ramp = np.tile(np.linspace(5.0, 1.0, 120)[:, None], (1, 160))
    np.save(root / "depth" / "disc.npy", np.repeat(ramp[None], FRAMES, 0).astype(np.float32))
    return root


def write_masks(folder: Path, ids: np.ndarray, frames: range | None = None) -> Path:
    folder.mkdir(parents=True)
    for t in frames or range(len(ids)):
        (folder / f"{t:05d}.png").write_bytes(encode_png(ids[t]))
    return folder


def test_imported_masks_become_motion_masks_and_nothing_embedded_is_computed(
    brought: Path, truth: np.ndarray, tmp_path: Path
) -> None:
    report, counter = segment(brought / "disc", tmp_path, {"proposals.path": str(brought / "masks")})
    assert not counter.stages & {"segments", "features"}
    found = masks(tmp_path / "out" / "disc")
    np.testing.assert_array_equal(found > 0, truth == 7)
    objects = result_of(report, tmp_path).objects
    assert objects["object"].tolist() == [0, 3, 7], "object = id"
    assert objects.set_index("object")["group"].to_dict() == {0: 0, 3: 0, 7: 1}


def test_imported_flow_gives_the_bytes_that_the_same_flow_computed_here_gives(
    brought: Path, tmp_path: Path
) -> None:
    _, counter = segment(brought / "disc", tmp_path, {"flow.path": str(brought / "flow")})
    assert "flow" in counter.stages
    np.testing.assert_array_equal(masks(tmp_path / "out" / "disc"), masks(brought / "own" / "out" / "disc"))


def test_flow_of_one_direction_is_enough(brought: Path, truth: np.ndarray, tmp_path: Path) -> None:
    with np.load(brought / "flow" / "disc.npz") as flow:
        np.savez(tmp_path / "disc.npz", forward=flow["forward"])
    settings = {"flow.path": str(tmp_path / "disc.npz"), "proposals.path": str(brought / "masks")}
    segment(brought / "disc", tmp_path, settings)
    np.testing.assert_array_equal(masks(tmp_path / "out" / "disc") > 0, truth == 7)


def test_depth_that_is_larger_farther_is_the_inverse_of_depth_that_is_larger_nearer(
    brought: Path, tmp_path: Path
) -> None:
    values = np.load(brought / "depth" / "disc.npy")
    np.save(tmp_path / "disc.npy", 1 / values)
    read = []
    for kind, path in (("depth", brought / "depth"), ("inverse-depth", tmp_path / "disc.npy")):
        settings = {"depth.path": str(path), "depth.kind": kind, "proposals.path": str(brought / "masks")}
        report, _ = segment(brought / "disc", tmp_path / kind, settings)
        read.append(Depth.read(result_of(report, tmp_path / kind).artifact("depth")).inverse_depth)
        assert (result_of(report, tmp_path / kind).artifact("affinity").description or {})["settings"][
            "motion"
        ]["model"] == "screw-shift"
    np.testing.assert_allclose(read[0].astype(float), read[1].astype(float), rtol=2e-3)
    assert read[0][0, -1, 0] > 3 * read[0][0, 0, 0], "near is large"


def test_masks_without_ids_are_linked_and_masks_of_some_frames_are_carried_between(
    brought: Path, truth: np.ndarray, tmp_path: Path
) -> None:
    shuffled = truth.copy()
    for t in range(1, FRAMES, 2):
        shuffled[t] = np.select([truth[t] == 7, truth[t] == 3], [3, 7], 0)
    write_masks(tmp_path / "shuffled", shuffled)
    report, _ = segment(
        brought / "disc",
        tmp_path / "a",
        {"proposals.path": str(tmp_path / "shuffled"), "proposals.kind": "masks"},
    )
    assert len(result_of(report, tmp_path / "a").objects) == 3
    np.testing.assert_array_equal(masks(tmp_path / "a" / "out" / "disc") > 0, truth == 7)
    write_masks(tmp_path / "some", truth, range(0, FRAMES, 3))
    segment(brought / "disc", tmp_path / "b", {"proposals.path": str(tmp_path / "some")})
    found = masks(tmp_path / "b" / "out" / "disc") > 0
    np.testing.assert_array_equal(found[::3], (truth == 7)[::3])
    for a, b in zip(found, truth == 7, strict=True):
        assert (a & b).sum() > 0.9 * (a | b).sum()


def test_chunk_length_changes_nothing_of_carried_masks(
    brought: Path, truth: np.ndarray, tmp_path: Path
) -> None:
    write_masks(tmp_path / "some", truth, range(1, FRAMES, 4))
    found = []
    for length in (1, 3, 8):
        settings = {"proposals.path": str(tmp_path / "some"), "chunk.length": length}
        segment(brought / "disc", tmp_path / str(length), settings)
        found.append(masks(tmp_path / str(length) / "out" / "disc", "objects"))
    assert all((f == found[0]).all() for f in found)


def test_one_command_from_masks_to_motion_masks_equals_import_and_run(
    brought: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    common = [str(brought / "disc"), "--scheduler", "serial"]
    cues = ["--proposals", str(brought / "masks"), "--depth", str(brought / "depth"), "--depth-is", "depth"]
    assert main(["run", *common, *cues, "-o", str(tmp_path / "out1"), "--store", str(tmp_path / "one")]) == 0
    two = ["--store", str(tmp_path / "two")]
    assert main(["import", *common, *cues, *two]) == 0
    told = capsys.readouterr().out
    assert "masks on 8 of 8 frames" in told
    assert "0 px hidden" in told
    assert main(["run", *common, *two, "-o", str(tmp_path / "out2")]) == 0
    np.testing.assert_array_equal(masks(tmp_path / "out1" / "disc"), masks(tmp_path / "out2" / "disc"))
    assert open_store(tmp_path / "two")["disc"].keys == open_store(tmp_path / "one")["disc"].keys
    assert (
        main(["run", *common, *two, "--set", "proposals.source=embedded", "-o", str(tmp_path / "out3")]) == 0
    )
    assert "segments" in open_store(tmp_path / "two")["disc"].keys


def test_the_content_of_the_files_is_in_the_key_and_their_place_is_not(
    brought: Path, truth: np.ndarray, tmp_path: Path
) -> None:
    segment(brought / "disc", tmp_path, {"proposals.path": str(brought / "masks")})
    other = write_masks(tmp_path / "elsewhere" / "disc", truth)
    _, counter = segment(brought / "disc", tmp_path, {"proposals.path": str(other)})
    assert not counter.stages
    (other / "00003.png").write_bytes(encode_png(np.where(truth[3] == 7, 7, 0)))
    _, counter = segment(brought / "disc", tmp_path, {"proposals.path": str(other)})
    assert counter.stages >= {"proposals", "objects", "labels", "statistics", "groups", "masks"}
    assert not counter.stages & {"frames", "flow"}


def test_overlapping_detections_count_their_hidden_pixels(brought: Path, tmp_path: Path) -> None:
    mask = np.zeros((2, 120, 160), bool)
    mask[0, 20:60, 20:60] = mask[1, 40:80, 40:80] = True
    packed = np.stack([np.packbits(m.ravel()) for m in mask])
    np.savez(
        tmp_path / "disc.npz",
        frame=np.repeat(np.arange(FRAMES), 2),
        score=np.tile([0.4, 0.9], FRAMES).astype(np.float32),
        cls=np.zeros(2 * FRAMES, np.int64),
        packed=np.tile(packed, (FRAMES, 1)),
        size=np.array([120, 160]),
    )
    report, _ = segment(
        brought / "disc", tmp_path, {"proposals.path": str(tmp_path / "disc.npz")}, until=["proposals"]
    )
    artifact = result_of(report, tmp_path).artifact("proposals")
    assert artifact is not None
    assert [artifact.part(i).facts["hidden"] for i in range(2)] == [1600, 1600]  # type: ignore[union-attr]
    assert (Proposals.read(artifact).mask[0][45:55, 45:55] == 2).all(), "the higher score is on top"


def test_a_cropped_range_uses_the_masks_of_its_frames(
    brought: Path, truth: np.ndarray, tmp_path: Path
) -> None:
    settings = {"proposals.path": str(brought / "masks"), "video.start": "2f", "video.end": "7f"}
    segment(brought / "disc", tmp_path, settings)
    np.testing.assert_array_equal(masks(tmp_path / "out" / "disc") > 0, truth[2:7] == 7)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"proposals.kind": "masks", "linking.overlap": 0.9}, "linking.overlap: 0.3 -> 0.9"),
        ({"proposals.kind": "masks", "linking.gap": 1}, "linking.gap: 3 -> 1"),
        ({"proposals.kind": "masks"}, "proposals.kind: ids -> masks"),
    ],
)
def test_every_setting_of_imports_changes_the_objects(
    change: dict[str, Any], words: str, brought: Path, truth: np.ndarray, tmp_path: Path
) -> None:
    """The disc jumps, and is gone for three frames."""
    ids = truth.copy()
    ids[3:6][ids[3:6] == 7] = 0
    ids[1] = np.where(truth[1] == 7, 0, truth[1])
    ids[1][np.roll(truth[1] == 7, 8, axis=1)] = 7
    path = write_masks(tmp_path / "ids", ids)
    start = {"proposals.path": str(path), **({"proposals.kind": "masks"} if len(change) > 1 else {})}
    before, _ = segment(brought / "disc", tmp_path, start)
    settings = resolve(overrides={"chunk.length": 4, **start, **change})
    assert words in "\n".join(
        dry_run(Request([str(brought / "disc")], tmp_path / "out", tmp_path / "store", settings))
    )
    old = MaskObjects.read(result_of(before, tmp_path).artifact("objects"))
    after, counter = segment(brought / "disc", tmp_path, {**start, **change})
    assert "objects" in counter.stages
    now = MaskObjects.read(result_of(after, tmp_path).artifact("objects"))
    assert old.object_of.tolist() != now.object_of.tolist()


def test_files_that_changed_after_an_import_are_not_read_under_its_key(
    brought: Path, truth: np.ndarray, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_masks(tmp_path / "masks" / "disc", truth)
    common = [str(brought / "disc"), "--scheduler", "serial", "--store", str(tmp_path / "store")]
    assert main(["import", *common, "--proposals", str(tmp_path / "masks")]) == 0
    (folder / "00002.png").write_bytes(encode_png(truth[3]))
    assert main(["run", *common, "-o", str(tmp_path / "out")]) == 0, "what is in the store needs no files"
    capsys.readouterr()
    again = ["run", *common, "-o", str(tmp_path / "out"), "--from", "proposals"]
    assert main(again) == 2
    assert "has changed since it was imported" in capsys.readouterr().err
    (record,) = (tmp_path / "store").glob("disc-*/imports.json")
    record.write_text("{")
    assert main(again[:-2]) == 2
    assert "imports.json: is damaged" in capsys.readouterr().err


def test_ids_too_sparse_for_tables_are_numbered_and_told(
    brought: Path, truth: np.ndarray, tmp_path: Path
) -> None:
    sparse = np.select([truth == 7, truth == 3], [40000, 9], 0).astype(np.uint16)
    path = write_masks(tmp_path / "masks", sparse)
    report, _ = segment(brought / "disc", tmp_path, {"proposals.path": str(path)})
    objects = result_of(report, tmp_path).objects
    assert objects["origin"].tolist() == [0, 9, 40000]
    assert objects["object"].tolist() == [0, 1, 2]
    assert objects["group"].tolist() == [0, 0, 1]


# ------------------------------------------------------------------ numbers at the ends of their range
def read_of(kind: str, clip: Path, path: Path, grid: tuple[int, int], **settings: Any) -> list[Any]:
    """What is taken of a file, frame by frame or pair by pair."""
    looked = probe(str(clip), resolve().video.parameters(Excerpt))
    take, stop = (flow_of, FRAMES - 1) if kind == "flow" else (depth_of, FRAMES)
    section = getattr(resolve(overrides={f"{kind}.path": str(path), **settings}), kind)
    return list(take(section, looked, 0, stop, grid))


@pytest.mark.parametrize("grid", [(120, 160), (60, 80)])
@pytest.mark.parametrize(
    ("length", "known"),
    [
        (8 * 160.0, True),
        (-8 * 160.0, True),
        (8 * 160.1, False),
        (9e8, False),
        (-9e8, False),
        (3e38, False),
        (1e300, False),
    ],
)
def test_flow_beyond_all_frames_is_unknown_as_in_flo(
    length: float, known: bool, grid: tuple[int, int], brought: Path, tmp_path: Path
) -> None:
    flow = np.ones((FRAMES - 1, 2, 120, 160))
    flow[2, 1, 40:50, 60:70] = length
    np.save(tmp_path / "flow.npy", flow)
    found = read_of("flow", brought / "disc", tmp_path / "flow.npy", grid)
    step = 120 // grid[0]
    for pair, (there, _) in enumerate(found):
        assert np.isfinite(there).all() or (pair == 2 and not known)
    inside = found[2][0][:, 40 // step : 50 // step, 60 // step : 70 // step]
    assert np.isfinite(inside).all() == known
    facts: dict[str, Any] = {}
    count_unknown(facts, found[2][0][0])
    assert facts["unknown"] == (0 if known else inside[0].size)


@pytest.mark.parametrize("scale", [1e-300, 1e-38, 1e-30, 1.0, 1e30, 1e37, 5e37])
@pytest.mark.parametrize("kind", ["depth", "inverse-depth", "disparity"])
@pytest.mark.parametrize("grid", [(120, 160), (60, 80)])
def test_depth_of_any_scale_is_relative(
    scale: float, kind: str, grid: tuple[int, int], brought: Path, tmp_path: Path
) -> None:
    """Warnings are errors here: nothing overflows."""
    ramp = np.load(brought / "depth" / "disc.npy")
    one, other = tmp_path / "one.npy", tmp_path / "other.npy"
    np.save(one, ramp)
    np.save(other, ramp.astype(np.float64) * scale)
    settings = {"depth.kind": kind}
    if scale < np.finfo(np.float32).smallest_subnormal:  # no number of float32: 0
        if kind != "inverse-depth":
            with pytest.raises(FormatError, match="unknown everywhere"):
                read_of("depth", brought / "disc", other, grid, **settings)
        return
    expected, found = (read_of("depth", brought / "disc", path, grid, **settings) for path in (one, other))
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def test_one_near_pixel_leaves_depth_finite(brought: Path, tmp_path: Path) -> None:
    values = np.load(brought / "depth" / "disc.npy")
    values[0, 0, 0], values[1, 0, 0] = 3e38, 1e36
    values[2, 0, 0] = np.inf
    np.save(tmp_path / "disc.npy", values)
    settings = {"depth.path": str(tmp_path / "disc.npy"), "depth.kind": "inverse-depth"}
    report, _ = segment(brought / "disc", tmp_path, settings | {"proposals.path": str(brought / "masks")})
    depth = Depth.read(result_of(report, tmp_path).artifact("depth")).inverse_depth
    assert np.isnan(depth[2, 0, 0])
    assert np.isfinite(np.delete(depth.ravel(), 2 * depth[0].size)).all()


# ------------------------------------------------------------------ what bad files get
def bad(settings: dict[str, Any], brought: Path, root: Path) -> str:
    with pytest.raises((FormatError, SettingsError)) as error:
        segment(brought / "disc", root, settings)
    assert not list((root / "store").glob("disc-*/*/*/parts/*")), "nothing is imported in part"
    text = str(error.value)
    assert "\n" not in text
    return text


def test_masks_of_other_size_other_names_or_of_nothing(
    brought: Path, truth: np.ndarray, tmp_path: Path
) -> None:
    small = write_masks(tmp_path / "small", truth[:, :60])
    assert "160 x 60" in bad({"proposals.path": str(small)}, brought, tmp_path / "a")
    strange = write_masks(tmp_path / "strange", truth)
    (strange / "00007.png").rename(strange / "00093.png")
    assert "00093 belongs to no frame" in bad({"proposals.path": str(strange)}, brought, tmp_path / "b")
    assert "no such file or folder" in bad(
        {"proposals.path": str(tmp_path / "gone")}, brought, tmp_path / "c"
    )
    (tmp_path / "empty").mkdir()
    assert "empty" in bad({"proposals.path": str(tmp_path / "empty")}, brought, tmp_path / "d")


def test_a_damaged_mask_in_the_middle_is_named(brought: Path, truth: np.ndarray, tmp_path: Path) -> None:
    folder = write_masks(tmp_path / "masks", truth)
    (folder / "00005.png").write_bytes((folder / "00005.png").read_bytes()[:40])
    assert "00005.png" in bad({"proposals.path": str(folder)}, brought, tmp_path / "a")


def test_binary_masks_where_ids_are_expected(brought: Path, truth: np.ndarray, tmp_path: Path) -> None:
    folder = write_masks(tmp_path / "masks", np.where(truth == 7, 255, 0).astype(np.uint8))
    assert "0 and 255" in bad({"proposals.path": str(folder)}, brought, tmp_path / "a")


def test_flow_of_other_size_with_nan_or_with_a_frame_missing(brought: Path, tmp_path: Path) -> None:
    with np.load(brought / "flow" / "disc.npz") as flow:
        forward = flow["forward"]
    cases = {"size": forward[:, :, :60], "nan": forward.copy(), "missing": forward[:-2]}
    cases["nan"][4, 0, 3, 3] = np.nan
    words = {"size": "160 x 60", "nan": "4", "missing": "5"}
    for name, values in cases.items():
        np.savez(tmp_path / f"{name}.npz", forward=values)
        text = bad({"flow.path": str(tmp_path / f"{name}.npz")}, brought, tmp_path / name)
        assert words[name] in text
        assert f"{name}.npz" in text


def _unknown(what: str, shape: tuple[int, ...]) -> np.ndarray:
    """(pairs, h, w) what of a flow is unknown."""
    unknown = np.zeros(shape, np.bool_)
    where: dict[str, Any] = {
        "one pixel": (3, 50, 50),
        "a block": (slice(None), slice(40, 70), slice(60, 100)),
        "a frame": 3,
        "a chunk": slice(0, 4),
        "all but two pairs": slice(2, None),
        "everything": slice(None),
    }
    if what == "half of all pixels":
        return np.broadcast_to(np.random.default_rng(0).random(shape[1:]) < 0.5, shape)
    unknown[where[what]] = True
    return unknown


@pytest.mark.parametrize("both_ways", [True, False])
@pytest.mark.parametrize(
    ("what", "found"),
    [
        ("one pixel", range(8)),
        ("a block", range(8)),
        ("half of all pixels", range(8)),
        ("a frame", range(8)),
        ("a chunk", range(5, 8)),
        ("all but two pairs", range(3)),
        ("everything", ()),
    ],
)
def test_flow_that_is_unknown_has_no_say(
    what: str, found: range, both_ways: bool, brought: Path, truth: np.ndarray, tmp_path: Path
) -> None:
    with np.load(brought / "flow" / "disc.npz") as flow:
        sides = [side for side in flow.files if both_ways or side == "forward"]
        for side in sides:
            values = np.where(_unknown(what, flow[side][:, 0].shape)[:, None], np.nan, flow[side])
            (tmp_path / "flow" / side).mkdir(parents=True)
            for pair, vectors in enumerate(values):
                write_flo(tmp_path / "flow" / side / f"{pair:05d}.flo", vectors)
    segment(brought / "disc", tmp_path, {"flow.path": str(tmp_path / "flow")})
    moving = masks(tmp_path / "out" / "disc") > 0
    if what == "half of all pixels" and not both_ways:
        return  # an object is found, but no flow is seen to lead back: it is not known to move
    assert moving.any() == (what != "everything")
    for frame in found:
        disc = truth[frame] == 7
        assert (moving[frame] & disc).sum() > 0.9 * (moving[frame] | disc).sum(), frame


def test_depth_without_the_word_that_says_which(brought: Path, tmp_path: Path) -> None:
    assert "--depth-is" in bad({"depth.path": str(brought / "depth")}, brought, tmp_path / "a")


def test_a_path_beside_a_source_that_does_without_it(brought: Path, tmp_path: Path) -> None:
    settings = {"flow.path": str(brought / "flow"), "flow.source": "dis"}
    assert "flow.source = dis" in bad(settings, brought, tmp_path / "a")
    assert "nothing was imported" in bad({"proposals.source": "imported"}, brought, tmp_path / "b")
    assert "every" in bad({"flow.path": str(brought / "flow"), "video.every": 2}, brought, tmp_path / "c")


def test_json_that_is_not_coco(brought: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "disc.json").write_text(json.dumps({"answer": 42}))
    arguments = ["import", str(brought / "disc"), "--store", str(tmp_path / "store"), "--scheduler", "serial"]
    assert main([*arguments, "--proposals", str(tmp_path / "disc.json")]) == 2
    error = capsys.readouterr().err
    assert "neither COCO" in error
    assert error.count("\n") == 1
    assert main(arguments) == 2
    assert "nothing to import" in capsys.readouterr().err


# ------------------------------------------------------------------ the record of what was imported
@pytest.fixture(scope="module")
def imported(brought: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with masks and a depth."""
    root = tmp_path_factory.mktemp("imported")
    arguments = ["import", str(brought / "disc"), "--store", str(root / "store"), "--scheduler", "serial"]
    cues = ["--proposals", str(brought / "masks"), "--depth", str(brought / "depth"), "--depth-is", "depth"]
    assert main([*arguments, *cues]) == 0
    return root / "store"


class Imported:
    """A copy of that store, and commands on it."""

    def __init__(self, store: Path, disc: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.store, self.disc, self.capsys = store, disc, capsys
        (self.record,) = store.glob("disc-*/imports.json")

    def __call__(self, command: str, *more: str) -> tuple[int, str]:
        source = [str(self.disc), "--scheduler", "serial"] if command in ("run", "import") else []
        self.capsys.readouterr()
        code = main([command, *source, "--store", str(self.store), *more])
        told = self.capsys.readouterr()
        return code, told.out + told.err


@pytest.fixture
def copy(imported: Path, brought: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Imported:
    return Imported(shutil.copytree(imported, tmp_path / "store"), brought / "disc", capsys)


def without_proposals(record: Path) -> None:
    found = read_record(record) or {}
    write_record(record, {kind: entry for kind, entry in found.items() if kind != "proposals"})


def folder_there(record: Path) -> None:
    record.unlink()
    record.mkdir()


def pipe_there(record: Path) -> None:
    record.unlink()
    os.mkfifo(record)


@pytest.mark.parametrize(
    "harm",
    [delete, without_proposals, empty, truncate, flip, folder_there, pipe_there],
    ids=lambda h: h.__name__,
)
def test_a_record_of_imports_that_is_lost_or_damaged_is_missed_until_the_import_is_repeated(
    harm: Callable[[Path], None], copy: Imported, brought: Path
) -> None:
    harm(copy.record)
    code, told = copy("verify")
    assert code == 1
    assert f"{copy.record}: " in told
    assert "zsmoseg import again" in told
    assert copy("repair", "--yes")[0] == 0
    code, told = copy("run", "--dry-run")
    assert code == 2
    assert str(copy.record) in told
    assert told.count("\n") == 1
    if harm is folder_there:
        copy.record.rmdir()
    masks = ["--proposals", str(brought / "masks")]
    assert copy("import", *masks)[0] == 0
    code, told = copy("verify")
    assert (code, "the depth imported" in told) == (int(harm is not without_proposals),) * 2, (
        "the other is missed still"
    )
    assert copy("import", "--depth", str(brought / "depth"), "--depth-is", "depth")[0] == 0
    assert copy("verify")[0] == 0
    assert copy("run", "--dry-run")[0] == 0


def test_a_lost_record_of_imports_is_no_more_missed_once_a_run_was_told_that_none_are_meant(
    copy: Imported,
) -> None:
    delete(copy.record)
    none = ["--set", "proposals.source=embedded", "--set", "depth.source=constant", "--until", "frames"]
    assert copy("run", *none)[0] == 0
    assert copy("verify")[0] == 0
    assert copy("run", "--dry-run")[0] == 0


def test_a_run_that_takes_masks_by_their_path_misses_no_record(
    brought: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    segment(brought / "disc", tmp_path, {"proposals.path": str(brought / "masks")}, until=["proposals"])
    assert main(["verify", "--store", str(tmp_path / "store")]) == 0


@pytest.mark.parametrize(
    ("drop", "stays"),
    [(["--older-than", "0h"], True), ([], True), (["--preset", "embedded"], True), (["--forget"], False)],
)
def test_gc_keeps_what_was_imported_unless_the_run_is_forgotten_by_its_name(
    drop: list[str], stays: bool, copy: Imported
) -> None:
    run = read_record(next(copy.record.parent.glob("runs/*.json"))) or {}
    drop = [*drop, run["run"]] if drop == ["--forget"] else drop
    told = copy("gc", *drop)[1]
    assert (f"{copy.record}: is kept" in told) == (drop == ["--older-than", "0h"])
    assert copy("gc", *drop, "--yes")[0] == 0
    assert copy.record.exists() == stays
    left = {path.name for path in copy.record.parent.iterdir()} if stays else set()
    assert left >= ({"proposals", "depth"} if stays else set())
    assert copy("gc", "--yes")[0] == 0
    assert copy.record.exists() == stays
    assert copy("run", "--dry-run")[0] == 0
