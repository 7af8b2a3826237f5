"""The registry of models: what it knows, what arrives is checked, and bad files, servers and names get one line."""

from __future__ import annotations

import errno
import hashlib
import io
import json
import re
import shutil
import stat
import sys
import threading
import types
import zipfile
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from filelock import FileLock
from onnx import TensorProto, helper, numpy_helper

from zsmoseg.errors import ModelError
from zsmoseg.networks.contract import contract_of, load_contract
from zsmoseg.networks.decoders import MasksTable
from zsmoseg.networks.depth import kind_of
from zsmoseg.networks.flow import check_flow
from zsmoseg.networks.tags import TagsTable
from zsmoseg.networks.text_boxes import TextTable
from zsmoseg.settings import PRESETS
from zsmoseg.tracking.by_cutie import Cutie
from zsmoseg.tracking.by_deaot import Deaot
from zsmoseg.workflows.cli import main
from zsmoseg.workflows.models import catalogue, downloading
from zsmoseg.workflows.models.catalogue import entries
from zsmoseg.workflows.models.contract_text import with_digests
from zsmoseg.workflows.models.needed import preset_models
from zsmoseg.workflows.models.place import find_model, models_folder, staging

ENTRIES = entries()
"""The real registry."""


def graph(size: int = 14, weights: int = 10) -> bytes:
    """A depth network that gives the mean of the colours and of its weights, which make the file long."""
    ends = [
        helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, size, size]),
        helper.make_tensor_value_info("depth", TensorProto.FLOAT, [1, 1, size, size]),
    ]
    nodes = [
        helper.make_node("ReduceMean", ["image"], ["grey"], axes=[1], keepdims=1),
        helper.make_node("ReduceMean", ["kept"], ["one"], keepdims=1),
        helper.make_node("Add", ["grey", "one"], ["depth"]),
    ]
    kept = numpy_helper.from_array(np.full(weights, 0.5, np.float32), "kept")
    made = helper.make_graph(nodes, "g", ends[:1], ends[1:], [kept])
    model = helper.make_model(made, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    return bytes(model.SerializeToString())


BYTES = graph(weights=200_000)
SHA = hashlib.sha256(BYTES).hexdigest()


def contract(name: str = "toy", file: str = "toy.onnx", more: str = "", output: str = "depth") -> str:
    """A contract as people write it."""
    return f"""# toy
name = "{name}"
task = "depth"
licence = "MIT"
commercial = true

[graph.main]
file = "{file}"  # the graph
{more}
outputs = {{ depth = "{output}" }}

[input]
colour_order = "RGB"

[input.resize]
rule = "stretch"
height = 14
width = 14

[output]
role = "depth"
meaning = "depth, larger = farther"
"""


# ------------------------------------------------------------------ a server, a registry, a cache
class Quiet(ThreadingHTTPServer):
    def handle_error(self, *_: Any) -> None:
        """A client that hangs up is what some tests are about."""


class Server:
    """Files over HTTP, as badly as a test wants."""

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}
        self.asked: list[tuple[str, str | None]] = []
        self.drop_after: list[int] = []
        self.ranges = True
        self.length = True
        self.httpd = Quiet(("127.0.0.1", 0), type("H", (Handler,), {"server_of": self}))
        self.url = f"http://127.0.0.1:{self.httpd.server_address[1]}"
        threading.Thread(target=self.httpd.serve_forever, args=(0.01,), daemon=True).start()


class Handler(BaseHTTPRequestHandler):
    server_of: Server

    def log_message(self, *_: Any) -> None:
        """Silence."""

    def do_GET(self) -> None:
        told, path = self.server_of, self.path.lstrip("/")
        told.asked.append((path, self.headers.get("Range")))
        if path not in told.files:
            self.send_error(404)
            return
        content, start = told.files[path], 0
        if told.ranges and (wanted := re.match(r"bytes=(\d+)-", self.headers.get("Range", ""))):
            start = int(wanted[1])
            if start >= len(content):
                self.send_error(416)
                return
            self.send_response(206)
            self.send_header("Content-Range", f"bytes {start}-{len(content) - 1}/{len(content)}")
        else:
            self.send_response(200)
        if told.length:
            self.send_header("Content-Length", str(len(content) - start))
        self.end_headers()
        stop = told.drop_after.pop(0) if told.drop_after else len(content)
        self.wfile.write(content[start : start + stop])


@pytest.fixture
def server() -> Iterator[Server]:
    made = Server()
    yield made
    made.httpd.shutdown()
    made.httpd.server_close()


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache, and no waiting."""
    monkeypatch.setenv("ZSMOSEG_MODELS", str(tmp_path / "cache"))
    monkeypatch.setattr(downloading, "PAUSE", 0.0)
    return tmp_path / "cache"


Register = Callable[..., None]


@pytest.fixture
def register(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Register]:
    """Entries of a registry of the test's own: ``register(name, contract, catalogue)``."""
    home = tmp_path / "registry"
    (home / "entries").mkdir(parents=True)
    (home / "catalogue.toml").write_text("")
    monkeypatch.setattr(catalogue, "HERE", home)
    entries.cache_clear()

    def add(name: str, text: str, extra: str = "") -> None:
        (home / "entries" / f"{name}.toml").write_text(text)
        with (home / "catalogue.toml").open("a") as file:
            file.write(extra)
        entries.cache_clear()

    yield add
    monkeypatch.undo()
    entries.cache_clear()


@pytest.fixture
def toy(server: Server, register: Register) -> Server:
    """An entry ``toy`` whose one file is on the server."""
    server.files["v1/toy.onnx"] = BYTES
    facts = f'sha256 = "{SHA}"\nbytes = {len(BYTES)}\nurl = "{server.url}/v1/toy.onnx"'
    register("toy", contract(more=facts))
    return server


def say(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str]:
    code = main(["models", *words])
    return code, capsys.readouterr().out


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """The one line that is printed on bad input."""
    code = main(["models", *words])
    err = capsys.readouterr().err
    assert code == 2, err
    assert err.count("\n") == 1, err
    return err


def kept(size: int) -> int:
    """Bytes that an interruption after ``size`` leaves: whole pieces."""
    return size // downloading.CHUNK * downloading.CHUNK


def unlocked(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir()) if folder.is_dir() else []


# ------------------------------------------------------------------ what the registry knows
@pytest.mark.parametrize("name", ENTRIES)
def test_an_entry_is_a_contract_that_its_adapter_reads(name: str) -> None:
    found = contract_of(ENTRIES[name].tables, Path(name))
    assert found.name == name
    assert found.licence
    assert found.source.startswith("https://")
    tables = {
        "tags": ("tags", TagsTable),
        "text-boxes": ("text", TextTable),
        "box-masks": ("masks", MasksTable),
    }
    styles = {"cutie": Cutie, "deaot": Deaot}
    if found.task == "tracker":
        found.extra("tracker", styles[found.tables["tracker"]["style"]])
    elif found.task in tables:
        found.extra(*tables[found.task])
    elif found.task == "depth":
        assert kind_of(found)
    else:
        check_flow(found)


@pytest.mark.parametrize("name", ENTRIES)
def test_an_address_is_pinned_to_a_commit_or_a_release(name: str) -> None:
    entry = ENTRIES[name]
    urls = [file.url for file in entry.files if file.url] + ([entry.archive.url] if entry.archive else [])
    for url in urls:
        assert re.search(r"/[0-9a-f]{40}/|/releases/download/v[0-9.]+/", url), url
    assert urls or entry.base or entry.exporter


@pytest.mark.parametrize("name", [name for name in ENTRIES if ENTRIES[name].exporter])
def test_an_exporter_that_the_registry_names_is_there(name: str) -> None:
    from zsmoseg.workflows.models.making import exporter_of

    assert callable(exporter_of(name))
    assert ENTRIES[name].checkpoint


def test_the_registry_has_every_network_of_the_paper_and_says_who_may_use_it() -> None:
    paper = {"ram", "grounding-dino-tiny", "sam-vit-b", "deaot-l", "pwc-net", "dpt-dinov2-small-nyu"}
    assert paper <= set(ENTRIES)
    assert "non-commercial" in ENTRIES["pwc-net"].about()
    assert "non-commercial" not in ENTRIES["raft"].about()


@pytest.mark.parametrize("preset", PRESETS)
def test_a_preset_needs_models_that_the_registry_has(preset: str) -> None:
    needed = preset_models(preset)
    assert set(needed) <= set(ENTRIES)
    assert bool(needed) == (PRESETS[preset].get("proposals.source") == "network")
    if preset == "paper":
        assert {"ram", "grounding-dino-tiny", "sam-vit-b", "deaot-l", "pwc-net"} <= set(needed)
    if preset == "permissive":
        assert not [n for n in needed if ENTRIES[n].tables.get("commercial") is False]


# ------------------------------------------------------------------ fetching
def test_what_is_fetched_is_a_model_with_its_contract_and_is_not_fetched_twice(
    toy: Server, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert say(capsys, "fetch", "toy") == (0, f"toy: {cache / 'toy'}\n")
    assert (cache / "toy" / "toy.onnx").read_bytes() == BYTES
    assert load_contract(find_model("toy")).digest
    assert unlocked(cache) == ["toy"]
    assert say(capsys, "fetch", "toy")[0] == 0
    assert len(toy.asked) == 1


def test_of_several_models_those_that_can_be_had_are_fetched(
    toy: Server, register: Register, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    register("only", contract("only"), '[only]\nexporter = ["x", "y"]\ncheckpoint = "z.pth"\n')
    assert "zsmoseg models export only CHECKPOINT (z.pth)" in refused(capsys, "fetch", "only", "toy")
    assert unlocked(cache) == ["toy"]


def test_an_interrupted_download_goes_on_at_its_byte(toy: Server, cache: Path) -> None:
    toy.drop_after = [300_000, 100_000]
    assert main(["models", "fetch", "toy"]) == 0
    first, second = kept(300_000), kept(300_000) + kept(100_000)
    assert [asked for _, asked in toy.asked] == [None, f"bytes={first}-", f"bytes={second}-"]
    assert (cache / "toy" / "toy.onnx").read_bytes() == BYTES


def test_a_download_that_is_given_up_goes_on_with_the_next_command(
    toy: Server, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    toy.drop_after = [500_000] + [0] * downloading.TRIES
    assert "stopped at 0.5 MB" in refused(capsys, "fetch", "toy")
    assert not (cache / "toy").exists()
    assert "unfinished" in say(capsys, "list")[1]
    toy.asked.clear()
    toy.drop_after.clear()
    assert main(["models", "fetch", "toy"]) == 0
    assert toy.asked == [("v1/toy.onnx", f"bytes={kept(500_000)}-")]
    assert (cache / "toy" / "toy.onnx").read_bytes() == BYTES


def test_a_server_without_ranges_or_lengths_is_read_from_the_start(toy: Server, cache: Path) -> None:
    toy.ranges = toy.length = False
    toy.drop_after = [300_000]
    assert main(["models", "fetch", "toy"]) == 0
    assert (cache / "toy" / "toy.onnx").read_bytes() == BYTES


def test_a_kept_beginning_of_another_file_is_thrown_away(toy: Server, cache: Path) -> None:
    work = staging(cache / "toy")
    work.mkdir(parents=True)
    (work / "toy.onnx.part").write_bytes(b"x" * 1000)
    assert main(["models", "fetch", "toy"]) == 0
    assert [asked for _, asked in toy.asked] == ["bytes=1000-", None]
    assert (cache / "toy" / "toy.onnx").read_bytes() == BYTES


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (BYTES[:-1] + b"?", "another content than the registry knows"),
        (BYTES[:-1], f"has {len(BYTES) - 1} bytes, the registry says {len(BYTES)}"),
        (BYTES + b"?", f"has {len(BYTES) + 1} bytes, the registry says {len(BYTES)}"),
        (None, "no such file (404)"),
    ],
)
def test_another_file_than_the_registry_knows_gets_no_place(
    toy: Server, cache: Path, capsys: pytest.CaptureFixture[str], content: bytes | None, says: str
) -> None:
    toy.files = {"v1/toy.onnx": content} if content is not None else {}
    assert says in refused(capsys, "fetch", "toy")
    assert unlocked(cache) == []


def test_a_server_that_sends_without_end_is_cut_off(
    server: Server, register: Register, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    server.files["toy.onnx"], server.length = BYTES, False
    register("toy", contract(more=f'url = "{server.url}/toy.onnx"'))
    monkeypatch.setattr(downloading, "MOST_BYTES", 100_000)
    assert "more than 100000 bytes" in refused(capsys, "fetch", "toy")


def test_an_unknown_digest_is_shown_and_taken_only_when_accepted(
    server: Server, register: Register, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    server.files["toy.onnx"] = BYTES
    register("toy", contract(more=f'url = "{server.url}/toy.onnx"'))
    said = refused(capsys, "fetch", "toy")
    assert SHA in said
    assert not (cache / "toy").exists()
    assert "--accept" in refused(capsys, "fetch", "toy", "--accept", "0" * 64)
    assert say(capsys, "fetch", "toy", "--accept", SHA)[0] == 0
    assert len(server.asked) == 1
    assert [(f.sha256, f.bytes) for f in load_contract(cache / "toy").files] == [(SHA, len(BYTES))]
    assert "# the graph" in (cache / "toy" / "contract.toml").read_text()


def test_on_a_terminal_it_asks_whether_to_trust(
    server: Server, register: Register, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    server.files["toy.onnx"] = BYTES
    register("toy", contract(more=f'url = "{server.url}/toy.onnx"'))
    for answer, code in (("n", 2), ("y", 0)):
        monkeypatch.setattr("sys.stdin", types.SimpleNamespace(isatty=lambda: True))
        monkeypatch.setattr("builtins.input", lambda _, answer=answer: answer)
        assert main(["models", "fetch", "toy"]) == code
        assert (cache / "toy").exists() == (code == 0)


@pytest.mark.parametrize("below", ["", "toy"])
def test_a_machine_without_internet_takes_the_files_from_a_folder_or_another_server(
    register: Register,
    server: Server,
    cache: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    below: str,
) -> None:
    register("toy", contract(more=f'sha256 = "{SHA}"'), "[toy]\nbase = 'https://example.org/x'\n")
    assert "--from https://example.org/x" in refused(capsys, "fetch", "toy")
    stick = tmp_path / "stick" / below
    stick.mkdir(parents=True)
    (stick / "toy.onnx").write_bytes(BYTES)
    assert say(capsys, "fetch", "toy", "--from", str(tmp_path / "stick"))[0] == 0
    assert (cache / "toy" / "toy.onnx").read_bytes() == BYTES
    shutil.rmtree(cache)
    server.files[f"{below}/toy.onnx".lstrip("/")] = BYTES
    assert say(capsys, "fetch", "toy", "--from", f"{server.url}/")[0] == 0
    assert (cache / "toy" / "toy.onnx").read_bytes() == BYTES


def test_a_folder_with_another_file_of_the_name_is_refused(
    register: Register, cache: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    register("toy", contract(more=f'sha256 = "{SHA}"'))
    assert "has no toy.onnx" in refused(capsys, "fetch", "toy", "--from", str(tmp_path))
    (tmp_path / "toy.onnx").write_bytes(graph())
    assert "the contract says" in refused(capsys, "fetch", "toy", "--from", str(tmp_path))
    assert unlocked(cache) == []


def test_an_output_known_by_its_shape_gets_its_name(
    server: Server, register: Register, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    server.files["toy.onnx"] = BYTES
    facts = f'sha256 = "{SHA}"\nurl = "{server.url}/toy.onnx"'
    register("toy", contract(more=facts, output="shape 1x1x14x14"))
    register("odd", contract("odd", more=facts, output="shape 1x1x7x7"))
    assert main(["models", "fetch", "toy"]) == 0
    assert load_contract(cache / "toy").graph["main"].outputs == {"depth": "depth"}
    assert "should have the shape [1, 1, 7, 7]" in refused(capsys, "fetch", "odd")


# ------------------------------------------------------------------ archives
def zipped(*members: tuple[str, bytes], link: str = "") -> bytes:
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members:
            info = zipfile.ZipInfo(name)
            info.compress_type = zipfile.ZIP_DEFLATED
            if name == link:
                info.external_attr = (stat.S_IFLNK | 0o777) << 16
            archive.writestr(info, content)
    return held.getvalue()


def register_zip(server: Server, register: Register, content: bytes, unpacked: int = 2_000_000) -> None:
    server.files["v1/toy.zip"] = content
    digest = hashlib.sha256(content).hexdigest()
    register(
        "toy",
        contract(),
        f'[toy.archive]\nurl = "{server.url}/v1/toy.zip"\nsha256 = "{digest}"\n'
        f"bytes = {len(content)}\nunpacked = {unpacked}\n",
    )


def test_the_files_of_an_archive_come_out_and_nothing_else(
    server: Server, register: Register, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    register_zip(server, register, zipped(("x/toy.onnx", BYTES), ("x/README", b"hello"), ("y/", b"")))
    assert say(capsys, "fetch", "toy")[0] == 0
    assert unlocked(cache / "toy") == ["contract.toml", "toy.onnx"]
    assert load_contract(cache / "toy").files[0].sha256 == SHA


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (zipped(("toy.onnx", BYTES), ("../evil", b"x")), "leads out of the folder"),
        (zipped(("toy.onnx", BYTES), ("/etc/evil", b"x")), "leads out of the folder"),
        (zipped(("toy.onnx", BYTES), ("..\\evil", b"x")), "leads out of the folder"),
        (zipped(("toy.onnx", b"/etc/passwd"), link="toy.onnx"), "is a link"),
        (zipped(("toy.onnx", b"\0" * 3_000_000)), "unpacks to 3000000 bytes, more than the 2000000"),
        (zipped(("a/toy.onnx", BYTES), ("b/toy.onnx", BYTES)), "has toy.onnx twice"),
        (zipped(("other.onnx", BYTES)), "lacks toy.onnx"),
        (zipped(("toy.onnx", BYTES))[:-30], "no sound zip file"),
        (b"hello", "no sound zip file"),
    ],
)
def test_an_archive_with_tricks_is_refused(
    server: Server,
    register: Register,
    cache: Path,
    capsys: pytest.CaptureFixture[str],
    content: bytes,
    says: str,
) -> None:
    register_zip(server, register, content)
    assert says in refused(capsys, "fetch", "toy")
    assert not (cache / "toy").exists()
    assert not list(cache.parent.rglob("evil"))


def test_a_member_that_is_larger_than_it_says_is_cut_off(
    server: Server, register: Register, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A bomb whose directory lies: the stated size is what is taken, and its checksum is then wrong."""
    bomb = zipped(("toy.onnx", b"\0" * 3_000_000))
    register_zip(
        server, register, bomb.replace((3_000_000).to_bytes(4, "little"), (1000).to_bytes(4, "little"))
    )
    assert "no sound zip file" in refused(capsys, "fetch", "toy")
    assert not (cache / "toy").exists()


# ------------------------------------------------------------------ the disk
def test_a_full_disk_is_said_before_and_during_a_download(
    toy: Server, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(shutil, "disk_usage", lambda _: types.SimpleNamespace(free=1000))
        assert "0 MB are free" in refused(capsys, "fetch", "toy")
    assert toy.asked == []

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(downloading._Pull, "_write", full)
    assert "the disk is full" in refused(capsys, "fetch", "toy")


def test_a_cache_that_cannot_be_written_is_named(
    toy: Server, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("ZSMOSEG_MODELS", str(tmp_path / "file" / "below"))
    assert "ZSMOSEG_MODELS sets another" in refused(capsys, "fetch", "toy")
    assert say(capsys, "list")[0] == 0


def test_two_processes_do_not_put_one_model_together(
    toy: Server, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    work = staging(cache / "toy")
    work.mkdir(parents=True)
    with FileLock(work.with_name(f"{work.name}.lock")):
        assert "wait for it" in refused(capsys, "fetch", "toy")
    assert main(["models", "fetch", "toy"]) == 0


# ------------------------------------------------------------------ finding
def test_a_model_is_found_by_name_or_path_and_reading_writes_nothing(
    tmp_path: Path, cache: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    mine = own(tmp_path / "mine", contract("mine"))
    assert find_model(str(mine)) == mine
    assert main(["models", "add", str(mine)]) == 0
    before = {p: p.stat().st_mtime_ns for p in cache.rglob("*")}
    assert find_model("mine") == cache / "mine"
    assert say(capsys, "list")[0] == say(capsys, "verify")[0] == 0
    assert {p: p.stat().st_mtime_ns for p in cache.rglob("*")} == before
    monkeypatch.delenv("ZSMOSEG_MODELS")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    if sys.platform == "linux":
        assert models_folder() == tmp_path / "xdg" / "zsmoseg" / "models"


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("sam-vit-b", "zsmoseg models fetch sam-vit-b"),
        ("pwc-net", "non-commercial only); get it with: zsmoseg models export pwc-net CHECKPOINT"),
        ("grounding-dino-tiny", "about 695 MB, Apache-2.0); get it with: zsmoseg models fetch"),
        ("rma-plus", "did you mean ram-plus?"),
        ("nothing-like-it", "see zsmoseg models list"),
        ("..", "has no contract.toml"),
        ("../cache", "has no contract.toml"),
        ("a b", "a name has letters, digits"),
        ("", "a name has letters, digits"),
    ],
)
def test_a_model_that_is_not_here_is_told_how_to_get(name: str, says: str) -> None:
    with pytest.raises(ModelError, match=re.escape(says)):
        find_model(name)


def test_the_list_says_what_is_here_for_people_and_programs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["models", "add", str(own(tmp_path / "mine", contract("mine")))])
    capsys.readouterr()
    lines = {line.split()[0]: line for line in say(capsys, "list")[1].splitlines()}
    assert "present" in lines["mine"]
    assert "non-commercial only" in lines["pwc-net"]
    assert "export only" in lines["pwc-net"]
    assert "64.1 MB" in lines["raft"]
    found = {row["name"]: row for row in json.loads(say(capsys, "list", "--json")[1])}
    assert found["mine"]["bytes"] == len(BYTES)
    assert found["pwc-net"]["commercial"] is False
    assert found["raft"]["command"] == "zsmoseg models fetch raft"


# ------------------------------------------------------------------ verifying
def test_verify_names_every_damage_and_fetch_gets_only_what_is_damaged(
    server: Server, register: Register, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = b"one\ntwo\n"
    server.files |= {"toy.onnx": BYTES, "words.txt": words}
    more = "".join(
        f'\n[{table}]\nfile = "{name}"\nsha256 = "{hashlib.sha256(content).hexdigest()}"\n'
        f'url = "{server.url}/{name}"\n'
        for table, name, content in [("graph.main", "toy.onnx", BYTES), ("tags.names", "words.txt", words)]
    )
    text = contract().split("[graph.main]")[0] + more + "\n[input]" + contract().split("[input]", 1)[1]
    register("toy", text)
    assert main(["models", "fetch", "toy"]) == 0
    assert say(capsys, "verify")[0] == 0
    (cache / "toy" / "words.txt").write_bytes(b"one\ntoo\n")
    code, out = say(capsys, "verify", "toy")
    assert code == 1
    assert f"{cache / 'toy' / 'words.txt'}: has sha256" in out.splitlines()[0]
    server.asked.clear()
    assert main(["models", "fetch", "toy"]) == 0
    assert [path for path, _ in server.asked] == ["words.txt"]
    (cache / "toy" / "toy.onnx").unlink()
    assert "incomplete" in say(capsys, "list")[1]
    assert "is missing" in say(capsys, "verify")[1]


# ------------------------------------------------------------------ models of one's own
def own(folder: Path, text: str, content: bytes = BYTES, file: str = "toy.onnx") -> Path:
    """A model folder."""
    folder.mkdir(parents=True)
    (folder / "contract.toml").write_text(text)
    (folder / file).write_bytes(content)
    return folder


def test_a_contract_without_digests_gets_them_when_it_is_added(
    tmp_path: Path, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = own(tmp_path / "mine", contract())
    (mine / "notes.txt").write_text("stays")
    code, out = say(capsys, "add", str(mine), "--name", "other")
    assert code == 0
    assert f"toy.onnx: sha256 {SHA} written" in out
    assert unlocked(cache / "other") == ["contract.toml", "toy.onnx"]
    added = load_contract(cache / "other")
    assert [(f.sha256, f.bytes) for f in added.files] == [(SHA, len(BYTES))]
    assert say(capsys, "add", str(mine), "--name", "other")[0] == 0
    own(tmp_path / "second", contract(), graph())
    assert "another model has this name" in refused(
        capsys, "add", str(tmp_path / "second"), "--name", "other"
    )


@pytest.mark.parametrize(
    ("text", "content", "file", "says"),
    [
        (contract(more=f'sha256 = "{"0" * 64}"'), BYTES, "toy.onnx", f"has sha256 {SHA}"),
        (contract(more="bytes = 5"), BYTES, "toy.onnx", "the contract says 5"),
        (contract(file="gone.onnx"), BYTES, "toy.onnx", "gone.onnx: is missing"),
        (contract(file="toy.pth"), BYTES, "toy.pth", "run code when loaded"),
        (contract(file=".."), BYTES, "toy.onnx", "'..' is refused"),
        (contract(file="../toy.onnx"), BYTES, "toy.onnx", "main.file"),
        (contract(file="contract.toml"), BYTES, "toy.onnx", "is refused"),
        (contract(), b"\x80\x04\x95pickle", "toy.onnx", "no ONNX file but a pickle"),
        (contract(), b"PK\x03\x04torch", "toy.onnx", "no ONNX file but a pickle"),
        (contract(), BYTES[:1000], "toy.onnx", "ONNX Runtime cannot load it"),
        (contract(output="flow"), BYTES, "toy.onnx", "has no output flow"),
        (contract(name="../evil"), BYTES, "toy.onnx", "name"),
        ("name = ", BYTES, "toy.onnx", "is not TOML"),
    ],
)
def test_a_model_that_is_not_sound_is_not_added(
    tmp_path: Path,
    cache: Path,
    capsys: pytest.CaptureFixture[str],
    text: str,
    content: bytes,
    file: str,
    says: str,
) -> None:
    assert says in refused(capsys, "add", str(own(tmp_path / "mine", text, content, file)))
    assert unlocked(cache) == []


def test_a_folder_without_a_contract_and_a_name_that_leaves_the_cache_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "has no contract.toml" in refused(capsys, "add", str(tmp_path))
    mine = own(tmp_path / "mine", contract())
    assert "a name has letters" in refused(capsys, "add", str(mine), "--name", "../mine")
    assert "a name has letters" in refused(capsys, "fetch", "../mine")
    assert "a name has letters" in refused(capsys, "fetch", ".hidden")


def test_a_model_of_ones_own_is_never_fetched(
    tmp_path: Path, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["models", "add", str(own(tmp_path / "mine", contract("mine")))])
    assert say(capsys, "fetch", "mine")[0] == 0
    (cache / "mine" / "toy.onnx").write_bytes(BYTES[:-1] + b"?")
    assert "add it again from where it came" in refused(capsys, "fetch", "mine")


def test_external_weights_come_along_and_are_checked(
    tmp_path: Path, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = onnx.load_from_string(BYTES)
    text = contract().replace("[input]", '[[graph.main.data]]\nfile = "toy.data"\n\n[input]', 1)
    mine = own(tmp_path / "mine", text)
    onnx.save_model(model, str(mine / "toy.onnx"), save_as_external_data=True, location="toy.data")
    assert say(capsys, "add", str(mine))[0] == 0
    assert unlocked(cache / "toy") == ["contract.toml", "toy.data", "toy.onnx"]
    assert all(file.sha256 for file in load_contract(cache / "toy").files)
    (mine / "contract.toml").write_text(contract())
    assert "its external data is missing" in refused(capsys, "add", str(mine), "--name", "other")


def test_a_contract_that_no_digest_can_be_written_into_says_what_to_write() -> None:
    text = 'name = "toy"\ntask = "depth"\ngraph = { main = { file = "toy.onnx" } }\n'
    with pytest.raises(ModelError, match=f'write sha256 = "{SHA}" and bytes = 5 beside file = "toy.onnx"'):
        with_digests(text, {"toy.onnx": (SHA, 5)}, Path("toy"))


# ------------------------------------------------------------------ exporting
@pytest.fixture
def exporter(register: Register, monkeypatch: pytest.MonkeyPatch) -> types.ModuleType:
    """An entry ``toy`` that a module ``fake`` exports."""
    extra = '[toy]\nexporter = ["fake", "export_toy"]\ncheckpoint = "toy.pth"\n'
    register("toy", contract(), extra)
    module = types.ModuleType("zsmoseg.networks.export.fake")

    def export_toy(checkpoint: Path, folder: Path, name: str) -> None:
        (folder / "toy.onnx").write_bytes(checkpoint.read_bytes())
        (folder / "scratch").write_text("goes")
        (folder / "contract.toml").write_text(contract(name))

    vars(module)["export_toy"] = export_toy
    monkeypatch.setitem(sys.modules, module.__name__, module)
    return module


def test_an_export_gets_its_place_when_it_is_whole(
    exporter: types.ModuleType, tmp_path: Path, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "toy.pth").write_bytes(BYTES)
    assert say(capsys, "export", "toy", str(tmp_path / "toy.pth"))[0] == 0
    assert unlocked(cache / "toy") == ["contract.toml", "toy.onnx"]
    assert load_contract(cache / "toy").digest
    assert "is there already" in refused(capsys, "export", "toy", str(tmp_path / "toy.pth"))
    assert say(capsys, "export", "toy", str(tmp_path / "toy.pth"), "--to", str(tmp_path / "there"))[0] == 0
    assert find_model(str(tmp_path / "there")) == tmp_path / "there"


def test_an_export_that_fails_leaves_nothing(
    exporter: types.ModuleType, tmp_path: Path, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "give the checkpoint (toy.pth)" in refused(capsys, "export", "toy", str(tmp_path / "gone"))
    (tmp_path / "toy.pth").write_bytes(b"no graph at all")
    assert "ONNX Runtime cannot load it" in refused(capsys, "export", "toy", str(tmp_path / "toy.pth"))

    def lacking(*_: Any, name: str) -> None:
        raise ImportError("No module named 'torch'")

    vars(exporter)["export_toy"] = lacking
    assert "pip install 'zsmoseg[export]'" in refused(capsys, "export", "toy", str(tmp_path / "toy.pth"))
    assert unlocked(cache) == []


def test_a_model_without_an_exporter_says_how_it_is_got(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert "zsmoseg models fetch efficient-sam-ti" in refused(
        capsys, "export", "efficient-sam-ti", str(tmp_path)
    )
