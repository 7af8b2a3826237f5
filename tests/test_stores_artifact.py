"""Artifacts: what is written is read, whatever the layout; nothing counts before its record does."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from stores_help import (
    DESCRIPTION,
    SIZE,
    Everything,
    begin_with,
    block_of,
    content,
    cut,
    data_files,
    lay_out,
    make_artifact,
    make_store,
    put_blocks,
    record_path,
    seal_it,
    specs,
    times,
    write_part,
)

from zsmoseg.errors import StoreError
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.beginning import plan_of
from zsmoseg.stores.checks import check, part_problem
from zsmoseg.stores.dataset import open_dataset
from zsmoseg.stores.fields import fields_of, table
from zsmoseg.stores.fixedpoint import decode, encode
from zsmoseg.stores.location import Store
from zsmoseg.stores.packing import pack, unpack
from zsmoseg.stores.reader import read_video
from zsmoseg.stores.schema import ArraySpec
from zsmoseg.stores.sealing import seal
from zsmoseg.stores.writer import PartWriter

relaxed = settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return make_store(tmp_path)


@relaxed
@given(frames=st.integers(2, 12), length=st.integers(1, 13), data=st.data())
def test_any_range_reads_as_it_was_written_whatever_the_layout(
    frames: int, length: int, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    artifact = make_artifact(make_store(tmp_path_factory.mktemp("layout")), "k", frames, length)
    for name, whole in content(frames).items():
        start = data.draw(st.integers(0, len(whole)))
        stop = data.draw(st.integers(start, len(whole)))
        np.testing.assert_array_equal(read_video(artifact, name, start, stop), whole[start:stop])
    assert check(artifact, deep=True) == []


tables = hnp.arrays(
    st.sampled_from([np.bool_, np.uint8, np.int16, np.uint32, np.int64, np.float16, np.float32, np.float64]),
    hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
)


@settings(max_examples=100, deadline=None)
@given(values=tables)
def test_a_table_of_any_size_and_kind_is_unpacked_as_it_was_packed(values: np.ndarray) -> None:
    found = unpack(pack(values), values.dtype.name, values.shape)
    assert found.dtype == values.dtype
    np.testing.assert_array_equal(found, values)


@relaxed
@given(values=tables)
def test_zarr_reads_tables_as_they_were_written(
    values: np.ndarray, tmp_path_factory: pytest.TempPathFactory
) -> None:
    import zarr

    dims = [f"d{i}" for i in range(values.ndim)]

    @dataclass(frozen=True)
    class One(Arrays):
        t: np.ndarray = table(*dims, dtype=values.dtype.name, meaning="any")

    artifact = Artifact(tmp_path_factory.mktemp("table"))
    begin_with(artifact, [(0, 3)])
    put_blocks(artifact, 0, One(start=0, stop=3, t=values))
    seal(artifact, One, *times(3))
    found = zarr.open_group(artifact.path, mode="r")["t"]
    assert found.dtype == values.dtype
    np.testing.assert_array_equal(found[...], values)
    np.testing.assert_array_equal(One.read(artifact).t, values)


def test_tables_of_text_are_refused(store: Store) -> None:
    artifact = make_artifact(store)
    with pytest.raises(TypeError, match="state: expected int32"):
        put_blocks(artifact, 0, Everything(start=0, stop=4, state=np.array(["a", "b"])))
    with pytest.raises(TypeError, match="expected booleans"):
        pack(np.array(["a", "b"]))


@settings(max_examples=60, deadline=None)
@given(hnp.arrays(np.float32, 7, elements=st.floats(-600, 600, width=32) | st.just(np.nan)))
def test_fixed_point_errs_by_half_a_step_at_most_and_counts_what_it_clips(values: np.ndarray) -> None:
    attributes = {"scale_factor": 1 / 64, "_FillValue": -32768}
    stored, clipped = encode(values, attributes, np.dtype("int16"))
    found = decode(stored, attributes)
    outside = np.rint(np.abs(values) * 64) > 32767
    assert clipped == np.count_nonzero(outside)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(values))
    inside = ~np.isnan(values) & ~outside
    assert np.all(np.abs(found[inside] - values[inside]) <= 1 / 128)
    assert np.all(np.sign(found[outside]) == np.sign(values[outside]))


def test_the_record_counts_values_out_of_range(store: Store) -> None:
    artifact, whole = make_artifact(store), content(10)
    whole["forward"][1, 0, 2, 3] = 1000
    write_part(artifact, 0, whole)
    record = artifact.part(0)
    assert record is not None
    assert record.facts["clipped"] == {"forward": 1}
    assert read_video(artifact, "forward", 1, 2)[0, 0, 2, 3] == 32767 / 64


def test_raw_reads_what_is_stored(store: Store) -> None:
    raw = read_video(make_artifact(store), "forward", 0, 9, raw=True)
    assert raw.dtype == np.int16
    np.testing.assert_array_equal(raw, content(10)["forward"] * 64)


@pytest.mark.parametrize(
    ("name", "values", "error"),
    [
        ("label", np.zeros((4, *SIZE), np.int64), TypeError),
        ("label", np.zeros((3, *SIZE), np.uint16), ValueError),
        ("label", np.zeros((4, 7, 6), np.uint16), ValueError),
        ("forward", np.zeros((4, 2, *SIZE), np.int16), TypeError),
        ("state", np.zeros(4, np.int64), TypeError),
        ("residual", np.zeros((4, 2)), TypeError),
    ],
)
def test_arrays_of_wrong_type_or_shape_are_refused_by_name(
    name: str, values: np.ndarray, error: type[Exception], store: Store
) -> None:
    artifact, whole = make_artifact(store), content(10)
    with pytest.raises(error, match=name):
        put_blocks(artifact, 0, replace(block_of(artifact, 0, whole), **{name: values}))
    assert artifact.part(0) is None


def test_a_part_that_lacks_an_array_gets_no_record(store: Store) -> None:
    artifact = make_artifact(store)
    with pytest.raises(ValueError, match="lacks forward, label"):
        put_blocks(artifact, 0, Everything(start=0, stop=4, image=content(10)["image"][:4]))
    assert part_problem(artifact, 0) == "not computed yet"
    assert artifact.done is None


def test_reading_past_the_end_is_an_error(store: Store) -> None:
    with pytest.raises(ValueError, match="has 10 rows"):
        read_video(make_artifact(store), "label", 8, 11)


@dataclass(frozen=True)
class Ragged(Arrays):
    """Rows by frame, some ids, one number a block."""

    rows: np.ndarray = table("frame", dtype="int64", meaning="how many rows")
    value: np.ndarray = table("row", dtype="float32", meaning="a row")
    object: np.ndarray = table("object", dtype="int64", meaning="ids")
    group: np.ndarray = table("object", dtype="int64", meaning="of the object")
    seen: np.ndarray = table("object", dtype="int64", meaning="times", add=True)
    affinity: np.ndarray = table("object", "other", dtype="float64", meaning="of two objects")
    shot: np.ndarray = table("shot", dtype="int64", meaning="number")
    rank: np.ndarray = table("shot", "place", dtype="float64", meaning="as many as there are")
    of_pair: np.ndarray = table("pair", dtype="float64", meaning="of a pair")


def ragged(store: Store) -> Artifact:
    """Three blocks of one part, of 3, 4 and 3 frames; objects 0 and two of their own."""
    artifact = Artifact(store.path / "ragged")
    begin_with(artifact, [(0, 10)])
    with PartWriter(artifact, 0) as part:
        for k, (start, stop) in enumerate([(0, 3), (3, 7), (7, 10)]):
            ids = np.array([0, 2 * k + 1, 2 * k + 2])
            part.put(
                Ragged(
                    start=start,
                    stop=stop,
                    rows=np.arange(start, stop),
                    value=np.full(sum(range(start, stop)), k, np.float32),
                    object=ids,
                    group=ids * 10 + (ids == 0) * k,
                    seen=np.array([1, k, k]),
                    affinity=np.full((3, 3), k / 2),
                    shot=np.array([k]),
                    rank=np.arange(k + 1.0)[None],
                    of_pair=np.full(stop - start - 1, k / 2),
                )
            )
            assert artifact.part(0) is None
        part.facts = {"seconds": np.float32(1.5), "warnings": ["none"]}
    return artifact


def test_a_part_is_written_block_by_block_and_read_so(store: Store) -> None:
    artifact = ragged(store)
    found = list(Ragged.read(artifact).blocks())
    assert [(block.start, block.stop) for block in found] == [(0, 3), (3, 7), (7, 10)]
    assert [block.value.tolist() for block in found[:1]] == [[0.0] * 3]
    assert [block.start for block in Ragged.read(artifact, 4, 8).blocks()] == [3, 7]
    record = artifact.part(0)
    assert record is not None
    assert record.seconds == 1.5


def test_tables_are_joined_along_frames_over_the_union_of_objects_and_row_by_row(store: Store) -> None:
    artifact = ragged(store)
    seal(artifact, Ragged, *times(10))
    found = Ragged.read(artifact)
    assert found.rows.tolist() == list(range(10))
    assert found.value.tolist() == [0.0] * 3 + [1.0] * 18 + [2.0] * 24
    assert found.object.tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert found.group.tolist() == [0, 10, 20, 30, 40, 50, 60], "the first block that knows an object decides"
    assert found.seen.tolist() == [3, 0, 0, 1, 1, 2, 2], "what counts adds up"
    assert found.affinity[3, 4] == 0.5
    assert np.isnan(found.affinity[1, 3]), "objects of two blocks have nothing in common"
    np.testing.assert_array_equal(found.rank, [[0, np.nan, np.nan], [0, 1, np.nan], [0, 1, 2]])
    opened = open_dataset(artifact)
    for name in fields_of(Ragged):
        np.testing.assert_array_equal(opened[name].values, getattr(found, name), err_msg=name)
    assert float(opened["affinity"].sel(object=5, other=6)) == 1.0
    np.testing.assert_array_equal(found.of_pair, [0, 0, np.nan, 0.5, 0.5, 0.5, np.nan, 1, 1])
    part = found.of(2, 8)
    assert part.rows.tolist() == [2, 3, 4, 5, 6, 7]


def test_frames_that_no_block_knows_are_unknown(store: Store) -> None:
    @dataclass(frozen=True)
    class Sparse(Arrays):
        margin: np.ndarray = table("frame", dtype="float32", meaning="known in some frames")
        valid: np.ndarray = table("pair", dtype="bool", meaning="of shots: none at the cut")

    artifact = Artifact(store.path / "sparse")
    begin_with(artifact, [(0, 8)])
    blocks = [(0, 3), (5, 8)]
    put_blocks(
        artifact,
        0,
        *(
            Sparse(start=a, stop=b, margin=np.full(3, a, np.float32), valid=np.ones(2, bool))
            for a, b in blocks
        ),
    )
    found, nan = Sparse.read(artifact), np.nan
    np.testing.assert_array_equal(found.margin, [0, 0, 0, nan, nan, 5, 5, 5])
    assert found.valid.tolist() == [True, True, False, False, False, True, True]
    np.testing.assert_array_equal(found.of(2, 6).margin, [0, nan, nan, 5])
    assert found.of(4, 8).valid.tolist() == [False, True, True]


def test_only_what_is_used_is_read(store: Store) -> None:
    artifact = make_artifact(store)
    found = Everything.read(artifact, 3, 6)
    assert "label" not in found.__dict__
    np.testing.assert_array_equal(found.label, content(10)["label"][3:6])
    assert "label" in found.__dict__
    assert "image" not in found.__dict__
    with pytest.raises(AttributeError, match="no colour"):
        found.colour  # noqa: B018


def test_a_task_that_fails_leaves_no_record(store: Store) -> None:
    artifact = make_artifact(store)
    part = PartWriter(artifact, 0)
    part.put(Everything(start=0, stop=4, flags=np.zeros(3, bool)))
    with pytest.raises(ValueError, match="image"), part:
        part.put(Everything(start=0, stop=4, image=np.zeros(3, np.uint8)))
    assert artifact.part(0) is None
    assert artifact.done is None


def test_a_part_written_again_loses_what_it_had(store: Store) -> None:
    artifact = Artifact(store.path / "again")
    begin_with(artifact, [(0, 10)])
    put_blocks(artifact, 0, Ragged(start=0, stop=10, rows=np.arange(10), seen=np.zeros(0, np.int64)))
    put_blocks(artifact, 0, Ragged(start=0, stop=10, rows=np.ones(10, np.int64)))
    assert [list(block.tables) for block in artifact.blocks(0)] == [["rows"]]
    assert Ragged.read(artifact).seen is None
    assert Ragged.read(artifact).rows.sum() == 10


def test_an_artifact_keeps_the_layout_it_was_begun_with(store: Store) -> None:
    artifact = make_artifact(store, length=4)
    before = data_files(artifact)
    lay_out(artifact, length=3)
    assert artifact.parts == cut(10, 4)
    assert data_files(artifact) == before
    assert artifact.done is not None


@pytest.mark.parametrize("sealed", [True, False])
@pytest.mark.parametrize(("before", "after"), [(4, 3), (3, 4)])
def test_parts_of_another_cut_never_count_when_the_description_was_lost(
    before: int, after: int, sealed: bool, store: Store
) -> None:
    artifact = make_artifact(store, length=before, sealed=sealed)
    record_path(artifact, "artifact").unlink()
    lay_out(artifact, length=after)
    assert artifact.parts == cut(10, after)
    assert all(part_problem(artifact, part) for part in range(len(artifact.parts)))
    whole = content(10)
    for part in range(len(artifact.parts)):
        write_part(artifact, part, whole)
    np.testing.assert_array_equal(read_video(artifact, "label", 0, 10), whole["label"])
    seal_it(artifact)
    assert data_files(artifact) == data_files(make_artifact(store, "k9", length=after)), (
        "nothing is left over"
    )


def test_arrays_of_another_kind_start_the_artifact_anew(store: Store) -> None:
    artifact = make_artifact(store)
    begin_with(artifact, cut(10, 4), DESCRIPTION, specs(10)[:2])
    assert set(artifact.arrays) == {"image", "forward"}
    assert part_problem(artifact, 0) == "not computed yet"
    assert artifact.done is None


@pytest.mark.parametrize("parts", [[], [(1, 4)], [(0, 4), (5, 10)], [(0, 3), (3, 10)], [(0, 4), (4, 8)]])
def test_parts_that_do_not_tile_the_video_are_refused(parts: list[tuple[int, int]], store: Store) -> None:
    with pytest.raises(ValueError, match=r"parts|rows"):
        plan_of({}, parts, specs(10))


def test_the_same_input_gives_the_same_bytes_in_every_file(tmp_path: Path) -> None:
    first, second = (make_artifact(make_store(tmp_path / name)) for name in "ab")
    write_part(second, 1, content(10, seed=5))
    write_part(second, 1, content(10))
    assert not (second.path / "zarr.json").exists(), "what is not whole is not opened by mistake"
    seal_it(second)
    assert data_files(first) == data_files(second)
    assert len(data_files(first)) > 20


def test_two_settings_stand_side_by_side(store: Store) -> None:
    one, two = make_artifact(store, "k1", seed=1), make_artifact(store, "k2", length=3, seed=2)
    for artifact, seed in ((one, 1), (two, 2)):
        np.testing.assert_array_equal(read_video(artifact, "label", 0, 10), content(10, seed)["label"])
    described = two.sibling()
    assert described is not None
    assert described["key"] == "k1"


def test_sealing_needs_every_part(store: Store) -> None:
    artifact = make_artifact(store)
    artifact.invalidate([1])
    assert artifact.done is None
    with pytest.raises(StoreError, match="part 1: not computed yet"):
        seal_it(artifact)
    write_part(artifact, 1, content(10))
    seal(artifact, Everything, *times(10), {"seconds": 3})
    assert artifact.done is not None
    assert artifact.done["seconds"] == 3


@pytest.mark.parametrize("open_it", [lambda a: xr.open_zarr(a.path), open_dataset])
def test_a_sealed_artifact_opens_in_xarray_labelled_and_in_physical_units(
    open_it: Callable[[Artifact], Any], store: Store
) -> None:
    artifact = make_artifact(store)
    found = open_it(artifact)
    assert set(found.variables) >= set(fields_of(Everything))
    flow = found["forward"]
    assert flow.dims == ("pair", "component", "y", "x")
    assert flow.attrs["units"] == "px"
    np.testing.assert_array_equal(flow.sel(pair=slice(2, 5)), content(10)["forward"][2:6])
    assert found["label"].sel(frame=3).coords["name"] == "00003"
    assert float(found["time"][5]) == 0.2
    assert found["time"].attrs["units"] == "s"
    np.testing.assert_array_equal(found["label"], content(10)["label"])
    np.testing.assert_array_equal(found["state"], np.arange(9))
    residual = found["residual"]
    assert residual.dims == ("pair", "model", "object")
    assert residual.attrs["units"] == "px^2"
    assert float(residual.sel(pair=5, model=0, object=2)) == 6.0
    assert np.isnan(residual.sel(pair=5, model=0, object=1))
    assert found["area"].values.tolist() == [30, 1, 2, 3]
    assert list(flow["component"].values) == ["x", "y"]


def test_long_tables_lie_in_chunks_and_read_as_one(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zsmoseg.stores.joining.CHUNK", 40)
    artifact = ragged(store)
    seal(artifact, Ragged, *times(10))
    assert len(list((artifact.path / "value").glob("c.*"))) == 5
    found = xr.open_zarr(artifact.path)
    np.testing.assert_array_equal(found["value"].values, Ragged.read(artifact).value)
    np.testing.assert_array_equal(found["rows"].values, np.arange(10))


def test_an_unfinished_artifact_is_not_opened(store: Store) -> None:
    artifact = make_artifact(store)
    artifact.invalidate([2])
    with pytest.raises(StoreError, match="not computed yet"):
        open_dataset(artifact)


def test_arrays_use_only_codecs_of_the_zarr_specification(store: Store) -> None:
    def names(codecs: list[dict]) -> set[str]:
        inner = [names(c["configuration"]["codecs"]) for c in codecs if c["name"] == "sharding_indexed"]
        return {c["name"] for c in codecs}.union(*inner)

    artifact = make_artifact(store)
    for name, data in data_files(artifact).items():
        if name.endswith("zarr.json") and (described := json.loads(data))["node_type"] == "array":
            text = {"vlen-utf8"} if described["data_type"] == "string" else set()
            assert (
                names(described["codecs"]) <= {"bytes", "blosc", "zstd", "crc32c", "sharding_indexed"} | text
            )
            assert names(described["codecs"]) >= {"crc32c"}


@pytest.mark.parametrize("wrong", [{"dims": ("y", "x")}, {"name": "records"}, {"shape": (3,)}])
def test_a_spec_that_is_none_is_refused(wrong: dict) -> None:
    with pytest.raises(ValueError, match=r"dims|name"):
        ArraySpec(**{"name": "a", "dims": ("frame", "x"), "shape": (3, 4), "dtype": "uint8", **wrong})


def test_ids_may_stand_in_any_order(store: Store) -> None:
    artifact = Artifact(store.path / "order")
    begin_with(artifact, [(0, 4)])
    blocks = [((0, 2), [5, 1], [50, 10]), ((2, 4), [1, 5, 7], [1, 5, 7])]
    put_blocks(
        artifact,
        0,
        *(Ragged(start=a, stop=b, object=np.array(ids), seen=np.array(n)) for (a, b), ids, n in blocks),
    )
    assert Ragged.read(artifact).seen.tolist() == [11, 55, 7]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"start": 0, "stop": 9, "rows": np.zeros(9, np.int64)}, "frames 0 to 8 are not in part 0"),
        (
            {"start": 0, "stop": 4, "rows": np.zeros(5, np.int64)},
            "rows, part 0: expected 4 along frame, got 5",
        ),
        ({"start": 1, "stop": 4, "rows": np.zeros(2, np.int64)}, "expected 3 along frame, got 2"),
        ({"start": 0, "stop": 4, "of_pair": np.zeros(3)}, "of_pair, part 0: expected 4 along pair, got 3"),
        (
            {"start": 0, "stop": 4, "object": np.arange(3), "group": np.arange(2)},
            "group, part 0: expected 3 along object, got 2",
        ),
    ],
)
def test_a_block_whose_lengths_contradict_each_other_is_refused(
    wrong: dict[str, Any], words: str, store: Store
) -> None:
    artifact = Artifact(store.path / "lengths")
    begin_with(artifact, [(0, 4), (4, 8)])
    with pytest.raises(ValueError, match=words):
        put_blocks(artifact, 0, Ragged(**wrong))
    assert artifact.part(0) is None


def test_plain_rows_are_not_read_of_a_part_of_a_block(store: Store) -> None:
    found = Ragged.read(ragged(store), 4, 8)
    assert found.rows.tolist() == [4, 5, 6, 7]
    with pytest.raises(ValueError, match=r"read it by blocks"):
        _ = found.value
    assert found.has("value")
    assert not Ragged.read(ragged(store)).has("nothing")


def test_an_array_cannot_have_a_name_that_means_something_else() -> None:
    @dataclass(frozen=True)
    class Bad(Arrays):
        time: np.ndarray = table("frame", dtype="int64", meaning="shadows a coordinate")

    with pytest.raises(TypeError, match="time is no name for an array"):
        fields_of(Bad)


def test_a_look_at_it_reads_nothing(store: Store) -> None:
    found = Ragged.read(ragged(store))
    assert repr(found) == "Ragged(start=0, stop=10)"
    assert found == Ragged.read(ragged(store))
    assert set(found.__dict__) == {"start", "stop", "_source"}


def test_two_blocks_of_the_same_frames_keep_their_ids_apart(store: Store) -> None:
    artifact = Artifact(store.path / "same")
    begin_with(artifact, [(0, 4)])
    ids = [np.array([1, 2]), np.array([2, 3])]
    put_blocks(artifact, 0, *(Ragged(start=0, stop=4, object=n, seen=n * 10) for n in ids))
    assert Ragged.read(artifact).seen.tolist() == [10, 40, 30]


def test_labels_that_do_not_fit_are_an_error(store: Store) -> None:
    artifact = Artifact(store.path / "labels")
    begin_with(artifact, [(0, 4)], {"labels": {"row": ["a", "b"]}})
    put_blocks(artifact, 0, Ragged(start=0, stop=4, value=np.zeros(3, np.float32)))
    with pytest.raises(ValueError, match="2 labels for 3 of row"):
        seal(artifact, Ragged, *times(4))
