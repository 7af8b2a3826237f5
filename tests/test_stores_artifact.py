"""Artifacts: what is written is read, whatever the layout; nothing counts before its record does."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from stores_help import (
    SIZE,
    content,
    cut,
    data_files,
    make_artifact,
    make_store,
    specs,
    write_part,
)

from zsmoseg.errors import StoreError
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.fixedpoint import decode, encode
from zsmoseg.stores.location import Store
from zsmoseg.stores.schema import ArraySpec
from zsmoseg.stores.tables import pack, unpack

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
        np.testing.assert_array_equal(artifact.read(name, start, stop), whole[start:stop])
    assert artifact.check(deep=True) == []


tables = hnp.arrays(
    st.sampled_from([np.bool_, np.uint8, np.int16, np.uint32, np.int64, np.float16, np.float32, np.float64]),
    hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
)


@settings(max_examples=100, deadline=None)
@given(values=tables)
def test_a_table_of_any_size_and_kind_is_unpacked_as_it_was_packed(values: np.ndarray) -> None:
    dims = [f"d{i}" for i in range(values.ndim)]
    found, names = unpack(*pack(values, dims))
    assert found.dtype == values.dtype
    assert names == tuple(dims)
    np.testing.assert_array_equal(found, values)


@relaxed
@given(values=tables)
def test_zarr_reads_tables_as_they_were_written(
    values: np.ndarray, tmp_path_factory: pytest.TempPathFactory
) -> None:
    import zarr

    artifact = Artifact(tmp_path_factory.mktemp("table"))
    artifact.begin({"stage": "s"}, [(0, 3)])
    artifact.write(0, tables={"t": values})
    found = zarr.open_group(artifact.data, mode="r")["parts/0000/t"]
    assert found.dtype == values.dtype
    np.testing.assert_array_equal(found[...], values)
    np.testing.assert_array_equal(artifact.read_table(0)["t"], values)


def test_tables_of_text_are_refused(store: Store) -> None:
    artifact = make_artifact(store)
    with pytest.raises(TypeError, match="expected booleans"):
        artifact.write(0, tables={"name": np.array(["a", "b"])})


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
    assert artifact.read("forward", 1, 2)[0, 0, 2, 3] == 32767 / 64


def test_raw_reads_what_is_stored(store: Store) -> None:
    raw = make_artifact(store).read("forward", 0, 9, raw=True)
    assert raw.dtype == np.int16
    np.testing.assert_array_equal(raw, content(10)["forward"] * 64)


@pytest.mark.parametrize(
    ("name", "values", "error"),
    [
        ("label", np.zeros((4, *SIZE), np.int64), TypeError),
        ("label", np.zeros((3, *SIZE), np.uint16), ValueError),
        ("label", np.zeros((4, 7, 6), np.uint16), ValueError),
        ("forward", np.zeros((4, 2, *SIZE), np.int16), TypeError),
        ("other", np.zeros(4, np.uint8), ValueError),
    ],
)
def test_arrays_of_wrong_type_or_shape_are_refused_by_name(
    name: str, values: np.ndarray, error: type[Exception], store: Store
) -> None:
    artifact, whole = make_artifact(store), content(10)
    given = {array: found[:4] for array, found in whole.items()} | {name: values}
    with pytest.raises(error, match=name):
        artifact.write(0, given)
    assert artifact.part(0) is None


def test_a_part_that_lacks_an_array_gets_no_record(store: Store) -> None:
    artifact = make_artifact(store)
    with pytest.raises(ValueError, match="lacks forward, label"):
        artifact.write(0, {"frame": content(10)["frame"][:4]})
    assert artifact.part_problem(0) == "not computed yet"
    assert artifact.done is None


def test_reading_past_the_end_is_an_error(store: Store) -> None:
    with pytest.raises(ValueError, match="has 10 rows"):
        make_artifact(store).read("label", 8, 11)


def test_a_part_written_bit_by_bit_holds_its_groups(store: Store) -> None:
    artifact = Artifact(store.path / "bits")
    artifact.begin({"stage": "objects"}, [(0, 10)])
    with artifact.writer(0) as writer:
        for shot in range(3):
            writer.put(f"{shot:03d}", {"area": np.arange(shot)})
        assert artifact.part(0) is None
        writer.put("", {"count": np.array([3])})
        writer.put_tables({"more": np.array([4])})
        writer.facts = {"seconds": np.float32(1.5), "warnings": ["none"]}
    assert artifact.groups(0) == ["000", "001", "002"]
    np.testing.assert_array_equal(artifact.read_table(0, "002")["area"], [0, 1])
    assert {n: v.tolist() for n, v in artifact.read_table(0).items()} == {"count": [3], "more": [4]}
    record = artifact.part(0)
    assert record is not None
    assert record.seconds == 1.5


def test_a_task_that_fails_leaves_no_record(store: Store) -> None:
    artifact = make_artifact(store)
    writer = artifact.writer(0)
    writer.put_tables({"a": np.zeros(3)})
    with pytest.raises(ValueError, match="frame"), writer:
        writer.put_arrays({"frame": np.zeros(3, np.uint8)})
    assert artifact.part(0) is None
    assert artifact.done is None


def test_a_part_written_again_loses_what_it_had(store: Store) -> None:
    artifact = Artifact(store.path / "again")
    artifact.begin({"stage": "s"}, [(0, 10)])
    artifact.write(0, tables={"old": np.zeros(3), "both": np.zeros(3)})
    artifact.write(0, tables={"both": np.ones(2)})
    assert list(artifact.read_table(0)) == ["both"]
    assert not (artifact.table_folder(0) / "old").exists()


def test_an_artifact_keeps_the_layout_it_was_begun_with(store: Store) -> None:
    artifact = make_artifact(store, length=4)
    before = data_files(artifact)
    artifact.begin({"stage": "flow", "key": "k0", "settings": {}}, cut(10, 3), specs(10))
    assert artifact.parts == cut(10, 4)
    assert data_files(artifact) == before
    assert artifact.done is not None


def test_parts_of_another_cut_never_count_when_the_description_was_lost(store: Store) -> None:
    artifact = make_artifact(store, length=4)
    (artifact.path / "artifact.json").unlink()
    artifact.begin({"stage": "flow", "key": "k0"}, cut(10, 3), specs(10))
    assert artifact.parts == cut(10, 3)
    assert all(artifact.part_problem(part) for part in range(4))
    whole = content(10)
    for part in range(4):
        write_part(artifact, part, whole)
    np.testing.assert_array_equal(artifact.read("label", 0, 10), whole["label"])


def test_arrays_of_another_kind_start_the_artifact_anew(store: Store) -> None:
    artifact = make_artifact(store)
    artifact.begin({"stage": "flow"}, cut(10, 4), specs(10)[:2])
    assert set(artifact.arrays) == {"frame", "forward"}
    assert artifact.part_problem(0) == "not computed yet"
    assert artifact.done is None


@pytest.mark.parametrize("parts", [[], [(1, 4)], [(0, 4), (5, 10)], [(0, 3), (3, 10)], [(0, 4), (4, 8)]])
def test_parts_that_do_not_tile_the_video_are_refused(parts: list[tuple[int, int]], store: Store) -> None:
    with pytest.raises(ValueError, match=r"parts|rows"):
        Artifact(store.path / "new").begin({}, parts, specs(10))


def test_the_same_input_gives_the_same_bytes_in_every_file(tmp_path: Path) -> None:
    first, second = (make_artifact(make_store(tmp_path / name)) for name in "ab")
    write_part(second, 1, content(10, seed=5))
    write_part(second, 1, content(10))
    assert data_files(first) == data_files(second)
    assert len(data_files(first)) > 20


def test_two_settings_stand_side_by_side(store: Store) -> None:
    one, two = make_artifact(store, "k1", seed=1), make_artifact(store, "k2", length=3, seed=2)
    for artifact, seed in ((one, 1), (two, 2)):
        np.testing.assert_array_equal(artifact.read("label", 0, 10), content(10, seed)["label"])
    described = two.sibling()
    assert described is not None
    assert described["key"] == "k1"


def test_sealing_needs_every_part(store: Store) -> None:
    artifact = make_artifact(store)
    artifact.invalidate([1])
    assert artifact.done is None
    with pytest.raises(StoreError, match="part 1: not computed yet"):
        artifact.seal()
    write_part(artifact, 1, content(10))
    artifact.seal({"seconds": 3})
    assert artifact.done is not None
    assert artifact.done["seconds"] == 3


def test_a_sealed_artifact_opens_in_xarray_labelled_and_in_physical_units(store: Store) -> None:
    artifact = make_artifact(store)
    found = artifact.dataset([t / 25 for t in range(10)], [f"{t:05d}" for t in range(10)])
    flow = found["forward"]
    assert flow.dims == ("pair", "component", "y", "x")
    assert flow.attrs["units"] == "px"
    np.testing.assert_array_equal(flow.sel(pair=slice(2, 5)), content(10)["forward"][2:6])
    assert found["label"].sel(frame=3).coords["name"] == "00003"
    assert float(found["time"][5]) == 0.2
    assert found["time"].attrs["units"] == "s"
    np.testing.assert_array_equal(found["label"], content(10)["label"])


def test_tables_with_named_dimensions_are_joined_for_users(store: Store) -> None:
    artifact = Artifact(store.path / "joined")
    artifact.begin({"stage": "s"}, cut(10, 4))
    for part, (start, stop) in enumerate(artifact.parts):
        with artifact.writer(part) as writer:
            pairs = np.arange(start, min(stop, 9))
            writer.put_tables({"valid": pairs % 2 == 0, "loose": pairs}, dims={"valid": ["pair"]})
    found = artifact.dataset([float(t) for t in range(10)], [str(t) for t in range(10)])
    assert list(found.data_vars) == ["valid"]
    np.testing.assert_array_equal(found["valid"].sel(pair=[3, 4, 8]), [False, True, True])
    assert found["frame"].dims == ("pair",)


def test_an_unfinished_artifact_is_not_opened(store: Store) -> None:
    artifact = make_artifact(store)
    artifact.invalidate([2])
    with pytest.raises(StoreError, match="not computed yet"):
        artifact.dataset([0.0] * 10, [""] * 10)


def test_arrays_use_only_codecs_of_the_zarr_specification(store: Store) -> None:
    def names(codecs: list[dict]) -> set[str]:
        inner = [names(c["configuration"]["codecs"]) for c in codecs if c["name"] == "sharding_indexed"]
        return {c["name"] for c in codecs}.union(*inner)

    artifact = make_artifact(store)
    for name, data in data_files(artifact).items():
        if name.endswith("zarr.json") and (described := json.loads(data))["node_type"] == "array":
            assert names(described["codecs"]) <= {"bytes", "blosc", "zstd", "crc32c", "sharding_indexed"}
            assert names(described["codecs"]) >= {"crc32c"}


@pytest.mark.parametrize("wrong", [{"dims": ("y", "x")}, {"name": "parts"}, {"shape": (3,)}])
def test_a_spec_that_is_none_is_refused(wrong: dict) -> None:
    with pytest.raises(ValueError, match=r"dims|name"):
        ArraySpec(**{"name": "a", "dims": ("frame", "x"), "shape": (3, 4), "dtype": "uint8", **wrong})
