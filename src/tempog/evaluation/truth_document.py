"""The truth written as an answer, by the schema of found objects: what a perfect method would say."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.objects_file import OBJECTS_VERSION
from tempog.evaluation.judge import cells_by_scan
from tempog.sensing.grid_spec import GridSpec
from tempog.simulation.observability import SeenPlace, seen_places
from tempog.simulation.simulation import MOVING, Hit
from tempog.simulation.truth import Truth

TRUE = 1.0  # confidence


def truth_document(truth: Truth, resolution_m: float, scans: Iterable[int] | None = None) -> dict[str, Any]:
    """What could be seen, as a document of found objects.

    Parameters
    ----------
    truth : Truth
        Of a whole log or a window of it.
    resolution_m : float, metres
    scans : iterable of int, optional
        Of which scans to say where beams ended on people. Default: of all.

    Returns
    -------
    dict
        Seen cells of walls, and of glass as uncertain; observable places with the periods in which things stood there
        or elsewhere; and people. `evaluate` gives it 1 in everything.
    """
    stamps = truth.stamps_s
    next_id = 1
    objects: list[dict[str, Any]] = []
    unassociated: list[dict[str, Any]] = []
    places = seen_places(truth, resolution_m)
    for k in range(len(truth.things)):
        ids: dict[int, int] = {}
        configurations = []
        for place in places:
            if place.thing == k and place.observable:
                ids[place.place] = next_id
                configurations.append(_configuration(place, next_id, truth, resolution_m))
                next_id += 1
        if len(configurations) > 1:
            column = np.array([ids.get(at, 0) for at in truth.places[:, k].tolist()])
            objects.append(
                {
                    "id": len(objects) + 1,
                    "confidence": TRUE,
                    "configurations": configurations,
                    "timeline": [[start, stop, at or None] for start, stop, at in _runs(column, stamps)],
                }
            )
        else:
            unassociated += configurations
    chosen = range(len(stamps)) if scans is None else sorted(set(scans))
    wanted = np.zeros(len(stamps), dtype=np.bool_)
    wanted[list(chosen)] = True
    on_people = cells_by_scan(truth, (truth.hits == Hit.PERSON) & wanted[:, None], resolution_m)
    nowhere = np.empty((0, 2), dtype=np.int64)
    return {
        "format": "tempog-objects",
        "version": OBJECTS_VERSION,
        "method": "truth",
        "settings": {},
        "resolution_m": float(resolution_m),
        "start_s": float(stamps[0]),
        "stop_s": float(stamps[-1]),
        "static": _points(truth.static_seen(resolution_m), resolution_m),
        "uncertain": _points(truth.glass_seen(resolution_m), resolution_m),
        "objects": objects,
        "unassociated": unassociated,
        "high_dynamic": [
            {"t": float(stamps[scan]), "cells": _points(on_people.get(scan, nowhere), resolution_m)}
            for scan in chosen
        ],
    }


def _configuration(place: SeenPlace, number: int, truth: Truth, resolution_m: float) -> dict[str, Any]:
    stands_at = truth.places[:, place.thing]
    column = np.where(stands_at == MOVING, MOVING, stands_at == place.place)
    return {
        "id": number,
        "cells": _points(place.seen, resolution_m),
        "periods": [
            [start, stop, "occupied" if state else "free"]
            for start, stop, state in _runs(column, truth.stamps_s)
            if state != MOVING
        ],
        "confidence": TRUE,
        "hypothesis": False,
    }


def _runs(column: NDArray[np.int64], stamps: NDArray[np.float64]) -> list[tuple[float, float, int]]:
    """Each run of equal values as (stamp of its first scan, stamp of the next run's first, value)."""
    firsts = np.flatnonzero(np.append(True, column[1:] != column[:-1]))
    starts, stops = stamps[firsts], np.append(stamps[firsts[1:]], stamps[-1])
    return [
        run for run in zip(starts.tolist(), stops.tolist(), column[firsts].tolist(), strict=True) if run[1] > run[0]
    ]


def _points(cells: NDArray[np.int64], resolution_m: float) -> list[list[float]]:
    points: list[list[float]] = GridSpec(resolution_m).centres(cells[:, 0], cells[:, 1]).round(6).tolist()
    return points
