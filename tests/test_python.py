"""The Python face, as the README shows it."""

from __future__ import annotations

from pathlib import Path

import dask.distributed
import numpy as np
import pytest
from runs import data_bytes, masks

import zsmoseg
from zsmoseg.errors import StoreError, ZsmosegError


@pytest.fixture(scope="module")
def result(clip: Path, tmp_path_factory: pytest.TempPathFactory):
    root = tmp_path_factory.mktemp("python")
    return root, zsmoseg.segment(clip, out=root / "out", store=root / "store")


def test_masks_are_those_of_the_output_folder(result) -> None:
    root, found = result
    for kind, folder in (("group", "masks"), ("instance", "objects")):
        np.testing.assert_array_equal(found.masks(kind).values, masks(root / "out" / "disc", folder))
    moving = found.masks("moving")
    assert moving.dtype == bool
    assert moving.dims == ("frame", "y", "x")
    np.testing.assert_array_equal(moving.values, masks(root / "out" / "disc") > 0)


def test_the_tree_holds_every_array_with_units_and_times(result) -> None:
    _, found = result
    flow = found.tree["flow/forward"]
    assert flow.dims == ("pair", "component", "y", "x")
    assert flow.attrs["units"] == "px"
    assert 1.5 < float(abs(flow.sel(component="x")).median()) < 2.5
    np.testing.assert_allclose(found.tree["frames/image"].time, np.arange(10) / 25)


def test_objects_are_a_table_of_what_was_seen(result) -> None:
    _, found = result
    table = found.objects.set_index("object")
    mover = table[table.group == 1].area.idxmax()
    assert table.excess[mover] > table.tolerance[mover]
    assert table.world[mover] < 0.5 < table.world[0]
    assert found.moving()[:, mover].any()


def test_the_store_opens_weeks_later(result) -> None:
    root, found = result
    again = zsmoseg.open_store(root / "store")
    assert list(again) == ["disc"]
    np.testing.assert_array_equal(again["disc"].masks("group"), found.masks("group"))
    with pytest.raises(StoreError, match="no finished run of 'cat'"):
        again["cat"]


def test_a_client_or_the_address_of_a_scheduler_gives_the_same_bytes(
    result, clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zsmoseg.workflows.running.run.SMALL", 0.0)
    expected = data_bytes(result[0])
    with (
        dask.distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=False, dashboard_address=None
        ) as cluster,
        dask.distributed.Client(cluster) as client,
    ):
        for name, scheduler in (("client", client), ("address", cluster.scheduler_address)):
            root = tmp_path / name
            zsmoseg.segment(clip, out=root / "out", store=root / "store", scheduler=scheduler)
            assert data_bytes(root) == expected


def test_bad_input_is_one_error_of_the_tree(tmp_path: Path) -> None:
    with pytest.raises(ZsmosegError, match=r"walk\.mp4"):
        zsmoseg.segment(tmp_path / "walk.mp4", out=tmp_path / "out", store=tmp_path / "store")
