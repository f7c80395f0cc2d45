"""``tempog experiment``: the paper's experiments, from the world to pictures and scores."""

from __future__ import annotations

import json
import shutil
import sys
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from tempog._files import whole_file
from tempog.cli._output import (
    DurationOption,
    ForceFlag,
    PeopleOption,
    QuietFlag,
    check_duration,
    counted,
    print_note,
    save_figure,
    status,
    track,
    track_scans,
    wants_progress,
)
from tempog.config import GridConfig, MapConfig
from tempog.errors import ConfigError, MapError, WorldError
from tempog.methods import METHODS, Method

if TYPE_CHECKING:
    from tempog.evaluation.experiment import Outcome

ALL = "all"
PICTURES = ("world.png", "classic.png", "objects.png", "side-by-side.png")
RESULTS = ("table.md", "scores.json")


def experiment(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME", help="1 (nobody), 2a, 2b, 2c (20, 40, 60 people), all, or a world as for tempog simulate."
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Where pictures and scores go.")],
    seed: Annotated[int, typer.Option(min=0, help="Of people, doors and noise; the first, with --seeds.")] = 0,
    seeds: Annotated[int, typer.Option(min=1, help="How many seeds to run, one after the other.")] = 1,
    method: Annotated[
        list[str] | None,
        typer.Option(
            metavar="|".join(METHODS),
            help="May be given several times. Default: evidence; for all experiments, every method.",
        ),
    ] = None,
    resolution: Annotated[
        list[float] | None,
        typer.Option(help="Side of a cell, metres; may be given several times. For all experiments: 0.1 and 0.05."),
    ] = None,
    people: PeopleOption = None,
    duration: DurationOption = None,
    force: ForceFlag = False,
    quiet: QuietFlag = False,
) -> None:
    """Simulate, map, find objects, judge and draw (sections V.B and V.C of the paper)."""
    from tempog.evaluation.experiment import EXPERIMENTS, drive_through, examine
    from tempog.evaluation.table import scores_table

    check_duration(duration)
    runs: dict[str, tuple[str, int | None]]
    if name in (ALL, *EXPERIMENTS):
        if people is not None:
            raise ConfigError(
                f"--people does not go with experiment {name}, which says how many; name a world instead"
            )
        runs = {one: ("hallway", EXPERIMENTS[one]) for one in (EXPERIMENTS if name == ALL else [name])}
    else:
        check_world(name, seed)
        runs = {Path(name).stem: (name, people)}
    for one_name in method or []:
        if one_name not in METHODS:
            raise ConfigError(f"--method {one_name} is unknown; wanted one of {', '.join(METHODS)}")
    methods = cast("list[Method]", method) or (list(METHODS) if name == ALL else ["evidence"])
    resolutions = resolution or ([0.1, 0.05] if name == ALL else [GridConfig.resolution_m])
    methods, resolutions = list(dict.fromkeys(methods)), list(dict.fromkeys(resolutions))  # each once
    for resolution_m in resolutions:
        MapConfig(grid=GridConfig(resolution_m=resolution_m))  # rather refused now than after a simulation
    folders = {title: output / title if len(runs) > 1 else output for title in runs}
    check_new_results(output, folders, force)

    started = time.perf_counter()
    outcomes: list[Outcome] = []
    first: dict[str, Outcome] = {}
    wants_bar = wants_progress(quiet)
    for title, (world, n_people) in runs.items():
        for one_seed in range(seed, seed + seeds):
            bar = partial(track, f"experiment {title}, seed {one_seed}: simulating") if wants_bar else None
            drive = drive_through(world, n_people, one_seed, duration, bar)
            for resolution_m in resolutions:
                for one_method in methods:
                    outcome = examine(drive, one_method, resolution_m, track_scans if wants_bar else None)
                    outcomes.append(outcome)
                    if title not in first:
                        first[title] = outcome
                        with status(f"experiment {title}: drawing", wants_bar):
                            draw(folders[title], title, outcome)
    if len(runs) > 1:
        draw_side_by_sides(output / "side-by-side.png", first)
    table = scores_table(outcomes)
    scores = json.dumps([outcome.to_dict() for outcome in outcomes], indent=1, allow_nan=False)
    for file, text in zip(RESULTS, (table, scores), strict=True):
        with whole_file(output / file) as unfinished:
            unfinished.write_text(text + "\n", encoding="utf-8")
    columns = shutil.get_terminal_size().columns
    if sys.stdout.isatty() and max(map(len, table.splitlines())) > columns:
        upright = scores_table(outcomes, upright=True)
        table = upright if max(map(len, upright.splitlines())) <= columns else table
    typer.echo(table)
    if not quiet:
        runs_text = counted(len(outcomes), "run", "runs")
        print_note(f"{runs_text} in {time.perf_counter() - started:.1f} s; pictures and scores in {output}")


def check_world(name: str, seed: int) -> None:
    """Refuse what is neither experiment nor world."""
    from tempog.evaluation.experiment import EXPERIMENTS
    from tempog.simulation import load_world

    try:
        load_world(name, seed)
    except WorldError as error:
        if Path(name).exists():
            raise
        raise WorldError(f"{error}\n  Experiments: {', '.join([*EXPERIMENTS, ALL])}.") from error


def check_new_results(output: Path, folders: dict[str, Path], force: bool) -> None:
    """Refuse to write over what is there unless told to."""
    files = [output / file for file in RESULTS]
    files += [folder / picture for folder in folders.values() for picture in PICTURES]
    if len(folders) > 1:
        files.append(output / "side-by-side.png")
    for folder in (output, *folders.values()):
        if folder.exists() and not folder.is_dir():
            raise MapError(f"{folder} is a file; name a directory for pictures and scores")
    for file in files:
        if file.exists() and not force:
            raise MapError(f"{file} exists already; use --force to replace it, or choose another directory")


def draw(folder: Path, title: str, outcome: Outcome) -> None:
    """Fig. 12, 14 and 13, and the three beside each other."""
    from tempog.views.figures import draw_layer
    from tempog.views.objects import draw_objects
    from tempog.views.worlds import draw_world

    folder.mkdir(parents=True, exist_ok=True)
    headline = f"experiment {title}"
    figures = (
        draw_world(outcome.drive.simulation, title=headline),
        draw_layer(outcome.found.history, "classic", title=headline),
        draw_objects(outcome.found, title=headline),
    )
    for figure, picture in zip(figures, PICTURES, strict=False):
        save_figure(figure, folder / picture)
    draw_side_by_sides(folder / PICTURES[3], {title: outcome})


def draw_side_by_sides(path: Path, outcomes: dict[str, Outcome]) -> None:
    """Table I: world, map and classic grid, a row for each experiment."""
    from tempog.views.side_by_side import Row, draw_table_1

    rows = [Row(title, outcome.drive.simulation, outcome.found) for title, outcome in outcomes.items()]
    save_figure(draw_table_1(rows), path)
