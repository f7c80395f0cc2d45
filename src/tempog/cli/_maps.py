"""How commands open maps."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tempog.cli._output import print_note

if TYPE_CHECKING:
    from tempog.store.saved_map import SavedMap

MapArgument = Annotated[Path, typer.Argument(metavar="MAP", help="A map made by tempog map.")]
SessionOption = Annotated[
    list[str] | None,
    typer.Option("--session", metavar="ID", help="Only what this session saw; may be repeated. See tempog info."),
]
RobotOption = Annotated[
    list[str] | None, typer.Option("--robot", metavar="NAME", help="Only what this robot saw; may be repeated.")
]


def opened(path: Path, sessions: list[str] | None = None, robots: list[str] | None = None) -> SavedMap:
    """A map, or chosen sessions of it; tells on standard error what a crash had left of it."""
    from tempog.store.saved_map import open_map

    saved = open_map(path, sessions=sessions or None, robots=robots or None)
    for note in saved.repaired:
        print_note(note)
    return saved
