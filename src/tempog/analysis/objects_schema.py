"""Reading documents of found objects: JSON that follows ``tempog/schemas/objects-1.json``."""

from __future__ import annotations

import json
import math
from functools import cache
from importlib.resources import files
from itertools import chain
from pathlib import Path
from typing import Any

from tempog.errors import AnswerError

# What of JSON Schema is understood here; the schema uses nothing else.
UNDERSTOOD = {
    "$ref",
    "additionalProperties",
    "const",
    "enum",
    "exclusiveMinimum",
    "items",
    "maxItems",
    "maximum",
    "minItems",
    "minimum",
    "prefixItems",
    "properties",
    "required",
    "type",
}
SAYS_NOTHING = {"$schema", "$defs", "title", "description"}
LONGEST_SHOWN = 60  # characters of a wrong value


@cache
def schema() -> dict[str, Any]:
    """The schema as it ships."""
    text = (files("tempog") / "schemas/objects-1.json").read_text(encoding="utf-8")
    loaded: dict[str, Any] = json.loads(text)
    return loaded


def read_objects(path: str | Path) -> dict[str, Any]:
    """Read a document of found objects.

    Raises
    ------
    AnswerError
        A file that cannot be read, is no JSON, or does not follow the schema; names the key.
    """
    path = Path(path)
    try:
        document = json.loads(path.read_bytes(), parse_constant=_refuse)
    except OSError as error:
        raise AnswerError(f"cannot read {path}: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise AnswerError(f"{path} is no JSON: {error}; wanted what tempog objects --json writes") from error
    check_objects(document, str(path))
    return dict(document)


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no number that JSON knows")


def check_objects(document: Any, source: str = "the document") -> None:
    """Raise AnswerError unless a document follows the schema; the message names the first wrong key.

    >>> check_objects({"format": "tempog-objects", "version": 7})
    Traceback (most recent call last):
    tempog.errors.AnswerError: the document: version is 7; wanted 1
    """
    if isinstance(document, dict) and "format" in document and "version" in document:
        for key in ("format", "version"):  # first, since the rest follows other rules if these are others
            _check(document[key], schema()["properties"][key], key, source)
    _check(document, schema(), "", source)


def _check(value: Any, rules: dict[str, Any], where: str, source: str) -> None:
    if "$ref" in rules:
        name = rules["$ref"].removeprefix("#/$defs/")
        if name == "cells" and _are_points(value):
            return  # hundreds of thousands of numbers; one by one takes seconds
        _check(value, schema()["$defs"][name], where, source)
    if "const" in rules and not _same(value, rules["const"]):
        _wrong(value, json.dumps(rules["const"]), where, source)
    if "enum" in rules and not any(_same(value, one) for one in rules["enum"]):
        _wrong(value, "one of " + ", ".join(map(json.dumps, rules["enum"])), where, source)
    if "type" in rules:
        kinds = rules["type"] if isinstance(rules["type"], list) else [rules["type"]]
        if not any(_is(value, kind) for kind in kinds):
            _wrong(value, " or ".join(kinds), where, source)
    if isinstance(value, dict):
        for key in rules.get("required", ()):
            if key not in value:
                raise AnswerError(f"{source}: {where or 'the document'} lacks {key!r}")
        known = rules.get("properties", {})
        for key, part in value.items():
            if key in known:
                _check(part, known[key], f"{where}.{key}" if where else str(key), source)
            elif rules.get("additionalProperties") is False:
                raise AnswerError(f"{source}: {where or 'the document'} holds {key!r}; wanted {', '.join(known)}")
    elif _is(value, "array"):
        if not rules.get("minItems", 0) <= len(value) <= rules.get("maxItems", math.inf):
            wanted = f"{rules.get('minItems', 0)} to {rules.get('maxItems', 'any number of')} items"
            _wrong(value, wanted, where, source)
        first = rules.get("prefixItems", [])
        for k, part in enumerate(value):
            if k < len(first):
                _check(part, first[k], f"{where}[{k}]", source)
            elif "items" in rules:
                _check(part, rules["items"], f"{where}[{k}]", source)
    elif _is(value, "number"):
        if value < rules.get("minimum", -math.inf) or value > rules.get("maximum", math.inf):
            wanted = f"{rules.get('minimum', '-inf')} to {rules.get('maximum', 'any number')}"
            _wrong(value, wanted, where, source)
        if value <= rules.get("exclusiveMinimum", -math.inf):
            _wrong(value, f"above {rules['exclusiveMinimum']}", where, source)


def _are_points(value: Any) -> bool:
    if type(value) is not list or not set(map(type, value)) <= {list} or not set(map(len, value)) <= {2}:
        return False
    numbers = list(chain.from_iterable(value))
    return set(map(type, numbers)) <= {int, float} and all(_is(number, "number") for number in numbers)


def _is(value: Any, kind: str) -> bool:
    if kind == "object":
        return isinstance(value, dict)
    if kind == "array":
        return isinstance(value, list | tuple)
    if kind == "number":
        try:
            return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        except OverflowError:  # an int that no float can hold
            return False
    if kind == "integer":
        return _is(value, "number") and value == int(value)
    return isinstance(value, {"string": str, "boolean": bool, "null": type(None)}[kind])


def _same(value: Any, other: Any) -> bool:
    return isinstance(value, bool) == isinstance(other, bool) and bool(value == other)


def _wrong(value: Any, wanted: str, where: str, source: str) -> None:
    shown = repr(value)
    shown = shown if len(shown) <= LONGEST_SHOWN else shown[:LONGEST_SHOWN] + "..."
    raise AnswerError(f"{source}: {where or 'the document'} is {shown}; wanted {wanted}")
