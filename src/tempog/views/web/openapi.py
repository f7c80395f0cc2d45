"""What the server answers, as an OpenAPI 3.1 document; docs/http-api.md says it with examples."""

from __future__ import annotations

from typing import Any

from tempog._version import __version__
from tempog.views.web.layers import LAYERS, THEMES

NUMBER, INTEGER, STRING, BOOLEAN = ({"type": kind} for kind in ("number", "integer", "string", "boolean"))
NUMBER_OR_NULL, STRING_OR_NULL, INTEGER_OR_NULL = (
    {"type": [kind, "null"]} for kind in ("number", "string", "integer")
)
Schema = dict[str, Any]


def _array(items: Schema, **more: Any) -> Schema:
    return {"type": "array", "items": items, **more}


def _object(required: Schema, optional: Schema | None = None) -> Schema:
    return {"type": "object", "properties": {**required, **(optional or {})}, "required": list(required)}


def _tuple(*items: Schema) -> Schema:
    return {"type": "array", "prefixItems": list(items), "minItems": len(items), "maxItems": len(items)}


def _map_of(values: Schema) -> Schema:
    return {"type": "object", "additionalProperties": values}


PERIOD = _tuple(NUMBER, NUMBER)
POINT = _tuple(NUMBER, NUMBER)
CELLS = _array(_tuple(INTEGER, INTEGER))
SHARES = {"anyOf": [_map_of(_array(NUMBER_OR_NULL)), {"type": "null"}]}
PLACE = {"id": INTEGER, "cells": CELLS, "centre": POINT, "hypothesis": BOOLEAN}
LAST = _object({"place": INTEGER_OR_NULL, "since_t": NUMBER, "seen_t": NUMBER})

SCHEMAS: dict[str, Schema] = {
    "Error": _object({"error": STRING}),
    "Working": _object({"state": {"const": "working"}, "progress": NUMBER_OR_NULL}),
    "Map": _object(
        {
            "name": STRING,
            "version": STRING,
            "live": BOOLEAN,
            "start_ns": {"type": "string", "pattern": "^-?[0-9]+$"},
            "start_iso": STRING_OR_NULL,
            "dated": BOOLEAN,
            "duration_s": NUMBER,
            "n_scans": INTEGER,
            "n_cells": INTEGER,
            "n_intervals": INTEGER,
            "resolution_m": NUMBER,
            "gap_s": NUMBER,
            "bounds": _tuple(NUMBER, NUMBER, NUMBER, NUMBER),
            "row0": INTEGER,
            "col0": INTEGER,
            "n_rows": INTEGER,
            "n_cols": INTEGER,
            "tile_px": INTEGER,
            "zooms": _array(INTEGER),
            "layers": _array(
                _object(
                    {
                        "id": {"enum": list(LAYERS)},
                        "title": STRING,
                        "kind": {"enum": ["moment", "period"]},
                        "legend": _array(_object({"colour": STRING, "colour_dark": STRING, "label": STRING})),
                    }
                )
            ),
            "sessions": _array(_object({"id": STRING, "robot": STRING, "start_t": NUMBER, "stop_t": NUMBER})),
            "poses": STRING_OR_NULL,
            "objects_version": STRING_OR_NULL,
        }
    ),
    "Activity": _object(
        {
            "version": STRING,
            "edges_t": _array(NUMBER),
            "changes": _array(INTEGER),
            "observed": _array(BOOLEAN),
        }
    ),
    "Objects": {
        "oneOf": [
            _object(
                {
                    "state": {"const": "ready"},
                    "version": STRING,
                    "method": STRING,
                    "dated": BOOLEAN,
                    "tz": STRING_OR_NULL,
                    "objects": _array(
                        _object(
                            {
                                "id": INTEGER,
                                "n_moves": INTEGER,
                                "confidence": NUMBER_OR_NULL,
                                "rivals": _array(INTEGER),
                                "seen_s": NUMBER,
                                "shares": _map_of(NUMBER),
                                "states": _array(_object({"place": INTEGER, **PLACE})),
                                "timeline": _array(_tuple(NUMBER, NUMBER, INTEGER_OR_NULL)),
                                "gaps": _array(PERIOD),
                                "stays": _array(_tuple(NUMBER, NUMBER, INTEGER_OR_NULL, NUMBER)),
                                "by_hour": SHARES,
                                "by_weekday": SHARES,
                                "last": {"anyOf": [LAST, {"type": "null"}]},
                            }
                        )
                    ),
                    "places": _array(
                        _object({**PLACE, "timeline": _array(_tuple(NUMBER, NUMBER, {"enum": ["occupied", "free"]}))})
                    ),
                }
            ),
            _object({"state": {"const": "failed"}, "error": STRING}),
        ]
    },
    "Cell": _object(
        {
            "row": INTEGER,
            "col": INTEGER,
            "intervals": _array(_tuple(NUMBER, NUMBER, NUMBER)),
            "gaps": _array(PERIOD),
            "n_total": INTEGER,
            "n_shown": INTEGER,
            "truncated": BOOLEAN,
        }
    ),
    "Diff": _object(
        {
            "a": NUMBER,
            "b": NUMBER,
            **{
                name: _array(_object({"cells": CELLS, "centre": POINT, "area_m2": NUMBER, "object": INTEGER_OR_NULL}))
                for name in ("appeared", "vanished")
            },
            "moved": _array(
                _object(
                    {
                        "object": INTEGER,
                        "from": INTEGER_OR_NULL,
                        "to": INTEGER_OR_NULL,
                        "n_moves": INTEGER,
                        "at": POINT,
                    }
                )
            ),
            "brief": INTEGER,
            "compared_m2": NUMBER,
            "not_seen_again_m2": NUMBER,
            "first_seen_m2": NUMBER,
            "objects_not_seen_again": _array(INTEGER),
        }
    ),
    "Now": _object({"t": NUMBER, "objects": _map_of(INTEGER_OR_NULL), "people": _array(POINT)}),
}


def _query(name: str, text: str, schema: Schema = NUMBER, *, required: bool = False) -> dict[str, Any]:
    return {"name": name, "in": "query", "required": required, "description": text, "schema": schema}


def _path(name: str, text: str, schema: Schema) -> dict[str, Any]:
    return {"name": name, "in": "path", "required": True, "description": text, "schema": schema}


T = "Seconds since the map's first scan."
HOLD = _query(
    "hold",
    "Seconds for which a cell keeps its last known state; inf, the default, for ever.",
    {"anyOf": [{"type": "number", "minimum": 0}, {"const": "inf"}], "default": "inf"},
)
SPAN = {"type": "integer", "minimum": 1, "maximum": 64, "default": 1}
THEME = _query("theme", "Colours.", {"enum": list(THEMES), "default": "light"})
VERSION = _query("v", "The map's version; with it, answers that will not change may be kept.", STRING)


def _json_answer(schema: str, text: str) -> dict[str, Any]:
    return {
        "description": text,
        "content": {"application/json": {"schema": {"$ref": f"#/components/schemas/{schema}"}}},
    }


def _file(media: str, text: str) -> dict[str, Any]:
    return {"description": text, "content": {media: {"schema": {"type": "string", "format": "binary"}}}}


def _get(summary: str, answers: dict[str, Any], parameters: list[dict[str, Any]] | None = None) -> dict[str, Any]:
    failures = {
        "400": _json_answer("Error", "A parameter that cannot be."),
        "401": _json_answer("Error", "The token is missing; only where the server is bound to other than loopback."),
        "421": _json_answer("Error", "The Host header names another host."),
        "503": _json_answer("Error", "Not now: too much is asked at once, or the map cannot be read."),
    }
    return {"get": {"summary": summary, "parameters": parameters or [], "responses": {**answers, **failures}}}


WORKING = _json_answer("Working", "The objects are being found; ask again.")
NO_SUCH = _json_answer("Error", "There is no such thing.")


def openapi_document() -> dict[str, Any]:
    """All of it."""
    z = {"type": "integer", "minimum": 0}
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "tempog view",
            "version": __version__,
            "summary": "A map with a memory, over HTTP.",
            "description": (
                "Times `t` are seconds since the map's first scan, positions metres in the map frame, cells [row,"
                " col] of the lattice: a cell covers x from col to col + 1 times resolution_m, y by row likewise."
                " All requests are GET or HEAD; nothing can be changed."
            ),
            "license": {"name": "BSD-3-Clause", "identifier": "BSD-3-Clause"},
        },
        "paths": {
            "/": _get("The page.", {"200": _file("text/html", "The page.")}),
            "/page/{name}": _get(
                "The page's files.",
                {"200": _file("text/javascript", "A file."), "404": NO_SUCH},
                [_path("name", "Its name.", STRING)],
            ),
            "/openapi.json": _get(
                "This document.",
                {"200": {"description": "It.", "content": {"application/json": {"schema": {"type": "object"}}}}},
            ),
            "/api/map": _get("What the map is.", {"200": _json_answer("Map", "What it is.")}),
            "/api/tiles/{layer}/{z}/{col}/{row}.png": _get(
                "A tile of the picture: 256 x 256 pixels, transparent where nothing is known, north up.",
                {"200": _file("image/png", "The tile."), "404": NO_SUCH},
                [
                    _path("layer", "Which layer; see /api/map.", {"enum": list(LAYERS)}),
                    _path("z", "Zoom: a pixel is 2**z cells wide, occupied if one of them is.", z),
                    _path("col", "Of the tile; it covers columns from col * 256 * 2**z on.", INTEGER),
                    _path("row", "Likewise for rows, counted northwards.", INTEGER),
                    _query("t", f"{T} Default: the last scan. Layers of a period have none."),
                    HOLD,
                    THEME,
                    _query("cols", "Tiles in the picture, from this one eastwards; 64 at most in all.", SPAN),
                    _query("rows", "Tiles in the picture, from this one northwards.", SPAN),
                    VERSION,
                ],
            ),
            "/api/activity": _get(
                "How many cells changed their state when. A long pause without scans is one bin.",
                {"200": _json_answer("Activity", "Bins, their edges, and whether there were scans.")},
                [
                    _query(
                        "bins", "About how many.", {"type": "integer", "minimum": 1, "maximum": 4000, "default": 400}
                    ),
                    VERSION,
                ],
            ),
            "/api/objects": _get(
                "Things with several places, such as doors, and when they were where.",
                {"200": _json_answer("Objects", "All of them, or why there are none."), "202": WORKING},
                [VERSION],
            ),
            "/api/cell": _get(
                "Every state of one cell.",
                {"200": _json_answer("Cell", "Its intervals with P(occupied), and when it was not seen.")},
                [
                    _query("x", "Metres.", required=True),
                    _query("y", "Metres.", required=True),
                    VERSION,
                ],
            ),
            "/api/diff": _get(
                "What appeared, vanished or moved between two moments.",
                {"200": _json_answer("Diff", "What changed."), "202": WORKING},
                [_query("a", T, required=True), _query("b", T, required=True), VERSION],
            ),
            "/api/snapshot": _get(
                "The whole map at a moment.",
                {
                    "200": {
                        "description": "A picture, one pixel per cell, or arrays value, age_s, row0, col0,"
                        " resolution_m and stamp_ns.",
                        "content": {
                            "image/png": {"schema": {"type": "string", "format": "binary"}},
                            "application/x-npz": {"schema": {"type": "string", "format": "binary"}},
                        },
                    }
                },
                [
                    _query("t", T, required=True),
                    _query("format", "Which.", {"enum": ["png", "npz"], "default": "png"}),
                    HOLD,
                    THEME,
                    VERSION,
                ],
            ),
            "/api/now": _get(
                "Where the objects and the people are now.",
                {"200": _json_answer("Now", "By the objects' ids, the place of each; and a point for each person.")},
                [VERSION],
            ),
            "/api/events": _get(
                "Server-sent events: `map`, with version, t and the objects' version, at once and when the map grew.",
                {"200": {"description": "Events.", "content": {"text/event-stream": {"schema": STRING}}}},
            ),
        },
        "components": {"schemas": SCHEMAS},
    }
