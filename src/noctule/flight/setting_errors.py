"""One line per mistake in a settings file: file, line, field, what was given, what is accepted."""

from __future__ import annotations

import difflib
import types
import typing
from collections.abc import Sequence
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from noctule.flight.toml_lines import key_lines, line_of

_TYPES = {
    "float": "a number", "int": "a whole number", "bool": "true or false", "string": "a text",
    "finite": "a finite number", "tuple": "a list", "list": "a list", "dict": "a table", "model": "a table",
}  # fmt: skip


def explain(error: ValidationError, model: type[BaseModel], text: str, name: str) -> str:
    """Return the mistakes in the TOML `text` of file `name`, one a line."""
    lines = key_lines(text)
    told: list[tuple[int, str]] = []
    found = [(item, *_find(model, item["loc"], item["type"])) for item in error.errors(include_url=False)]
    places = [location for _, location, _, _ in found]
    for i, (item, location, field, owner) in enumerate(found):
        # A union tells a mistake per member: the deepest of them says most, of equals the first.
        deeper = any(len(p) > len(location) and p[: len(location)] == location for p in places)
        if deeper or location in places[:i]:
            continue
        line = line_of(lines, location)
        where = name if line is None else f"{name}:{line}"
        told.append((line or 0, f"{where}: {_sentence(item, location, field, owner)}"))
    return "\n".join(sentence for _, sentence in sorted(told, key=lambda t: t[0]))


def dotted(location: Sequence[str | int]) -> str:
    """Return a key path as a person writes it: room.columns[0].x."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def _sentence(
    item: Any, location: Sequence[str | int], field: FieldInfo | None, owner: type[BaseModel]
) -> str:
    name, kind = dotted(location), item["type"]
    if kind == "extra_forbidden":
        known = sorted(owner.model_fields)
        near = difflib.get_close_matches(str(location[-1]), known, n=1, cutoff=0.5)
        return f"unknown key {name}; " + (
            f"did you mean {near[0]}?" if near else f"expected one of {', '.join(known)}"
        )
    if kind == "missing":
        return f"{name} is missing; expected {_accepted(item, field)}"
    if kind == "value_error":
        said = str(item["ctx"]["error"])
        return f"{name}: {said}" if name else said
    return f"{name} is {_given(item['input'])}; expected {_accepted(item, field)}"


def _given(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    text = f'"{value}"' if isinstance(value, str) else "a table" if isinstance(value, dict) else str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _accepted(item: Any, field: FieldInfo | None) -> str:
    """Say what a field accepts: its type, its range, what it is."""
    context = item.get("ctx", {})
    said = ""
    if item["type"] == "literal_error":
        said = "one of " + str(context["expected"]).replace(" or ", ", ").replace("'", "")
    elif item["type"] in ("too_long", "too_short"):
        bound = "most" if "max_length" in context else "least"
        said = f"a list of at {bound} {context['max_length' if bound == 'most' else 'min_length']}"
    else:
        said = _range(item, field)
        for prefix, words in _TYPES.items():
            if item["type"].startswith(f"{prefix}_"):
                said = words + (f", {said}" if said else "")
                break
    if not said:
        said = "a table" if field is not None and _models(field.annotation) else "a value"
    return f"{said} ({field.description})" if field is not None and field.description else said


def _range(item: Any, field: FieldInfo | None) -> str:
    bounds = {}
    for source in field.metadata if field is not None else ():
        for name in ("gt", "ge", "lt", "le"):
            if (value := getattr(source, name, None)) is not None:
                bounds[name] = value
    if not bounds:
        bounds = {k: v for k, v in item.get("ctx", {}).items() if k in ("gt", "ge", "lt", "le")}
    low = f"{bounds['ge']:g}" if "ge" in bounds else f"above {bounds['gt']:g}" if "gt" in bounds else ""
    high = f"{bounds['le']:g}" if "le" in bounds else f"below {bounds['lt']:g}" if "lt" in bounds else ""
    if low and high:
        return f"{low} to {high}"
    if high:
        return high if "lt" in bounds else f"at most {high}"
    return (low if "gt" in bounds else f"at least {low}") if low else ""


def _models(annotation: Any) -> list[type[BaseModel]]:
    """Return the settings groups that an annotation can hold."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    if typing.get_origin(annotation) is types.UnionType or typing.get_args(annotation):
        return [m for a in typing.get_args(annotation) for m in _models(a)]
    return []


def _find(
    model: type[BaseModel], location: tuple[str | int, ...], kind: str
) -> tuple[tuple[str | int, ...], FieldInfo | None, type[BaseModel]]:
    """Follow pydantic's location through the groups; returns it without pydantic's own words.

    Also returns the field, and the group that it is (or, when unknown, would be) a key of.
    """
    clean: list[str | int] = []
    field: FieldInfo | None = None
    owner, inside = model, True
    for n, part in enumerate(location):
        if isinstance(part, int):
            clean.append(part)
        elif inside and part in owner.model_fields:
            field = owner.model_fields[part]
            clean.append(part)
            models = _models(field.annotation)
            inside = bool(models)
            if models and n + 1 < len(location):
                owner = models[0]
        elif kind == "extra_forbidden" and n + 1 == len(location):
            clean.append(part)
            field = None
    return tuple(clean), field, owner
