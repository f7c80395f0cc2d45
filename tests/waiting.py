"""Waiting for what another thread or process does: as long as it takes, but not for ever."""

from __future__ import annotations

import time
from collections.abc import Callable

PATIENCE_S = 60.0


def wait_for(happened: Callable[[], object], patience_s: float = PATIENCE_S) -> None:
    """Return once something has happened; AssertionError if it does not."""
    end = time.monotonic() + patience_s
    while not happened():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.01)
