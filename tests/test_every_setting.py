"""Changing any setting recomputes exactly the stages that declare it and what hangs on them, and changes bytes."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import draw_clip, write_folder
from runs import segment

from zsmoseg.settings import Settings, defaults, resolve
from zsmoseg.workflows.plan import _following
from zsmoseg.workflows.run import Request, dry_run
from zsmoseg.workflows.stages import STAGES

OTHER: dict[str, Any] = {
    "video.start": "1f",
    "video.end": "7f",
    "groups.count": 1,
    "video.fingerprint": "stat",
}
"""Values that a rule cannot guess."""
NO_BYTES = {
    "video.fps": "times of images: asserted on the times",
    "video.allow_truncated": "acts on damaged videos: tests/test_video.py",
    "video.fingerprint": "names the source: another video folder, tests/test_run.py",
    "chunk.length": "changes nothing by design: tests/test_run.py",
}
"""Settings that leave the bytes of a healthy clip alone, and where they are tested."""


def other_value(name: str, tmp_path: Path) -> Any:
    """Another allowed value."""
    if name == "ignore.mask":
        mask = np.zeros((120, 160), np.uint8)
        mask[:30] = 255
        cv2.imwrite(str(tmp_path / "ignore.png"), mask)
        return str(tmp_path / "ignore.png")
    if name in OTHER:
        return OTHER[name]
    section, field = name.split(".")
    default = defaults()[name]
    schema = type(getattr(Settings(), section)).model_json_schema()["properties"][field]
    if "enum" in schema:
        return next(v for v in schema["enum"] if v != default)
    if isinstance(default, bool):
        return not default
    low = schema.get("minimum", schema.get("exclusiveMinimum", 0))
    high = schema.get("maximum", schema.get("exclusiveMaximum", np.inf))
    for value in (default * 2, default / 2, default + 1):
        value = type(default)(value)
        if low < value < high and value != default:
            return value
    raise AssertionError(f"no other value known for {name}")


def activation(name: str) -> dict[str, Any]:
    """What makes a setting act, where it belongs to a choice."""
    section, field = name.split(".")
    when = type(getattr(Settings(), section)).extra(field)["when"]
    return {f"{section}.{when[0]}": when[1]} if when else {}


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    root = tmp_path_factory.mktemp("settings")
    clip = write_folder(root / "disc", draw_clip(3, 9)[0])
    segment(clip, root / "run")
    return clip, root / "run"


def leaves(root: Path, keys: dict[str, str]) -> dict[str, dict[str, bytes]]:
    """The bytes of the artifacts of some keys."""
    (video,) = [p for p in (root / "store").iterdir() if p.name.startswith("disc-")]
    return {
        stage: {
            str(p.relative_to(video / stage / key)): p.read_bytes()
            for p in sorted((video / stage / key / "data.zarr").rglob("*"))
            if p.is_file()
        }
        for stage, key in keys.items()
        if (video / stage / key).exists()
    }


@pytest.mark.parametrize("name", sorted(set(defaults()) - set(NO_BYTES)))
def test_a_setting_recomputes_its_stages_and_changes_something(
    name: str, base: tuple[Path, Path], tmp_path: Path
) -> None:
    root = tmp_path / "copy"
    shutil.copytree(base[1], root)
    clip, start = base[0], activation(name)
    before, _ = segment(clip, root, start)
    value = other_value(name, tmp_path)
    changed = {**start, name: value}
    lines = "\n".join(
        dry_run(
            Request(
                [str(clip)], root / "out", root / "store", resolve(overrides={"chunk.length": 4, **changed})
            )
        )
    )
    assert name in lines
    readers = [s.name for s in STAGES.values() if name.split(".")[0] in s.sections]
    expected = set().union(*(_following(reader) for reader in readers))
    after, counter = segment(clip, root, changed)
    assert counter.stages == expected, "other stages were computed than those that read the setting"
    old, new = ({n: s.key for n, s in r.plans[0].stages.items()} for r in (before, after))
    stored = leaves(root, old) != leaves(root, new)
    painted = "write" in name or before.plans[0].output.files != after.plans[0].output.files
    assert stored or painted, f"{name} = {value} changed no byte"


def test_frame_rate_of_folders_sets_their_times(base: tuple[Path, Path]) -> None:
    clip, root = base
    report, _ = segment(clip, root, {"video.fps": 10.0})
    np.testing.assert_allclose(np.diff(report.plans[0].probe.times), 0.1)
