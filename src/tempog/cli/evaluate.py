"""``tempog evaluate``: how right is what was found in a simulated log?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tempog.cli._output import (
    JsonFlag,
    QuietFlag,
    count_text,
    counted,
    duration_text,
    print_json,
    print_note,
    status,
    wants_progress,
)
from tempog.errors import AnswerError
from tempog.methods import Method

if TYPE_CHECKING:
    from tempog.evaluation import Scores, Share

LISTED = 12  # missed places
EVERY_S = 1.0  # as in the experiments


def evaluate(
    answer: Annotated[
        Path, typer.Argument(metavar="MAP_OR_JSON", help="A map, or what tempog objects --json wrote about one.")
    ],
    truth: Annotated[Path, typer.Argument(metavar="TRUTH", help="The log that was mapped, or LOG.truth.json.")],
    method: Annotated[
        Method | None, typer.Option(help="Of a map: how to find objects, as for tempog objects. Default: evidence.")
    ] = None,
    every: Annotated[
        float | None,
        typer.Option(min=0, help="Of a map: seconds from one look for what is on the move to the next. Default: 1."),
    ] = None,
    json: JsonFlag = False,
    quiet: QuietFlag = False,
) -> None:
    """Score the objects found in a map of a simulated log against the truth."""
    from tempog.evaluation import evaluate as judge
    from tempog.simulation.truth import read_truth

    known = read_truth(truth)
    if not quiet and not json:
        for note in doubts(answer, truth, method, every):
            print_note(note)
    with status("finding objects", wants_progress(quiet or json)):
        document = found(answer, method or "evidence", EVERY_S if every is None else every)
    with status("comparing with the truth", wants_progress(quiet or json)):
        scores = judge(document, known)
    if json:
        print_json(scores.to_dict())
    else:
        typer.echo("\n".join(table(scores)))


def found(answer: Path, method: Method, every_s: float) -> dict[str, Any]:
    """The document to score: a JSON file as it is, or what a method finds in a map."""
    if not answer.is_dir():
        if answer.is_file() and answer.suffix in (".npz", ".log", ".clf", ".gz"):
            raise AnswerError(
                f"{answer} is no JSON; wanted a map, which tempog map makes of a log,"
                " or what tempog objects --json writes"
            )
        from tempog.analysis.objects_schema import read_objects

        return read_objects(answer)
    from tempog.analysis.find_objects import find_objects
    from tempog.store.saved_map import open_map

    objects = find_objects(open_map(answer), method)
    return objects.document(objects.high_dynamics(every_s))


def doubts(answer: Path, truth: Path, method: Method | None, every_s: float | None) -> list[str]:
    """What a user may have got wrong, though it can be scored."""
    if not answer.is_dir():
        given = {"--method": method, "--every": every_s}
        names = [name for name, value in given.items() if value is not None]
        return [f"{' and '.join(names)} ignored: {answer} says what was found already"] if names else []
    from tempog.simulation.truth import SUFFIXES
    from tempog.store.saved_map import open_map

    log = truth.name
    for suffix in SUFFIXES:
        log = log.removesuffix(suffix)
    sources = [source for session in open_map(answer).sessions for source in session.sources]
    mapped = [Path(source["path"]).name for source in sources if source["path"]]
    if not mapped or log in mapped:
        return []
    return [
        f"{answer} is a map of {', '.join(mapped)}, the truth is about {log}; scores mean nothing if these differ"
    ]


def table(scores: Scores) -> list[str]:
    """The scores as lines of text."""
    static, places, things, links, moving = (
        scores.static,
        scores.configurations,
        scores.objects,
        scores.links,
        scores.high_dynamic,
    )
    f1 = "unknown" if static.f1 is None else f"{static.f1:.2f}"
    lines = [
        f"{scores.world or 'world'}, method {scores.method}, {duration_text(scores.stop_s - scores.start_s)},"
        f" cells of {scores.resolution_m:g} m",
        f"{'':<16}{'precision':<24}recall",
        _row("static", static.precision, static.recall, f"F1 {f1}", _neutral(static.n_neutral)),
        *([_row("glass", scores.uncertain.precision, scores.uncertain.recall)] if scores.uncertain.recall.of else []),
        _row(
            "configurations",
            places.precision,
            places.recall,
            f"seen twice {_share(places.recall_twice)}",
            _neutral(places.n_neutral),
        ),
        _row("links", links.precision, links.recall, f"{links.n_wrong} wrong", _neutral(links.n_neutral)),
        _row(
            "on the move",
            moving.precision,
            moving.recall,
            counted(moving.n_scans, "scan", "scans"),
            "" if moving.n_scans else "tempog objects --high-dynamic writes them",
            f"false {_share(moving.false_share)} of what was hit" if moving.false_share.of else "",
            _neutral(moving.n_neutral),
        ),
        "",
        f"false configurations: {places.n_at_walls} at walls, {places.n_at_things} at doors and boxes,"
        f" {places.n_in_free_space} elsewhere",
        _counts(
            f"objects fully associated: {things.associated.n} of {things.associated.of}",
            {"two places": things.two_places, "three": things.three_places, "more": things.more_places},
        ),
        f"objects of one place, kept alone: {things.alone.n} of {things.alone.of}",
    ]
    kinds = {"hinged": things.hinged, "sliding": things.sliding, "boxes": things.box}
    if any(share.of for share in kinds.values()):
        lines.append(_counts("all objects", kinds))
    missed = [f"{one.thing} {one.place}" for one in scores.places if one.observable and one.configuration is None]
    if missed:
        more = f" and {len(missed) - LISTED} more" if len(missed) > LISTED else ""
        lines.append(f"missed: {', '.join(missed[:LISTED])}{more}")
    return lines


def _row(name: str, precision: Share, recall: Share, *notes: str) -> str:
    return f"{name:<16}{_share(precision):<24}{_share(recall):<24}{', '.join(filter(None, notes))}".rstrip()


def _share(share: Share) -> str:
    if share.value is None:
        return "unknown"
    return f"{share.value:.2f} ({count_text(share.n)} of {count_text(share.of)})"


def _neutral(count: int) -> str:
    return f"{count_text(count)} neutral" if count else ""


def _counts(text: str, parts: dict[str, Share]) -> str:
    known = ", ".join(f"{part} {share.n} of {share.of}" for part, share in parts.items() if share.of)
    return f"{text} ({known})" if known else text
