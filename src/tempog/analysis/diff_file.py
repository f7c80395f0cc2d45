"""What changed between two moments as entries of a JSON document, by ``tempog/schemas/diff-1.json``."""

from __future__ import annotations

from typing import Any

from tempog.analysis.moved_objects import Move, Whereabouts
from tempog.analysis.objects_file import points_entry
from tempog.analysis.patches import Patch
from tempog.times import NS_PER_S

DIFF_VERSION = 1


def change_entry(number: int, change: Move | Patch) -> dict[str, Any]:
    """A change with the number that it has in texts and pictures."""
    entry = _move_entry(change) if isinstance(change, Move) else patch_entry(change)
    return {"number": number, **entry}


def _move_entry(move: Move) -> dict[str, Any]:
    return {
        "kind": "moved",
        "object": move.one.id,
        "confidence": move.one.confidence,
        "n_moves": move.n_moves,
        "before": _state_entry(move, move.before),
        "after": _state_entry(move, move.after),
    }


def _state_entry(move: Move, where: Whereabouts) -> dict[str, Any]:
    place = move.place(where)
    return {
        "configuration": where.configuration,
        "centre": None if place is None else _rounded(place.centre_m),
        "since_s": where.since_ns / NS_PER_S,
        "last_seen_s": where.last_seen_ns / NS_PER_S,
    }


def patch_entry(patch: Patch) -> dict[str, Any]:
    """A patch."""
    return {
        "kind": patch.kind,
        "object": patch.object_id,
        "centre": _rounded(patch.centre_m),
        "extent": _rounded(patch.bounds),
        "area_m2": round(patch.area_m2, 6),
        "last_before_s": patch.last_before_ns / NS_PER_S,
        "first_after_s": patch.first_after_ns / NS_PER_S,
        "age_before_s": round(patch.age_before_s, 3),
        "age_after_s": round(patch.age_after_s, 3),
        "watched_s": patch.watched_s,
        "cells": points_entry(patch.points_map),
    }


def _rounded(lengths_m: tuple[float, ...]) -> list[float]:
    return [round(length, 6) for length in lengths_m]  # micrometres
