"""``tempog diff``: what changed between two moments."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tempog._files import whole_file
from tempog.cli._maps import MapArgument, RobotOption, SessionOption, note_pruned, opened
from tempog.cli._output import (
    ForceFlag,
    QuietFlag,
    check_new_file,
    check_new_picture,
    counted,
    duration_text,
    print_note,
    save_figure,
    status,
    wants_progress,
    wrapped,
)
from tempog.cli.objects import MethodOption, offset_text
from tempog.cli.show import MOMENT_HELP
from tempog.methods import FOR_S, SMALLEST_M, SURFACE_M

if TYPE_CHECKING:
    from tempog.analysis.map_diff import MapDiff
    from tempog.analysis.moved_objects import Move, Whereabouts
    from tempog.analysis.patches import Patch

NUMBER_WIDTH = 5
HEAD = f"{'no.':>4} {'change':<9} {'x':>7} {'y':>7}  what"


def diff(
    map_path: MapArgument,
    between: Annotated[
        tuple[str, str], typer.Option("--between", metavar="T1 T2", help=f"The two moments: {MOMENT_HELP}.")
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="PICTURE", help="Draw it to a file, e.g. diff.png.")
    ] = None,
    file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write all of it to a file as JSON.")
    ] = None,
    for_s: Annotated[
        float,
        typer.Option(
            "--for", help="Seconds; what was watched there for a shorter time is counted, not listed: people."
        ),
    ] = FOR_S,
    hold: Annotated[
        float | None, typer.Option(help="Seconds that a cell keeps its last known state. Default: for ever.")
    ] = None,
    smallest_m: Annotated[
        float, typer.Option("--smallest", help="Metres; what reaches less far is dropped.")
    ] = SMALLEST_M,
    surface_m: Annotated[
        float,
        typer.Option(
            "--surface", help="Metres; what is this close to something occupied at the other moment is no change."
        ),
    ] = SURFACE_M,
    method: MethodOption = "evidence",
    sessions: SessionOption = None,
    robots: RobotOption = None,
    force: ForceFlag = False,
    quiet: QuietFlag = False,
) -> None:
    """Say what appeared, vanished or moved between two moments, and what nobody can tell.

    Known objects, such as doors, move, at least so often as is said; anything else appears or vanishes. The last
    known state counts at either moment. Times are seconds since the log's start. What was watched for less than
    --for while it was there may be somebody who waits; where nobody walks about, --for 1 lists everything else, too.
    """
    if output is not None:
        check_new_picture(output, force)
    if file is not None:
        check_new_file(file, force)
    from tempog.analysis.find_objects import find_objects
    from tempog.analysis.map_diff import map_diff, two_moments
    from tempog.analysis.pose_consistency import pose_consistency

    saved = opened(map_path, sessions, robots)
    two_moments(saved, *between)  # errors come before the work
    with status("finding what changed", wants_progress(quiet)):
        changed = map_diff(
            saved,
            *between,
            found=find_objects(saved, method),
            hold=math.inf if hold is None else hold,
            for_s=for_s,
            smallest_m=smallest_m,
            surface_m=surface_m,
        )
        poses = pose_consistency(saved)
    if file is not None:  # before anything is printed: whoever reads that may stop listening
        document = {**changed.document(), "poses": poses.to_dict()}
        with whole_file(file) as unfinished:
            unfinished.write_text(json.dumps(document, allow_nan=False) + "\n", encoding="utf-8")
    if output is not None:
        from tempog.views.diff import draw_diff

        save_figure(draw_diff(changed, title=map_path.stem), output)
    for line in diff_lines(changed):
        typer.echo(line)
    for path in (output, file):
        if path is not None:
            typer.echo(f"Written: {path}")
    if quiet:
        return
    note_pruned(saved, changed.before_ns, changed.after_ns)
    if poses.warning:
        print_note(poses.warning)


def diff_lines(changed: MapDiff) -> list[str]:
    """All changes, a line each, and what cannot be said."""
    from tempog.analysis.moved_objects import Move

    start_ns = int(changed.history.stamps_ns[0])
    moments = [offset_text(stamp, start_ns) for stamp in (changed.before_ns, changed.after_ns)]
    counts = f"{len(changed.moved)} moved, {len(changed.appeared)} appeared, {len(changed.vanished)} vanished"
    lines = [f"{moments[0]} s to {moments[1]} s: {counts}, in {changed.areas.compared_m2:.1f} m² seen again"]
    if changed.changes:
        lines.append(HEAD)
    for k, change in enumerate(changed.changes):
        text = move_text(change, start_ns) if isinstance(change, Move) else patch_text(change, start_ns)
        lines.append(f"{k + 1:>4} {text}")
    unseen = changed.objects_not_seen_again
    objects = f", {'object' if len(unseen) == 1 else 'objects'} {', '.join(map(str, unseen))}" if unseen else ""
    lines.append(wrapped(f"not seen again: {changed.areas.not_seen_again_m2:.1f} m²{objects}", 4))
    lines.append(f"seen only since: {changed.areas.first_seen_m2:.1f} m²")
    if changed.brief:
        n = len(changed.brief)
        lines.append(
            f"not listed: {counted(n, 'patch', 'patches')} of what was watched for less than {changed.for_s:g} s,"
            " as people are"
        )
    return lines


def move_text(move: Move, start_ns: int) -> str:
    """A move as a line of the table, without its number."""
    points = [place.centre_m for place in move.one.configurations]
    x, y = (sum(values) / len(points) for values in zip(*points, strict=True))
    places = " -> ".join(state_text(move, where) for where in (move.before, move.after))
    seen = [offset_text(stamp, start_ns) for stamp in (move.before.last_seen_ns, move.after.last_seen_ns)]
    return row(
        "moved",
        x,
        y,
        f"object {move.one.id}: {places}; {counted(move.n_moves, 'move', 'moves')}; last seen {seen[0]}, {seen[1]}",
    )


def state_text(move: Move, where: Whereabouts) -> str:
    """Where an object was: the id of a place with its centre, or in none of them."""
    place = move.place(where)
    if place is None:
        return "elsewhere"
    x, y = place.centre_m
    return f"{place.id} ({x:.1f}, {y:.1f})"


def patch_text(patch: Patch, start_ns: int) -> str:
    """A patch as a line of the table, without its number."""
    (x, y), box = patch.centre_m, patch.bounds
    was, now = ("free", "there") if patch.kind == "appeared" else ("there", "free")
    last, first = (offset_text(stamp, start_ns) for stamp in (patch.last_before_ns, patch.first_after_ns))
    of_object = f"; at object {patch.object_id}" if patch.object_id is not None else ""
    return row(
        patch.kind,
        x,
        y,
        f"{box.x_max - box.x_min:.1f} x {box.y_max - box.y_min:.1f} m, {was} until {last}, {now} from {first};"
        f" watched {duration_text(patch.watched_s)}{of_object}",
    )


def row(kind: str, x: float, y: float, what: str) -> str:
    """The columns of one change after its number."""
    columns = f"{kind:<9} {x:>7.2f} {y:>7.2f}  "
    return columns + wrapped(what, len(columns) + NUMBER_WIDTH)
