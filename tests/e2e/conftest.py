"""The command line, called without a process of its own."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import NamedTuple

import pytest

from tempog.cli.app import run


class Result(NamedTuple):
    code: int
    out: str
    err: str


Tempog = Callable[..., Result]


@pytest.fixture
def tempog(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Tempog:
    """``tempog WORDS...``: its exit code, and what it printed."""

    def call(*words: object) -> Result:
        monkeypatch.setattr(sys, "argv", ["tempog", *(str(word) for word in words)])
        capsys.readouterr()
        code = 0
        try:
            run()
        except SystemExit as stop:
            code = int(stop.code or 0)
        captured = capsys.readouterr()
        return Result(code, captured.out, captured.err)

    return call
