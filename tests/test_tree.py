"""Every array that any stage leaves is in the tree, with its dimensions, equal to what the stage wrote."""

from __future__ import annotations

import shutil
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
import xarray as xr
from conftest import draw_clip, write_folder
from graphs import coloured_clip, write_depth, write_detector, write_segmenter, write_tagger
from runs import segment

import zsmoseg
from zsmoseg.painting.palette import encode_png
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import IDS_OF, TIMES, fields_of, tables_of
from zsmoseg.workflows.result import Result
from zsmoseg.workflows.stage import Stage
from zsmoseg.workflows.stages.graph import GRAPHS

CUT = 6
"""Frame at which the second shot begins."""
FRONTS: dict[str, dict[str, Any]] = {
    "network-flow": {"looks.span": 3},
    "embedded-flow": {"depth.source": "ground"},
    "imported-epipolar": {"affinity.cues": "both", "trajectories.gaps": [1, 2]},
}


@pytest.fixture(scope="module", params=FRONTS)
def finished(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, Result, dict[str, list[Arrays]]]:
    """A run of two shots in small chunks, and every block that its tasks left."""
    root = tmp_path_factory.mktemp("tree")
    images = np.concatenate([draw_clip(0, CUT, 96, 128)[0], draw_clip(5, 6, 96, 128)[0]])
    truth = np.concatenate([draw_clip(0, CUT, 96, 128)[1], draw_clip(5, 6, 96, 128)[1]])
    write_folder(root / "disc", images)
    settings = dict(FRONTS[request.param])
    if request.param.startswith("imported"):
        (root / "given").mkdir()
        for t, mask in enumerate(truth):
            ids = np.where(mask, 7, 0).astype(np.uint16)
            ids[5:30, 5:30] = 3
            (root / "given" / f"{t:05d}.png").write_bytes(encode_png(ids))
        settings["proposals.path"] = str(root / "given")
    if request.param.startswith("network"):
        settings |= {
            "tags.model": str(write_tagger(root / "tagger")),
            "proposals.boxes": str(write_detector(root / "detector")),
            "proposals.masks": str(write_segmenter(root / "segmenter")),
            "depth.model": str(write_depth(root / "depth")),
        }
        shutil.rmtree(root / "disc")
        write_folder(
            root / "disc", np.concatenate([coloured_clip(CUT, 96, 128)[0], coloured_clip(6, 96, 128, 1)[0]])
        )
    left: dict[str, list[Arrays]] = {}
    with pytest.MonkeyPatch.context() as patch:
        from zsmoseg.stores.writer import PartWriter

        put = PartWriter.put

        def noted(writer: PartWriter, block: Arrays) -> None:
            left.setdefault(writer.artifact.path.parent.name, []).append(block)
            put(writer, block)

        patch.setattr(PartWriter, "put", noted)
        _, counter = segment(root / "disc", root, settings)
    (plan,) = counter.plans
    assert plan.graph == request.param
    return request.param, zsmoseg.open_store(root / "store")["disc"], left


def test_every_array_that_any_stage_leaves_is_in_the_tree_with_its_dims(
    finished: tuple[str, Result, dict[str, list[Arrays]]],
) -> None:
    graph, result, left = finished
    tree = result.tree
    constant = {"depth"} if graph.startswith("imported") else set()
    stages = [stage for stage in GRAPHS[graph].values() if stage.leaves and stage.name not in constant]
    assert {stage.name for stage in stages} == set(tree.children) == set(left)
    for stage in stages:
        assert stage.leaves is not None
        there = {
            name: field for name, field in fields_of(stage.leaves).items() if name in expected(stage, graph)
        }
        for name, field in there.items():
            array = tree[f"{stage.name}/{name}"]
            assert array.dims == field.dims, f"{stage.name}/{name}"
            assert array.attrs["long_name"] == field.meaning
            assert array.attrs.get("units", "") == field.unit
            for dim in field.dims:
                if dim in TIMES or dim in {
                    "component",
                    "channel",
                    "object",
                    "model",
                    "other",
                    "term",
                    "cue",
                    "tag",
                    "category",
                    "edge",
                }:
                    assert dim in array.coords, f"{stage.name}/{name} has no labels of {dim}"
        opened = xr.open_zarr(result.artifact(stage.name).path)
        assert set(opened.variables) >= set(there)


def expected(stage: Stage[Any, Any], graph: str) -> set[str]:
    """The arrays of a stage; masks of files have no names."""
    hints = get_type_hints(stage.leaves)
    optional = {name for name, hint in hints.items() if type(None) in get_args(hint)}
    return set(fields_of(stage.leaves)) - (optional if graph.startswith("imported") else set())


def test_it_is_equal_in_content_to_what_the_stages_wrote(
    finished: tuple[str, Result, dict[str, list[Arrays]]],
) -> None:
    _, result, left = finished
    for stage, blocks in left.items():
        tree = result.tree[stage]
        assert isinstance(tree, xr.DataTree)
        dataset = tree.to_dataset()
        rows: dict[str, int] = {}
        added: dict[str, np.ndarray] = {}
        for block in blocks:
            for name, field in fields_of(type(block)).items():
                values = getattr(block, name)
                if values is None:
                    continue
                if field.add:
                    total = added.setdefault(name, np.zeros(dataset[name].shape, np.float64))
                    total[places(dataset, block, field.dims, np.shape(values))] += values
                    continue
                found = dataset[name].values[
                    places(dataset, block, field.dims, np.shape(values), rows.get(name, 0))
                ]
                rows[name] = rows.get(name, 0) + (len(values) if field.dims else 0)
                if field.scale != 1:
                    np.testing.assert_allclose(found, values, atol=field.scale / 2, err_msg=f"{stage}/{name}")
                elif not shared(field.dims, block):
                    np.testing.assert_array_equal(found, values, err_msg=f"{stage}/{name}")
        for name, total in added.items():
            np.testing.assert_array_equal(dataset[name].values, total, err_msg=f"{stage}/{name}")


def shared(dims: tuple[str, ...], block: Arrays) -> bool:
    """Whether the background, which every shot has, may have other values in another block."""
    return (
        bool(dims)
        and dims[0] not in TIMES
        and any(IDS_OF.get(d, d) == "object" for d in dims)
        and block.start > 0
    )


def places(
    dataset: xr.Dataset, block: Arrays, dims: tuple[str, ...], shape: tuple[int, ...], first: int = 0
) -> Any:
    """Where the values of a block are to be found, written down independently of ``stores.joining``.

    ``first`` is the row at which those of a table of plain rows begin.
    """
    out = []
    for axis, (dim, length) in enumerate(zip(dims, shape, strict=True)):
        ids = IDS_OF.get(dim, dim)
        own = tables_of(type(block)).get(ids)
        if dim in TIMES:
            out.append(np.arange(block.start, block.start + length))
        elif own is not None and own.dims == (ids,):
            labels = dataset[ids].values.tolist()
            out.append(np.array([labels.index(n) for n in getattr(block, ids)], int))
        else:
            rows = axis == 0 and dim not in dataset.coords
            out.append(np.arange(length) + first * rows)
    return np.ix_(*out) if out else ()


def test_the_tensor_and_the_matrix_are_there_in_three_lines(
    finished: tuple[str, Result, dict[str, list[Arrays]]],
) -> None:
    tree = finished[1].tree
    error = tree["residuals/residual"].sel(model=0)
    assert error.dims == ("pair", "object")
    similar = tree["affinity/affinity"]
    assert similar.dims == ("object", "other")
    np.testing.assert_array_equal(similar, similar.values.T)
    moving = tree["groups/moving"].sel(frame=slice(0, 3))
    assert moving.dims == ("frame", "object")


def test_nothing_is_read_before_it_is_used(finished: tuple[str, Result, dict[str, list[Arrays]]]) -> None:
    tree = finished[1].tree
    assert not tree["frames/image"].variable._in_memory
    assert not tree["labels/label"].variable._in_memory
