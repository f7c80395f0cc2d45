"""The little YAML that maps need: written so that every parser agrees, and the flat files of map_server read."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from tempog.errors import MapError

DECIMALS = 6  # micrometres
_PLAIN_KEY = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_ENTRY = re.compile(r"([A-Za-z_]\w*)\s*:(?:\s+(.*))?$")
_ITEM = re.compile(r"\s*-\s+(.*)$")
# YAML 1.1, which ROS reads, would take these words for something else than text.
_OTHER_WORDS = {"y", "n", "yes", "no", "on", "off", "true", "false", "null"}


def to_yaml(document: Mapping[str, Any], comment: str = "") -> str:
    """A document of mappings, sequences, text, numbers, true, false and null, as YAML.

    Sequences without a mapping in them are written in one line. Text is quoted, numbers have a fixed number of
    decimals, so that YAML 1.1 and 1.2 read the same.

    >>> print(to_yaml({"image": "map.pgm", "origin": [-1.5, 0.0, 0.0], "doors": [{"id": 1, "hinge": None}]}), end="")
    image: "map.pgm"
    origin: [-1.5, 0.0, 0.0]
    doors:
      - id: 1
        hinge: null
    """
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    return "\n".join([*lines, *_lines(document)]) + "\n"


def _lines(value: Mapping[str, Any]) -> list[str]:
    lines = []
    for key, entry in value.items():
        name = key if _PLAIN_KEY.fullmatch(key) and key.lower() not in _OTHER_WORDS else _quoted(key)
        if isinstance(entry, Mapping) and entry:
            lines += [f"{name}:", *(f"  {line}" for line in _lines(entry))]
        elif _is_sequence(entry) and any(isinstance(one, Mapping) and one for one in entry):
            lines.append(f"{name}:")
            for one in entry:
                head, *rest = _lines(one)
                lines += [f"  - {head}", *(f"    {line}" for line in rest)]
        else:
            lines.append(f"{name}: {_flow(entry)}")
    return lines


def _is_sequence(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _flow(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_quoted(key)}: {_flow(entry)}" for key, entry in value.items()) + "}"
    if _is_sequence(value):
        return "[" + ", ".join(_flow(one) for one in value) + "]"
    if isinstance(value, float):
        if not math.isfinite(value):
            raise ValueError(f"{value} cannot be written; use None")
        text = f"{value:.{DECIMALS}f}".rstrip("0")
        return "0.0" if float(text) == 0 else text + "0" * text.endswith(".")
    return _quoted(value)


def _quoted(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def read_flat_yaml(text: str, label: str) -> dict[str, Any]:
    """The keys and values of a file as map_server has it: scalars and lists of scalars, no nesting.

    Parameters
    ----------
    text : str
    label : str
        Where it comes from, for messages.

    Raises
    ------
    MapError
        Anything beyond that.

    >>> read_flat_yaml("image: a.pgm  # a map\\norigin: [0, -1.5, 0]\\nnegate: 0", "map.yaml")
    {'image': 'a.pgm', 'origin': [0, -1.5, 0], 'negate': 0}
    """
    found: dict[str, Any] = {}
    open_list: list[Any] | None = None  # of the key above, whose items follow on lines of their own
    lines = iter(enumerate(text.splitlines(), start=1))
    for number, line in lines:
        line = _without_comment(line)
        if line.strip() in ("", "---", "..."):
            continue
        item = _ITEM.match(line)
        if item and open_list is not None:
            open_list.append(_scalar(item[1]))
            continue
        entry = _ENTRY.match(line)
        if not entry:
            raise MapError(
                f"{label}, line {number}: {line.strip()[:60]!r} is no 'key: value'; wanted a map_server file"
            )
        key, value = entry[1], (entry[2] or "").strip()
        open_list = None
        if value.startswith("["):
            while not value.endswith("]"):  # a list over several lines
                more = next(lines, None)
                if more is None:
                    raise MapError(f"{label}: the list of {key!r} has no end; add a ]")
                value += " " + _without_comment(more[1]).strip()
            found[key] = [_scalar(one) for one in value[1:-1].split(",") if one.strip()]
        elif value:
            found[key] = _scalar(value)
        else:
            found[key] = open_list = []
    return found


def _without_comment(line: str) -> str:
    """A line without its comment: a # at its begin or after a space, outside quotes."""
    quote = ""
    for k, character in enumerate(line):
        if quote:
            quote = "" if character == quote else quote
        elif character in "\"'":
            quote = character
        elif character == "#" and (k == 0 or line[k - 1].isspace()):
            return line[:k].rstrip()
    return line.rstrip()


def _scalar(text: str) -> Any:
    text = text.strip()
    if len(text) > 1 and text[0] == text[-1] and text[0] in "\"'":
        if text[0] == "'":
            return text[1:-1].replace("''", "'")
        try:
            return json.loads(text)
        except ValueError:
            return text[1:-1]
    if text.lower() in ("true", "yes", "on"):
        return True
    if text.lower() in ("false", "no", "off"):
        return False
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
