"""Changing any setting recomputes exactly the stages that declare it and what hangs on them, and changes bytes."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import textured, write_folder
from runs import segment

from zsmoseg.settings import Settings, defaults, resolve
from zsmoseg.workflows.planning.plan import VideoPlan, following
from zsmoseg.workflows.running.request import Request
from zsmoseg.workflows.running.run import dry_run
from zsmoseg.workflows.stages.graph import GRAPHS

OTHER: dict[str, Any] = {
    "video.start": "1f",
    "video.end": "7f",
    "groups.count": 1,
    "frames.width": 96,
}
"""Values that a rule cannot guess."""
NO_BYTES = {
    "video.fps": "times of images: asserted on the times",
    "video.allow_truncated": "acts on damaged videos: tests/test_video.py",
    "video.fingerprint": "names the source: another video folder, tests/test_run.py",
    "trajectories.spacing": "second cue: tests/test_second_cue.py",
    "trajectories.gaps": "second cue: tests/test_second_cue.py",
    "affinity.cues": "second cue: tests/test_second_cue.py",
    "affinity.fusion": "second cue: tests/test_second_cue.py",
    "affinity.columns": "second cue: tests/test_second_cue.py",
    "flow.source": "imports: tests/test_imports.py",
    "flow.path": "imports: tests/test_imports.py",
    "flow.reach": "acts on what moves by 20 px a frame: tests/test_flow.py",
    "depth.path": "imports: tests/test_imports.py",
    "depth.kind": "imports: tests/test_imports.py",
    **{
        f"proposals.{name}": "imports: tests/test_imports.py"
        for name in type(Settings().proposals).model_fields
    },
    "flow.model": "networks: tests/test_networks_flow.py",
    "depth.model": "networks: tests/test_networks_run.py",
    **{
        name: "networks: tests/test_networks_run.py"
        for name in defaults()
        if name.split(".")[0] in ("looks", "tags", "selection", "linking", "tracking")
    },
    **{f"networks.{name}": "changes nothing by design" for name in type(Settings().networks).model_fields},
    "affinity.error": "acts on what a camera passes: tests/test_geometry.py",
    "affinity.parallax": "acts on what a camera passes: tests/test_geometry.py",
    "groups.weak": "acts on what comes back: tests/test_grouping.py",
    "chunk.length": "changes nothing by design: tests/test_run.py",
}
"""Settings that leave the bytes of a healthy clip alone, and where they are tested."""


def other_values(name: str, tmp_path: Path) -> list[Any]:
    """Other allowed values, near ones first."""
    if name == "ignore.mask":
        mask = np.zeros((120, 160), np.uint8)
        mask[:30] = 255
        cv2.imwrite(str(tmp_path / "ignore.png"), mask)
        return [str(tmp_path / "ignore.png")]
    if name in OTHER:
        return [OTHER[name]]
    section, field = name.split(".")
    default = defaults()[name]
    schema = type(getattr(Settings(), section)).model_json_schema()["properties"][field]
    if "enum" in schema:
        return [v for v in schema["enum"] if v != default]
    if isinstance(default, bool):
        return [not default]
    low, high = schema.get("minimum", -np.inf), schema.get("maximum", np.inf)
    above, below = schema.get("exclusiveMinimum", -np.inf), schema.get("exclusiveMaximum", np.inf)
    tried = [
        type(default)(v)
        for v in (default * 2, default / 2, default + 1, default * 20, default / 20, 0, 1e3, 1)
    ]
    return [v for v in dict.fromkeys(tried) if low <= v <= high and above < v < below and v != default]


DEMANDING = {"objects.clean_from": 0.0, "objects.clean_full": 0.1, "objects.unclean_from": 0.0}
SETUP: dict[str, dict[str, Any]] = {
    "affinity.rounds": {"affinity.most": 200.0},
    "groups.overlap": {"affinity.most": 1e5, "video.start": "2f", "groups.reach": 100.0},
    "groups.share": {"affinity.floor": 0.01, "affinity.pair": 0.0, "groups.reach": 0.0},
    "groups.gap": {"groups.least_pairs": 8},
    "objects.clean_power": DEMANDING,
    "objects.clean_half": DEMANDING,
    "objects.unclean_from": DEMANDING,
    "objects.unclean_full": DEMANDING,
    "objects.clean_from": {**DEMANDING, "objects.clean_full": 0.99},
    "objects.clean_full": DEMANDING,
    "objects.contrast_colour": {"objects.window": 0},
}
"""Others that let a setting act on so small a clip."""


def activation(name: str) -> dict[str, Any]:
    """What makes a setting act, where it belongs to a choice."""
    section, field = name.split(".")
    when = type(getattr(Settings(), section)).extra(field)["when"]
    return {**SETUP.get(name, {}), **({f"{section}.{when[0]}": when[1]} if when else {})}


def eventful(frames: int = 16, height: int = 120, width: int = 160) -> np.ndarray:
    """A pan over texture with a mover that stops, one that is hidden for a while, a slow one, limbs, and spray."""
    rng = np.random.default_rng(3)
    world = textured(rng, height + 40, width + 80, (110, 130, 90))
    skins = [
        textured(rng, 200, 240, c) for c in ((60, 60, 200), (190, 150, 40), (50, 190, 190), (80, 60, 190))
    ]
    images = []
    for t in range(frames):
        image = world[10 + t // 3 : 10 + t // 3 + height, 2 * t : 2 * t + width].copy()
        moved = min(t, frames // 2)
        discs = [
            (skins[0], 40 + 3 * moved - 2 * max(t - moved, 0), 40 + moved, 15),
            (skins[3], 40 + 3 * moved - 2 * max(t - moved, 0) + 14 + t % 3, 50 + moved, 5),
            (skins[1], 130 - 4 * t, 88, 0 if 5 <= t < 8 else 12),
            (skins[2], 110 + t // 2 - 2 * t, 30, 9),
        ]
        for skin, x, y, radius in discs:
            mask = np.zeros((height, width), np.uint8)
            cv2.circle(mask, (x, y), radius, 1, -1) if radius else None
            shifted = skin[70 - y + height // 2 :, 90 - x + width // 2 :][:height, :width]
            part = mask[: shifted.shape[0], : shifted.shape[1]] > 0
            image[: shifted.shape[0], : shifted.shape[1]][part] = shifted[part]
        image[100:116, 20:60] = textured(rng, 16, 40, (220, 220, 220))
        images.append(np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8))
    return np.stack(images)


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    root = tmp_path_factory.mktemp("settings")
    clip = write_folder(root / "disc", eventful())
    segment(clip, root / "run")
    return clip, root / "run"


def leaves(root: Path, keys: dict[str, str]) -> dict[str, dict[str, bytes]]:
    """The bytes of the artifacts of some keys."""
    (video,) = [p for p in (root / "store").iterdir() if p.name.startswith("disc-")]
    return {
        stage: {
            str(p.relative_to(video / stage / key)): p.read_bytes()
            for p in sorted((video / stage / key).rglob("*"))
            if p.is_file() and "records" not in p.parts
        }
        for stage, key in keys.items()
        if (video / stage / key).exists()
    }


def outputs(plan: VideoPlan) -> dict[str, int]:
    """Files and sizes in the output folder, as its list has them, without what only says what was asked for."""
    return {name: entry["size"] for name, entry in plan.output.files.items() if name != "summary.json"}


@pytest.mark.parametrize("name", sorted(set(defaults()) - set(NO_BYTES)))
def test_a_setting_recomputes_its_stages_and_changes_something(
    name: str, base: tuple[Path, Path], tmp_path: Path
) -> None:
    root = tmp_path / "copy"
    shutil.copytree(base[1], root)
    clip, start = base[0], activation(name)
    before = segment(clip, root, start)[1].plans[0]
    values = other_values(name, tmp_path)
    changed = {**start, name: values[0]}
    lines = "\n".join(
        dry_run(
            Request(
                [str(clip)], root / "out", root / "store", resolve(overrides={"chunk.length": 4, **changed})
            )
        )
    )
    assert name in lines
    stages = GRAPHS["embedded-flow"]
    readers = [s.name for s in stages.values() if name.split(".")[0] in s.section_names]
    expected = set().union(*(following(stages, reader) for reader in readers))
    _, counter = segment(clip, root, changed)
    assert counter.stages == expected, "other stages were computed than those that read the setting"
    assert any(
        changes(before, segment(clip, root, {**start, name: value})[1].plans[0], root) for value in values
    ), f"{name} = {values} changed no byte"


def changes(before: VideoPlan, after: VideoPlan, root: Path) -> bool:
    """Whether any byte differs of what two runs left."""
    old, new = ({n: s.key for n, s in plan.stages.items()} for plan in (before, after))
    return leaves(root, old) != leaves(root, new) or outputs(before) != outputs(after)


def test_frame_rate_of_folders_sets_their_times(base: tuple[Path, Path]) -> None:
    clip, root = base
    _, counter = segment(clip, root, {"video.fps": 10.0})
    np.testing.assert_allclose(np.diff(counter.plans[0].probe.times), 0.1)
