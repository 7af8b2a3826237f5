"""zsmoseg evaluate: what it reads, what it prints, and what it refuses."""

from __future__ import annotations

import csv
import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import SHARED
from PIL import Image
from runs import masks, segment

from zsmoseg.datasets.published import published_rows, sequence_lists
from zsmoseg.metrics.protocols import PROTOCOLS
from zsmoseg.metrics.regions import region_j
from zsmoseg.metrics.tracks import track_scores
from zsmoseg.workflows.cli import main
from zsmoseg.workflows.evaluate.reports import REPORTS

FRAMES, SIZE = 6, (40, 60)


def write(path: Path, values: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(values.astype(np.uint8)).save(path)
    return path


def volume(shift: int = 0, objects: int = 2) -> np.ndarray:
    """(frames, H, W): squares that move to the right, ``shift`` pixels off."""
    out = np.zeros((FRAMES, *SIZE), np.uint8)
    for t in range(FRAMES):
        for n in range(objects):
            out[t, 5 + 15 * n : 15 + 15 * n, 5 + 2 * t + shift : 20 + 2 * t + shift] = n + 1
    return out


def save(folder: Path, labels: np.ndarray) -> Path:
    for number, frame in enumerate(labels):
        write(folder / f"{number:05d}.png", frame)
    return folder


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    """A DAVIS of two sequences, one of them with one object."""
    root = tmp_path / "DAVIS"
    save(root / "Annotations/480p/goat", volume())
    save(root / "Annotations/480p/dog", volume(objects=1))
    return root


@pytest.fixture
def near(tmp_path: Path) -> Path:
    """Masks one pixel off."""
    for name, objects in (("goat", 2), ("dog", 1)):
        save(tmp_path / "near" / name, volume(1, objects))
    return tmp_path / "near"


def evaluated(capsys: pytest.CaptureFixture[str], *arguments: object) -> Any:
    """What ``evaluate`` prints as JSON."""
    assert main(["evaluate", *map(str, arguments), "--format", "json"]) == 0
    return json.loads(capsys.readouterr().out)


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The one line that ``evaluate`` ends with."""
    assert main(["evaluate", *map(str, arguments)]) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert error.count("\n") == 1
    return error


def test_json_has_every_number_of_every_sequence_and_the_mean(
    truth: Path, near: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = evaluated(capsys, near, "--truth", truth)
    assert found["protocol"] == "moving"
    assert list(found["methods"]) == ["near"]
    method = found["methods"]["near"]
    for name, objects in (("goat", 2), ("dog", 1)):
        pairs = list(zip(volume(0, objects), volume(1, objects), strict=True))
        pu, ru, fu = track_scores(pairs)
        j = 100 * np.mean([region_j(t > 0, p > 0) for t, p in pairs])
        merged = track_scores((t > 0, p > 0) for t, p in pairs)
        assert method["sequences"][name] == pytest.approx(
            {"Fu": fu, "Pu": pu, "Ru": ru, "J": j, "Fu_binary": merged.fu, "Pu_binary": merged.pu}
            | {"Ru_binary": merged.ru}
        )
    assert method["mean"]["Fu"] == np.mean([s["Fu"] for s in method["sequences"].values()])
    assert method["mean_one_object"] == method["sequences"]["dog"]
    assert method["sequences_with_one_object"] == 1
    assert {"frames", "void", "unit"} <= set(found["about"])


def test_the_same_masks_score_the_same_however_they_are_stored(
    truth: Path, near: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, objects in (("goat", 2), ("dog", 1)):
        save(tmp_path / "out" / name / "masks", volume(1, objects))
        save(tmp_path / "out" / name / "objects", volume(0, objects))
        for folder in ("packed", "plain", "floats"):
            (tmp_path / folder).mkdir(exist_ok=True)
        np.savez_compressed(tmp_path / "packed" / f"{name}.npz", segmentation=volume(1, objects))
        np.save(tmp_path / "plain" / f"{name}.npy", volume(1, objects).astype(np.int32))
        np.savez(tmp_path / "floats" / f"{name}.npz", volume(1, objects).astype(np.float64))
    stored = [tmp_path / name for name in ("out", "packed", "plain", "floats")]
    for protocol in ("moving", "davis-2017"):
        found = evaluated(capsys, near, *stored, "--truth", truth, "--protocol", protocol)["methods"]
        assert len(found) == 5
        assert all(scores == found["near"] for scores in found.values())
    things = evaluated(capsys, tmp_path / "out", "--truth", truth, "--label", "instance")
    assert things["methods"]["out"]["mean"]["Fu"] == 100


def test_processes_change_no_number(truth: Path, near: Path, capsys: pytest.CaptureFixture[str]) -> None:
    alone = evaluated(capsys, near, f"same={truth}/Annotations/480p", "--truth", truth, "--workers", 1)
    pooled = evaluated(capsys, near, f"same={truth}/Annotations/480p", "--truth", truth, "--workers", 2)
    assert alone == pooled


def test_a_store_scores_like_the_masks_of_its_run(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    segment(clip, tmp_path)
    found = masks(tmp_path / "out" / clip.name)
    assert found.any()
    save(tmp_path / "truth" / clip.name, np.roll(found, 1, 2))
    scores = evaluated(capsys, tmp_path / "store", tmp_path / "out", "--truth", tmp_path / "truth")["methods"]
    assert scores["store"] == scores["out"]
    assert 50 < scores["store"]["mean"]["Fu"] < 100


def test_davis_protocols_drop_the_ends_and_count_objects(
    truth: Path, near: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (near / "goat/00000.png").unlink()
    (near / "dog/00005.png").unlink()
    one = evaluated(capsys, near, "--truth", truth, "--protocol", "davis-2016")["methods"]["near"]
    each = evaluated(capsys, near, "--truth", truth, "--protocol", "davis-2017")["methods"]["near"]
    j = np.mean([region_j(t > 0, p > 0) for t, p in zip(volume(), volume(1), strict=True)][1:-1])
    assert one["sequences"]["goat"]["J"] == pytest.approx(j)
    assert list(each["objects"]) == ["dog_1", "goat_1", "goat_2"]
    assert each["mean"]["J"] == pytest.approx(np.mean([o["J"] for o in each["objects"].values()]))
    message = refused(capsys, near, "--truth", truth, "--protocol", "davis-2017-unsupervised")
    assert "has no mask of the annotated frame 0000" in message


def test_black_and_white_truth_is_one_object_and_official_stops(
    truth: Path, near: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save(truth / "Annotations/480p/dog", 255 * volume(objects=1))
    options = ("--truth", truth, "--sequences", "dog", "--protocol", "davis-2017-unsupervised")
    found = evaluated(capsys, near, *options)
    assert found["methods"]["near"]["mean"]["F"] == 1
    assert found["about"]["notes"] == "the annotation is 0/255, read as one object (dog)"
    assert "dog/00000.png: has no object (255 is void to the official program; leave out" in refused(
        capsys, near, *options, "--official"
    )


def test_void_is_a_named_option_and_told(truth: Path, near: Path, capsys: pytest.CaptureFixture[str]) -> None:
    marked = volume()
    marked[:, :, 30:] = 255
    save(truth / "Annotations/480p/goat", marked)
    options = (near, "--truth", truth, "--sequences", "goat")
    label, left_out = evaluated(capsys, *options), evaluated(capsys, *options, "--void", 255)
    scores = [found["methods"]["near"]["mean"]["Ru"] for found in (label, left_out)]
    assert scores[0] < scores[1]
    assert label["about"]["void"] == "none, 255 is a label like any other"
    assert left_out["about"]["void"] == "label 255 is left out"
    assert "contradict" in refused(capsys, *options, "--void", 255, "--official")
    assert "--void often: expected" in refused(capsys, *options, "--void", "often")


def test_annotations_on_some_frames_only_are_matched_by_number(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = np.repeat(volume(), 5, 0)
    for number in (5, 10, 20):
        write(tmp_path / f"train/Annotations/0248626d9a/{number:05d}.png", whole[number])
    save(tmp_path / "all/0248626d9a", whole)
    for name, rows in (("every", whole), ("fifth", whole[::5]), ("annotated", whole[[5, 10, 20]])):
        (tmp_path / name).mkdir()
        np.savez(tmp_path / name / "0248626d9a.npz", rows)
    paths = [tmp_path / name for name in ("all", "every", "fifth", "annotated")]
    found = evaluated(capsys, *paths, "--truth", tmp_path / "train")["methods"]
    assert [scores["mean"]["Fu"] for scores in found.values()] == [100] * 4
    np.savez(tmp_path / "fifth/0248626d9a.npz", whole[:4])
    assert "0248626d9a.npz: holds 4 frames; 3 are annotated, the last of them is number 20" in refused(
        capsys, tmp_path / "fifth", "--truth", tmp_path / "train"
    )


def test_long_sequences_have_the_right_decay_and_official_has_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frame = np.zeros((300, 8, 8), np.uint8)
    frame[:, 2:6, 2:6] = 1
    lost = frame.copy()
    lost[225:] = 0
    (tmp_path / "lost").mkdir()
    np.save(tmp_path / "lost/goat.npy", lost)
    save(tmp_path / "truth/goat", frame)
    options = (tmp_path / "lost", "--truth", tmp_path / "truth", "--protocol", "davis-2016", "--workers", 1)
    assert evaluated(capsys, *options)["methods"]["lost"]["mean"]["J_decay"] > 0.9
    assert evaluated(capsys, *options, "--official")["methods"]["lost"]["mean"]["J_decay"] is None


def test_motion_times_add_scores_of_the_frames_that_move(
    truth: Path, near: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    times = tmp_path / "times.csv"
    times.write_text("sequence,object,start,stop\ngoat,1,0,6\n")
    options = (near, "--truth", truth, "--motion-times", times)
    found = evaluated(capsys, *options, "--sequences", "goat")["methods"]["near"]["mean"]
    assert found["J_moving"] == pytest.approx(100 * 14 / 16)
    assert found["false_objects"] == 1
    assert "has no line for the sequence 'dog'" in refused(capsys, *options)
    assert "davis-2016 does not use them" in refused(capsys, *options, "--protocol", "davis-2016")
    times.write_text("sequence,object,start,stop\ngoat,7,0,6\n")
    assert "name the object 7" in refused(capsys, *options, "--sequences", "goat")


def test_points_are_scored_under_the_masks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    labels = volume()
    y, x = np.mgrid[2:38:3, 2:58:3].reshape(2, -1)
    points = np.stack([np.stack([x, y], 1)] * FRAMES, 1).astype(float)
    group = labels[0, y, x] + 1
    (tmp_path / "kt").mkdir()
    still = np.repeat(labels[:1], FRAMES, 0)
    np.savez(tmp_path / "kt/clip.npz", points=points, visible=np.ones(points.shape[:2], bool), label=group)
    save(tmp_path / "right/clip", 5 * still)
    save(tmp_path / "nothing/clip", 0 * still)
    found = evaluated(capsys, tmp_path / "right", tmp_path / "nothing", "--truth", tmp_path / "kt")
    assert found["protocol"] == "points"
    errors = [scores["mean"]["error"] for scores in found["methods"].values()]
    assert errors == [0, pytest.approx(100 * np.mean(group != 1))]
    (tmp_path / "right/clip/00000.png").unlink()
    assert "has 5 masks of 'clip', its tracks 6 frames" in refused(
        capsys, tmp_path / "right", "--truth", tmp_path / "kt"
    )
    message = refused(capsys, tmp_path / "right", "--truth", tmp_path / "kt", "--protocol", "moving")
    assert "--protocol points only" in message


def test_differences_have_an_interval_that_tells_noise_from_progress(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in range(6):
        save(tmp_path / f"truth/s{number}", volume())
        save(tmp_path / f"good/s{number}", volume(1))
        save(tmp_path / f"worse/s{number}", volume(3 + number % 2))
        save(tmp_path / f"mixed/s{number}", volume(1 + (-1) ** number))
    paths = [tmp_path / name for name in ("good", "worse", "mixed")]
    options = (*paths, "--truth", tmp_path / "truth", "--workers", 1)
    found = {(d["method"], d["base"], d["metric"]): d for d in evaluated(capsys, *options)["differences"]}
    worse, mixed = found["worse", "good", "Fu"], found["mixed", "good", "Fu"]
    assert worse["high"] < 0
    assert worse["clear"]
    assert not mixed["clear"]
    assert worse["low"] <= worse["difference"] <= worse["high"]
    assert mixed["low"] < 0 < mixed["high"]
    assert ("mixed", "worse", "J") in found
    assert list(found.values()) == evaluated(capsys, *options)["differences"]


def test_one_sequence_has_no_interval(truth: Path, near: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = (near, f"same={truth}/Annotations/480p", "--truth", truth, "--sequences", "goat")
    differences = evaluated(capsys, *options)["differences"]
    assert differences
    assert all(d["low"] is None and d["difference"] >= 0 for d in differences)


def test_few_sequences_make_no_difference_clear(
    truth: Path, near: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = (near, f"same={truth}/Annotations/480p", "--truth", truth)
    found = {d["metric"]: d for d in evaluated(capsys, *options)["differences"]}
    assert found["Fu"]["low"] > 0
    assert not found["Fu"]["clear"]
    assert main(["evaluate", *map(str, options)]) == 0
    assert "too few sequences" in capsys.readouterr().out


def test_published_figures_stand_beside_and_are_marked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in sequence_lists()["ytvos-moving-val"]:
        write(tmp_path / "YTVOS/train/Annotations" / name / "00000.png", np.eye(8))
    same = f"same={tmp_path}/YTVOS/train/Annotations"
    options = (same, "--truth", tmp_path / "YTVOS", "--workers", 1)
    rows = evaluated(capsys, *options)["published"]
    assert [(r["method"], r["labels"], r["Pu"], r["Ru"], r["Fu"]) for r in rows] == [
        (r.method, r.labels, *r.values) for r in published_rows() if r.benchmark == "ytvos-moving-val"
    ]
    assert {row["sequences"] for row in rows} == {"ytvos-moving-val, all 101 sequences"}
    assert main(["evaluate", *map(str, options)]) == 0
    assert "published, not computed here" in capsys.readouterr().out


def test_published_figures_are_those_of_the_protocol_and_of_the_whole_list(
    truth: Path, near: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two sequences of a list are scored: what others reach on all of it says so, in the unit of the board."""
    found = {}
    for protocol in ("moving", "davis-2016", "davis-2017"):
        options = (near, "--truth", truth, "--protocol", protocol)
        found[protocol] = evaluated(capsys, *options)["published"]
        for kind in ("text", "markdown", "latex", "csv"):
            assert main(["evaluate", *map(str, options), "--format", kind]) == 0
            told = capsys.readouterr().out
            assert ("published, not computed here" in told) == (kind != "csv" and protocol != "davis-2017")
    assert found["davis-2017"] == []
    assert {row["sequences"] for row in found["moving"]} == {
        "davis-moving-val, all 22 sequences; scored here: 2 of them"
    }
    one = found["davis-2016"][0]
    assert (one["method"], one["J"], one["F"]) == ("ARP", 0.762, 0.706)
    assert one["sequences"] == "davis-2016-val, all 20 sequences; scored here: 2 of them"
    options = (near, "--truth", truth, "--sequences", "davis-moving-train")
    assert main(["evaluate", *map(str, options)]) == 2, "a list that the dataset does not have"


def test_every_format_holds_the_numbers_and_the_rules(
    truth: Path, near: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = (near, f"a_b={truth}/Annotations/480p", "--truth", truth)
    fu = evaluated(capsys, *options)["methods"]["near"]["sequences"]["goat"]["Fu"]
    for kind in ("text", "csv", "markdown", "latex"):
        path = tmp_path / "scores"
        assert main(["evaluate", *map(str, options), "--format", kind, "-o", str(path)]) == 0
        text = path.read_text()
        assert capsys.readouterr().out == ""
        for told in (
            "moving",
            "every annotated frame",
            "none, 255 is a label like any other",
            f"{fu:.2f}"[:-1],
        ):
            assert told in text, (kind, told)
    main(["evaluate", *map(str, options), "--format", "csv"])
    lines = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert [(line["method"], line["sequence"]) for line in lines[:3]] == [
        ("near", "dog"),
        ("near", "goat"),
        ("near", "mean"),
    ]
    assert float(lines[1]["Fu"]) == fu
    assert "cannot be written" in refused(capsys, *options, "-o", tmp_path / "nowhere/scores")
    assert "cannot be written" in refused(capsys, *options, "-o", tmp_path)


def test_latex_and_markdown_escape_names(truth: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["evaluate", f"a_b|c={truth}/Annotations/480p", "--truth", str(truth), "--format"]
    main([*options, "latex"])
    assert r"Fu\_binary & Pu\_binary" in capsys.readouterr().out
    main([*options, "markdown"])
    assert "| dog | 100.00 |" in capsys.readouterr().out


def test_names_are_the_shortest_unique_ends(
    truth: Path, near: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other/near").symlink_to(near)
    save(tmp_path / "copy/near/goat", volume())
    save(tmp_path / "copy/near/dog", volume())
    found = evaluated(capsys, near, tmp_path / "copy/near", "--truth", truth)
    assert list(found["methods"]) == [f"{tmp_path.name}/near", "copy/near"]
    message = refused(capsys, f"a={near}", f"a={tmp_path}/copy/near", "--truth", truth)
    assert "two predictions are called 'a'" in message


def bad(kind: str, folder: Path) -> None:
    """Damage the masks of goat."""
    goat = folder / "goat"
    if kind == "size":
        write(goat / "00003.png", np.zeros((20, 30)))
    elif kind == "missing":
        (goat / "00003.png").unlink()
    elif kind == "names":
        for path in list(goat.iterdir()):
            path.rename(goat / f"frame_{path.name}")
    elif kind == "sequence":
        for path in list(goat.iterdir()):
            path.unlink()
    elif kind == "colour":
        write(goat / "00003.png", np.random.default_rng(0).integers(0, 9, (*SIZE, 3)))
    elif kind == "damaged":
        (goat / "00003.png").write_bytes((goat / "00003.png").read_bytes()[:60])
    elif kind == "0/255":
        save(goat, 255 * (volume() > 0))
    elif kind == "ids":
        save(goat, volume() * 9)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("size", "goat/00003.png: is 30 x 20, the annotation 60 x 40"),
        ("missing", "goat: has no mask of the annotated frame 00003; its 5 masks are called 00000 to 00005"),
        ("names", "goat: has no mask of the annotated frame 00001; its 6 masks are called frame_00000"),
        ("sequence", "near: has no masks of the sequence 'goat'"),
        ("colour", "goat/00003.png: is a colour image"),
        ("damaged", "goat/00003.png: cannot be read as an image"),
        ("0/255", "goat/00001.png: is a 0/255 mask, which this protocol reads as object 255"),
        ("ids", "goat/00001.png: has the id 18, but the highest id of the truth is 2"),
    ],
)
def test_masks_that_cannot_be_scored_are_named(
    truth: Path, near: Path, capsys: pytest.CaptureFixture[str], kind: str, message: str
) -> None:
    bad(kind, near)
    assert message in refused(capsys, near, "--truth", truth, "--protocol", "davis-2017")


def test_arrays_that_cannot_be_scored_are_named(
    truth: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "arrays" / "goat.npz"
    path.parent.mkdir()
    options = (path.parent, "--truth", truth, "--sequences", "goat")
    np.savez(path, a=volume(), b=volume())
    assert "goat.npz: holds a, b; give one array" in refused(capsys, *options)
    np.savez(path, volume()[0])
    assert "goat.npz: expected numbers (frames, height, width)" in refused(capsys, *options)
    np.savez(path, volume() + 0.5)
    assert "goat.npz, frame 0: holds values that are no whole numbers" in refused(capsys, *options)
    np.savez(path, volume()[:, :20])
    assert "goat.npz, frame 0: is 60 x 20, the annotation 60 x 40" in refused(capsys, *options)
    path.write_bytes(path.read_bytes()[:-300])
    assert "goat.npz: cannot be read" in refused(capsys, *options)
    path.unlink()
    np.save(path.with_suffix(".npy"), volume())
    path.with_suffix(".npy").write_bytes(path.with_suffix(".npy").read_bytes()[:5000])
    assert "goat.npy: cannot be read" in refused(capsys, *options)


def test_truth_that_does_not_hold_together_is_named(
    truth: Path, near: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(truth / "Annotations/480p/goat/00004.png", np.zeros((20, 30)))
    assert "480p/goat/00004.png: is 30 x 20, the frames before it 60 x 40" in refused(
        capsys, near, "--truth", truth
    )
    for number in range(2, FRAMES):
        (truth / f"Annotations/480p/dog/{number:05d}.png").unlink()
    message = refused(capsys, near, "--truth", truth, "--protocol", "davis-2016", "--sequences", "dog")
    assert "dog: has 2 annotated frames" in message


def test_predictions_that_are_no_folder_of_masks_are_refused(
    truth: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    assert "empty: is empty" in refused(capsys, tmp_path / "empty", "--truth", truth)
    assert "gone: is no folder of masks and no store" in refused(capsys, tmp_path / "gone", "--truth", truth)


def test_the_command_offers_what_there_is(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["evaluate", "--help"])
    told = capsys.readouterr().out
    assert all(name in told for name in (*PROTOCOLS, *REPORTS))


def test_golden_scores_come_out_of_the_command(davis: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = ("car-shadow", "scooter-black")
    path = SHARED / "golden/davis-osvos/masks"
    options = ("--truth", davis, "--protocol", "davis-2016", "--workers", 1)
    found = evaluated(capsys, path, *options, "--sequences", ",".join(names))["methods"]["masks"]
    with (path.parent / "per_sequence.csv").open(newline="") as file:
        golden = {row["sequence"]: row for row in csv.DictReader(file)}
    for name in names:
        for metric in ("J", "F"):
            assert math.isclose(
                found["sequences"][name][metric], float(golden[name][f"{metric}_mean"]), abs_tol=1e-9
            )
            for part in ("recall", "decay"):
                expected = float(golden[name][f"{metric}_{part}"])
                assert math.isclose(found["sequences"][name][f"{metric}_{part}"], expected, abs_tol=1e-9)
