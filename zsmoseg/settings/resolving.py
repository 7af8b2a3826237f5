"""From presets, TOML files and words of the command line to settings."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from math import isfinite
from pathlib import Path, PurePath
from typing import Any

from pydantic import ValidationError

from zsmoseg.errors import SettingsError
from zsmoseg.remote.url import given_path
from zsmoseg.settings.gone import GONE, GONE_VALUES
from zsmoseg.settings.tree import Settings, defaults
from zsmoseg.settings.words import problems_of, unknown

PAPER_CORE: Mapping[str, Any] = {
    "motion.model": "screw-printed",
    "affinity.kernel": "ordered",
    "affinity.ranking": "row",
    "affinity.weight": "equal",
    "groups.rule": "spectral",
    "groups.equal": True,
    "groups.count": 2,
}
PRESETS: Mapping[str, Mapping[str, Any]] = {
    "embedded": {},
    "paper-core": PAPER_CORE,
    "paper": {
        "proposals.source": "network",
        "tags.model": "ram",
        "proposals.boxes": "grounding-dino-tiny",
        "proposals.masks": "sam-vit-b",
        "tracking.source": "network",
        "tracking.model": "deaot-l",
        "tracking.carry": False,
        "flow.source": "network",
        "flow.model": "pwc-net",
        "depth.source": "network",
        "depth.model": "dpt-dinov2-small-nyu",
        **PAPER_CORE,
    },
    "permissive": {
        "proposals.source": "network",
        "tags.model": "ram-plus-int8",
        "proposals.boxes": "grounding-dino-tiny",
        "proposals.masks": "mobile-sam",
        "depth.source": "network",
        "depth.model": "depth-anything-v2-small",
    },
}
"""Named settings. ``paper-core`` is the paper to the letter from the proposals on, ``paper`` with its networks too;
``permissive`` has weights only that may be used commercially, and our own decision.
"""
LARGEST, MOST_DOTS, MOST_SETTINGS = 1 << 18, 500, 1000
"""Bytes of a file of settings, dots in a line of it (the parts of a dotted key cost their square) and settings in it, at most."""
GONE_PRESETS = {"default": "is embedded now"}


def resolve(
    preset: str = "embedded", config: Path | None = None, overrides: Mapping[str, Any] | None = None
) -> Settings:
    """Settings from a preset, then a TOML file, then ``overrides`` (dotted names).

    Raises
    ------
    SettingsError
        Unknown preset; unreadable TOML; every setting that is gone, unknown, mistyped or out of range, all at once.
    """
    if not isinstance(preset, str) or preset not in PRESETS:
        what = GONE_PRESETS.get(str(preset), "is unknown")
        raise SettingsError(f"preset {preset!r} {what}; there are {', '.join(PRESETS)}")
    flat: dict[Any, Any] = {
        **PRESETS[preset],
        **(_toml(Path(given_path(config, "config"))) if config is not None else {}),
        **(overrides or {}),
    }
    problems = []
    tree: dict[str, dict[str, Any]] = {}
    known = defaults()
    for name, value in flat.items():
        if not isinstance(name, str):
            problems.append(f"{name!r} is no name; names are section.name")
        elif unusable := _unusable(value):
            problems.append(f"{name} {unusable}")
        elif (name, str(value)) in GONE_VALUES:
            problems.append(f"{name}={value} {GONE_VALUES[name, str(value)]}")
        elif name in known:
            section, field = name.split(".", 1)
            tree.setdefault(section, {})[field] = str(value) if isinstance(value, PurePath) else value
        else:
            problems.append(f"{name} {GONE[name]}" if name in GONE else unknown(name))
    try:
        settings = Settings.model_validate(tree)
    except ValidationError as error:
        problems += problems_of(error)
    if problems:
        raise SettingsError("settings: " + " | ".join(problems))
    return settings


def _unusable(value: Any) -> str | None:
    """What is wrong with a value whatever the setting: not finite, more digits than any number needs, a null byte."""
    if isinstance(value, float) and not isfinite(value):
        return f"= {value}: expected a finite number"
    if isinstance(value, int) and abs(value) >= 2**63:
        return "has more digits than any setting takes"
    if isinstance(value, str) and "\0" in value:
        return f"= {value!r}: holds a null byte, which no text or name can have here"
    if isinstance(value, dict):
        return "is a table; expected one value"
    if isinstance(value, list):
        return next((problem for one in value if (problem := _unusable(one))), None)
    return None


def parse_override(text: str) -> tuple[str, Any]:
    """``"flow.stride=4"`` as name and TOML value; what is not TOML is a string."""
    name, equals, value = text.partition("=")
    if not equals or not name.strip():
        raise SettingsError(f"--set {text}: expected section.name=value")
    try:
        return name.strip(), _loads(f"v = {value}", f"--set {name}")["v"]
    except tomllib.TOMLDecodeError:
        return name.strip(), value.strip()
    except (ValueError, RecursionError) as error:
        raise SettingsError(f"--set {name}: {_toml_words(error)}") from error


def _toml(path: Path) -> dict[str, Any]:
    """Settings of a file by dotted names, of no more than a file of settings holds."""
    try:
        if path.resolve().is_fifo():  # that of a shell's <(...) has no name, and an end
            raise OSError(0, "a named pipe may never end")
        with path.open("rb") as file:
            content = file.read(LARGEST + 1)
        if len(content) > LARGEST:
            raise SettingsError(
                f"{path}: holds more than {LARGEST >> 10} KiB, no file of settings does; give a TOML file to --config"
            )
        found = _flatten(_loads(content.decode("utf-8-sig"), str(path)))
    except OSError as error:
        raise SettingsError(
            f"{path}: cannot be read ({error.strerror}); give a TOML file to --config"
        ) from error
    except (ValueError, RecursionError) as error:
        raise SettingsError(f"{path}: {_toml_words(error)}") from error
    if len(found) > MOST_SETTINGS:
        raise SettingsError(
            f"{path}: holds {len(found)} settings, there are {len(defaults())}; give those that you change"
        )
    return found


def _loads(text: str, where: str) -> dict[str, Any]:
    """TOML, once no key in it has too many parts; ``where`` begins the error."""
    if any(line.count(".") > MOST_DOTS for line in text.split("\n")):
        raise SettingsError(
            f"{where}: has a line of over {MOST_DOTS} dots; settings are section.name = value"
        )
    return tomllib.loads(text)


def _toml_words(error: Exception) -> str:
    """Why something cannot be read as TOML; Python's own limits are no syntax errors."""
    if isinstance(error, tomllib.TOMLDecodeError):
        return f"is not TOML ({error})"
    if isinstance(error, UnicodeDecodeError):
        return f"is not UTF-8, as TOML must be ({error.reason} at byte {error.start}); save it as UTF-8"
    if isinstance(error, RecursionError):
        return "is nested too deep; settings are section.name = value"
    return "holds a number or a name that cannot be read; settings are section.name = value"


def _flatten(tree: Mapping[str, Any]) -> dict[str, Any]:
    return {
        f"{section}.{name}": value
        for section, fields in tree.items()
        for name, value in (fields.items() if isinstance(fields, dict) else [("", fields)])
    }
