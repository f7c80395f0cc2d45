"""TOML tables whose values are checked as they are taken, and whose leftover keys are refused."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from tempog.errors import WorldError
from tempog.simulation.polygons import Point


class Table:
    """A TOML table that knows its key, hands out checked values, and which keys nobody asked for."""

    def __init__(self, values: Mapping[str, Any], key: str) -> None:
        self.values = dict(values)
        self.key = key
        self.known: list[str] = []

    def full(self, key: str) -> str:
        return f"{self.key}.{key}" if self.key else key

    def has(self, key: str) -> bool:
        self.known.append(key)
        return key in self.values

    def take(self, key: str, default: Any = None) -> Any:
        if self.has(key):
            return self.values.pop(key)
        if default is None:
            raise WorldError(f"{self.full(key)} is missing")
        return default

    def number(self, key: str, default: float | None = None) -> float:
        return to_number(self.take(key, default), self.full(key))

    def text(self, key: str, default: str | None = None) -> str:
        value = self.take(key, default)
        if not isinstance(value, str):
            raise WorldError(f"{self.full(key)} = {value!r}; wanted text in quotes")
        return value

    def flag(self, key: str, default: bool) -> bool:
        value = self.take(key, default)
        if not isinstance(value, bool):
            raise WorldError(f"{self.full(key)} = {value!r}; wanted true or false")
        return value

    def numbers(self, key: str, count: int, default: list[float] | None = None) -> tuple[float, ...]:
        return to_numbers(self.take(key, default), self.full(key), count)

    def point(self, key: str) -> Point:
        x, y = self.numbers(key, 2)
        return x, y

    def points(self, key: str, least: int) -> tuple[Point, ...]:
        value = self.take(key)
        if not isinstance(value, list) or len(value) < least:
            raise WorldError(f"{self.full(key)} = {value!r}; wanted {least} or more points [x, y]")
        pairs = [to_numbers(point, f"{self.full(key)}[{k}]", 2) for k, point in enumerate(value)]
        return tuple((x, y) for x, y in pairs)

    def table(self, key: str) -> Table:
        value = self.take(key, {})
        if not isinstance(value, dict):
            raise WorldError(f"{self.full(key)} = {value!r}; wanted a table")
        return Table(value, self.full(key))

    def tables(self, key: str) -> list[Table]:
        value = self.take(key, [])
        if not isinstance(value, list) or not all(isinstance(one, dict) for one in value):
            raise WorldError(f"{self.full(key)}: wanted tables [[{self.full(key)}]]")
        return [Table(one, f"{self.full(key)}[{k}]") for k, one in enumerate(value)]

    def done(self) -> None:
        for key in self.values:
            raise WorldError(f"{self.full(key)} is no known key; wanted {', '.join(sorted(set(self.known)))}")


def to_number(value: Any, key: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise WorldError(f"{key} = {value!r}; wanted a finite number")
    return float(value)


def to_numbers(value: Any, key: str, count: int) -> tuple[float, ...]:
    if not isinstance(value, list) or len(value) != count:
        raise WorldError(f"{key} = {value!r}; wanted {count} numbers in brackets")
    return tuple(to_number(one, key) for one in value)
