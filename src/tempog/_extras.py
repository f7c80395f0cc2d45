"""Packages that only some of tempog needs: imported where they are used, with an error that names the extra."""

from __future__ import annotations

import importlib
from typing import Any

from tempog.errors import ExtraError


def need(module: str, extra: str) -> Any:
    """A module that comes with one of tempog's extras; ExtraError, naming the extra, where it is not installed.

    >>> need("json", "bags").__name__
    'json'
    >>> need("no_such_module", "bags")
    Traceback (most recent call last):
        ...
    tempog.errors.ExtraError: this needs the package no_such_module: pip install 'tempog[bags]'
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        package = module.partition(".")[0]
        if error.name is None or error.name.partition(".")[0] != package:
            raise  # the package is here, and lacks something itself
        raise ExtraError(f"this needs the package {package}: pip install 'tempog[{extra}]'") from None
