"""The house: imports go one way, a file has one subject and can be read in one look, one room for storage."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from itertools import combinations
from pathlib import Path

import grimp
import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
SOURCES = sorted(
    path for folder in ("zsmoseg", "stores", "workflows") for path in (ROOT / folder).rglob("*.py")
)
FACES = {"__init__", "errors"}
"""What may stand at the top of the science beside rooms."""
FRAMEWORKS = ("dask", "distributed", "zarr", "xarray")
LONGEST, MEDIAN = 350, 110
LONGEST_FUNCTION = 46
"""Lines that 99 of 100 functions do not exceed."""
IO = {"open", "read_bytes", "write_bytes", "read_text", "write_text", "exists", "is_file", "is_dir", "glob", "rglob",
      "iterdir", "mkdir", "unlink", "stat", "touch", "rename", "rmdir"}  # fmt: skip


@cache
def graph() -> grimp.ImportGraph:
    return grimp.build_graph("zsmoseg", include_external_packages=True)


def room(module: str) -> str:
    """The room of the science that a module is in, or ``stores`` or ``workflows``."""
    return module.split(".")[1] if "." in module else ""


def modules() -> list[str]:
    return sorted(name for name in graph().modules if name.split(".")[0] == "zsmoseg")


def test_the_science_knows_neither_the_dag_nor_the_store() -> None:
    """By package: a new room is guarded without an edit here."""
    for module in modules():
        if room(module) in ("", "stores", "workflows"):
            continue
        reached = graph().find_modules_directly_imported_by(module)
        wrong = {m for m in reached if room(m) in ("stores", "workflows") or m.split(".")[0] in FRAMEWORKS}
        assert not wrong, f"{module} imports {wrong}"


def test_the_store_knows_no_stage_and_no_dask() -> None:
    for module in modules():
        if room(module) == "stores":
            reached = graph().find_modules_directly_imported_by(module)
            wrong = {m for m in reached if room(m) == "workflows" or m in ("dask", "distributed")}
            assert not wrong, f"{module} imports {wrong}"


def test_no_two_modules_import_each_other_and_no_circle_is_larger() -> None:
    names, found = modules(), graph()
    for a, b in combinations(names, 2):
        assert not (
            found.direct_import_exists(importer=a, imported=b)
            and found.direct_import_exists(importer=b, imported=a)
        ), f"{a} and {b} import each other"
    free: set[str] = set()
    waiting = set(names) - {"zsmoseg"}  # offers what stands above it, when asked
    while ready := {m for m in waiting if not (found.find_modules_directly_imported_by(m) & waiting)}:
        waiting -= ready
        free |= ready
    assert not waiting, f"these import each other in a circle: {sorted(waiting)}"


def test_nothing_stands_flat_beside_the_rooms_of_the_science() -> None:
    flat = {path.stem for path in (ROOT / "zsmoseg").glob("*.py")}
    assert flat == FACES


def test_files_are_short() -> None:
    lines = {path: len(path.read_text().splitlines()) for path in SOURCES if path.name != "__init__.py"}
    longest = max(lines, key=lambda path: lines[path])
    assert lines[longest] <= LONGEST, longest
    assert np.median(list(lines.values())) <= MEDIAN


def functions(path: Path) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    yield from (
        n
        for n in ast.walk(ast.parse(path.read_text()))
        if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)
    )


def test_functions_are_short() -> None:
    found = {
        f"{path}:{f.name}": (f.end_lineno or 0) - f.lineno + 1 for path in SOURCES for f in functions(path)
    }
    long = {name: length for name, length in found.items() if length > LONGEST_FUNCTION}
    assert len(long) <= len(found) // 100, long


@pytest.mark.parametrize("path", [p for p in SOURCES if p.parent.name == "stores"], ids=str)
def test_only_one_room_of_the_store_touches_storage(path: Path) -> None:
    """So that another kind of storage is one file in ``stores/files``."""
    calls = [n.func for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Call)]
    touched = [
        f.attr if isinstance(f, ast.Attribute) else f.id
        for f in calls
        if (isinstance(f, ast.Name) and f.id == "open")
        or (
            isinstance(f, ast.Attribute)
            and f.attr in IO
            and not _named(f.value, "files", "cls", "store", "Store")
        )
    ]
    allowed = {"location.py": {"open"}}.get(path.name, set())
    assert not set(touched) - allowed, f"{path.name} touches the disk itself: {touched}"


def _named(node: ast.expr, *names: str) -> bool:
    return isinstance(node, ast.Name) and node.id in names


def test_no_name_of_a_file_means_two_things() -> None:
    """Files of one name are stages of one name, of two front ends, or a command and what it calls."""
    by_name: dict[str, list[str]] = {}
    for path in SOURCES:
        if path.stem not in ("__init__",) and "cli" not in path.parts and "stages" not in path.parts:
            by_name.setdefault(path.stem, []).append(str(path.relative_to(ROOT)))
    twice = {name: paths for name, paths in by_name.items() if len(paths) > 1}
    assert {name: paths for name, paths in twice.items() if name not in SAME} == {}


SAME = {
    "flow": "flow on disk",
    "depth": "depth on disk",
}
"""Names that stand in two rooms and mean the same."""


def test_every_file_says_what_it_is_about() -> None:
    for path in SOURCES:
        about = ast.get_docstring(ast.parse(path.read_text()))
        assert about, path
        assert len(about.split(". ")[0]) > 15, f"{path}: {about}"
