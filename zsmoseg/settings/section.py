"""What a section of settings is: values that are read together, each with unit, range and meaning."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from functools import cache
from numbers import Real
from typing import TYPE_CHECKING, Any, TypeVar, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

from zsmoseg.networks.references import digest_of

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")


def setting(
    default: Any,
    meaning: str,
    unit: str = "",
    when: tuple[Any, ...] = (),
    tasks: tuple[str, ...] = (),
    pattern: tuple[str | None, str] = (None, ""),
    **limits: Any,
) -> Any:
    """One setting.

    Parameters
    ----------
    when
        ``(name, value, ...)``: it acts only while ``name`` of its section is such a value.
    tasks
        It names a model, of one of these tasks.
    pattern
        That a text must match, and what users are told instead.
    """
    extra: dict[str, Any] = {"unit": unit, "when": list(when), "tasks": list(tasks), "words": pattern[1]}
    return Field(default, description=meaning, json_schema_extra=extra, pattern=pattern[0], **limits)


class Section(BaseModel):
    """Settings that are read together."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)

    @field_validator("*", mode="before")
    @classmethod
    def _numbers(cls, value: Any, info: ValidationInfo) -> Any:
        """True is no 1, though Python takes it for one; a number is a text where texts of numbers are meant: seconds."""
        each = value if isinstance(value, list | tuple) else [value]
        if cls.model_fields[str(info.field_name)].annotation is not bool and any(
            isinstance(one, bool) for one in each
        ):
            raise ValueError("a truth value")
        if isinstance(value, Real) and cls.extra(str(info.field_name))["words"]:
            return f"{value:.12f}".rstrip("0").rstrip(".")
        return value

    def active(self) -> dict[str, Any]:
        """The settings that act: those of a backend or rule that is not chosen are left out.

        Of a model its digest counts, not where it lies.
        """
        acting = {name: value for name, value in self.model_dump(mode="json").items() if self.acts(name)}
        return {name: digest_of(value) if self.tasks(name) else value for name, value in acting.items()}

    def models(self) -> dict[str, str]:
        """The models that act, by setting."""
        found = {name: getattr(self, name) for name in type(self).model_fields if self.tasks(name)}
        return {name: model for name, model in found.items() if model and self.acts(name)}

    @classmethod
    def tasks(cls, name: str) -> tuple[str, ...]:
        """The tasks of the models that setting ``name`` may name; none where it names no model."""
        return tuple(cls.extra(name)["tasks"])

    def acts(self, name: str) -> bool:
        """Whether setting ``name`` can change anything now."""
        when = type(self).extra(name)["when"]
        return not when or getattr(self, when[0]) in when[1:]

    def parameters(self, kind: type[T]) -> T:
        """The parameters ``kind`` of a function of the science: a frozen dataclass, filled by the names of its fields.

        A field that is such a dataclass itself is filled from this section too. Fields that are no settings keep
        their defaults: they are constants.
        """
        hints, values = _hints(kind), {}
        for field in fields(kind):
            if is_dataclass(hint := hints[field.name]) and isinstance(hint, type):
                values[field.name] = self.parameters(hint)
            elif field.name in type(self).model_fields:
                values[field.name] = getattr(self, field.name)
        return kind(**values)

    @classmethod
    @cache
    def extra(cls, name: str) -> dict[str, Any]:
        """Unit and condition of setting ``name``."""
        extra = cls.model_fields[name].json_schema_extra
        assert isinstance(extra, dict)
        return extra


@cache
def _hints(kind: type) -> dict[str, Any]:
    """Types of the fields of a dataclass; finding them takes longer than a small function of the science."""
    return get_type_hints(kind)


class Brought(Section):
    """A section whose cue may be brought by the user: a path, whose content counts in the key."""

    def active(self) -> dict[str, Any]:
        """What acts, without the path: ``zsmoseg.workflows.imports`` puts the fingerprint of its content there."""
        return {name: value for name, value in super().active().items() if name != "path"}
