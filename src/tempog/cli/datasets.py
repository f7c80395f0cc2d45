"""``tempog datasets``: public logs to try things on."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from tempog.cli._output import (
    JsonFlag,
    QuietFlag,
    bytes_text,
    print_json,
    print_note,
    wants_progress,
    wrapped,
)

INDENT = 17  # columns before what a row says

app = typer.Typer(
    name="datasets",
    help="Public laser logs: what there is, and fetching it.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.command("list")
def list_datasets(json: JsonFlag = False) -> None:
    """Say which logs there are, how large they are, and what to mind."""
    from tempog.scans.datasets import datasets

    if json:
        print_json({"datasets": [one.to_dict() for one in datasets().values()]})
        return
    for one in datasets().values():
        typer.echo(f"{one.name:{INDENT}}{wrapped(f'{bytes_text(one.size)}: {one.what}', INDENT)}")
        for pitfall in one.pitfalls:
            typer.echo(f"{'':{INDENT}}{wrapped(f'note: {pitfall}', INDENT)}")
    typer.echo("For all of them: " + "; ".join(sorted({one.licence for one in datasets().values()})) + ".")


@app.command("get")
def get_dataset(
    name: Annotated[str, typer.Argument(metavar="NAME", help="As in tempog datasets list.")],
    to: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Put a copy there. Default: only keep it in the cache.")
    ] = None,
    quiet: QuietFlag = False,
    json: JsonFlag = False,
) -> None:
    """Fetch a log, unless it is in the cache already, and say where it is."""
    from tempog.scans.datasets import dataset, fetch

    wanted = dataset(name)
    progress = _Bar(name, wanted.size) if wants_progress(quiet or json) else None
    path = fetch(name, to=to, progress=progress)
    if json:
        print_json({"path": str(path), **wanted.to_dict()})
        return
    typer.echo(path)
    if quiet:
        return
    for pitfall in wanted.pitfalls:
        print_note(pitfall)
    print_note(wanted.licence)
    print_note(f"try: {wanted.try_it.format(file=shlex.quote(str(path)))}")


class _Bar:
    """A progress bar on standard error, told by pooch how many bytes have come."""

    def __init__(self, text: str, total: int) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (TextColumn("fetching {task.description}"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
        self._progress = Progress(*columns, console=Console(stderr=True), transient=True)
        self._task = self._progress.add_task(text, total=total)
        self.total = total

    def update(self, n: int) -> None:
        self._progress.start()
        self._progress.update(self._task, advance=n)

    def reset(self) -> None:
        """Pooch calls it when all has come."""

    def close(self) -> None:
        self._progress.stop()
