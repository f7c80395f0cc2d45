"""The judge: every score of an answer, each by its own function."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.objects_schema import check_objects
from tempog.config import GridConfig
from tempog.errors import AnswerError, ConfigError
from tempog.evaluation.answer import Answer, document_cells, read_answer
from tempog.evaluation.matching import match
from tempog.evaluation.scores import (
    ConfigurationScores,
    HighDynamicScores,
    LinkScores,
    ObjectScores,
    PlaceScore,
    Scores,
    Share,
    StaticScores,
    UncertainScores,
)
from tempog.sensing.grid_spec import GridSpec
from tempog.simulation.cell_sets import cells_at, near, unique_cells
from tempog.simulation.observability import SeenPlace, seen_places
from tempog.simulation.polygons import covered_cells
from tempog.simulation.simulation import MOVING, Hit
from tempog.simulation.truth import SAME_STAMP_S, Truth

Matched = dict[int, tuple[int, float]]


def evaluate(document: dict[str, Any], truth: Truth) -> Scores:
    """Score found objects against the truth about their log.

    Parameters
    ----------
    document : dict
        By ``tempog/schemas/objects-1.json``, as `objects_document` makes and `read_objects` reads it.
    truth : Truth
        Of the log, or of a longer one: only what was true, and could be seen, from the document's start_s to its
        stop_s counts.

    Returns
    -------
    Scores
        Counts and shares of each kind; see `tempog.evaluation.scores` for what each counts.

    Raises
    ------
    AnswerError
        A document that does not follow the schema, of cells that no map has, of a period that the truth covers
        only in part, or of scans that it does not know.
    EmptyWindowError
        A document of another time than the truth.

    Notes
    -----
    All cells have the document's size, and near means within one cell, diagonals included. A configuration is matched
    with a place by the place's seen cells (`tolerant_iou` of `MATCH_IOU` or more), each with one at most. What is
    reported at places that were seen but are not observable, most of them since they were never seen free, counts
    neither for nor against anything, whether as wall or as their configuration; so does glass as wall. See
    `tempog.simulation.observability` for what counts as seen.

    Examples
    --------
    >>> from tempog.evaluation import truth_document
    >>> from tempog.simulation import load_world, simulate
    >>> truth = Truth.of(simulate(load_world("hallway"), duration_s=120.0))
    >>> scores = evaluate(truth_document(truth, 0.05), truth)
    >>> scores.static.f1, scores.configurations.recall.value, scores.links.n_wrong
    (1.0, 1.0, 0)
    """
    check_objects(document)
    resolution_m = float(document["resolution_m"])
    try:
        GridConfig(resolution_m=resolution_m)
    except ConfigError as error:
        raise AnswerError(f"the document: {error}") from error
    whole, truth = truth, truth.window(document["start_s"], document["stop_s"])
    if (
        document["start_s"] < whole.stamps_s[0] - SAME_STAMP_S
        or document["stop_s"] > whole.stamps_s[-1] + SAME_STAMP_S
    ):
        raise AnswerError(
            f"the document is about {document['start_s']:.3f} s to {document['stop_s']:.3f} s, the truth only about"
            f" {whole.stamps_s[0]:.3f} s to {whole.stamps_s[-1]:.3f} s. Is this the truth about the same log?"
        )
    places = seen_places(truth, resolution_m)
    answer = read_answer(document)
    matched = match(answer.configurations, [place.seen for place in places], [place.observable for place in places])
    configuration_of = {place: (number, iou) for number, (place, iou) in matched.items()}
    return Scores(
        world=truth.world,
        method=document["method"],
        resolution_m=resolution_m,
        start_s=float(truth.stamps_s[0]),
        stop_s=float(truth.stamps_s[-1]),
        static=_static(answer, truth, places, resolution_m),
        uncertain=_uncertain(answer, truth, resolution_m),
        configurations=_configurations(answer, truth, places, matched, resolution_m),
        objects=_objects(answer, truth, places, configuration_of),
        links=_links(answer, places, matched),
        high_dynamic=_high_dynamic(document["high_dynamic"], truth, resolution_m),
        places=tuple(
            PlaceScore(
                thing=truth.things[place.thing].name,
                place=list(truth.things[place.thing].places)[place.place],
                n_cells=len(place.seen),
                n_occupied=place.n_occupied,
                n_free=place.n_free,
                observable=place.observable,
                configuration=answer.ids[configuration_of[k][0]] if k in configuration_of else None,
                iou=configuration_of[k][1] if k in configuration_of else None,
            )
            for k, place in enumerate(places)
            if len(place.seen)
        ),
    )


def _static(answer: Answer, truth: Truth, places: list[SeenPlace], resolution_m: float) -> StaticScores:
    unclear = [place.covered for place in places if len(place.seen) and not place.observable]
    neutral_cells = unique_cells(truth.static_cells(resolution_m, glass=True), *unclear)
    right = near(answer.static, truth.static_cells(resolution_m))
    neutral = ~right & near(answer.static, neutral_cells)
    seen = truth.static_seen(resolution_m)
    return StaticScores(
        precision=Share(int(right.sum()), int((~neutral).sum())),
        recall=Share(int(near(seen, answer.static).sum()), len(seen)),
        n_neutral=int(neutral.sum()),
    )


def _uncertain(answer: Answer, truth: Truth, resolution_m: float) -> UncertainScores:
    right = near(answer.uncertain, truth.static_cells(resolution_m, glass=True))
    seen = truth.glass_seen(resolution_m)
    return UncertainScores(
        precision=Share(int(right.sum()), len(right)),
        recall=Share(int(near(seen, answer.uncertain).sum()), len(seen)),
    )


def _configurations(
    answer: Answer, truth: Truth, places: list[SeenPlace], matched: Matched, resolution_m: float
) -> ConfigurationScores:
    walls = unique_cells(truth.static_cells(resolution_m), truth.static_cells(resolution_m, glass=True))
    things = unique_cells(*(place.covered for place in places))
    n_at_walls = n_at_things = n_in_free_space = 0
    for number, cells in enumerate(answer.configurations):
        if number in matched:
            continue
        if 2 * np.count_nonzero(near(cells, walls)) > len(cells):
            n_at_walls += 1
        elif 2 * np.count_nonzero(near(cells, things)) > len(cells):
            n_at_things += 1
        else:
            n_in_free_space += 1
    found = {place for place, _ in matched.values()}
    right = {place for place in found if places[place].observable}
    observable = {k for k, place in enumerate(places) if place.observable}
    twice = {k for k in observable if places[k].n_occupied >= 2}
    return ConfigurationScores(
        precision=Share(len(right), len(right) + n_at_walls + n_at_things + n_in_free_space),
        recall=Share(len(right), len(observable)),
        recall_twice=Share(len(right & twice), len(twice)),
        n_neutral=len(found - right),
        n_at_walls=n_at_walls,
        n_at_things=n_at_things,
        n_in_free_space=n_in_free_space,
    )


def _objects(
    answer: Answer, truth: Truth, places: list[SeenPlace], configuration_of: dict[int, tuple[int, float]]
) -> ObjectScores:
    outcomes: list[tuple[str, int, bool]] = []  # kind, number of observable places, whether right
    for k, thing in enumerate(truth.things):
        of_thing = [j for j, place in enumerate(places) if place.thing == k]
        observable = [j for j in of_thing if places[j].observable]
        if not observable:
            continue
        allowed = {configuration_of[j][0] for j in of_thing if j in configuration_of}
        wanted = {configuration_of[j][0] for j in observable if j in configuration_of}
        right = len(wanted) == len(observable)
        if len(observable) > 1:
            right = right and any(wanted <= one <= allowed for one in answer.objects)
        else:
            right = right and all(one <= allowed for one in answer.objects if one & wanted)
        outcomes.append((thing.kind, len(observable), right))

    def share(low: int, high: float = np.inf, kind: str | None = None) -> Share:
        chosen = [right for of, n, right in outcomes if low <= n <= high and kind in (None, of)]
        return Share(sum(chosen), len(chosen))

    return ObjectScores(
        associated=share(2),
        alone=share(1, 1),
        two_places=share(2, 2),
        three_places=share(3, 3),
        more_places=share(4),
        hinged=share(1, kind="hinged"),
        sliding=share(1, kind="sliding"),
        box=share(1, kind="box"),
    )


def _links(answer: Answer, places: list[SeenPlace], matched: Matched) -> LinkScores:
    links = {pair for one in answer.objects for pair in combinations(sorted(one), 2)}
    n_right = n_neutral = 0
    for pair in links:
        if not all(number in matched for number in pair):
            continue
        first, second = (places[matched[number][0]] for number in pair)
        if first.thing == second.thing:
            both = first.observable and second.observable
            n_right += both
            n_neutral += not both
    observable = [place.thing for place in places if place.observable]
    n_wanted = sum(one == other for one, other in combinations(observable, 2))
    return LinkScores(Share(n_right, len(links) - n_neutral), Share(n_right, n_wanted), n_neutral)


def _high_dynamic(measurements: list[dict[str, Any]], truth: Truth, resolution_m: float) -> HighDynamicScores:
    reported: dict[int, list[NDArray[np.int64]]] = {}
    for k, one in enumerate(measurements):
        cells = document_cells(one["cells"], resolution_m, f"high_dynamic[{k}].cells")
        reported.setdefault(_scan_at(one["t"], truth, f"high_dynamic[{k}].t"), []).append(cells)
    chosen = np.zeros(len(truth.t), dtype=np.bool_)
    chosen[list(reported)] = True
    on_people = cells_by_scan(truth, (truth.hits == Hit.PERSON) & chosen[:, None], resolution_m)
    on_anything = cells_by_scan(truth, np.isfinite(truth.distances) & chosen[:, None], resolution_m)
    nowhere = np.empty((0, 2), dtype=np.int64)
    n_right = n_false = n_neutral = n_found = n_wanted = n_ends = 0
    for scan, several in reported.items():
        cells = unique_cells(*several)
        wanted = on_people.get(scan, nowhere)
        right = near(cells, wanted) | _beside_people(cells, truth, scan, resolution_m)
        neutral = ~right & near(cells, _moving_cells(truth, scan, resolution_m))
        n_right += int(right.sum())
        n_neutral += int(neutral.sum())
        n_false += int((~right & ~neutral).sum())
        n_found += int(near(wanted, cells).sum())
        n_wanted += len(wanted)
        n_ends += len(on_anything.get(scan, nowhere))
    anybody = bool(np.isfinite(truth.people[chosen]).any())
    return HighDynamicScores(
        n_scans=len(reported),
        precision=Share(n_right, n_right + n_false) if anybody else Share(0, 0),
        recall=Share(n_found, n_wanted),
        false_share=Share(n_false, n_ends),
        n_neutral=n_neutral,
    )


def _scan_at(stamp_s: float, truth: Truth, where: str) -> int:
    stamps = truth.stamps_s
    scan = int(np.argmin(abs(stamps - stamp_s)))
    if abs(stamps[scan] - stamp_s) > SAME_STAMP_S:
        raise AnswerError(
            f"{where} is {stamp_s:.3f} s, but no scan from the document's start_s to its stop_s was taken then;"
            f" the nearest is at {stamps[scan]:.3f} s. Is this the truth about the same log?"
        )
    return scan


def cells_by_scan(truth: Truth, beams: NDArray[np.bool_], resolution_m: float) -> dict[int, NDArray[np.int64]]:
    """For each scan with such beams, the cells in which they ended."""
    scans, which = np.nonzero(beams)
    cells = cells_at(truth.ends(scans, which), resolution_m)
    numbers, first = np.unique(scans, return_index=True)
    return (
        {int(scan): unique_cells(part) for scan, part in zip(numbers, np.split(cells, first[1:]), strict=True)}
        if len(scans)
        else {}
    )


def _beside_people(cells: NDArray[np.int64], truth: Truth, scan: int, resolution_m: float) -> NDArray[np.bool_]:
    people = truth.people[scan]
    people = people[np.isfinite(people).all(axis=1)]
    centres = GridSpec(resolution_m).centres(cells[:, 0], cells[:, 1])
    gaps = np.hypot(*(centres[:, None] - people).transpose(2, 0, 1))
    beside: NDArray[np.bool_] = (gaps <= truth.person_radius_m + resolution_m).any(axis=1)
    return beside


def _moving_cells(truth: Truth, scan: int, resolution_m: float) -> NDArray[np.int64]:
    """The cells that leaves and boxes cover on their way; a box that is carried is nowhere."""
    corners = truth.corners[scan, truth.places[scan] == MOVING]
    return unique_cells(*(covered_cells(one, resolution_m) for one in corners if np.isfinite(one).all()))
