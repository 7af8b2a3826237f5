"""One system of ids: what anything calls object 3 is the same thing, whatever pieces it was proposed in."""

from __future__ import annotations

import csv
import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from conftest import draw_clip, write_folder
from PIL import Image
from runs import masks, segment

from zsmoseg.grouping.numbering import carried_instances, connected
from zsmoseg.workflows.cli import main
from zsmoseg.workflows.result import Result, open_store


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A disc proposed in three pieces, the middle one the largest, beside things that stand still."""
    root = tmp_path_factory.mktemp("pieces")
    images, truth = draw_clip(frames=6)
    write_folder(root / "disc", images)
    for t, disc in enumerate(truth):
        label = np.zeros(disc.shape, np.uint8)
        label[8:28, 8:28], label[90:112, 120:150] = 4, 6
        thirds = np.digitize(np.arange(disc.shape[1]), np.flatnonzero(disc.any(0))[[8, 28]])
        label[disc] = np.array([2, 9, 11], np.uint8)[thirds][np.nonzero(disc)[1]]
        path = root / "proposed" / "disc" / f"{t:05d}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(label).save(path)
    segment(root / "disc", root, {"proposals.path": str(root / "proposed")})
    return root


@pytest.fixture(scope="module")
def result(root: Path) -> Result:
    return open_store(root / "store")["disc"]


@pytest.fixture(scope="module")
def pixels(root: Path) -> dict[int, int]:
    """Of every object in ``objects/``."""
    number, count = np.unique(masks(root / "out" / "disc", "objects"), return_counts=True)
    return {int(n): int(c) for n, c in zip(number, count, strict=True) if n}


def test_the_clip_has_an_object_of_three_pieces_with_the_number_of_the_largest(result: Result) -> None:
    table, pieces = result.objects.set_index("object"), result.pieces.set_index("piece")
    mover = int(table.index[table.group == 1][0])
    joined = pieces[pieces.object == mover]
    assert len(joined) == 3
    assert joined.area.idxmax() == mover != joined.index.min()
    assert sorted(joined.origin) == [2, 9, 11]
    assert sorted(table.pieces[mover]) == sorted(joined.index)
    assert sorted(pieces.origin[table.index[(table.group == 0) & (table.index > 0)]]) == [4, 6]


def test_the_images_the_table_and_the_masks_of_python_agree(result: Result, pixels: dict[int, int]) -> None:
    table = result.objects.set_index("object")
    moving = table[table.group > 0]
    assert moving.area.to_dict() == pixels
    painted = result.masks("instance").values
    assert {int(n): int((painted == n).sum()) for n in np.unique(painted) if n} == pixels
    assert moving.frames.to_dict() == dict.fromkeys(pixels, 6)


def test_the_summary_agrees_and_lists_what_was_joined(
    root: Path, result: Result, pixels: dict[int, int]
) -> None:
    summary = json.loads((root / "out" / "disc" / "summary.json").read_text())
    table = result.objects.set_index("object")
    told = {e["object"]: e for e in summary["evidence"]}
    assert told.keys() == set(table.index) - {0}
    assert summary["objects"] == len(told) == 3
    assert {n: e["pixels"] for n, e in told.items() if e["group"]} == pixels
    for number, entry in told.items():
        assert [number, *(piece["piece"] for piece in entry["joined"])] == list(table.pieces[number])
        assert entry["frames_moving"] == table.frames_moving[number]


def test_motion_csv_agrees(root: Path, result: Result) -> None:
    rows = list(csv.DictReader((root / "out" / "disc" / "motion.csv").read_text().splitlines()))
    pieces = result.pieces.set_index("piece")
    assert {(int(row["piece"]), int(row["object"])) for row in rows} == {
        (n, of) for n, of in pieces.object.items() if n
    }
    counted = Counter(int(row["piece"]) for row in rows if row["moving"] == "1")
    assert counted == Counter({n: f for n, f in pieces.frames_moving.items() if f})


@pytest.mark.parametrize("what", ["instance", "object"])
def test_exports_agree(root: Path, result: Result, pixels: dict[int, int], what: str, tmp_path: Path) -> None:
    store = ["--store", str(root / "store"), "-o", str(tmp_path)]
    assert main(["export", "disc", *store, "--format", "coco", "--what", what]) == 0
    found: Counter[int] = Counter()
    for annotation in json.loads((tmp_path / "disc.json").read_text())["annotations"]:
        found[annotation["track_id"]] += annotation["area"]
    area = {n: a for n, a in result.objects.set_index("object").area.items() if n}
    assert found == Counter(pixels if what == "instance" else area)


def test_explain_agrees_and_lists_what_was_joined(
    root: Path, result: Result, capsys: pytest.CaptureFixture[str]
) -> None:
    def told(*more: str) -> list[str]:
        assert main(["explain", "disc", "--store", str(root / "store"), *more]) == 0
        return capsys.readouterr().out.splitlines()

    table = result.objects.set_index("object")
    lines = told()
    assert [line.split(":")[0] for line in lines if not line.startswith(" ")] == [
        f"object {n}" for n in table.index if n
    ]
    mover = int(table.index[table.group == 1][0])
    assert f"group 1, pieces {', '.join(map(str, table.pieces[mover]))}" in told("--object", str(mover))[0]
    for piece in table.pieces[mover]:
        assert any(line.startswith(f"  piece {piece} of object {mover}: ") for line in lines)
    assert told("--object", str(table.pieces[mover][1]))[0].startswith(
        f"piece {table.pieces[mover][1]} of object {mover}: "
    )


# ------------------------------------------------------------------------ numbers
def test_an_instance_has_the_number_of_its_largest_object() -> None:
    group = np.array([0, 1, 1, 0, 1, 2])
    near = np.zeros((6, 6), np.bool_)
    near[1, 2] = near[2, 1] = near[4, 5] = near[5, 4] = near[0, 1] = near[3, 4] = True
    support = np.array([0.0, 5.0, 9.0, 50.0, 3.0, 4.0])
    assert connected(group, near, support).tolist() == [0, 2, 2, 0, 4, 5]
    assert connected(group[:1], near[:1, :1], support[:1]).tolist() == [0]


@pytest.mark.parametrize("seed", range(30))
def test_whatever_windows_say_an_instance_is_called_by_an_object_in_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    instance = np.zeros(12, np.int64)
    for _ in range(5):
        objects = np.concatenate([[0], 1 + np.sort(rng.choice(11, int(rng.integers(1, 9)), replace=False))])
        group = np.append(0, rng.integers(0, 3, len(objects) - 1))
        near = rng.random((len(objects), len(objects))) < 0.3
        weight = rng.integers(1, 9, len(objects)).astype(np.float64)
        local = connected(group, near | near.T, weight)
        named = carried_instances(local, instance[objects], weight, objects)
        new = (instance[objects] == 0) & (local > 0)
        instance[objects[new]] = named[new]
        called = np.flatnonzero(instance)
        np.testing.assert_array_equal(instance[instance[called]], instance[called])
