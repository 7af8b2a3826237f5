"""The scheduler of somebody's Dask cluster: what may stand for one, told before anything is started; the first word from it."""

from __future__ import annotations

import asyncio
import json
import os
import stat
import time
from collections.abc import Callable
from contextlib import suppress
from http.client import HTTPConnection, HTTPException
from typing import Any

from zsmoseg.errors import ClusterError, SettingsError
from zsmoseg.workflows.running.workers import within

CONNECT = 10.0
"""Seconds for the first answer of a scheduler that runs: it takes milliseconds."""
TICK = 1.0
"""Seconds from one look at the cluster to the next while no result comes."""
SETTLING = 2.0
"""Seconds in which a scheduler file may be half there: the scheduler may be writing it."""
LARGEST = 1 << 26
"""Bytes of a scheduler file at most; ``Client.write_scheduler_file`` names every worker, in some KB each."""
HIGHEST = 65535
"""Of ports."""
KINDS = "give local, serial, an address (tcp://HOST:8786) or a scheduler file"
WEB = ("ws", "wss")
"""Schemes of Dask that are spoken by web servers."""

Wait = Callable[[float, str, str], None]
"""Takes since when, for what is waited, and what to do: says it, raises ``ClusterError`` when patience is at an end."""


def check_scheduler(where: Any) -> None:
    """Whether ``where`` can be a scheduler; nothing is connected to.

    Raises
    ------
    SettingsError
        If it is no word, address or scheduler file that Dask can read, nor a ``distributed.Client`` that is connected.
    """
    if isinstance(where, str):
        if where not in ("local", "serial") and not _comes_later(where):
            scheduler_address(where)
        return
    from distributed import Client

    if not isinstance(where, Client):
        raise SettingsError(
            f"scheduler: is of type {type(where).__name__}; expected 'local', 'serial', the address of a scheduler, "
            "its file, all as text, or a distributed.Client"
        )
    if where.status != "running" or where.asynchronous:
        state = "asynchronous" if where.status == "running" else where.status
        raise SettingsError(f"scheduler: this distributed.Client is {state}; give one that is connected")


def scheduler_address(where: str) -> str:
    """The address that ``where`` is, or that the scheduler file of this name holds.

    Raises
    ------
    SettingsError
        If it is none, or the file is bad.
    """
    address = _address_in(where) if _is_file(where) else where
    try:
        _check_address(address)
    except Exception as error:  # whatever the parsers of Dask's protocols raise
        words = str(error) or type(error).__name__
        if _is_file(where):
            raise SettingsError(
                f"--scheduler {where}: is no scheduler file, its address {address!r} is none ({words}); "
                "start the scheduler again with --scheduler-file"
            ) from error
        raise SettingsError(
            f"--scheduler {where!r}: is no address of a scheduler ({words}), and no file of this name is there; {KINDS}"
        ) from error
    return address


def connect(where: str, patience: float, wait: Wait) -> Any:
    """A ``distributed.Client`` of the scheduler at an address or of a scheduler file; waited for ``patience`` s at most.

    Raises
    ------
    SettingsError, ClusterError
        If that is none; if none answers there.
    """
    from distributed import Client

    begun = time.monotonic()
    while _comes_later(where):  # a job script starts the scheduler beside the run
        wait(begun, f"scheduler file {where}", "start the scheduler")
        time.sleep(TICK)
    address, begun = scheduler_address(where), time.monotonic()
    try:
        while not _answers(address, max(TICK, min(CONNECT, patience))):
            _refuse_web_server(where, address)
            wait(
                begun,
                f"answer of the scheduler {where}",
                "look whether it is stopped or too busy, and whether this is its own port (8786 as a rule), not that of "
                "its dashboard or of another program,",
            )
        return within(2 * CONNECT, lambda: Client(address, timeout=CONNECT, set_as_default=False))
    except ClusterError:
        raise
    except Exception as error:
        _refuse_web_server(where, address)
        raise ClusterError(
            f"--scheduler {where}: no Dask scheduler answers there ({error or type(error).__name__}); {KINDS}"
        ) from error


def _is_file(where: str) -> bool:
    return os.path.exists(where) or where.endswith(".json")


def _comes_later(where: str) -> bool:
    return _is_file(where) and not os.path.exists(where)


def _address_in(file: str) -> str:
    """What a scheduler file says, once it is whole."""
    end = time.monotonic() + SETTLING
    while True:
        try:
            return _address_of(_content(file))
        except (OSError, ValueError, RecursionError) as error:
            if isinstance(error, ValueError) and time.monotonic() < end:
                time.sleep(SETTLING / 20)
                continue
            words = "nested too deep" if isinstance(error, RecursionError) else error
            raise SettingsError(
                f"--scheduler {file}: is no scheduler file ({getattr(error, 'strerror', None) or words}); start the scheduler "
                "again with --scheduler-file, or give its address"
            ) from error


def _content(file: str) -> bytes:
    """Of a plain file; whatever else has a name, as pipes and devices, may never end."""
    mode = os.stat(file).st_mode
    if not stat.S_ISREG(mode):
        raise OSError(0, "a folder" if stat.S_ISDIR(mode) else "a pipe or a device")
    with open(file, "rb") as stream:
        content = stream.read(LARGEST + 1)
    if len(content) > LARGEST:
        raise OSError(0, f"larger than {LARGEST >> 20} MiB")
    return content


def _address_of(content: bytes) -> str:
    if not content.strip():
        raise ValueError("it is empty")
    try:
        address = json.loads(content)["address"]
    except (KeyError, TypeError, IndexError) as error:
        raise ValueError("it holds no address") from error
    if not isinstance(address, str):
        raise ValueError(f"its address is {address!r:.40}")
    return address


def _check_address(address: str) -> None:
    """Raise if Dask's own parser cannot read it, or nobody can listen there."""
    from distributed.comm import parse_address
    from distributed.comm.registry import get_backend

    scheme, place = parse_address(address)
    with suppress(NotImplementedError):  # protocols without host and port
        host, port = get_backend(scheme).get_address_host_port(place)
        if not host or not 0 < port <= HIGHEST:
            raise ValueError(f"ports are 1 to {HIGHEST}" if host else "no host")


def _answers(address: str, limit: float) -> bool:
    """Whether a scheduler says who it is; False where somebody takes the connection and says nothing for ``limit`` s.

    ``Client`` itself would wait for ever: its timeout does not hold for the words exchanged first.

    Raises
    ------
    Exception
        Whatever Dask raises where the connection or the answer is none.
    """
    from distributed.comm import connect as open_comm
    from distributed.security import Security

    async def ask() -> None:
        comm = await open_comm(address, timeout=limit, **Security().get_connection_args("client"))
        try:
            await comm.write({"op": "identity", "n_workers": 0, "reply": True})
            await comm.read()
        finally:
            comm.abort()

    async def in_time() -> bool:
        asked = asyncio.ensure_future(ask())
        done, _ = await asyncio.wait({asked}, timeout=limit + TICK)
        if done:
            asked.result()
        asked.cancel()
        return bool(done)

    return within(2 * (limit + CONNECT), lambda: asyncio.run(in_time()))


def _refuse_web_server(where: str, address: str) -> None:
    """Raise ``ClusterError`` if what listens there speaks HTTP, as dashboards do."""
    from distributed.comm import get_address_host_port, parse_address

    if parse_address(address)[0] in WEB:
        return
    try:
        host, port = get_address_host_port(address)
        connection = HTTPConnection(host, port, timeout=TICK)
        try:
            connection.request("HEAD", "/")
            connection.getresponse()
        finally:
            connection.close()
    except (OSError, ValueError, HTTPException):
        return
    raise ClusterError(
        f"--scheduler {where}: a web server answers there, as the dashboard of a scheduler is one; give the scheduler's own "
        "address (tcp://HOST:8786 as a rule; it prints it when it starts)"
    )
