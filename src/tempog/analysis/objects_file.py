"""Objects as a JSON document, by the schema in ``tempog/schemas/objects-1.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.configurations import Configuration
from tempog.analysis.high_dynamic import HighDynamic
from tempog.analysis.objects import MovingObject, ObjectStay
from tempog.times import NS_PER_S

OBJECTS_VERSION = 1


def objects_document(
    *,
    method: str,
    settings: Mapping[str, Any],
    resolution_m: float,
    start_ns: int,
    stop_ns: int,
    static_points_map: NDArray[np.float64],
    uncertain_points_map: NDArray[np.float64],
    objects: Sequence[MovingObject],
    unassociated: Sequence[Configuration],
    high_dynamic: Sequence[HighDynamic],
) -> dict[str, Any]:
    """What a method found from `start_ns` to `stop_ns`, ready for `json.dumps`."""
    return {
        "format": "tempog-objects",
        "version": OBJECTS_VERSION,
        "method": method,
        "settings": dict(settings),
        "resolution_m": resolution_m,
        "start_s": start_ns / NS_PER_S,
        "stop_s": stop_ns / NS_PER_S,
        "static": points_entry(static_points_map),
        "uncertain": points_entry(uncertain_points_map),
        "objects": [_object(one) for one in objects],
        "unassociated": [_configuration(place) for place in unassociated],
        "high_dynamic": [
            {"t": measured.stamp_ns / NS_PER_S, "cells": points_entry(measured.points_map)}
            for measured in high_dynamic
        ],
    }


def points_entry(points_map: NDArray[np.float64]) -> list[list[float]]:
    """Cells' centres as a document has them."""
    points: list[list[float]] = points_map.round(6).tolist()  # micrometres: no digits that only binary fractions have
    return points


def _configuration(place: Configuration) -> dict[str, Any]:
    return {
        "id": place.id,
        "cells": points_entry(place.points_map),
        "periods": [[start / NS_PER_S, stop / NS_PER_S, state] for start, stop, state in place.periods],
        "confidence": None,
        "hypothesis": place.hypothesis,
    }


def _object(one: MovingObject) -> dict[str, Any]:
    return {
        "id": one.id,
        "confidence": one.confidence,
        "rivals": list(one.rivals),
        "configurations": [_configuration(place) for place in one.configurations],
        "timeline": [[start / NS_PER_S, stop / NS_PER_S, place] for start, stop, place in one.timeline],
        "stays": [_stay(stay) for stay in one.stays],
        "last": _stay(one.last_stay) if one.last_stay else None,
        "n_moves": one.n_moves,
        "gaps": [[start / NS_PER_S, stop / NS_PER_S] for start, stop in one.gaps],
        "seen_s": one.seen_s,
        "shares": [{"configuration": place, "share": share} for place, share in one.shares.items()],
    }


def _stay(stay: ObjectStay) -> dict[str, Any]:
    return {
        "configuration": stay.configuration,
        "since_s": stay.start_ns / NS_PER_S,
        "last_seen_s": stay.stop_ns / NS_PER_S,
        "seen_s": stay.seen_s,
    }
