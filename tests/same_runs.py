"""Whether two sets of intervals are the same to the last bit."""

from __future__ import annotations

from tempog.grid.segments import Runs


def assert_identical(found: Runs, wanted: Runs) -> None:
    for name, is_there, ought_to_be in zip(Runs._fields, found, wanted, strict=True):
        assert is_there.dtype == ought_to_be.dtype, name
        assert is_there.tobytes() == ought_to_be.tobytes(), name
