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


def note_pruned(saved: SavedMap, *stamps_ns: int) -> None:
    """Say on standard error that little is known of moments from before history was deleted."""
    cut_ns = max((deleted["before_ns"] for deleted in saved.manifest.pruned), default=None)
    if cut_ns is not None and any(stamp_ns < cut_ns for stamp_ns in stamps_ns):
        print_note(
            f"history from before {saved.format_moment(cut_ns)} was pruned; of earlier moments at most the last look"
            " at each cell is left"
        )
