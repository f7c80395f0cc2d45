"""Walls, places and objects from evidence per state: the whole method on one screen."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.configurations import Configuration
from tempog.analysis.evidence.association import ChosenSet, associate_places
from tempog.analysis.evidence.blocks import BLOCK_TILES, cell_states
from tempog.analysis.evidence.grouping import group_cells
from tempog.analysis.evidence.hidden import Hidden, hidden_places
from tempog.analysis.evidence.known import Known, recalled
from tempog.analysis.evidence.places import Place, by_block, find_places
from tempog.analysis.evidence.states import CellStates
from tempog.analysis.objects import MovingObject, timeline_of
from tempog.analysis.series import Intervals, ever_occupied, look_ns
from tempog.analysis.static import CellClass
from tempog.grid.history import History
from tempog.methods import EvidenceConfig
from tempog.times import NS_PER_S

if TYPE_CHECKING:
    from tempog.analysis.evidence.elsewhere import Workers

HYPOTHESIS_ODDS = 0.0  # log odds: as likely as not
LOOK_WORTH_S = 0.3  # s; scanners on robots look at least so often, mostly ten times a second
HIDDEN_LOOKS = 2.0  # times its size: how far from a place `hidden_places` looks, at most
OBSERVED_TIMES = ("worth_s", "least_stay_s")


def find_by_evidence(
    history: History,
    settings: EvidenceConfig,
    known: Known | None = None,
    block_tiles: int = BLOCK_TILES,
    workers: Workers | None = None,
) -> tuple[NDArray[np.int8], list[Configuration], list[MovingObject]]:
    """Static map, configurations and objects of a history; see `find_objects`.

    The answer depends neither on what is known from an earlier analysis, nor on the size of the blocks, nor on
    who works them out. What workers find out is not remembered.
    """
    look = steady_look_ns(history)
    settings = for_looks_every(look / NS_PER_S, settings)
    if known is not None:
        known.begin((settings, look, history.tiles.spec.resolution_m, block_tiles))
    elsewhere = None
    if workers is not None:
        from tempog.analysis.evidence.elsewhere import Elsewhere

        parts = (Intervals.of(history, look), history.poses, history.tiles.spec.resolution_m)
        elsewhere = Elsewhere(workers, *parts, settings)
    states = cell_states(history, settings, known, block_tiles, look, elsewhere)
    places = find_places(states, group_cells(states, settings, known, elsewhere), settings, known, elsewhere)
    places = [place for place in places if 2 * np.count_nonzero(states.by_view[place.cells]) <= len(place.cells)]
    places, sets = without_doubtful(places, associate_places(places, settings), settings)
    several = {i for one in sets for i in one.members}
    hidden = _hidden(states, places, [k for k in range(len(places)) if k not in several], settings, known)
    sets += [ChosenSet((one.of, len(places) + k), HYPOTHESIS_ODDS, HYPOTHESIS_ODDS) for k, one in enumerate(hidden)]
    n_seen, places = len(places), places + [one.place for one in hidden]
    configurations = [_configuration(k + 1, place, states, k >= n_seen) for k, place in enumerate(places)]
    walls = _classes(history, states, places, settings)
    return walls, configurations, _objects(sets, configurations)


def without_doubtful(
    places: list[Place], sets: list[ChosenSet], settings: EvidenceConfig
) -> tuple[list[Place], list[ChosenSet]]:
    """Without places that neither their traits nor a link speak for; and the sets, in the new numbers."""
    several = {i for one in sets for i in one.members}
    kept = [
        i
        for i, place in enumerate(places)
        if i in several
        or place.log_odds - (settings.once_doubt if place.n_changes == 1 else 0.0) > settings.place_above
    ]
    new = {i: k for k, i in enumerate(kept)}
    renumbered = [
        one._replace(members=tuple(new[i] for i in one.members), rivals=tuple(new[i] for i in one.rivals if i in new))
        for one in sets
    ]
    return [places[i] for i in kept], renumbered


def steady_look_ns(history: History) -> int:
    """What a look stands for, to three digits: a median of stamps that jitter would be another with every scan."""
    look = look_ns(history)
    return max(1, round(look, 3 - len(str(look))))


def _hidden(
    states: CellStates, places: list[Place], alone: list[int], settings: EvidenceConfig, known: Known | None
) -> list[Hidden]:
    """`hidden_places`, asked for one place after the other, those of one block together."""
    found: dict[int, list[Hidden]] = {}
    for n in by_block(states, [places[k].cells for k in alone]):
        k, place = alone[n], places[alone[n]]
        area = states.around(place.cells, math.ceil(HIDDEN_LOOKS * place.size_m / states.resolution_m))

        def work_out(k: int = k, area: NDArray[np.int64] = area) -> list[tuple[NDArray[np.int64], Place]]:
            ones = hidden_places(states, places, [k], settings)
            return [(np.searchsorted(area, one.place.cells), one.place) for one in ones]

        key = partial(states.digest, "hidden", place.cells, area)
        answers = recalled(known, key, work_out)
        found[k] = [Hidden(k, replace(one, cells=area[cells])) for cells, one in answers]
    return [one for k in alone for one in found[k]]


def for_looks_every(period_s: float, settings: EvidenceConfig) -> EvidenceConfig:
    """Settings for a scanner, or a thinned log, that looks less often than `LOOK_WORTH_S`.

    A look stands for the time until the next one. If that is seconds, few looks make a long time, and a stray one a
    stay: what a time is taken to prove must then last longer.
    """
    longer = max(1.0, period_s / LOOK_WORTH_S)
    return replace(settings, **{name: longer * getattr(settings, name) for name in OBSERVED_TIMES})


def _configuration(number: int, place: Place, states: CellStates, hypothesis: bool) -> Configuration:
    cells = np.stack([states.rows[place.cells], states.cols[place.cells]], axis=-1).astype(np.int32)
    return Configuration(number, cells, place.points_map, place.periods, hypothesis)


def _classes(history: History, states: CellStates, places: list[Place], settings: EvidenceConfig) -> NDArray[np.int8]:
    """Static is what was occupied most of the time and belongs to no place; uncertain what depends on the view."""
    classes = np.full(history.tiles.n_cells, CellClass.UNEXPLORED, dtype=np.int8)
    classes[ever_occupied(history, above=0.0)] = CellClass.FREE
    share = states.occupied_share
    numbers = states.numbers
    classes[numbers[share > 1 - settings.static_share]] = CellClass.CHANGING
    classes[numbers[states.by_view]] = CellClass.UNCERTAIN
    classes[numbers[share >= settings.static_share]] = CellClass.STATIC
    for place in places:
        classes[numbers[place.cells]] = CellClass.CHANGING
    return history.tiles.to_dense(classes, CellClass.UNEXPLORED)


def _objects(sets: list[ChosenSet], configurations: list[Configuration]) -> list[MovingObject]:
    """Things of several places, then those of one, each group by the number of its first place."""
    linked = {one.members: one for one in sets}
    several = {i for group in linked for i in group}
    alone = [(i,) for i in range(len(configurations)) if i not in several]
    objects = []
    for k, group in enumerate([*sorted(linked), *alone]):
        one = linked.get(group)
        confidence = 1 / (1 + math.exp(-one.margin)) if one else None
        rivals = tuple(configurations[i].id for i in one.rivals) if one else ()
        chosen = tuple(configurations[i] for i in group)
        objects.append(MovingObject(k + 1, chosen, *timeline_of(chosen), confidence, rivals))
    return objects
