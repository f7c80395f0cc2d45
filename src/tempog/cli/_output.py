"""What several commands print alike."""

from __future__ import annotations

import json
import math
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from tempog.errors import ConfigError, MapError
from tempog.texts import bytes_text, count_text, counted, duration_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tempog.scans.scan import Scan

__all__ = ["bytes_text", "count_text", "counted", "duration_text"]  # as commands import them

Tracked = TypeVar("Tracked")
WIDTH = 120  # columns of what is printed
PICTURE_SUFFIXES = (".png", ".pdf", ".svg", ".jpg", ".webp")

JsonFlag = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
PeopleOption = Annotated[int | None, typer.Option(min=0, help="How many people walk. Default: as the world says.")]
DurationOption = Annotated[float | None, typer.Option(help="Seconds. Default: as the world says.")]
ForceFlag = Annotated[bool, typer.Option("--force", help="Replace what is there.")]
QuietFlag = Annotated[bool, typer.Option("--quiet", "-q", help="No progress bar, no notes.")]


def print_json(answer: dict[str, Any]) -> None:
    """One JSON object on standard output."""
    typer.echo(json.dumps(answer, indent=2, allow_nan=False))


def print_note(text: str) -> None:
    """Something the user should know, on standard error."""
    typer.echo(f"note: {text}", err=True)


def wrapped(text: str, indent: int) -> str:
    """Text that begins in column `indent`, on lines of up to 120 columns; it breaks at commas if it has any.

    >>> wrapped("a, b", 8), [len(line) for line in wrapped(", ".join(["1 m"] * 30), 8).splitlines()]
    ('a, b', [109, 46])
    """
    whole = text.replace(" ", "\0").replace(",\0", ", ")
    if any(len(part) > WIDTH - indent for part in whole.split()):
        whole = text
    lines = textwrap.wrap(whole, WIDTH - indent, break_long_words=False, break_on_hyphens=False) or [""]
    return f"\n{'':>{indent}}".join(lines).replace("\0", " ")


def check_duration(seconds: float | None) -> None:
    """Refuse to simulate nothing, or without end."""
    if seconds is not None and not 0 < seconds < math.inf:
        raise ConfigError(f"--duration {seconds:g} cannot work; wanted seconds above 0")


def track_scans(scans: Sequence[Scan]) -> Iterable[Scan]:
    """The scans, with a progress bar for mapping them on standard error."""
    return track("mapping", scans)


def track(text: str, scans: Sequence[Tracked]) -> Iterable[Tracked]:
    """Scans or their numbers, with a progress bar on standard error: how many, how many a second, time left."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    def tracked() -> Iterator[Tracked]:
        columns = (
            TextColumn(text),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("scans  {task.fields[rate]}"),
            TimeRemainingColumn(),
        )
        with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
            task = progress.add_task(text, total=len(scans), rate="")
            for done, scan in enumerate(scans):
                yield scan
                if done % 64 == 0:
                    speed = progress.tasks[0].speed
                    rate = f"{count_text(round(speed))}/s" if speed else ""
                    progress.update(task, completed=done + 1, rate=rate)
            progress.update(task, completed=len(scans))

    return tracked()


@contextmanager
def track_bytes(text: str, wanted: bool) -> Iterator[Callable[[int, int], None] | None]:
    """A progress bar for reading a file, where it is wanted: how much, how fast, time left.

    What it gives is to be called with the bytes that are done, and with all there are.
    """
    if not wanted:
        yield None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        DownloadColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
        TransferSpeedColumn,
    )

    columns = (TextColumn(text), BarColumn(), DownloadColumn(), TransferSpeedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(text, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


@contextmanager
def status(text: str, wanted: bool) -> Iterator[Callable[[str], None]]:
    """A spinner with a text on standard error, where it is wanted; what it gives changes the text."""
    if not wanted:
        yield lambda text: None
        return
    from rich.console import Console

    with Console(stderr=True).status(text) as spinner:
        yield spinner.update


def wants_progress(quiet: bool) -> bool:
    """Whether a progress bar is welcome: on a terminal, and not told to be quiet."""
    return not quiet and sys.stderr.isatty()


def check_new_picture(path: Path, force: bool) -> None:
    """Refuse to write over a file unless told to, into no directory, and in an unknown format."""
    if path.suffix.lower() not in PICTURE_SUFFIXES:
        raise ConfigError(f"{path} names no picture format; wanted a name that ends in {', '.join(PICTURE_SUFFIXES)}")
    check_new_file(path, force)


def check_new_file(path: Path, force: bool) -> None:
    """Refuse to write over a file unless told to, and into no directory."""
    if path.is_dir():
        raise MapError(f"{path} is a directory; name a file")
    if path.exists() and not force:
        raise MapError(f"{path} exists already; use --force to replace it, or choose another name")
    if not path.absolute().parent.is_dir():
        raise MapError(f"{path.parent} is not a directory; make it first, or choose another place for {path.name}")


def save_figure(figure: Figure, path: Path) -> None:
    """Write a picture, all of it or nothing."""
    from tempog.views import figures

    figures.save_figure(figure, path)
