"""The command line: ``zsmoseg COMMAND``; one file a command, each imported only when it is called."""

from __future__ import annotations

import argparse
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from io import TextIOWrapper
from types import ModuleType
from typing import NoReturn

from zsmoseg import __version__
from zsmoseg.errors import ZsmosegError, system_errors_in_words

COMMANDS = {
    "run": "segment videos: what is missing is computed, the rest is kept",
    "demo": "render a synthetic clip, segment it and score it",
    "import": "bring masks, flow or depth that you already have into a store",
    "export": "the result for other tools: masks, tracks, cues",
    "evaluate": "score masks against the truth of a dataset, as the official evaluators do",
    "models": "the networks: what there is, how to get it, whether it is whole",
    "ablate": "one setting after the other over one set of cached cues, scored",
    "status": "what the store holds of each video",
    "explain": "why each object was called moving or static",
    "verify": "check every file of the store and the output folders; exits with 1 when something is wrong",
    "repair": "take back what verify finds, so that the next run makes it again",
    "gc": "remove what no remembered run reaches",
    "runs": "the runs that the store remembers",
    "settings": "all settings: default, unit, allowed values, meaning",
}


EXIT = (
    "exit codes: 0 done; 1 some videos failed after the start, or verify found something; 2 nothing was started, the line "
    "says why; 130 stopped by Ctrl-C or SIGTERM, what was finished is kept"
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Returns
    -------
    0; 1: some videos failed, or ``verify`` found something; 2: nothing was started, the line says why; 130: stopped
    by Ctrl-C or SIGTERM.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    if isinstance(sys.stdout, TextIOWrapper):  # names of files need not be text
        sys.stdout.reconfigure(errors="backslashreplace")
    command = words[0] if words and words[0] in COMMANDS else None
    try:
        parser = _parser(command)
        options = parser.parse_args(words)
        if command is None:
            parser.print_help()
            return 2
        options.words = words
        with system_errors_in_words(), _terminated_like_interrupted():
            return int(_module(command).main(options))
    except ZsmosegError as error:
        print(f"zsmoseg: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        if arguments is None:  # once more, while Dask lets go of its processes: at once, and without a word
            signal.signal(signal.SIGINT, signal.SIG_DFL)
        print("zsmoseg: interrupted; what was finished is kept", file=sys.stderr)
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 0


@contextmanager
def _terminated_like_interrupted() -> Iterator[None]:
    """SIGTERM, by which batch systems end a job, lets go of everything as Ctrl-C does."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        """One line, exit code 2."""
        self.exit(2, f"zsmoseg: {message}; see {self.prog} --help\n")


def _parser(command: str | None) -> argparse.ArgumentParser:
    """The parser; only the called command's options are built."""
    parser = _Parser(
        "zsmoseg",
        description="Finds what moves by itself in a video from a moving camera, without training.",
        epilog=EXIT,
    )
    parser.add_argument("--version", action="version", version=f"zsmoseg {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", title="commands")
    for name, what in COMMANDS.items():
        sub = commands.add_parser(name, help=what, description=what, epilog=EXIT)
        if name == command:
            _module(name).options(sub)
    return parser


def _module(command: str) -> ModuleType:
    """The file of a command; ``import`` is no name for a module."""
    return import_module(f"zsmoseg.workflows.cli.{'import_' if command == 'import' else command}")
