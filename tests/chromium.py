"""A browser without a window, where the machine has one."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")


@contextmanager
def chromium() -> Iterator[Any]:
    """A Playwright browser; without one the test is skipped, or fails where TEMPOG_REQUIRE_BROWSER is set."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = next((found for name in NAMES if (found := shutil.which(name))), None)
    if path is None:
        lacking = f"no browser here: none of {', '.join(NAMES)} is on the path"
        if os.environ.get("TEMPOG_REQUIRE_BROWSER"):
            pytest.fail(lacking)
        pytest.skip(lacking)
    with playwright.sync_playwright() as started:
        options = ["--no-sandbox"] if os.geteuid() == 0 else []  # its sandbox does not work for root
        browser = started.chromium.launch(executable_path=path, args=options)
        try:
            yield browser
        finally:
            browser.close()
