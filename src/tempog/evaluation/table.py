"""Scores of many runs as one table: a row per setting, mean and spread over the seeds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from tempog.evaluation.experiment import Outcome
from tempog.evaluation.scores import Share


class Column(NamedTuple):
    """A column: its heading, and what one run says in it; None where it says nothing."""

    heading: str
    value: Callable[[Outcome], float | None]
    digits: int = 2


COLUMNS = (
    Column("static F1", lambda run: run.scores.static.f1),
    Column("places found", lambda run: run.scores.configurations.recall.value),
    Column("of those seen twice", lambda run: run.scores.configurations.recall_twice.value),
    Column("precision", lambda run: run.scores.configurations.precision.value),
    Column("false places", lambda run: n_missed(run.scores.configurations.precision), 1),
    Column("things right", lambda run: run.scores.objects.associated.n + run.scores.objects.alone.n, 1),
    Column("of", lambda run: run.scores.objects.associated.of + run.scores.objects.alone.of, 1),
    Column("wrong links", lambda run: run.scores.links.n_wrong, 1),
    Column("moving: precision", lambda run: run.scores.high_dynamic.precision.value),
    Column("moving: recall", lambda run: run.scores.high_dynamic.recall.value),
    *(
        Column(f"{step} (s)", lambda run, step=step: run.step_s[step], 1)  # type: ignore[misc]
        for step in ("simulate", "map", "analyse")
    ),
)
HEADINGS = ("world", "people", "method", "cell (m)", "seeds")


def n_missed(share: Share) -> int:
    """Those of a share that do not count."""
    return share.of - share.n


def scores_table(outcomes: Sequence[Outcome], *, upright: bool = False) -> str:
    """A Markdown table of runs, grouped by world, people, method and resolution, in the order they first came.

    A number is the mean over the seeds, followed by the smallest and the largest value where they differ when
    rounded. "-" stands where no run says anything: nobody was on the move, for example. Random buildings are one
    world, whatever their seed. An `upright` table has a column per setting instead of a row.
    """
    first_seen = {key: k for k, key in reversed(list(enumerate(map(_setting, outcomes))))}
    ordered = sorted(outcomes, key=lambda run: first_seen[_setting(run)])
    rows = [[*HEADINGS, *(column.heading for column in COLUMNS)]]
    for setting, runs in groupby(ordered, key=_setting):
        group = list(runs)
        cells = [_cell([column.value(run) for run in group], column.digits) for column in COLUMNS]
        rows.append([*map(str, setting), str(len(group)), *cells])
    if upright:
        rows = [list(column) for column in zip(*rows, strict=True)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = [
        "| " + " | ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)) + " |" for row in rows
    ]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def _setting(run: Outcome) -> tuple[str, int, str, str]:
    return run.drive.name, run.drive.people, run.method, f"{run.resolution_m:g}"


def _cell(values: Sequence[float | None], digits: int) -> str:
    known = [value for value in values if value is not None]
    if not known:
        return "-"
    if isinstance(known[0], int) and len(set(known)) == 1:  # a count, not a mean of counts
        return str(known[0])
    mean, low, high = (f"{value:.{digits}f}" for value in (np.mean(known), min(known), max(known)))
    return mean if low == high else f"{mean} ({low}-{high})"
