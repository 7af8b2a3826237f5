"""Settings: cheap to look at, in words, gone with an answer, and handed to the science by name."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass, fields, is_dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, get_type_hints

import pytest

from zsmoseg.errors import SettingsError
from zsmoseg.flow.dis import Dis
from zsmoseg.flow.pairs import PairCriteria
from zsmoseg.grouping.core import Core
from zsmoseg.grouping.geometry import Limits
from zsmoseg.settings import Section, defaults, describe, parse_override, resolve
from zsmoseg.settings.gone import GONE, GONE_VALUES
from zsmoseg.video.probe import Excerpt


def test_a_look_at_the_settings_loads_no_library_of_arrays() -> None:
    heavy = "numpy", "cv2", "numba", "scipy"
    code = f"import sys, zsmoseg.settings; print([name for name in {heavy} if name in sys.modules])"
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "[]"


def test_a_setting_that_is_gone_names_its_successor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(GONE, "flow.pace", "is flow.stride now")
    with pytest.raises(SettingsError) as error:
        resolve(overrides={"flow.pace": 4})
    assert str(error.value) == "settings: flow.pace is flow.stride now"


def test_what_is_gone_is_no_setting_and_its_successor_is_a_setting_or_a_constant() -> None:
    for name, words in GONE.items():
        assert name not in defaults()
        if "constant" in words:
            constant, _, value, _, where, _ = words.removeprefix("is the constant ").split()
            module, kind = where.rsplit(".", 1)
            default = {field.name: field.default for field in fields(getattr(import_module(module), kind))}
            assert default[constant] == float(value), name
        else:
            assert [word for word in words.replace(",", " ").split() if word in defaults()], words


@pytest.mark.parametrize(("name", "value"), GONE_VALUES)
def test_a_value_that_is_gone_names_its_successor(name: str, value: str) -> None:
    with pytest.raises(SettingsError) as error:
        resolve(overrides={name: value})
    successor = GONE_VALUES[name, value].removeprefix("is ").removesuffix(" now")
    assert str(error.value) == f"settings: {name}={value} is {successor} now"
    resolve(overrides={name: successor})


def test_everything_wrong_is_told_at_once() -> None:
    wrong = {"flow.strid": 1, "flow.stride": 99, "groups.keep": 0.5}
    with pytest.raises(SettingsError) as error:
        resolve(overrides=wrong)
    text = str(error.value)
    assert "flow.strid is unknown; did you mean flow.stride?" in text
    assert "flow.stride = 99: expected an integer >= 1 and <= 8" in text
    assert "groups.keep went: the strongest" in text


def test_words_of_the_command_line_are_values() -> None:
    assert parse_override("flow.stride=4") == ("flow.stride", 4)
    assert parse_override("motion.model = affine") == ("motion.model", "affine")
    assert describe("flow.stride")["allowed"] == "an integer >= 1 and <= 8"


@dataclass(frozen=True)
class Inner:
    stride: int
    constant: float = 2.5


@dataclass(frozen=True)
class Outer:
    cut: float
    inner: Inner


def test_parameters_are_filled_by_name_however_deep() -> None:
    section = resolve(overrides={"flow.stride": 3, "flow.cut": 0.25}).flow
    assert section.parameters(Outer) == Outer(0.25, Inner(3))


def leaves(kind: Any) -> set[str]:
    """Names of the fields of a dataclass and of those in it."""
    hints = get_type_hints(kind)
    return {
        name
        for f in fields(kind)
        for name in (leaves(hints[f.name]) if is_dataclass(hints[f.name]) else {f.name})
    }


CORE = {field.name: get_type_hints(Core)[field.name] for field in fields(Core)}


@pytest.mark.parametrize(
    ("section", "kinds"),
    [
        ("video", [Excerpt]),
        ("flow", [Dis, PairCriteria]),
        *((name, [kind, *([Limits] if name == "affinity" else [])]) for name, kind in CORE.items()),
    ],
)
def test_the_science_reads_every_setting_of_a_section_but_what_stages_read(
    section: str, kinds: list[Any]
) -> None:
    names = set(type(getattr(resolve(), section)).model_fields)
    read = set().union(*map(leaves, kinds))
    assert read <= names
    of_stages = {"fingerprint", "source", "path", "model", "cues", "fusion", "columns", "geometry"}
    assert names - read <= of_stages


def test_sections_are_sections() -> None:
    assert all(isinstance(section, Section) for _, section in resolve())


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"# long\n" * (1 << 16), "holds more than 256 KiB"),
        (b"a" + b".a" * 50_000 + b" = 1", "has a line of over 500 dots"),
        (b"flow = {a" + b' . "\xe2\x80\xa8"' * 20_000 + b" = 1}", "has a line of over 500 dots"),
        (b"[a" + b".a" * 50_000 + b"]", "has a line of over 500 dots"),
        (b"\n".join(b"a%d = 1" % n for n in range(20_000)), "holds 20000 settings"),
        (b"a = " + b"[" * 100_000, "is nested too deep"),
        ("device", "holds more than 256 KiB"),
        ("pipe", "a named pipe may never end"),
        ("link to a pipe", "a named pipe may never end"),
        ("folder", "cannot be read (Is a directory)"),
    ],
)
def test_no_more_is_read_than_a_file_of_settings_holds(
    content: bytes | str, says: str, tmp_path: Path
) -> None:
    file = tmp_path / "settings.toml"
    if isinstance(content, bytes):
        file.write_bytes(content)
    elif content == "device":
        file = Path("/dev/zero")
    elif content == "folder":
        file.mkdir()
    else:
        os.mkfifo(tmp_path / "pipe")
        file.symlink_to(tmp_path / "pipe")
        file = file if "link" in content else tmp_path / "pipe"
    with pytest.raises(SettingsError) as error:
        resolve(config=file)
    assert str(error.value).startswith(f"{file}: ")
    assert says in str(error.value)


def test_a_pipe_of_the_shell_is_a_file_of_settings() -> None:
    read, write = os.pipe()
    os.write(write, b"flow.stride = 6")
    os.close(write)
    assert resolve(config=Path(f"/dev/fd/{read}")).flow.stride == 6
    os.close(read)


def test_a_value_of_too_many_dots_is_told_without_being_read() -> None:
    with pytest.raises(SettingsError, match="--set flow: has a line of over 500 dots"):
        parse_override("flow={a" + ".a" * 50_000 + " = 1}")
