"""What requests ask, read and checked."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import TypeVar

from starlette.requests import Request

T = TypeVar("T", bound=str)

WHOLE = re.compile(r"-?[0-9]{1,10}")
NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,3})?")
FARTHEST = 2**31 - 1  # tiles, rows and columns
LONGEST = 1e12  # seconds and metres: beyond any map, and still exact enough


class BadParameterError(ValueError):
    """Something that was asked for cannot be."""


class Parameters:
    """The part of an address behind the question mark.

    Raises
    ------
    BadParameterError
        There is one that is not among the `known`, or one twice.
    """

    def __init__(self, request: Request, known: Iterable[str]) -> None:
        names = [*known, "token"]
        self._given: dict[str, str] = {}
        for name, value in request.query_params.multi_items():
            if name not in names:
                raise BadParameterError(
                    f"{_short(name)} is no parameter of this; wanted {', '.join(names[:-1]) or 'none'}"
                )
            if name in self._given:
                raise BadParameterError(f"{name} is given twice")
            self._given[name] = value

    def text(self, name: str) -> str | None:
        """A parameter as it is."""
        return self._given.get(name)

    def whole(self, name: str, text: str, least: int = -FARTHEST, most: int = FARTHEST) -> int:
        """A whole number within bounds."""
        if not WHOLE.fullmatch(text) or not least <= int(text) <= most:
            raise BadParameterError(f"{name} = {_short(text)} is no whole number from {least} to {most}")
        return int(text)

    def number(self, name: str) -> float:
        """A number that must be given."""
        number = self.seconds(name)
        if number is None:
            raise BadParameterError(f"{name} is missing; wanted a number")
        return number

    def seconds(self, name: str) -> float | None:
        """A finite number, or None where it is not given."""
        text = self._given.get(name)
        if text is None:
            return None
        if not NUMBER.fullmatch(text) or not abs(float(text)) <= LONGEST:
            raise BadParameterError(f"{name} = {_short(text)} is no number up to {LONGEST:g}")
        return float(text)

    def duration(self, name: str, default: float) -> float:
        """Seconds, 0 or more; ``inf`` for ever."""
        if self._given.get(name) == "inf":
            return math.inf
        seconds = self.seconds(name)
        if seconds is not None and seconds < 0:
            raise BadParameterError(f"{name} = {seconds:g} is no duration; wanted seconds, 0 or more, or inf")
        return default if seconds is None else seconds

    def choice(self, name: str, choices: Sequence[T], default: T) -> T:
        """One of several words."""
        text = self._given.get(name)
        if text is None:
            return default
        for choice in choices:
            if text == choice:
                return choice
        raise BadParameterError(f"{name} = {_short(text)} is unknown; wanted one of {', '.join(choices)}")


def _short(text: str) -> str:
    """Some text of others, as it may stand in a message."""
    return repr(text if len(text) <= 40 else text[:40] + "...")
