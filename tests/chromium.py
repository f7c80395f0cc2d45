"""A browser without a window, where the machine has one."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


@contextmanager
def chromium(*options: str) -> Iterator[Any]:
    """A Playwright browser; without one the test is skipped, or fails where TEMPOG_REQUIRE_BROWSER is set."""
    try:
        from playwright.sync_api import sync_playwright
    except ModuleNotFoundError:
        _missing("Playwright is not installed (pip install 'tempog[dev]')")
    path = next((found for found in map(shutil.which, NAMES) if found), None)
    if path is None:
        _missing(f"no browser here: none of {', '.join(NAMES)} is on the path")
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=path, args=list(options))
        try:
            yield browser
        finally:
            browser.close()


def _missing(what: str) -> NoReturn:
    if os.environ.get("TEMPOG_REQUIRE_BROWSER") == "1":
        pytest.fail(what)
    pytest.skip(what)
