"""Scripts as users write them, each in an interpreter of its own: without a guard, without a place to write, on other systems."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import pytest
from closed import skip_where_all_is_open, without_privileges
from conftest import draw_clip, write_folder

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


def python(
    script: str, folder: Path, closed: bool = False, **variables: str
) -> subprocess.CompletedProcess[str]:
    """A script of its own in ``folder``; ``closed``: permissions count for it."""
    (folder / "script.py").write_text(script)
    return subprocess.run(
        [sys.executable, "script.py"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), **variables},
        preexec_fn=without_privileges if closed else None,
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
    truth = draw_clip(frames=4, height=24, width=32)[1].astype("uint8")
    for name in ("ant", "bee"):
        write_folder(tmp_path / "masks" / name, truth)
        write_folder(tmp_path / "truth" / name, truth)
    found = python(EVALUATE.replace("DATA", str(tmp_path)), tmp_path)
    assert found.returncode == 2
    (line,) = found.stderr.splitlines()
    assert "if __name__ == '__main__':" in line


# ---------------------------------------------------------------------- nowhere to write, nothing to read
def close(*places: Path, mode: int = 0o555) -> None:
    for place in places:
        for path in reversed([place, *place.rglob("*")]):
            path.chmod(mode)
    skip_where_all_is_open(places[0])


@pytest.fixture
def opened_again(tmp_path: Path) -> Iterator[Path]:
    yield tmp_path
    subprocess.run(["chmod", "-R", "u+rwx", str(tmp_path)], check=True)


def test_it_runs_where_neither_package_nor_home_can_be_written(clip: Path, opened_again: Path) -> None:
    root = opened_again
    work = root / "work"
    work.mkdir()
    (root / "home").mkdir()
    for name in ("zsmoseg", "stores", "workflows"):
        target = root / "package" / "zsmoseg" / ("" if name == "zsmoseg" else name)
        links = ("__pycache__", "stores", "workflows") if name == "zsmoseg" else ("__pycache__",)
        shutil.copytree(ROOT / name, target, ignore=shutil.ignore_patterns(*links), dirs_exist_ok=True)
    close(root / "package", root / "home")
    words = ["run", str(clip), "--until", "flow", "--scheduler", "serial"]
    script = f"import zsmoseg\nfrom zsmoseg.workflows.cli import main\nprint(zsmoseg.__file__)\nraise SystemExit(main({words}))"
    where = {"PYTHONPATH": str(root / "package"), "HOME": str(root / "home"), "XDG_CACHE_HOME": ""}
    found = python(script, work, closed=True, **where)
    assert found.returncode == 0, found.stderr
    assert found.stdout.startswith(str(root / "package"))
    assert "done up to flow" in found.stderr
    assert not [*(root / "home").iterdir(), *(root / "package").rglob("__pycache__")]


def test_what_was_compiled_is_kept_where_it_can_be(tmp_path: Path) -> None:
    script = "from zsmoseg.motion.grams import *\nfrom zsmoseg.compiling import compiled\nprint(compiled(lambda: 1)())"
    assert python(script, tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache")).returncode == 0
    assert list((tmp_path / "cache").rglob("*.nbi"))


CLOSED = {
    "run good -o closed/out --store other": "closed/out",
    "run good -o out --store closed/store": "closed/store",
    "run good -o out --store kept": "kept/runs",
    "run good -o out --store hidden": "hidden",
    "run locked.mp4 -o out": "locked.mp4",
    "run good -o out --ignore locked.png": "locked.png",
    "run good -o out --proposals locked": "locked",
    "run good -o out --config locked.toml": "locked.toml",
    "run good -o out --events closed/events": "closed/events",
    "demo -o closed/demo": "closed/demo",
    "status --store hidden": "hidden",
    "verify --store hidden": "hidden",
    "runs --store hidden": "hidden",
    "gc --store hidden": "hidden",
    "explain good --store hidden": "hidden",
    "export good --store hidden --format davis -o out": "hidden",
    "import good --proposals good --store closed/store": "closed/store",
    "import good --proposals locked --store new": "locked",
    "models fetch mobile-sam": "closed",
    "evaluate good --truth locked": "locked",
}


def test_each_permission_that_is_missing_is_one_line_that_names_it(opened_again: Path) -> None:
    root = opened_again
    images = draw_clip(frames=3, height=24, width=32)[0]
    for name in ("good", "locked"):
        write_folder(root / name, images)
    (root / "locked.mp4").write_bytes(bytes(100))
    (root / "locked.toml").write_text("")
    cv2.imwrite(str(root / "locked.png"), images[0])
    (root / "closed").mkdir()
    main = "from zsmoseg.workflows.cli import main\n"
    stop = ["run", "good", "--until", "frames", "--scheduler", "serial", "--store"]
    for store in ("kept", "hidden"):
        assert python(f"{main}raise SystemExit(main({[*stop, store]}))", root).returncode == 0
    close(root / "closed", root / "kept")
    close(*(root / f"locked{end}" for end in ("", ".mp4", ".toml", ".png")), root / "hidden", mode=0)
    script = f"""
import io, json, sys
from contextlib import redirect_stderr, redirect_stdout
{main}
for line in {list(CLOSED)}:
    said = io.StringIO()
    with redirect_stderr(said), redirect_stdout(io.StringIO()):
        code = main(line.replace("run ", "run --scheduler serial ").split())
    print(json.dumps([line, code, said.getvalue()]))
"""
    found = python(script, root, closed=True, ZSMOSEG_MODELS=str(root / "closed"))
    assert found.returncode == 0, found.stderr
    told = [json.loads(line) for line in found.stdout.splitlines()]
    assert [line for line, _, _ in told] == list(CLOSED)
    for line, code, said in told:
        assert code == 2, (line, said)
        assert said.count("\n") == 1, (line, said)
        assert CLOSED[line] in said, (line, said)
        assert "ermission denied" in said, (line, said)
    assert {path.name for path in root.iterdir()} >= {"good", "closed"}
    assert not (root / "out").exists()


# ---------------------------------------------------------------------- Ctrl-C
WATCHED = """
import sys, time
import zsmoseg.workflows.running.run as running
import zsmoseg.workflows.running.local_cluster as local
import zsmoseg.workflows.running.progress as progress
from zsmoseg.workflows.cli import main
running.SMALL = 0.0
progress.EVERY = float("inf")
real = local.unheard
def unheard():
    print("starting", file=sys.stderr, flush=True)
    return real()
local.unheard = unheard
if __name__ == "__main__":
    raise SystemExit(main())
"""


@pytest.mark.skipif(sys.platform == "win32", reason="process groups are those of POSIX")
@pytest.mark.parametrize("when", ["starting", "frames done"])
@pytest.mark.parametrize("times", [1, 2])
def test_ctrl_c_ends_it_without_a_word_of_python_whenever_it_comes(
    when: str, times: int, clip: Path, tmp_path: Path
) -> None:
    """To all processes of the terminal, as Ctrl-C is; while the cluster starts it is not lost."""
    (tmp_path / "script.py").write_text(WATCHED)
    words = ["run", str(clip), "-o", "out", "--scheduler", "local", "--workers", "1"]
    with subprocess.Popen(
        [sys.executable, "script.py", *words, "--set", "chunk.length=2"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # What starts the tests in the background has them, and all that they start, pass over SIGINT.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        assert process.stderr is not None
        next(line for line in process.stderr if when in line)
        for n in range(times):
            time.sleep(0.5 * n)
            os.killpg(process.pid, signal.SIGINT)
        rest = process.stderr.read()
    said = [line for line in rest.splitlines() if not line.startswith("disc")]
    if times == 1:
        assert process.returncode == 130
        assert said == ["zsmoseg: interrupted; what was finished is kept"]
    else:
        assert process.returncode in (130, -signal.SIGINT)
        assert set(said) <= {"zsmoseg: interrupted; what was finished is kept"}
