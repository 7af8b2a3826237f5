"""Scripts as users write them, each in an interpreter of its own: without a guard, without a place to write, on other systems."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
SEGMENT = """
import zsmoseg.workflows.running.run as running
running.SMALL = 0.0  # stands for a video of some minutes
import zsmoseg
found = zsmoseg.segment("CLIP", out="out", store="store", workers=2, progress=False)
print(found.name)
"""
EVALUATE = """
import zsmoseg.workflows.evaluate.evaluation as evaluation
evaluation.SMALL = 0
from zsmoseg.workflows.cli import main
raise SystemExit(main(["evaluate", "DATA/masks", "--truth", "DATA/truth", "--workers", "2"]))
"""


def python(script: str, folder: Path, *before: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """A script of its own in ``folder``."""
    (folder / "script.py").write_text(script)
    env = {**os.environ, "PYTHONPATH": str(ROOT), **variables}
    return subprocess.run(
        [*before, sys.executable, "script.py"],
        cwd=folder,
        env=env,
        capture_output=True,
        text=True,
        timeout=120,
    )


def test_a_script_without_a_guard_is_named_in_one_line(clip: Path, tmp_path: Path) -> None:
    found = python(SEGMENT.replace("CLIP", str(clip)), tmp_path)
    assert found.returncode == 1
    *trace, line = found.stderr.splitlines()
    assert line.startswith(f"zsmoseg.errors.ClusterError: {tmp_path / 'script.py'}: ")
    assert "if __name__ == '__main__':" in line
    assert trace[0] == "Traceback (most recent call last):"
    assert found.stderr.count("Traceback") == 1


def test_with_a_guard_it_runs(clip: Path, tmp_path: Path) -> None:
    lines = SEGMENT.replace("CLIP", str(clip)).strip().splitlines()
    guarded = "\n".join(["if __name__ == '__main__':", *(f"    {line}" for line in lines)])
    found = python(guarded, tmp_path)
    assert (found.returncode, found.stdout, found.stderr) == (0, "disc\n", "")


def test_a_script_that_cannot_be_loaded_again_is_no_wait_for_ever(clip: Path, tmp_path: Path) -> None:
    once = "import os\nos.mkdir('once')\n"
    found = python(once + SEGMENT.replace("CLIP", str(clip)), tmp_path)
    assert found.returncode == 1
    assert "cannot be loaded by the processes that it starts (exit code 1)" in found.stderr.splitlines()[-1]


def test_scoring_in_processes_wants_a_guard_too(tmp_path: Path) -> None:
    from conftest import draw_clip, write_folder

    truth = draw_clip(frames=4, height=24, width=32)[1].astype("uint8")
    for name in ("ant", "bee"):
        write_folder(tmp_path / "masks" / name, truth)
        write_folder(tmp_path / "truth" / name, truth)
    found = python(EVALUATE.replace("DATA", str(tmp_path)), tmp_path)
    assert found.returncode == 2
    (line,) = found.stderr.splitlines()
    assert "if __name__ == '__main__':" in line
