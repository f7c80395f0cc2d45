"""Objects as a JSON document, by the schema in ``tempog/schemas/objects-1.json``."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.configurations import Configuration, static_cells
from tempog.analysis.high_dynamic import HighDynamic
from tempog.analysis.objects import MovingObject
from tempog.config import ObjectsConfig
from tempog.grid.history import History
from tempog.times import NS_PER_S

OBJECTS_VERSION = 1


def objects_document(
    history: History,
    walls: NDArray[np.int8],
    configurations: Sequence[Configuration],
    objects: Sequence[MovingObject],
    high_dynamic: Sequence[HighDynamic],
    settings: ObjectsConfig,
) -> dict[str, Any]:
    """What the paper's method found, ready for `json.dumps`."""
    associated = {place.id for one in objects for place in one.configurations}
    rows, cols = history.tiles.rows_cols(np.flatnonzero(static_cells(history, walls)).astype(np.int32))
    stamps = history.stamps_ns
    return {
        "format": "tempog-objects",
        "version": OBJECTS_VERSION,
        "method": "paper",
        "settings": dataclasses.asdict(settings),
        "resolution_m": history.tiles.spec.resolution_m,
        "start_s": int(stamps[history.first_scan]) / NS_PER_S,
        "stop_s": int(stamps[history.last_scan]) / NS_PER_S,
        "static": _points(history.tiles.spec.centres(rows, cols)),
        "objects": [_object(one) for one in objects],
        "unassociated": [_configuration(place) for place in configurations if place.id not in associated],
        "high_dynamic": [
            {"t": measured.stamp_ns / NS_PER_S, "cells": _points(measured.points_map)} for measured in high_dynamic
        ],
    }


def _points(points_map: NDArray[np.float64]) -> list[list[float]]:
    points: list[list[float]] = points_map.round(6).tolist()  # micrometres: no digits that only binary fractions have
    return points


def _configuration(place: Configuration) -> dict[str, Any]:
    return {
        "id": place.id,
        "cells": _points(place.points_map),
        "periods": [[start / NS_PER_S, stop / NS_PER_S, state] for start, stop, state in place.periods],
        "confidence": None,
        "hypothesis": False,
    }


def _object(one: MovingObject) -> dict[str, Any]:
    return {
        "id": one.id,
        "confidence": one.confidence,
        "configurations": [_configuration(place) for place in one.configurations],
        "timeline": [[start / NS_PER_S, stop / NS_PER_S, place] for start, stop, place in one.timeline],
    }
