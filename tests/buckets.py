"""A server that speaks S3 (moto, in a process of its own), behind a proxy that counts requests and makes faults."""

from __future__ import annotations

import http.client
import socket
import subprocess
import sys
import threading
import time
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

KEY, SECRET = "AKIDNOBODYKNOWS", "SECRETNOBODYKNOWS"
Fault = Callable[[int, str, str], int]
"""Of the number, method and path of a request: an HTTP status instead of an answer, -1 for none at all, 0 for no fault."""


class Proxy(ThreadingHTTPServer):
    """Hands requests on to ``port``."""

    daemon_threads = True
    request_queue_size = 64

    def __init__(self, port: int) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.port = port
        self.requests: list[tuple[str, str]] = []
        self.answers: list[tuple[str, str, int]] = []
        self.fault: Fault | None = None

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"

    def counted(self, method: str = "", part: str = "") -> list[str]:
        """The paths that were asked for with ``method`` and hold ``part``."""
        return [path for verb, path in self.requests if verb.startswith(method) and part in path]

    @contextmanager
    def failing(self, fault: Fault) -> Iterator[None]:
        self.requests.clear()
        self.fault = fault
        try:
            yield
        finally:
            self.fault = None


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    wbufsize = -1
    server: Proxy

    def log_message(self, *words: object) -> None:
        return

    def handle_one_request(self) -> None:
        try:
            super().handle_one_request()
        except OSError:  # the client had enough
            self.close_connection = True

    def _pass(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        path = urllib.parse.unquote(self.path)
        self.server.requests.append((self.command, path))
        fault = self.server.fault
        status = fault(len(self.server.requests), self.command, path) if fault else 0
        if status < 0:
            time.sleep(30)
            return
        if status:
            self._answer(status, {}, b"<Error><Code>Busy</Code></Error>")
            return
        onward = http.client.HTTPConnection("127.0.0.1", self.server.port)
        onward.request(self.command, self.path, body, dict(self.headers))
        found = onward.getresponse()
        self.server.answers.append((self.command, path, found.status))
        self._answer(found.status, dict(found.getheaders()), found.read())
        onward.close()

    def _answer(self, status: int, headers: dict[str, str], content: bytes) -> None:
        self.send_response_only(status)
        for name, value in headers.items():
            if name.lower() not in ("transfer-encoding", "connection", "content-length"):
                self.send_header(name, value)
        length = headers.get("Content-Length") if self.command == "HEAD" else None
        self.send_header("Content-Length", length or str(len(content)))
        self.end_headers()
        self.wfile.write(b"" if self.command == "HEAD" else content)
        self.wfile.flush()

    do_GET = do_PUT = do_POST = do_HEAD = do_DELETE = _pass


@contextmanager
def s3_server(log: Path) -> Iterator[Proxy]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with log.open("wb") as out:
        words = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
        server = subprocess.Popen(words, stdout=out, stderr=out)
    proxy = Proxy(port)
    threading.Thread(target=proxy.serve_forever, daemon=True).start()
    try:
        for _ in range(300):
            try:
                urllib.request.urlopen(
                    urllib.request.Request(f"http://127.0.0.1:{port}/bucket", method="PUT")
                )
                break
            except OSError:
                time.sleep(0.1)
        yield proxy
    finally:
        proxy.shutdown()
        proxy.server_close()
        server.kill()
        server.wait()


def environment(proxy: Proxy) -> dict[str, str]:
    return {
        "AWS_ACCESS_KEY_ID": KEY,
        "AWS_SECRET_ACCESS_KEY": SECRET,
        "AWS_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": proxy.url,
        "AWS_ALLOW_HTTP": "true",
    }
