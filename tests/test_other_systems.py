"""Windows and macOS, as far as Linux can tell: no POSIX-only module or function is asked for, no symbolic link is needed."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import draw_clip, write_folder

from zsmoseg.workflows.running.workers import code

ROOT = Path(__file__).parents[1]
PACKAGES = ("zsmoseg", "stores", "workflows")
MODULES = (
    "crypt",
    "fcntl",
    "grp",
    "nis",
    "posix",
    "pty",
    "pwd",
    "readline",
    "resource",
    "spwd",
    "syslog",
    "termios",
    "tty",
)
"""Modules of the standard library that Windows does not have."""
FUNCTIONS = {
    *(
        "chown",
        "chroot",
        "ctermid",
        "fchdir",
        "fchmod",
        "fchown",
        "fork",
        "forkpty",
        "getegid",
        "geteuid",
        "getgid",
    ),
    *(
        "getgroups",
        "getloadavg",
        "getpgid",
        "getpgrp",
        "getpriority",
        "getresuid",
        "getsid",
        "getuid",
        "killpg",
    ),
    *(
        "lchown",
        "mkfifo",
        "mknod",
        "nice",
        "openpty",
        "pathconf",
        "posix_fadvise",
        "posix_fallocate",
        "pread",
    ),
    *(
        "pwrite",
        "sched_getaffinity",
        "sched_setaffinity",
        "sendfile",
        "setpgid",
        "setpriority",
        "setsid",
        "setuid",
    ),
    *("statvfs", "sync", "sysconf", "tcgetpgrp", "uname", "wait3", "wait4", "WIFSIGNALED"),
}
"""Functions of ``os`` that Windows does not have."""
BLOCKED = f"""
import builtins
real = builtins.__import__
def without_posix(name, globals=None, *more, **named):
    asks = str((globals or {{}}).get("__name__", ""))
    if asks.split(".")[0] == "zsmoseg" and name.split(".")[0] in {MODULES}:
        raise ModuleNotFoundError(f"{{asks}} asks for {{name}}")
    return real(name, globals, *more, **named)
builtins.__import__ = without_posix
"""


def python(script: str, folder: Path, checkout: Path) -> subprocess.CompletedProcess[str]:
    (folder / "script.py").write_text(script)
    env = {**os.environ, "PYTHONPATH": str(checkout)}
    return subprocess.run(
        [sys.executable, "script.py"], cwd=folder, env=env, capture_output=True, text=True, timeout=200
    )


def test_every_module_is_imported_and_a_clip_is_run_without_posix_only_modules(tmp_path: Path) -> None:
    write_folder(tmp_path / "clip", draw_clip(frames=4, height=48, width=64)[0])
    script = f"""{BLOCKED}
import importlib, pkgutil, zsmoseg
for found in pkgutil.walk_packages(zsmoseg.__path__, "zsmoseg."):
    if not found.name.startswith("zsmoseg.networks.export."):  # those need torch
        importlib.import_module(found.name)
result = zsmoseg.segment("clip", progress=False)
print(result.masks().shape, zsmoseg.open_store("zsmoseg-store")["clip"].summary["frames"])
from zsmoseg.workflows.running.jobs import peak_memory_mb
assert 50 < peak_memory_mb() < 5000
from zsmoseg.workflows.models.settling_in import put_together
from pathlib import Path
with put_together(Path("models/toy")) as work:
    (work / "file").touch()
assert not list(Path("models").iterdir())
"""
    found = python(script, tmp_path, ROOT)
    assert (found.returncode, found.stdout) == (0, "(4, 48, 64) 4\n"), found.stderr


def test_the_block_finds_what_asks_for_them(tmp_path: Path) -> None:
    (tmp_path / "zsmoseg").mkdir()
    (tmp_path / "zsmoseg" / "__init__.py").write_text("import resource\n")
    found = python(f"{BLOCKED}import zsmoseg", tmp_path, tmp_path)
    assert "zsmoseg asks for resource" in found.stderr


@pytest.mark.parametrize("package", PACKAGES)
def test_functions_that_windows_lacks_are_asked_for_before_they_are_called(package: str) -> None:
    for path in (ROOT / package).rglob("*.py"):
        tree = ast.parse(path.read_text())
        used = {
            node.attr
            for node in ast.walk(tree)
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "os"
        }
        for name in used & FUNCTIONS:
            assert f'hasattr(os, "{name}")' in path.read_text(), f"{path}: os.{name}"


def checkout(root: Path) -> Path:
    """As git leaves it where there are no symbolic links: a file with the target in the place of each."""
    for name in PACKAGES:
        ignore = shutil.ignore_patterns("__pycache__", *(PACKAGES[1:] if name == "zsmoseg" else ()))
        shutil.copytree(ROOT / name, root / name, ignore=ignore)
    for name in PACKAGES[1:]:
        (root / "zsmoseg" / name).write_text(f"../{name}")
    return root


def test_a_checkout_without_symbolic_links_works(tmp_path: Path) -> None:
    script = """
import zsmoseg.stores, zsmoseg.workflows.stages.graph as graph
from zsmoseg.workflows.running.workers import code
from zsmoseg.workflows.cli import main
print(len(graph.names()), code())
assert main(["models", "list"]) == 0
"""
    found = python(script, tmp_path, checkout(tmp_path / "there"))
    assert found.returncode == 0, found.stderr
    assert found.stdout.split()[1] == code(), "workers with and without links run the same code"


def test_what_was_installed_from_one_says_what_to_do(tmp_path: Path) -> None:
    for name in PACKAGES[1:]:
        shutil.rmtree(checkout(tmp_path / name) / name)
        found = python("import zsmoseg.workflows.cli", tmp_path, tmp_path / name)
        assert found.returncode == 1
        assert "git clone -c core.symlinks=true" in found.stderr.splitlines()[-1]
