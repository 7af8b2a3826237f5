"""The second affinity: trajectories and two-view geometry through the graph and the store."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import draw_clip, write_folder
from runs import Counter, segment

from zsmoseg.painting.palette import encode_png
from zsmoseg.settings import resolve
from zsmoseg.workflows.running.request import Request
from zsmoseg.workflows.running.run import dry_run
from zsmoseg.workflows.stages.motion.affinity import Affinity
from zsmoseg.workflows.stages.motion.groups import Groups

SPECTRAL = {"groups.rule": "spectral", "affinity.cues": "both"}


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A clip of a disc and two still patches, all brought as ids, run once with both cues."""
    root = tmp_path_factory.mktemp("cues")
    frames, disc = draw_clip(0, 10)
    write_folder(root / "disc", frames)
    (root / "masks").mkdir()
    for t, mask in enumerate(disc):
        ids = np.where(mask, 1, 0).astype(np.uint8)
        ids[70:118, 5:45], ids[70:118, 100:150] = 2, 3
        (root / "masks" / f"{t:05d}.png").write_bytes(encode_png(ids))
    settings = {"proposals.path": str(root / "masks"), **SPECTRAL}
    segment(root / "disc", root / "run", settings)
    return root, settings


def affinity_of(counter: Counter) -> Affinity:
    return Affinity.read(counter.plans[0].stages["affinity"].artifact)


def test_both_cues_find_the_disc_and_leave_an_affinity_each(base: tuple[Path, dict[str, Any]]) -> None:
    root, settings = base
    _, counter = segment(root / "disc", root / "run", settings)
    assert not counter.stages, "nothing to do a second time"
    table = affinity_of(counter)
    assert table.agreement.shape == (2, 4, 4)
    assert table.affinity[2, 3] > table.affinity[1, 2]
    groups = Groups.read(counter.plans[0].stages["groups"].artifact).group
    assert groups.tolist() == [0, 1, 0, 0]


def test_flow_alone_computes_no_trajectories(base: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    root, settings = base
    _, counter = segment(root / "disc", tmp_path, {**settings, "affinity.cues": "flow"})
    assert not counter.stages & {"trajectories", "epipolar"}


@pytest.mark.parametrize(
    ("name", "value", "first"),
    [
        ("affinity.cues", "epipolar", "affinity"),
        ("affinity.fusion", "coregularised", "affinity"),
        ("affinity.columns", 1, "affinity"),
        ("trajectories.spacing", 8, "trajectories"),
        ("trajectories.gaps", [1, 3], "trajectories"),
    ],
)
def test_its_settings_recompute_what_reads_them_and_change_the_affinity(
    name: str, value: Any, first: str, base: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    root, settings = base
    start = {**settings, **({"affinity.fusion": "coregularised"} if name == "affinity.columns" else {})}
    shutil.copytree(root / "run", tmp_path / "run")
    _, before = segment(root / "disc", tmp_path / "run", start)
    changed = {**start, name: value}
    chosen = resolve(overrides={"chunk.length": 4, **changed})
    request = Request([str(root / "disc")], tmp_path / "run" / "out", tmp_path / "run" / "store", chosen)
    assert name in "\n".join(dry_run(request))
    _, after = segment(root / "disc", tmp_path / "run", changed)
    order = ["trajectories", "epipolar", "affinity", "groups", "masks", "overlay"]
    expected = set(order[order.index(first) :])
    assert after.stages == expected
    old, new = affinity_of(before), affinity_of(after)
    names = ("agreement", "together", "affinity")
    pairs = [(getattr(old, name), getattr(new, name)) for name in names]
    assert any(a.shape != b.shape or (a != b).any() for a, b in pairs)
