"""How settings differ, in words."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import shorten
from typing import Any

from zsmoseg.networks.references import in_words


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """``setting flow.stride: 4 -> 5`` for every setting that differs."""
    return [
        f"setting {section}.{name}: {shown(old.get(section, {}).get(name))} -> {shown(value)}"
        for section, fields in new.items()
        for name, value in fields.items()
        if old.get(section, {}).get(name, value) != value
    ]


def shown(value: Any) -> str:
    """A value as it is shown: short, and of a model its name and the front of its digest."""
    return shorten(str(in_words(value)), 80, placeholder=" ...")
