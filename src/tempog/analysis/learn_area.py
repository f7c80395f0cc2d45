"""What an analysis of one rectangle changes in what is known: new places and objects, and those that are no more."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.configurations import Configuration
from tempog.analysis.find_objects import FoundObjects, find_objects
from tempog.analysis.objects import MovingObject, timeline_of
from tempog.analysis.static import CellClass
from tempog.grid.history import History
from tempog.methods import Method
from tempog.sensing.grid_spec import Bounds, Extent

LEAF_M = 1.0  # a place that is centred within the method's `within_m` reaches about so much farther
REACH_M = 4.0  # where the method compares places however far apart
SAME_SHARE = 0.5  # of the cells of the smaller of two places that are the same one


class Learned(NamedTuple):
    """What was learned of an area: ids of places and of objects that are new, and of those that are retired."""

    new_configurations: tuple[int, ...]
    retired_configurations: tuple[int, ...]
    new_objects: tuple[int, ...]
    retired_objects: tuple[int, ...]


class NextIds(NamedTuple):
    """The lowest ids that no place and no object has or had."""

    configuration: int
    object: int


@dataclass
class _Group:
    """Places that belong together: an object's, or a single one's that is part of none."""

    places: set[int]
    object: MovingObject | None


def learn_area(
    found: FoundObjects, history: History, bounds: Bounds, ids: NextIds
) -> tuple[FoundObjects, Learned, NextIds]:
    """Analyse a rectangle of a history again, and put what comes out in place of what was known there.

    Parameters
    ----------
    found : FoundObjects
        What was known.
    history : History
        As it is now: the same map, driven on.
    bounds : Bounds, metres
        Places with a cell in it are found anew, with the places that they share an object with. What lies around, as
        far as the method compares places, is analysed too, and else left as it was.
    ids : NextIds

    Returns
    -------
    found : FoundObjects
        Places that are found again keep their ids, and so do their objects.
    learned : Learned
    ids : NextIds

    Raises
    ------
    EmptyWindowError
        `history` holds nothing of the area.
    """
    halo_m = (found.settings.within_m or REACH_M) + LEAF_M
    area = history.area(*bounds.grown(halo_m))
    anew = find_objects(area, found.method, found.settings)
    known_of = _matches(anew.configurations, found.configurations)
    taken_new, taken_known = _affected(anew, found, bounds, known_of)

    start_ns = int(area.stamps_ns[area.first_scan])
    known = {place.id: place for place in found.configurations}
    next_place, next_object = ids
    id_of: dict[int, int] = {}
    places = dict(known)
    changed = set().union(*(group.places for group in taken_known))
    for place in anew.configurations:
        if not any(place.id in group.places for group in taken_new):
            continue
        id_of[place.id] = known_of.get(place.id, next_place)
        next_place += place.id not in known_of
        before = known[known_of[place.id]].periods if place.id in known_of else ()
        earlier = tuple(
            period._replace(stop_ns=min(period.stop_ns, start_ns)) for period in before if period.start_ns < start_ns
        )
        places[id_of[place.id]] = replace(place, id=id_of[place.id], periods=earlier + place.periods)
    found_again = set(id_of.values())
    retired = {i for i in changed - found_again if bounds.holds(known[i].points_map).any()}
    for i in retired:
        del places[i]

    old = [group.object for group in taken_known if group.object is not None]
    claimed: set[int] = set()
    here = {**known_of, **id_of}
    objects = [one for one in found.objects if one not in old]
    for group in taken_new:
        if group.object is None:
            continue
        mine = {id_of[i] for i in group.places}
        shared = {one.id: len(mine & {place.id for place in one.configurations}) for one in old}
        number = max(
            (i for i in shared if shared[i] and i not in claimed), key=lambda i: (shared[i], -i), default=None
        )
        if number is None:
            number, next_object = next_object, next_object + 1
        claimed.add(number)
        rivals = tuple(sorted(here[i] for i in group.object.rivals if i in here))
        chosen = tuple(places[i] for i in sorted(mine))
        objects.append(_thing(group.object, number, chosen, rivals, found.method))
    # What was part of an affected object, lies outside, and was not found again stays as it was.
    for one in old:
        left = tuple(place for place in one.configurations if place.id not in found_again | retired)
        if left and one.id not in claimed and len(left) > 1:
            claimed.add(one.id)
            objects.append(_thing(one, one.id, left, one.rivals, found.method))
        elif left and found.method == "evidence":
            for place in left:
                number = next_object if one.id in claimed else one.id
                next_object += one.id in claimed
                claimed.add(one.id)
                objects.append(_thing(one, number, (place,), (), found.method))
    objects = [
        replace(one, rivals=tuple(i for i in one.rivals if i in places)) if set(one.rivals) - set(places) else one
        for one in objects
    ]

    extent = history.extent.around(found.extent)  # a map of today may not reach as far as what is known
    had = {one.id for one in found.objects}
    has = {one.id for one in objects}
    learned = Learned(
        tuple(sorted(found_again - set(known))),
        tuple(sorted(retired)),
        tuple(sorted(has - had)),
        tuple(sorted(had - has)),
    )
    return (
        FoundObjects(
            history,
            found.method,
            found.settings,
            _walls(found, anew, extent, bounds, [places[i] for i in sorted(found_again)]),
            extent,
            tuple(places[i] for i in sorted(places)),
            tuple(sorted(objects, key=lambda one: one.id)),
        ),
        learned,
        NextIds(next_place, next_object),
    )


def _thing(
    one: MovingObject, number: int, places: tuple[Configuration, ...], rivals: tuple[int, ...], method: Method
) -> MovingObject:
    """An object by another number, with other places or more that is known of them."""
    timeline, common_s, none_s, both_s = timeline_of(places, all_seen=method != "evidence")
    confidence = one.confidence if len(places) > 1 else None
    return MovingObject(number, places, timeline, common_s, none_s, both_s, confidence, rivals)


def _matches(anew: tuple[Configuration, ...], known: tuple[Configuration, ...]) -> dict[int, int]:
    """Which new places, by id, are which known ones: those that share the most cells first."""
    owners: dict[tuple[int, int], list[Configuration]] = {}
    for place in known:
        for row, col in place.cells.tolist():
            owners.setdefault((row, col), []).append(place)
    pairs = []
    sizes = {place.id: len(place.cells) for place in known}
    for place in anew:
        common = Counter(owner.id for row, col in place.cells.tolist() for owner in owners.get((row, col), []))
        for other, n in common.items():
            if n >= SAME_SHARE * min(len(place.cells), sizes[other]):
                pairs.append((-n, place.id, other))
    matched: dict[int, int] = {}
    for _, mine, other in sorted(pairs):
        if mine not in matched and other not in matched.values():
            matched[mine] = other
    return matched


def _affected(
    anew: FoundObjects, found: FoundObjects, bounds: Bounds, known_of: dict[int, int]
) -> tuple[list[_Group], list[_Group]]:
    """New and known groups with a place in the rectangle, and all that are tied to these by a place found again."""
    new, known = _groups(anew), _groups(found)
    new_of = {other: mine for mine, other in known_of.items()}
    inside_new = {place.id for place in anew.configurations if bounds.holds(place.points_map).any()}
    inside_known = {place.id for place in found.configurations if bounds.holds(place.points_map).any()}
    while True:
        taken_new = [group for group in new if group.places & inside_new]
        taken_known = [group for group in known if group.places & inside_known]
        more_new = {i for group in taken_new for i in group.places}
        more_new |= {new_of[i] for group in taken_known for i in group.places if i in new_of}
        more_known = {i for group in taken_known for i in group.places}
        more_known |= {known_of[i] for group in taken_new for i in group.places if i in known_of}
        if more_new <= inside_new and more_known <= inside_known:
            return taken_new, taken_known
        inside_new |= more_new
        inside_known |= more_known


def _groups(found: FoundObjects) -> list[_Group]:
    groups = [_Group({place.id for place in one.configurations}, one) for one in found.objects]
    return [*groups, *(_Group({place.id}, None) for place in found.unassociated)]


def _walls(
    known: FoundObjects, anew: FoundObjects, extent: Extent, bounds: Bounds, places: list[Configuration]
) -> NDArray[np.int8]:
    """The static map of before, laid over the extent of now, with the rectangle's own part put in."""
    walls = known.walls_over(extent)
    part = anew.extent
    rows, cols = np.indices(part.shape).reshape(2, -1)
    inside = bounds.holds(anew.history.tiles.spec.centres(rows + part.row0, cols + part.col0)).reshape(part.shape)
    walls[part.part_of(extent)][inside] = anew.walls[inside]
    for place in places:
        walls[place.cells[:, 0] - extent.row0, place.cells[:, 1] - extent.col0] = CellClass.CHANGING
    return walls
