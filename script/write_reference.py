"""Writes mission-reference.md, the table of every key of a mission file, from the settings themselves."""

from __future__ import annotations

import json
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin

import annotated_types as limits
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from noctule.flight.mission import Mission

PAGE = Path(__file__).parents[1] / "docs" / "mission-reference.md"
_HEAD = """# Every key of a mission file

This page is written by `script/reference` from the settings that check the file. Every group and key may be
left out unless it says *required*. Units stand in brackets.
"""


def groups(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the groups of settings inside a type."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from groups(part)


def kind(annotation: Any) -> str:
    """Return a type in words."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return " or ".join(f"`{part}`" for part in parts)
    if origin in (Union, types.UnionType):
        return " or ".join(kind(part) for part in parts if part is not type(None))
    if origin is tuple:
        if parts[-1] is Ellipsis:
            return f"list of {kind(parts[0])}"
        return f"{len(parts)} values: {', '.join(dict.fromkeys(kind(part) for part in parts))}"
    if hasattr(annotation, "__metadata__"):
        return kind(annotation.__origin__) + _range(annotation.__metadata__)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "table"
    names = {float: "number", int: "whole number", bool: "true or false", str: "text", Path: "path"}
    return names.get(annotation, str(annotation))


_BOUNDS = (
    (limits.Ge, "ge", "from"),
    (limits.Gt, "gt", "above"),
    (limits.Le, "le", "to"),
    (limits.Lt, "lt", "below"),
)


def _range(metadata: Any) -> str:
    found = []
    for rule in metadata:
        if isinstance(rule, FieldInfo):
            return _range(rule.metadata)
        found += [
            f"{word} {getattr(rule, name):g}" for bound, name, word in _BOUNDS if isinstance(rule, bound)
        ]
    return f" {' '.join(found)}" if found else ""


def _default(field: FieldInfo) -> str:
    value = field.default
    if value is PydanticUndefined:
        return "*required*" if field.default_factory is None else "see there"
    if value is None:
        return "none"
    if isinstance(value, BaseModel):
        return "see there"
    if isinstance(value, tuple) and any(isinstance(entry, BaseModel) for entry in value):
        return f"{len(value)} of them"
    return f"`{json.dumps(value)}`"


def table(name: str, model: type[BaseModel]) -> Iterator[str]:
    """Yield the lines about one group, then those of the groups inside it."""
    inner: list[tuple[str, type[BaseModel]]] = []
    yield f"\n## {f'`[{name}]`' if name else 'At the top'}\n"
    yield f"{(model.__doc__ or '').strip().splitlines()[0]}\n"
    yield "| key | value | default | meaning |"
    yield "|---|---|---|---|"
    for key, field in model.model_fields.items():
        path = f"{name}.{key}" if name else key
        inside = list(groups(field.annotation))
        place = path if kind(field.annotation) == "table" else f"[{path}]"
        about = field.description or (f"see `[{place}]`" if inside else "")
        inner += [(place, group) for group in inside]
        words = kind(field.annotation) + _range(field.metadata)
        yield f"| `{key}` | {words} | {_default(field)} | {about} |"
    for path, group in inner:
        yield from table(path, group)


def page() -> str:
    """Return the page."""
    return _HEAD + "\n".join(table("", Mission)) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
