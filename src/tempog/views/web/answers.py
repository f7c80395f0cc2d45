"""What the server answers about a map, ready for JSON; times in seconds since the map's first scan."""

from __future__ import annotations

import io
import json
from datetime import UTC, datetime, tzinfo
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.map_diff import map_diff
from tempog.analysis.moved_objects import Move
from tempog.analysis.patches import Patch
from tempog.errors import TimeError
from tempog.grid.history import OCCUPIED_ABOVE, History
from tempog.store.manifest import Session
from tempog.times import NS_PER_S, is_unix_time
from tempog.views.web.blocks import SIDE
from tempog.views.web.finding import Findings, laid_over
from tempog.views.web.kernels import FREE, NOTHING, OCCUPIED
from tempog.views.web.layers import Theme, layer_entries, palette
from tempog.views.web.model import Model
from tempog.views.web.objects_json import objects_entry
from tempog.views.web.png import encode_png
from tempog.views.web.prepared import Prepared, activity
from tempog.views.web.tiles import fade_s

MOST_INTERVALS = 2000  # of one cell that are sent; the latest
PERSON_M = 0.5  # cells on the move so near each other are of one person


class UnanswerableError(Exception):
    """A question that has no answer, for reasons that lie in the question."""


def map_entry(model: Model) -> dict[str, Any]:
    """What the map is."""
    version, source = model.version, model.source
    findings, walked = model.findings(), model.walked()
    with source.lock:
        config = source.history().config
        gap_s = source.history().gap_s
    start_ns, extent = version.start_ns, version.extent
    dated = is_unix_time(start_ns)
    x_min, x_max, y_min, y_max = extent.bounds
    return {
        "name": source.name,
        "version": version.name,
        "live": source.live,
        "start_ns": str(start_ns),
        "start_iso": _iso(start_ns) if dated else None,
        "dated": dated,
        "duration_s": version.duration_s,
        "n_scans": len(version.stamps_ns),
        "n_cells": version.n_cells,
        "n_intervals": version.n_intervals,
        "resolution_m": config.grid.resolution_m,
        "gap_s": gap_s,
        "bounds": [x_min, x_max, y_min, y_max],
        "row0": extent.row0,
        "col0": extent.col0,
        "n_rows": extent.n_rows,
        "n_cols": extent.n_cols,
        "tile_px": SIDE,
        "zooms": list(range(version.n_zooms)),
        "layers": layer_entries(fade_s(version.duration_s), walked[1] if walked else 1),
        "sessions": [_session(session, start_ns) for session in source.sessions()],
        "poses": findings.poses if findings else None,
        "objects_version": findings.version if findings else None,
    }


def _session(session: Session, start_ns: int) -> dict[str, Any]:
    return {
        "id": session.id,
        "robot": session.robot,
        "start_t": (session.start_ns - start_ns) / NS_PER_S,
        "stop_t": (session.stop_ns - start_ns) / NS_PER_S,
    }


def _iso(stamp_ns: int) -> str:
    return datetime.fromtimestamp(stamp_ns // NS_PER_S, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def activity_entry(model: Model, prepared: Prepared, n_bins: int) -> dict[str, Any]:
    """When much changed."""
    version = model.version
    if not len(version.stamps_ns):
        return {"version": version.name, "edges_t": [], "changes": [], "observed": []}
    return {"version": version.name, **activity(version.stamps_ns, prepared.changes, n_bins)}


def objects_text(model: Model, findings: Findings, zone: tzinfo) -> bytes:
    """The objects, as JSON."""
    start_ns = model.version.start_ns
    stop_ns = model.stamp_ns(model.version.duration_s)
    return json.dumps(
        objects_entry(findings.found, findings.version, start_ns, stop_ns, zone), allow_nan=False
    ).encode()


def cell_entry(model: Model, x: float, y: float) -> dict[str, Any]:
    """Every state of the cell at a point; the latest ones, if there are very many."""
    with model.source.lock:
        history = model.source.history()
        row, col = history.tiles.spec.cell_of(x, y)
        states = history.history(x, y)
    start_ns = model.version.start_ns
    since, until = ((stamps - start_ns) / NS_PER_S for stamps in (states.start_ns, states.stop_ns))
    gaps = (states.gaps - start_ns) / NS_PER_S
    shown = slice(max(0, len(states) - MOST_INTERVALS), None)
    shown_since = float(since[shown][0]) if len(states) else 0.0
    return {
        "row": row,
        "col": col,
        "intervals": [
            [a, b, round(prob, 6)]
            for a, b, prob in zip(
                since[shown].tolist(), until[shown].tolist(), states.value[shown].tolist(), strict=True
            )
        ],
        "gaps": gaps[gaps[:, 1] >= shown_since].tolist(),
        "n_total": len(states),
        "n_shown": len(states.value[shown]),
        "truncated": len(states) > MOST_INTERVALS,
    }


def diff_entry(model: Model, findings: Findings, a: float, b: float) -> dict[str, Any]:
    """What appeared, vanished or moved from one moment to another; exchanged if the second is the earlier one."""
    a, b = min(a, b), max(a, b)
    before, after = (np.datetime64(model.stamp_ns(t), "ns") for t in (a, b))
    try:
        with model.asking:
            history = model.whole()
            diff = map_diff(history, before, after, found=laid_over(findings.found, history))
    except TimeError as error:
        raise UnanswerableError(str(error)) from error
    return {
        "a": a,
        "b": b,
        "appeared": [_patch(patch) for patch in diff.appeared],
        "vanished": [_patch(patch) for patch in diff.vanished],
        "moved": [_move(move) for move in diff.moved],
        "brief": len(diff.brief),
        "compared_m2": round(diff.areas.compared_m2, 3),
        "not_seen_again_m2": round(diff.areas.not_seen_again_m2, 3),
        "first_seen_m2": round(diff.areas.first_seen_m2, 3),
        "objects_not_seen_again": list(diff.objects_not_seen_again),
    }


def _patch(patch: Patch) -> dict[str, Any]:
    return {
        "cells": patch.cells.tolist(),
        "centre": [round(length, 4) for length in patch.centre_m],
        "area_m2": round(patch.area_m2, 4),
        "object": patch.object_id,
    }


def _move(move: Move) -> dict[str, Any]:
    places = [move.place(move.after), move.place(move.before), *move.one.configurations]
    at = next(place for place in places if place is not None).centre_m
    return {
        "object": move.one.id,
        "from": move.before.configuration,
        "to": move.after.configuration,
        "n_moves": move.n_moves,
        "at": [round(length, 4) for length in at],
    }


def snapshot_bytes(model: Model, t: float, hold_s: float, kind: str, theme: Theme) -> bytes:
    """The whole map at a moment: a picture with one pixel per cell, or arrays."""
    stamp_ns = model.stamp_ns(t)
    with model.source.lock:
        history = model.source.history()
        history.require_scans()
        snapshot = history.at(np.datetime64(stamp_ns, "ns"), hold_s)
    extent = snapshot.extent
    if kind == "png":
        codes = np.full((extent.n_rows, extent.n_cols), NOTHING, dtype=np.uint8)
        codes[snapshot.value <= OCCUPIED_ABOVE] = FREE
        codes[snapshot.value > OCCUPIED_ABOVE] = OCCUPIED
        return encode_png(np.ascontiguousarray(codes[::-1]), palette("occupancy", theme))
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        value=snapshot.value,
        age_s=snapshot.age_s,
        row0=extent.row0,
        col0=extent.col0,
        resolution_m=extent.resolution_m,
        stamp_ns=stamp_ns,
    )
    return buffer.getvalue()


def now_entry(model: Model) -> dict[str, Any]:
    """Where the objects and people are now, as far as anybody knows."""
    version = model.version
    known = model.source.now()
    if known is not None:
        points = np.array(known.points_map, dtype=np.float64).reshape(-1, 2)
        t = (known.stamp_ns - version.start_ns) / NS_PER_S
        return {"t": t, "objects": {str(k): place for k, place in known.objects.items()}, "people": people(points)}
    findings = model.findings()
    if findings is None:
        return {"t": version.duration_s, "objects": {}, "people": []}
    found = findings.found
    last = {str(one.id): one.last_stay.configuration if one.last_stay else None for one in found.objects}
    return {"t": version.duration_s, "objects": last, "people": people(_moving_at_end(found.history, findings))}


def _moving_at_end(history: History, findings: Findings) -> NDArray[np.float64]:
    moving = findings.moving
    cells = np.unique(moving.cell[moving.last >= history.last_scan])
    return history.tiles.spec.centres(*history.tiles.rows_cols(cells))


def people(points_map: NDArray[np.float64]) -> list[list[float]]:
    """Where people are, from the cells that something on the move is in: the middle of each group, metres.

    >>> people(np.array([[0.0, 0.0], [0.3, 0.0], [5.0, 1.0]]))
    [[0.15, 0.0], [5.0, 1.0]]
    """
    if not len(points_map):
        return []
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(points_map).query_pairs(PERSON_M, output_type="ndarray")
    n = len(points_map)
    joined = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    n_groups, group = connected_components(joined, directed=False)
    middles = [points_map[group == k].mean(axis=0) for k in range(n_groups)]
    return [[round(x, 3), round(y, 3)] for x, y in (middle.tolist() for middle in middles)]
