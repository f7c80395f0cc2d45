"""``tempog simulate``: a world file to a log, with the truth beside it."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from tempog.cli._output import (
    DurationOption,
    ForceFlag,
    JsonFlag,
    PeopleOption,
    QuietFlag,
    check_duration,
    check_new_file,
    counted,
    duration_text,
    print_json,
    track,
    wants_progress,
)
from tempog.errors import ConfigError

LOG_SUFFIXES = (".npz", ".log", ".clf")


def simulate(
    world: Annotated[
        str, typer.Argument(metavar="WORLD", help="A world as a TOML file, or: hallway, office, ring, rooms, random.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="LOG", help="The log to write: .npz, or .log.")],
    people: PeopleOption = None,
    seed: Annotated[int, typer.Option(min=0, help="Of people, doors, noise, and random buildings.")] = 0,
    duration: DurationOption = None,
    force: ForceFlag = False,
    quiet: QuietFlag = False,
    json: JsonFlag = False,
) -> None:
    """Simulate a robot in a world with doors and people; write its log and the truth."""
    from tempog.simulation import load_world
    from tempog.simulation import simulate as run
    from tempog.simulation.truth import truth_paths, write_truth

    check_duration(duration)
    if output.suffix.lower() not in LOG_SUFFIXES:
        raise ConfigError(f"{output} names no kind of log; wanted a name that ends in {', '.join(LOG_SUFFIXES)}")
    for path in (output, *truth_paths(output)):
        check_new_file(path, force)
    described = load_world(world, seed)
    bar = partial(track, f"simulating {world}") if wants_progress(quiet or json) else None
    simulation = run(described, duration, seed=seed, people=people, track=bar)
    for path in truth_paths(output):
        path.unlink(missing_ok=True)  # if writing stops half-way, a log without truth is better than with another's
    if output.suffix.lower() == ".npz":
        from tempog.scans.npz import write_npz

        write_npz(output, simulation.scans)
    else:
        from tempog.scans.carmen_writer import write_carmen

        write_carmen(output, simulation.scans)
    as_json, as_npz = write_truth(output, simulation)
    n_people, n_replayed = simulation.people.shape[1], len(described.people.tracks)
    replayed = f" ({n_replayed} of them replayed)" if n_replayed else ""
    if json:
        print_json(
            {
                "log": str(output),
                "truth": [str(as_json), str(as_npz)],
                "world": world,
                "seed": seed,
                "n_scans": len(simulation.scans),
                "n_people": n_people,
                "n_replayed": n_replayed,
                "n_things": len(described.things),
                "duration_s": simulation.duration_s,
            }
        )
    elif not quiet:
        typer.echo(
            f"{output}: {counted(len(simulation.scans), 'scan', 'scans')} in {duration_text(simulation.duration_s)},"
            f" {counted(n_people, 'person', 'people')}{replayed},"
            f" {counted(len(described.things), 'door or box', 'doors and boxes')}"
        )
        typer.echo(f"Truth: {as_json}, {as_npz}")
