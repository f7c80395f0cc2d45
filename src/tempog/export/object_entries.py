"""Things and their states as plain data: the same words in YAML, GeoJSON and messages."""

from __future__ import annotations

from typing import Any

from tempog._version import __version__
from tempog.export.doors import outline_of
from tempog.export.site_map import SiteMap, Thing
from tempog.times import NS_PER_S

FORMAT, VERSION = "tempog-site-objects", 1
DECIMALS_M = 3  # millimetres; shapes are known to a few centimetres
DECIMALS_SHARE = 4


def objects_entry(site: SiteMap) -> dict[str, Any]:
    """All things of a site, for objects.yaml."""
    history = site.history
    stamps = history.stamps_ns
    return {
        "format": FORMAT,
        "version": VERSION,
        "made_by": f"tempog {__version__}",
        "frame": "map",
        "from_s": int(stamps[history.first_scan]) / NS_PER_S,
        "to_s": int(stamps[history.last_scan]) / NS_PER_S,
        "at_s": site.at_ns / NS_PER_S,
        "objects": [thing_entry(thing, site.extent.resolution_m) for thing in site.things],
    }


def thing_entry(thing: Thing, resolution_m: float) -> dict[str, Any]:
    """One thing: metres in the map frame, seconds of the log's clock, shares of the time it was seen."""
    one, hinge = thing.one, thing.hinge
    states: list[dict[str, Any]] = []
    for k, place in enumerate(one.configurations):
        state: dict[str, Any] = {
            "state": place.id,
            "centre": _point(place.centre_m),
            "outline": [_point(corner) for corner in outline_of(place, resolution_m)],
            "leaf": None if hinge is None else [_point((hinge.x, hinge.y)), _point(hinge.tips[k])],
            "share": _share(one.shares[place.id]),
            "blocks_way": thing.blocks[k],
            "hypothesis": place.hypothesis,
        }
        states.append(state)
    return {
        "id": one.id,
        "kind": thing.kind,
        "confidence": _share(one.confidence),
        "hinge": None if hinge is None else _point((hinge.x, hinge.y)),
        "leaf_length": None if hinge is None else round(hinge.length_m, DECIMALS_M),
        "share_open": _share(thing.share_open),
        "share_unclear" if len(one.configurations) > 1 else "share_away": _share(one.shares.get(None, 0.0)),
        "moves": one.n_moves,
        "seen_s": round(one.seen_s, DECIMALS_M),
        "last": last_entry(thing),
        "states": states,
    }


def last_entry(thing: Thing) -> dict[str, Any] | None:
    """What a thing was in at the moment of the export, since when, and when it was last seen so; None if never."""
    if thing.at is None:
        return None
    return {
        "state": thing.at.configuration,
        "open": thing.is_open,
        "since_s": thing.at.start_ns / NS_PER_S,
        "last_seen_s": thing.at.stop_ns / NS_PER_S,
    }


def _point(point: tuple[float, float]) -> list[float]:
    # + 0.0 makes 0.0 of -0.0.
    return [round(float(part), DECIMALS_M) + 0.0 for part in point]


def _share(share: float | None) -> float | None:
    return None if share is None else round(share, DECIMALS_SHARE)


def geojson(site: SiteMap) -> dict[str, Any]:
    """All things as a GeoJSON FeatureCollection: an area per state, and for doors a point and a line per leaf.

    Coordinates are x and y in metres of the map frame, not degrees: RFC 7946 wants longitude and latitude, which a
    map does not know. A GIS shows them with any metric or local reference system.
    """
    features: list[dict[str, Any]] = []
    for thing in site.things:
        entry = thing_entry(thing, site.extent.resolution_m)
        states, last = entry.pop("states"), entry.pop("last")
        now = None if last is None else last["state"]
        if entry["hinge"] is not None:
            features.append(_feature("hinge", "Point", entry["hinge"], entry | {"last": last}))
        for state in states:
            outline, leaf = state.pop("outline"), state.pop("leaf")
            about = {"id": entry["id"], "kind": entry["kind"], **state, "now": state["state"] == now}
            features.append(_feature("state", "Polygon", [[*outline, outline[0]]], about))
            if leaf is not None:
                features.append(_feature("leaf", "LineString", leaf, about))
    return {
        "type": "FeatureCollection",
        "frame": "map",
        "units": "metres",
        "made_by": f"tempog {__version__}",
        "features": features,
    }


def _feature(what: str, kind: str, coordinates: Any, about: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "Feature",
        "geometry": {"type": kind, "coordinates": coordinates},
        "properties": {"what": what, **about},
    }
