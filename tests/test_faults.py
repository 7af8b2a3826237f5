"""Short versions of the campaigns: processes are killed, files are damaged, and nothing is lost or let through."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def campaign(name: str, out: Path, words: str) -> str:
    """What a script of ``benchmarks/`` prints; it has to end with 0."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, str(ROOT / "benchmarks" / name), str(out), *words.split()]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_a_batch_under_kills_ends_right_and_computes_nothing_twice(tmp_path: Path) -> None:
    said = campaign("fault_campaign.py", tmp_path, "--kills 5 --videos 3 --seed 1 --clusters local separate")
    assert "5 kills in 2 batches, 0 failures" in said


def test_damaged_files_are_found_or_harmless_and_mended(tmp_path: Path) -> None:
    said = campaign("corruption_campaign.py", tmp_path, "--trials 8 --seed 1")
    assert "8 trials, 0 failures" in said
