"""Datasets: recognised by layout, checked, with the published lists."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import SHARED
from PIL import Image
from scipy.io import savemat

from zsmoseg.datasets import Points, Truth, open_dataset, point_tracks, select
from zsmoseg.datasets.motion_times import read_motion_times
from zsmoseg.datasets.point_tracks import read_tracks
from zsmoseg.datasets.published import published_rows, sequence_lists
from zsmoseg.errors import DatasetError, FormatError
from zsmoseg.metrics.protocols import PROTOCOLS

MASK = np.kron(np.array([[0, 1], [2, 0]], np.uint8), np.ones((4, 5), np.uint8))


def write(path: Path, values: np.ndarray = MASK) -> Path:
    """An image, its folders made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(values).save(path)
    return path


def sequence(folder: Path, frames: int = 3, values: np.ndarray = MASK, suffix: str = ".png") -> Path:
    for number in range(frames):
        write(folder / f"{number:05d}{suffix}", values)
    return folder


def test_published_lists_have_the_published_lengths() -> None:
    lengths = {name: len(set(names)) for name, names in sequence_lists().items()}
    assert lengths == {
        "davis-2016-val": 20,
        "davis-2017-val": 30,
        "davis-moving-train": 30,
        "davis-moving-val": 22,
        "fbms-59-test": 30,
        "fbms-59-train": 29,
        "kt3dmoseg": 22,
        "segtrack-v2": 14,
        "ytvos-moving-train": 396,
        "ytvos-moving-val": 101,
    }
    assert set(sequence_lists()["davis-2016-val"]) < set(sequence_lists()["davis-2017-val"])


def test_published_figures_are_of_published_lists() -> None:
    assert published_rows()
    for row in published_rows():
        protocol = PROTOCOLS[row.protocol]
        assert row.benchmark in protocol.lists.values()
        assert row.labels in ("multi", "binary")
        assert len(row.values) == len(protocol.published)
        assert all(1 < value < 100 for value in row.values), "percent"
        assert row.training
        assert row.source
    about = [(row.benchmark, row.labels, row.method) for row in published_rows()]
    assert len(set(about)) == len(about)


def test_every_protocol_that_names_published_numbers_has_some() -> None:
    told = {row.protocol for row in published_rows()}
    assert told == {name for name, protocol in PROTOCOLS.items() if protocol.published}


def test_the_table_of_methods_without_learning_is_that_of_the_board() -> None:
    text = (Path(__file__).parents[1] / "docs" / "results.md").read_text()
    table = text.split("## Beside the board of DAVIS 2016")[1].split("\n## ")[0]
    rows = [line.strip("| ").split(" | ") for line in table.splitlines() if line.startswith("| ")]
    told = [row for row in rows if row[0] not in ("method", "---") and "zsmoseg" not in row[0]]
    board = [
        row for row in published_rows() if row.protocol == "davis-2016" and row.training == "no learning"
    ]
    assert told == [[row.method, *(f"{value:.1f}" for value in row.values)] for row in board]
    (ours,) = (row for row in rows if "zsmoseg" in row[0])
    assert f"| **mean of twelve** | **{ours[1].strip('*')}** |" in text
    assert "twelve of its twenty" in ours[0]


@pytest.mark.parametrize("inner", ["", "Annotations", "Annotations/480p"])
def test_davis_is_recognised_at_its_root_and_at_its_annotations(tmp_path: Path, inner: str) -> None:
    sequence(tmp_path / "Annotations/480p/goat")
    sequence(tmp_path / "JPEGImages/480p/goat", suffix=".jpg")
    dataset = open_dataset(tmp_path / inner)
    truth = dataset.truth("goat")
    assert dataset.name == "DAVIS"
    assert isinstance(truth, Truth)
    assert (truth.frames, truth.numbers, truth.note) == (("00000", "00001", "00002"), (0, 1, 2), "")
    assert np.array_equal(truth.labels(1), MASK)


def test_davis_unsupervised_has_annotations_of_its_own(tmp_path: Path) -> None:
    sequence(tmp_path / "Annotations/480p/goat")
    sequence(tmp_path / "Annotations_unsupervised/480p/goat", 5)
    for protocol, frames in (("davis-2017", 3), ("davis-2017-unsupervised", 5)):
        truth = open_dataset(tmp_path, protocol).truth("goat")
        assert isinstance(truth, Truth)
        assert len(truth.frames) == frames


@pytest.mark.parametrize("root", ["train/Annotations", "Annotations", "."])
def test_youtube_vos_is_recognised_with_its_frame_numbers(tmp_path: Path, root: str) -> None:
    for number in (5, 10, 15):
        write(tmp_path / root / "0248626d9a" / f"{number:05d}.png")
    dataset = open_dataset(tmp_path)
    truth = dataset.truth("0248626d9a")
    assert dataset.name == "YouTube-VOS"
    assert isinstance(truth, Truth)
    assert truth.numbers == (5, 10, 15)


def test_frames_without_annotation_are_noted_and_annotations_without_frame_refused(tmp_path: Path) -> None:
    folder = sequence(tmp_path / "Annotations/480p/goat")
    sequence(tmp_path / "JPEGImages/480p/goat", 5, suffix=".jpg")
    truth = open_dataset(tmp_path).truth("goat")
    assert isinstance(truth, Truth)
    assert truth.note == "not every frame is annotated"
    write(folder / "00007.png")
    with pytest.raises(DatasetError, match=r"goat/00007\.png: annotates a frame that is not in .*JPEGImages"):
        open_dataset(tmp_path).truth("goat")


def test_segtrack_objects_in_folders_become_ids(tmp_path: Path) -> None:
    sequence(tmp_path / "JPEGImages/cheetah")
    for number in (1, 2):
        sequence(tmp_path / f"GroundTruth/cheetah/{number}", values=(number == MASK).astype(np.uint8) * 255)
    sequence(tmp_path / "JPEGImages/worm")
    sequence(tmp_path / "GroundTruth/worm", values=(MASK > 0).astype(np.uint8) * 255)
    dataset = open_dataset(tmp_path)
    cheetah, worm = dataset.truth("cheetah"), dataset.truth("worm")
    assert dataset.name == "SegTrack v2"
    assert isinstance(cheetah, Truth)
    assert isinstance(worm, Truth)
    assert np.array_equal(cheetah.labels(0), MASK)
    assert np.unique(worm.labels(0)).tolist() == [0, 255]
    (tmp_path / "GroundTruth/cheetah/2/00001.png").unlink()
    with pytest.raises(DatasetError, match="frame 00001 is not annotated for every object of cheetah"):
        dataset.truth("cheetah")


def fbms(
    folder: Path, colours: tuple[int, ...] = (0, 8388608, 65280), frames: tuple[int, ...] = (0, 19)
) -> Path:
    """One FBMS sequence; region 1 is dark red, region 2 green."""
    lines = [
        "Ground truth definition file; do not change!",
        "",
        "Total number of regions:",
        str(len(colours)),
    ]
    for number, colour in enumerate(colours):
        lines += [f"Scale of region {number}:", str(colour)]
    lines += ["", "Confusion penality matrix:", "0 1 1", "", "Total number of frames in this shot:", "20"]
    lines += ["Total number of labeled frames for this shot:", str(len(frames))]
    rgb = np.zeros((*MASK.shape, 3), np.uint8)
    rgb[MASK == 1], rgb[MASK == 2] = (128, 0, 0), (0, 255, 0)
    for number in frames:
        name = f"cars1_{number:04d}"
        lines += ["Frame number:", str(number), "File name:", f"{name}_gt.ppm"]
        lines += ["Input file name:", f"{name}.jpg"]
        write(folder / "GroundTruth" / f"{name}_gt.ppm", rgb)
    (folder / "GroundTruth" / "Cars1Def.dat").write_text("\n".join(lines))
    return folder


def test_fbms_colours_become_regions_and_unknown_colours_background(tmp_path: Path) -> None:
    fbms(tmp_path / "Testset/cars1")
    fbms(tmp_path / "Trainingset/bear01", colours=(0, 65280))
    dataset = open_dataset(tmp_path)
    cars, bear = dataset.truth("cars1"), dataset.truth("bear01")
    assert dataset.name == "FBMS-59"
    assert isinstance(cars, Truth)
    assert isinstance(bear, Truth)
    assert (cars.frames, cars.numbers) == (("cars1_0000", "cars1_0019"), (0, 19))
    assert np.array_equal(cars.labels(1), MASK)
    assert np.array_equal(bear.labels(0), (MASK == 2).astype(int))
    assert cars.weights(0) is None


def test_fbms_probabilities_are_read_where_they_are(tmp_path: Path) -> None:
    folder = fbms(tmp_path / "cars1")
    write(folder / "GroundTruth/cars1_0019_gt.pgm", np.full(MASK.shape, 51, np.uint8))
    truth = open_dataset(tmp_path).truth("cars1")
    assert isinstance(truth, Truth)
    weights = truth.weights(1)
    assert weights is not None
    assert np.allclose(weights, 0.2)


def test_fbms_definition_files_that_do_not_fit_are_named(tmp_path: Path) -> None:
    folder = fbms(tmp_path / "cars1")
    definition = folder / "GroundTruth/Cars1Def.dat"
    text = definition.read_text()
    definition.write_text(text.replace("this shot:\n2", "this shot:\n3"))
    with pytest.raises(DatasetError, match=r"Cars1Def\.dat: announces 3 labelled frames, lists 2"):
        open_dataset(tmp_path).truth("cars1")
    definition.write_text(text.replace("Frame number:\n19", "Frame number:\nlast"))
    with pytest.raises(DatasetError, match=r"Cars1Def\.dat: 'last' after 'Frame number:' is no whole number"):
        open_dataset(tmp_path).truth("cars1")
    definition.write_text(text.replace("cars1_0019_gt.ppm", "../../elsewhere/cars1_0019_gt.ppm"))
    assert open_dataset(tmp_path).truth("cars1")
    (folder / "GroundTruth/cars1_0019_gt.ppm").unlink()
    with pytest.raises(DatasetError, match=r"cars1_0019_gt\.ppm: is missing; Cars1Def\.dat lists it"):
        open_dataset(tmp_path).truth("cars1")


def test_point_tracks_are_read_from_npz_and_from_the_original_mat(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(0, 9, (6, 4, 2)).astype(np.float32)
    visible, label = rng.integers(0, 2, (6, 4)).astype(bool), np.array([1, 1, 2, 2, 3, 3], np.uint8)
    np.savez(tmp_path / "Seq005_Clip01.npz", points=points, visible=visible, label=label)
    homogeneous = np.concatenate([points.transpose(2, 0, 1), np.ones((1, 6, 4), np.float32)])
    data = {"ySparse": homogeneous, "visibleSparse": visible.astype(float), "GtLabel": label[:, None]}
    savemat(tmp_path / "Seq009_Clip01.mat", {"Data": data})
    dataset = open_dataset(tmp_path)
    assert dataset.name == "KT3DMoSeg"
    for name in ("Seq005_Clip01", "Seq009_Clip01"):
        truth = dataset.truth(name)
        assert isinstance(truth, Points)
        tracks = read_tracks(truth.path)
        assert np.array_equal(tracks.points, points)
        assert np.array_equal(tracks.visible, visible)
        assert np.array_equal(tracks.label, label)


@pytest.mark.parametrize(
    "content",
    [b"", b"MATLAB 5.0 MAT-file" + bytes(200), b"x" * 4096],
    ids=["empty", "cut off", "something else"],
)
def test_a_damaged_mat_is_named(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "clip.mat").write_bytes(content)
    with pytest.raises(DatasetError, match=r"clip\.mat: cannot be read as point tracks \("):
        read_tracks(tmp_path / "clip.mat")


def test_a_mat_that_ends_its_reader_ends_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(point_tracks, "_READER", "import os; os.abort()")
    (tmp_path / "clip.mat").write_bytes(b"MATLAB")
    with pytest.raises(DatasetError, match=r"clip\.mat: cannot be read .*its reader died"):
        read_tracks(tmp_path / "clip.mat")


def test_point_tracks_that_do_not_fit_are_named(tmp_path: Path) -> None:
    path = tmp_path / "clip.npz"
    np.savez(path, points=np.zeros((6, 4, 2)), visible=np.zeros((6, 3)), label=np.zeros(6))
    with pytest.raises(DatasetError, match=r"clip\.npz: points \(6, 4, 2\), visible \(6, 3\)"):
        read_tracks(path)
    path.write_bytes(b"PK")
    with pytest.raises(DatasetError, match=r"clip\.npz: cannot be read as point tracks"):
        read_tracks(path)


def test_shared_datasets_are_recognised(davis: Path) -> None:
    found = {name: open_dataset(SHARED / name) for name in ("kt3dmoseg", "hopkins155", "proposals/rvos")}
    assert [(d.name, len(d.places)) for d in found.values()] == [
        ("KT3DMoSeg", 11),
        ("point tracks", 80),
        ("DAVIS", 12),
    ]
    assert open_dataset(davis).name == "DAVIS"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda p: None, "is no folder"),
        (lambda p: p.mkdir(), "is empty"),
        (lambda p: write(p / "notes.jpg"), "has no layout that is known"),
        (lambda p: write(p / "00000.png"), "holds masks itself; give the folder above it"),
    ],
)
def test_folders_that_are_no_dataset_are_refused(tmp_path: Path, make: object, message: str) -> None:
    make(tmp_path / "truth")  # type: ignore[operator]
    with pytest.raises(DatasetError, match=f"truth: {message}"):
        open_dataset(tmp_path / "truth")


def test_names_of_annotations_must_tell_the_frame(tmp_path: Path) -> None:
    write(tmp_path / "goat/first.png")
    with pytest.raises(DatasetError, match="goat/first: has no frame number in its name"):
        open_dataset(tmp_path).truth("goat")
    write(tmp_path / "goat/1.png")
    write(tmp_path / "goat/01.png")
    (tmp_path / "goat/first.png").unlink()
    with pytest.raises(DatasetError, match="goat/1: has the same frame number as the file before it"):
        open_dataset(tmp_path).truth("goat")


def test_colour_and_damaged_annotations_are_refused_and_grey_in_colour_files_read(tmp_path: Path) -> None:
    write(tmp_path / "goat/00000.png", np.dstack([MASK, MASK, MASK, np.full_like(MASK, 255)]))
    write(tmp_path / "goat/00001.png", np.dstack([MASK, MASK * 0, MASK]))
    (tmp_path / "goat/00002.png").write_bytes(b"\x89PNG")
    truth = open_dataset(tmp_path).truth("goat")
    assert isinstance(truth, Truth)
    assert np.array_equal(truth.labels(0), MASK)
    with pytest.raises(DatasetError, match=r"00001\.png: is a colour image"):
        truth.labels(1)
    with pytest.raises(DatasetError, match=r"00002\.png: cannot be read as an image"):
        truth.labels(2)


def test_the_list_of_the_protocol_is_scored_where_the_dataset_holds_it(tmp_path: Path) -> None:
    for name in (*sequence_lists()["davis-2016-val"], "bear"):
        sequence(tmp_path / name, 1)
    dataset = open_dataset(tmp_path)
    assert select(dataset, None, "davis-2016").benchmark == "davis-2016-val"
    assert len(select(dataset, None, "moving").names) == 21
    assert len(select(dataset, ["all"], "davis-2016").names) == 21
    assert select(dataset, ["bear", "goat"], "davis-2016").names == ("bear", "goat")
    with pytest.raises(DatasetError, match=r"has no sequence '\.\./goat'"):
        select(dataset, ["../goat"], "davis-2016")
    with pytest.raises(DatasetError, match="has no sequence 'bike-packing'"):
        select(dataset, ["davis-moving-val"], "moving")


def test_motion_times_are_read_and_checked(tmp_path: Path) -> None:
    path = tmp_path / "times.csv"
    path.write_text("sequence,object,start,stop\ngoat,1,0,5\ngoat,1,9,12\ngoat,2,3,4\n")
    assert read_motion_times(path) == {"goat": {1: [(0, 5), (9, 12)], 2: [(3, 4)]}}
    for line, message in (
        ("goat,1,5,5", "start 5 is not before stop 5"),
        ("goat,one,2,3", "three whole numbers"),
    ):
        path.write_text(f"sequence,object,start,stop\n{line}\n")
        with pytest.raises(FormatError, match=f"times.csv, line 2: .*{message}"):
            read_motion_times(path)
    path.write_text("goat,1,0,5\n")
    with pytest.raises(FormatError, match="the first line must be sequence,object,start,stop"):
        read_motion_times(path)
