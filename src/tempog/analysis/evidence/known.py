"""What was worked out before, to be worked out again only if what it came from has changed."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from hashlib import blake2b
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")


class Known:
    """Answers by what they came from. Those that one analysis did not need are forgotten with the next."""

    def __init__(self) -> None:
        self._context: Hashable = None
        self._before: dict[bytes, Any] = {}
        self._now: dict[bytes, Any] = {}
        self.n_recalled = self.n_worked_out = 0

    def begin(self, context: Hashable) -> None:
        """Begin an analysis; what is known from another context than before is forgotten."""
        self._before = self._now if context == self._context else {}
        self._context, self._now = context, {}
        self.n_recalled = self.n_worked_out = 0

    def recall(self, key: bytes) -> tuple[bool, Any]:
        """Whether there is an answer, and which."""
        for answers in (self._now, self._before):
            if key in answers:
                self._now[key] = answers[key]
                self.n_recalled += 1
                return True, answers[key]
        return False, None

    def keep(self, key: bytes, answer: Any) -> None:
        """Keep an answer for the next analysis."""
        self._now[key] = answer
        self.n_worked_out += 1


def recalled(known: Known | None, key: Callable[[], bytes], work_out: Callable[[], T]) -> T:
    """An answer that is known, or worked out now and kept."""
    if known is None:
        return work_out()
    name = key()
    found, answer = known.recall(name)
    if not found:
        answer = work_out()
        known.keep(name, answer)
    return answer  # type: ignore[no-any-return]


def digest(purpose: str, *arrays: NDArray[Any]) -> bytes:
    """A name for what arrays hold, which no other arrays have but by a chance of 1 in 2 ** 64."""
    mixed = blake2b(purpose.encode(), digest_size=16)
    for array in arrays:
        mixed.update(str((array.dtype.str, array.shape)).encode())
        mixed.update(np.ascontiguousarray(array).data)
    return mixed.digest()
