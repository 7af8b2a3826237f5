"""Stores, outputs and sources in a bucket: the same bytes as on a disk, whatever the server does."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter as Tally
from collections.abc import Iterator
from datetime import timedelta
from http.server import BaseHTTPRequestHandler, SimpleHTTPRequestHandler, ThreadingHTTPServer
from importlib.util import find_spec
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest

from tests.buckets import KEY, SECRET, Proxy, environment, s3_server
from tests.conftest import draw_clip, write_folder, write_mp4
from tests.runs import Counter, segment, without_records
from tests.stores_help import FINGERPRINT, make_artifact
from zsmoseg.errors import AccessError, VideoError
from zsmoseg.remote import bucket, connection, copies
from zsmoseg.remote.url import URL, folder, local_folder, place
from zsmoseg.settings import resolve
from zsmoseg.stores import files, leases
from zsmoseg.stores.checks import part_problem
from zsmoseg.stores.leases import lease
from zsmoseg.stores.location import Store
from zsmoseg.video.frames import read
from zsmoseg.video.probe import Excerpt, probe
from zsmoseg.video.sources import fingerprint, image_files, sources, stat_signature, unique_names
from zsmoseg.workflows.cli import main
from zsmoseg.workflows.running.request import Quiet, Report, Request, Watcher
from zsmoseg.workflows.running.run import run

needs_moto = pytest.mark.skipif(find_spec("moto") is None, reason="moto, the S3 server, is not installed")
FRAMES = draw_clip(0, 5, 48, 64)[0]
STORE, OUT, DATA = "s3://bucket/store", "s3://bucket/out", "s3://bucket/data"


def one_line(text: str, *parts: str) -> None:
    assert len(text.strip().splitlines()) == 1, text
    for part in parts:
        assert part in text
    assert KEY not in text
    assert SECRET not in text


# ------------------------------------------------------------------ URLs
def test_a_url_is_a_path_that_no_file_system_takes() -> None:
    clip = URL("s3://bucket/films/goat.mp4")
    assert (str(clip), clip.scheme, clip.bucket, clip.key) == (
        "s3://bucket/films/goat.mp4",
        "s3",
        "bucket",
        "films/goat.mp4",
    )
    assert str(clip.parent / "a" / "b.png") == "s3://bucket/films/a/b.png"
    assert (clip.relative_to(clip.parent).as_posix(), clip.stem, clip.suffix) == ("goat.mp4", "goat", ".mp4")
    assert clip == URL("s3://bucket//films/goat.mp4")
    with pytest.raises(TypeError, match="no file of this machine"):
        open(clip)  # type: ignore[call-overload]  # noqa: SIM115


@pytest.mark.parametrize("path", ["run:2", "C:/x", "s3", "a:b/c:d", "s3:x", "/abs:/x", "a?b=c", "me@host/x"])
def test_a_colon_makes_no_url(path: str) -> None:
    assert place(path) == local_folder(path) == Path(path)


def test_a_url_of_a_file_is_a_path() -> None:
    assert place("file:///tmp/a b") == Path("/tmp/a b")


@pytest.mark.parametrize(
    "url",
    [
        "https://me:hunter2@host/x.mp4",
        "s3://me:hunter2@bucket/x",
        "https://host/x.mp4?X-Amz-Signature=hunter2",
        "s3://bucket/x?token=hunter2",
        "az://box/x?sv=1&sig=hunter2",
        "https://host/x.mp4#hunter2=1",
    ],
)
@pytest.mark.parametrize(
    "option", ["source", "--store", "-o", "--proposals", "--flow", "--depth", "--ignore"]
)
def test_a_url_with_a_secret_is_refused_and_not_repeated(
    url: str, option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    clip = str(write_folder(tmp_path / "clip", FRAMES))
    words = [url] if option == "source" else [clip, option, url]
    assert main(["run", *words, "--scheduler", "serial"]) == 2
    told = capsys.readouterr()
    one_line(told.err)
    assert "hunter2" not in told.err + told.out
    left = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert not any(b"hunter2" in path.read_bytes() for path in left)


@pytest.mark.parametrize(
    ("url", "why"),
    [
        ("whatever+x://y/z", "of a kind that is not known"),
        ("s3:/bucket/x", "with two slashes"),
        ("https://host/x", "can only be read"),
        ("s3://bucket", "whole bucket"),
        ("s3://bucket/../x", "no URL of a folder"),
        ("s3:///x", "no URL of a folder"),
    ],
)
@pytest.mark.parametrize("option", ["--store", "-o"])
def test_a_url_that_no_store_can_have_is_refused_and_makes_no_folder(
    url: str,
    why: str,
    option: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["run", "clip", option, url]) == 2
    one_line(capsys.readouterr().err, why)
    assert list(tmp_path.iterdir()) == []


def test_what_is_written_for_others_goes_to_a_disk(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "clip", "--format", "coco", "-o", "s3://bucket/x"]) == 2
    one_line(capsys.readouterr().err, "s3://bucket/x", "give a path")


# ------------------------------------------------------------------ memory, in one process
@pytest.fixture
def memory() -> URL:
    connection.connect.cache_clear()
    found = place("memory://box/root")
    assert isinstance(found, URL)
    return found


def test_files_do_the_same_on_a_disk_and_behind_a_url(memory: URL, tmp_path: Path) -> None:
    for root in (tmp_path, memory):
        one = files.below(root, "a/b/one.json")
        assert files.read(one) is None
        assert not files.exists(root / "a")
        files.write(one, b"12345")
        assert (files.read(one), files.size(one), files.read_range(one, 1, 2)) == (b"12345", 5, b"23")
        assert files.read_range(one, 9, 2) == b""
        before = files.stamp(one)
        files.write_whole(one, b"1234567")
        assert files.stamp(one) != before
        assert files.create(one, b"mine") is None
        assert files.create(root / "a" / "two.json", b"mine") is not None
        assert [path.name for path in files.folders(root / "a")] == ["b"]
        assert [path.name for path in files.inside(root / "a")] == ["b", "two.json"]
        assert [path.name for path in files.matching(root / "a", "*.json")] == ["two.json"]
        assert files.tree(root) == ["a/b/one.json", "a/two.json"]
        assert files.size(root / "a") == 11
        grown = files.Appended(root / "a" / "grown")
        assert (grown.add(b"ab"), grown.add(b"c")) == (0, 2)
        grown.close()
        with files.appearing(root / "a" / "film") as partial:
            partial.write_bytes(b"film")
        with pytest.raises(ZeroDivisionError), files.appearing(root / "a" / "no") as partial:
            partial.write_bytes(bytes(1 // 0))
        assert {name: stat.size for name, stat in files.listing(root / "a").items()} == {
            "b/one.json": 7,
            "film": 4,
            "grown": 3,
            "two.json": 4,
        }
        files.remove(root / "a" / "b")
        files.unlink(root / "a" / "two.json")
        files.unlink(root / "a" / "two.json")
        assert files.tree(root) == ["a/film", "a/grown"]


def test_a_lease_is_held_by_one_and_taken_over_from_one_that_is_gone(
    memory: URL, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(leases, "_heart", leases._Heart())
    for name, value in (("EXPIRY", 0.2), ("FAR_PAUSE", 0.05), ("BEAT", 0.02)):
        monkeypatch.setattr(leases, name, value)
    path = memory / "part.lease"
    files.write(path, json.dumps({"host": "elsewhere", "pid": 1, "started": 0.0}).encode())
    with lease(path) as ours:
        assert ours
        first = files.stamp(path)
        for _ in range(3):
            with lease(path, lambda: True) as second:
                assert not second
        leases.time.sleep(0.2)
        assert files.stamp(path) != first, "it beats"
    assert files.read(path) is None


def test_of_two_that_take_a_lease_over_one_gets_it(memory: URL, tmp_path: Path) -> None:
    for root in (memory, tmp_path):
        path = root / "part.lease"
        files.write(path, b"somebody's")
        seen = files.signature(path)
        assert seen is not None
        assert files.take(path, b"first", seen) is not None
        assert files.take(path, b"second", seen) is None
        assert files.read(path) == b"first"


def test_a_request_whose_answer_was_lost_is_known_again(memory: URL) -> None:
    """The first attempt wrote, its answer was lost, the second is refused: the file is ours all the same."""
    files.write(memory / "part.lease", b"mine")
    assert files.create(memory / "part.lease", b"mine") is not None
    assert files.create(memory / "part.lease", b"other") is None


def test_a_machine_without_hard_links_makes_leases_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "link", refuse)
    assert files.create(tmp_path / "part.lease", b"mine") is not None
    assert files.create(tmp_path / "part.lease", b"other") is None
    assert [path.name for path in tmp_path.iterdir()] == ["part.lease"]


def test_a_dataset_behind_a_url_is_found_as_on_a_disk(memory: URL, tmp_path: Path) -> None:
    names = [
        "JPEGImages/480p/a/0.jpg",
        "JPEGImages/480p/a/1.jpg",
        "JPEGImages/480p/b/0.jpg",
        "c/x.mp4",
        "c/.h.png",
    ]
    for root in (tmp_path, memory):
        for name in names:
            files.write(root / name, name.encode())
    for pattern in (
        "",
        "c",
        "JPEGImages/*/a",
        "JPEGImages/480p/*",
        "**/0.jpg",
        "JPEGImages/480p/?/[01].jpg",
        "*/x.mp4",
    ):
        local, far = (sources([f"{root}/{pattern}".rstrip("/")]) for root in (tmp_path, memory))
        assert [name.replace(str(tmp_path), str(memory)) for name in local] == far, pattern
        assert unique_names(local) == unique_names(far)
        for one, other in zip(local, far, strict=True):
            assert len(image_files(one)) == len(image_files(other))
            assert fingerprint(one, "content") == fingerprint(other, "content")
    with pytest.raises(VideoError, match="no such file"):
        sources([f"{memory}/nothing"])


def test_a_film_on_a_web_server_is_a_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Served(SimpleHTTPRequestHandler):
        def __init__(self, *words: Any) -> None:
            super().__init__(*words, directory=str(tmp_path / "web"))

        def log_message(self, *words: object) -> None:
            return

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    (tmp_path / "web").mkdir()
    film = write_mp4(tmp_path / "web" / "a film.mp4", FRAMES)
    with ThreadingHTTPServer(("127.0.0.1", 0), Served) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        root = f"http://127.0.0.1:{server.server_address[1]}"
        far, near = sources([f"{root}/a%20film.mp4", str(film)])
        assert fingerprint(far, "content") == fingerprint(near, "content")
        excerpt = resolve().video.parameters(Excerpt)
        looked = [probe(source, excerpt) for source in (far, near)]
        frames = [np.stack(list(read(one, 0, 5))) for one in looked]
        assert np.array_equal(*frames)
        with pytest.raises(VideoError, match="no such file"):
            sources([f"{root}/nothing.mp4"])
        server.shutdown()


@pytest.mark.parametrize(
    ("stated", "says"),
    [
        (10**15, "the server states 1000000.0 GB"),
        (2**63 - 1, "the server states 9223372036.9 GB"),
        (2000, "the content ends before the length that the server states"),
        (1001, "the content ends before the length that the server states"),
    ],
)
def test_a_length_that_cannot_be_ends_in_a_line(
    stated: int,
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    class Stating(BaseHTTPRequestHandler):
        def log_message(self, *words: object) -> None:
            return

        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Length", str(stated))
            self.send_header("ETag", '"a"')
            self.send_header("Last-Modified", "Wed, 01 Jan 2025 00:00:00 GMT")
            self.end_headers()
            if self.command == "GET":
                self.wfile.write(bytes(1000))

        do_HEAD = do_GET

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with ThreadingHTTPServer(("127.0.0.1", 0), Stating) as server:
        Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        film = f"http://127.0.0.1:{server.server_address[1]}/film.mp4"
        where = ["-o", str(tmp_path / "out"), "--store", str(tmp_path / "store"), "--scheduler", "serial"]
        assert main(["run", film, *where]) == 2
        one_line(capsys.readouterr().err, film, says)
        server.shutdown()
    assert list(copies.folder().iterdir()) == []


def test_copies_stay_within_their_bound(memory: URL, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(copies, "BOUND", 25)
    monkeypatch.setattr(copies, "RECENT", -1.0)
    for n in range(4):
        files.write(memory / f"{n}.png", b"0123456789")
        copy = copies.local_copy(memory / f"{n}.png")
        assert copy.read_bytes() == b"0123456789"
    assert len(list(copies.folder().iterdir())) == 2
    files.write(memory / "3.png", b"other")
    assert copies.local_copy(memory / "3.png").read_bytes() == b"other"
    assert not copy.exists(), "what was replaced goes"
    copies.folder().chmod(0o777)
    with pytest.raises(AccessError, match="others may write there"):
        copies.local_copy(memory / "3.png")


def test_what_another_took_back_meanwhile_stays_taken_back(memory: URL) -> None:
    """A task that found damage, too, goes by what is there now, not by what it saw when it began."""
    store = Store.open(str(memory / "store"), create=True)
    store.describe_video(store.video_id("goat", FINGERPRINT), "goat.mp4", FINGERPRINT)
    artifact = make_artifact(store)
    with files.glancing_at(artifact.path.parent):
        assert not [i for i in range(3) if part_problem(artifact, i)]
        other = Thread(
            target=artifact.invalidate, args=([0],)
        )  # of another process: this thread does not know
        other.start()
        other.join()
        artifact.invalidate([1])
    assert [i for i in range(3) if part_problem(artifact, i)] == [0, 1]


# ------------------------------------------------------------------ S3
@pytest.fixture(scope="module")
def s3(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Proxy]:
    root = tmp_path_factory.mktemp("s3")
    (root / "tmp").mkdir()
    with pytest.MonkeyPatch.context() as patch, s3_server(root / "log") as proxy:
        for name, value in {**environment(proxy), "TMPDIR": str(root / "tmp"), "HOME": str(root)}.items():
            patch.setenv(name, value)
        patch.setattr("tempfile.tempdir", str(root / "tmp"))
        connection.connect.cache_clear()
        for n, image in enumerate(write_folder(root / "clip", FRAMES).iterdir()):
            assert bucket.put(URL(f"{DATA}/clip/{image.name}"), image.read_bytes()), n
        yield proxy
    connection.connect.cache_clear()


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run to compare with."""
    root = tmp_path_factory.mktemp("local")
    report, _ = segment(write_folder(root / "data" / "clip", FRAMES), root)
    assert not report.failures
    return root


def remote_run(
    store: str = STORE,
    out: str = OUT,
    source: str = f"{DATA}/clip",
    watcher: Watcher | None = None,
    **more: object,
) -> tuple[Report, Counter]:
    counter = Counter()
    request = Request(
        [source],
        folder(out),
        folder(store),
        resolve(overrides={"chunk.length": 4}),
        "serial",
        **more,  # type: ignore[arg-type]
    )
    return run(request, watcher or counter), counter


@pytest.fixture(scope="module")
def finished(s3: Proxy) -> Report:
    report, counter = remote_run()
    assert not report.failures
    assert "masks" in counter.stages
    return report


def content(root: Path | URL) -> dict[str, bytes]:
    """Every array, table and image, without records of time and place."""
    return without_records({name: files.read(root / name) or b"" for name in files.listing(root)})


@needs_moto
def test_store_and_output_hold_the_bytes_that_a_disk_would(finished: Report, local: Path) -> None:
    for far, near in ((STORE, local / "store"), (OUT, local / "out")):
        found = place(far)
        assert content(found) == content(near)
    assert sorted(files.tree(place(OUT))) == sorted(files.tree(local / "out"))


@needs_moto
def test_a_second_run_does_nothing_and_downloads_nothing(finished: Report, s3: Proxy) -> None:
    s3.requests.clear()
    report, counter = remote_run()
    assert not counter.parts
    assert not report.failures
    assert len(s3.counted("GET", "prefix=data/clip/")) == 2, "to find it, and to plan it"
    assert len(s3.counted("GET", "prefix=store/clip-")) == 1
    assert not s3.counted("PUT", "/out/"), "nothing is written again"
    ours = [
        path for _, path in s3.requests if "clip" in path or ("fingerprints/" in path and ".json" in path)
    ]
    assert len(ours) <= 11, "ten a video, and the listing by which it was found"
    assert len(s3.requests) - len(ours) < 10, "of the run"


@needs_moto
def test_the_fingerprint_is_that_of_the_content_and_costs_one_listing(
    finished: Report, s3: Proxy, local: Path
) -> None:
    near = str(local / "data" / "clip")
    assert fingerprint(f"{DATA}/clip", "content") == fingerprint(near, "content")
    s3.requests.clear()
    assert stat_signature(f"{DATA}/clip") == stat_signature(f"{DATA}/clip")
    assert [method for method, _ in s3.requests] == ["GET", "GET"]


@needs_moto
def test_the_commands_answer_from_a_bucket(
    finished: Report, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for command, told in (
        ("status", "done"),
        ("runs", "1 video: clip"),
        ("verify", "every file is as it was written"),
        ("repair --yes", "every file is as it was written"),
        ("gc --yes", "0 artifacts and leftovers"),
        ("explain clip", "object"),
    ):
        assert main([*command.split(), "--store", STORE]) == 0, command
        assert told in capsys.readouterr().out
    assert main(["export", "clip", "--store", STORE, "-o", str(tmp_path / "x"), "--format", "coco"]) == 0
    from zsmoseg import open_store

    result = open_store(STORE)["clip"]
    assert result.tree["flow/forward"].shape[0] == len(FRAMES) - 1
    assert result.masks("group").values.shape == FRAMES.shape[:3]


@needs_moto
def test_a_first_run_asks_a_task_for_a_listing_not_for_file_after_file(finished: Report, s3: Proxy) -> None:
    s3.requests.clear()
    report, counter = remote_run(f"{STORE}2", f"{OUT}2")
    assert not report.failures
    parts, listings = len(counter.parts), s3.counted("GET", "list-type")
    assert len(s3.counted("HEAD")) < 2 * parts
    assert len(listings) < 7 * parts
    reads = [path for path in s3.counted("GET", "store2/clip-") if path not in listings]
    assert max(Tally(reads).values()) <= 4, "no file is read again for each of its tables"
    assert len(s3.requests) - len(s3.counted("PUT")) < 20 * parts


@needs_moto
def test_a_folder_of_more_than_one_listing_is_asked_file_by_file_once(
    s3: Proxy, monkeypatch: pytest.MonkeyPatch
) -> None:
    many = place(f"{STORE}3")
    for i in range(3):
        files.write(many / f"{i}.txt", b"x")
    monkeypatch.setattr(bucket, "BATCH", 2)
    s3.requests.clear()
    with files.glancing_at(many):
        for _ in range(3):
            assert files.stamp(many / "0.txt")
            assert files.stamp(many / "9.txt") is None
        files.write(many / "9.txt", b"xy")
        assert files.size(many / "9.txt") == 2
    assert len(s3.counted("HEAD")) == 2
    assert len(s3.counted("GET", "list-type")) == 1


@needs_moto
def test_status_lists_the_store_once(finished: Report, s3: Proxy, capsys: pytest.CaptureFixture[str]) -> None:
    s3.requests.clear()
    assert main(["status", "--store", STORE]) == 0
    assert not s3.counted("HEAD")


@needs_moto
def test_damage_in_a_bucket_is_found_taken_back_and_made_again(
    finished: Report, capsys: pytest.CaptureFixture[str]
) -> None:
    store, out = place(STORE), place(OUT)
    before = content(store), content(out)
    mask = next(name for name in files.tree(out) if name.endswith(".png"))
    files.write(out / mask, b"no picture")
    table = next(name for name in files.tree(store) if name.endswith("0000.tables"))
    files.write(store / table, (files.read(store / table) or b"")[:-1] + b"x")
    assert main(["verify", "--store", STORE]) == 1
    assert f"{out / mask}: has other content" in capsys.readouterr().out
    assert main(["repair", "--store", STORE, "--yes"]) == 0
    report, counter = remote_run()
    assert not report.failures
    assert counter.parts
    assert (content(store), content(out)) == before


@needs_moto
def test_a_source_that_changes_fails_by_name(s3: Proxy, local: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for image in sorted((local / "data" / "clip").iterdir()):
        bucket.put(URL(f"{DATA}/moving/{image.name}"), image.read_bytes())
    from zsmoseg.workflows.running import batch as module

    original = module.prepare

    def change(*words: object) -> None:
        original(*words)  # type: ignore[arg-type]
        bucket.put(URL(f"{DATA}/moving/00001.png"), (local / "data" / "clip" / "00003.png").read_bytes())

    monkeypatch.setattr(module, "prepare", change)
    report, _ = remote_run(
        "s3://bucket/other", "s3://bucket/other-out", f"{DATA}/moving", Quiet(), until=["frames"]
    )
    assert "changed since the run was planned" in report.failures["moving"]


@needs_moto
def test_a_video_file_is_read_through_a_copy(s3: Proxy, tmp_path: Path) -> None:
    film = write_mp4(tmp_path / "film.mp4", FRAMES)
    bucket.put(URL(f"{DATA}/film.mp4"), film.read_bytes())
    report, far = remote_run(
        "s3://bucket/films", "s3://bucket/films-out", f"{DATA}/film.mp4", until=["frames"]
    )
    assert not report.failures
    _, near = segment(film, tmp_path, until=["frames"])
    assert near.plans[0].fingerprint == far.plans[0].fingerprint
    assert content(place("s3://bucket/films")) == content(tmp_path / "store")
    s3.answers.clear()
    remote_run("s3://bucket/films", "s3://bucket/films-out", f"{DATA}/film.mp4", until=["frames"])
    asked = [status for method, path, status in s3.answers if method == "GET" and path.endswith("film.mp4")]
    assert set(asked) <= {304}, "nothing is downloaded again"


# ------------------------------------------------------------------ faults
@needs_moto
def test_a_server_that_is_busy_now_and_then_changes_nothing(
    s3: Proxy, finished: Report, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(connection.RETRY["backoff"], "init_backoff", timedelta(milliseconds=5))
    connection.connect.cache_clear()
    with s3.failing(lambda n, method, path: (0, 500, 0, 503)[n % 20 // 5] if n % 5 == 0 else 0):
        report, _ = remote_run("s3://bucket/busy", "s3://bucket/busy-out", until=["depth", "flow"])
    assert not report.failures
    connection.connect.cache_clear()
    done = content(place("s3://bucket/busy"))
    assert done
    assert done.items() <= content(place(STORE)).items()


@needs_moto
@pytest.mark.parametrize("status", [503, -1, 403])
def test_a_server_that_gives_no_answer_ends_in_one_line(
    status: int, s3: Proxy, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(connection.RETRY, "max_retries", 1)
    monkeypatch.setenv("AWS_TIMEOUT", "1s")
    connection.connect.cache_clear()
    told = {503: "answers 503", -1: "does not answer in time", 403: "access was refused"}[status]
    with s3.failing(lambda n, method, path: status):
        assert main(["run", f"{DATA}/clip", "--store", STORE, "-o", OUT, "--scheduler", "serial"]) == 2
        one_line(capsys.readouterr().err, "s3://bucket/", told)
        assert main(["status", "--store", STORE]) == 2
        one_line(capsys.readouterr().err, "s3://bucket/", told)
    connection.connect.cache_clear()


@needs_moto
def test_a_server_that_fails_in_the_middle_fails_the_video_and_not_the_store(
    s3: Proxy, finished: Report, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(connection.RETRY, "max_retries", 0)
    connection.connect.cache_clear()
    out = "s3://bucket/broken-out"
    with s3.failing(
        lambda n, method, path: 500 if method == "PUT" and "/flow/" in path and "tables" in path else 0
    ):
        report, _ = remote_run("s3://bucket/broken", out, watcher=Quiet(), until=["flow"])
    assert "answers 500" in report.failures["clip"]
    connection.connect.cache_clear()
    report, counter = remote_run("s3://bucket/broken", out, until=["flow"])
    assert not report.failures
    assert counter.stages == {"flow"}
    assert content(place("s3://bucket/broken")).items() <= content(place(STORE)).items()


@needs_moto
def test_no_such_bucket_and_no_server_are_said(
    s3: Proxy, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(connection.RETRY, "max_retries", 0)
    assert main(["status", "--store", "s3://nobodys/store"]) == 2
    one_line(capsys.readouterr().err, "no such bucket")
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    assert main(["status", "--store", "s3://unreached/store"]) == 2
    one_line(capsys.readouterr().err, "cannot be reached")
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.delenv(name)
    monkeypatch.setenv("AWS_CONTAINER_CREDENTIALS_FULL_URI", "http://127.0.0.1:9/credentials")
    assert main(["status", "--store", "s3://unsigned/store"]) == 2
    one_line(capsys.readouterr().err, "credentials")


@needs_moto
def test_a_run_that_is_killed_goes_on_where_it_was(s3: Proxy, finished: Report) -> None:
    store, out = "s3://bucket/killed", "s3://bucket/killed-out"
    words = [
        "run",
        f"{DATA}/clip",
        "--store",
        store,
        "-o",
        out,
        "--scheduler",
        "serial",
        "--set",
        "chunk.length=4",
    ]
    code = f"from zsmoseg.workflows.cli import main; raise SystemExit(main({words!r}))"
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )

    def kill(n: int, method: str, path: str) -> int:
        if method == "PUT" and "/segments/" in path and path.endswith("0001.lease"):
            process.kill()
        return 0

    with s3.failing(kill):
        assert process.wait(60) == -9
    report, counter = remote_run(store, out)
    assert not report.failures
    assert ("segments", 1) in counter.parts
    assert ("segments", 0) not in counter.parts, "what was finished is kept"
    assert content(place(store)) == content(place(STORE))
    assert content(place(out)) == content(place(OUT))


@needs_moto
def test_no_file_and_no_line_holds_a_secret(s3: Proxy, finished: Report) -> None:
    for root in (STORE, OUT, "s3://bucket/broken"):
        found = place(root)
        for name in files.listing(found):
            held = files.read(found / name) or b""
            assert KEY.encode() not in held
            assert SECRET.encode() not in held
