"""The command line: one file per command, each of which parses, calls the library and prints."""

from __future__ import annotations


def main() -> None:
    """Entry point of ``tempog``."""
    from tempog.cli.app import run

    run()
