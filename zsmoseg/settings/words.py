"""Settings in words: what one is and may be, and what is wrong with those given."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any

from pydantic import ValidationError

from zsmoseg.settings.section import Section
from zsmoseg.settings.tree import Settings, defaults

LIKE = 0.5
"""Similarity (difflib, 0 to 1) from which a known name is offered for one that is unknown."""


def describe(name: str) -> dict[str, Any]:
    """Default, unit, allowed values and meaning of one setting, in words."""
    section, field = name.split(".", 1)
    model: type[Section] = type(getattr(Settings(), section))
    info = model.model_fields[field]
    extra = model.extra(field)
    condition = (
        f" (only with {section}.{extra['when'][0]} = {' or '.join(str(v).lower() for v in extra['when'][1:])})"
        if extra["when"]
        else ""
    )
    return {
        "name": name,
        "default": info.default,
        "unit": extra["unit"],
        "allowed": allowed(model, field),
        "meaning": f"{info.description}{condition}",
    }


def allowed(model: type[Section], field: str) -> str:
    """The allowed values of a field in words, from its JSON schema."""
    schema = model.model_json_schema()["properties"][field]
    return schema["words"] or " or ".join(_schema_words(part) for part in schema.get("anyOf", [schema]))


_KINDS = {
    "integer": "an integer",
    "number": "a number",
    "string": "text",
    "boolean": "true or false",
    "array": "a list",
}


def _schema_words(schema: Mapping[str, Any]) -> str:
    if "enum" in schema:
        return ", ".join(map(str, schema["enum"]))
    if "const" in schema:
        return str(schema["const"])
    limits = [
        f"{sign} {schema[word]:g}"
        for word, sign in (
            ("minimum", ">="),
            ("exclusiveMinimum", ">"),
            ("maximum", "<="),
            ("exclusiveMaximum", "<"),
        )
        if word in schema
    ]
    return " ".join([_KINDS.get(str(schema.get("type")), "a value"), " and ".join(limits)]).strip()


def unknown(name: str) -> str:
    """What to say of a name that is no setting."""
    near = get_close_matches(name, defaults(), 1, LIKE)
    return f"{name} is unknown" + (f"; did you mean {near[0]}?" if near else "; see zsmoseg settings")


def problems_of(error: ValidationError) -> list[str]:
    """One sentence per wrong setting."""
    words: dict[str, str] = {}
    for item in error.errors():
        section, field = str(item["loc"][0]), str(item["loc"][1])
        model: type[Section] = type(getattr(Settings(), section))
        words[f"{section}.{field}"] = (
            f"{section}.{field} = {_value(error, section, field)!r}: expected {allowed(model, field)}"
        )
    return list(words.values())


def _value(error: ValidationError, section: str, field: str) -> Any:
    return next(e["input"] for e in error.errors() if e["loc"][:2] == (section, field))
