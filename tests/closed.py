"""Permissions that count, for tests that run as root too."""

from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path

import pytest

DAC = (1, 2)
"""The capabilities of root that override permissions."""


def without_privileges() -> None:
    """Permissions count for root too: for ``preexec_fn`` of a process."""
    libc = ctypes.CDLL(None, use_errno=True)
    for capability in DAC:
        libc.prctl(24, capability, 0, 0, 0)


def skip_where_all_is_open(place: Path) -> None:
    """``place`` was closed: skip where that means nothing, and root cannot be made to obey."""
    if os.access(place, os.R_OK | os.W_OK) and (os.geteuid() or not sys.platform.startswith("linux")):
        pytest.skip("permissions count for nothing here")
