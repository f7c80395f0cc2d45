"""What is published: maps, places and events as standard ROS messages."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.configurations import Configuration, PlaceState
from tempog.analysis.find_objects import FoundObjects
from tempog.analysis.static import CellClass
from tempog.analysis.tracker import PlaceEvent
from tempog.grid.history import OCCUPIED_ABOVE
from tempog.ros import messages as ros
from tempog.sensing.grid_spec import Extent
from tempog.times import NS_PER_S

MARKERS = "visualization_msgs/msg/MarkerArray"
LINE_STRIP, TEXT, ADD, DELETE_ALL = 4, 9, 0, 3  # of Marker
COLOURS = {"occupied": (0.85, 0.2, 0.15, 0.9), "free": (0.2, 0.65, 0.3, 0.45), None: (0.5, 0.5, 0.5, 0.45)}
OCCUPIED_CELL, FREE_CELL = 100, 0
TEXT_M = 0.25  # height of letters

States = dict[int, tuple[PlaceState | None, int | None]]
"""Of each place, by its id: what it was last seen as, and when."""

# Topics in the order of docs/live.md.
STATIC_MAP, CURRENT_MAP = "tempog/static_map", "tempog/map"
DOORS, EVENTS, DOOR_MARKERS = "tempog/doors", "tempog/events", "tempog/door_markers"
HIGH_DYNAMIC, STATUS = "tempog/high_dynamic", "tempog/status"


def static_cells(found: FoundObjects) -> NDArray[np.int8]:
    """The static map for an OccupancyGrid: walls, floor, and what nobody has seen; doors count as floor.

    Cells that are occupied or free by where they are seen from are walls: glass stops a robot.
    """
    cells = np.full(found.walls.shape, ros.UNKNOWN_CELL, dtype=np.int8)
    cells[(found.walls == CellClass.FREE) | (found.walls == CellClass.CHANGING)] = FREE_CELL
    cells[(found.walls == CellClass.STATIC) | (found.walls == CellClass.UNCERTAIN)] = OCCUPIED_CELL
    return cells


def current_cells(value: NDArray[np.float32]) -> NDArray[np.int8]:
    """P(occupied) for an OccupancyGrid: occupied, free or, where it is NaN, unknown.

    Nothing between: by default, costmaps of Nav2 take as occupied what is 100, and nothing less.
    """
    known = np.where(value > OCCUPIED_ABOVE, np.int8(OCCUPIED_CELL), np.int8(FREE_CELL))
    return np.where(np.isnan(value), np.int8(ros.UNKNOWN_CELL), known)


def grid(codec: ros.Codec, stamp_ns: int, frame: str, extent: Extent, cells: NDArray[np.int8]) -> bytes:
    """An OccupancyGrid."""
    x_min, _, y_min, _ = extent.bounds
    return codec.encode(ros.occupancy_grid(codec, stamp_ns, frame, extent.resolution_m, (x_min, y_min), cells))


def events_text(event: PlaceEvent, found: FoundObjects) -> str:
    """One event as JSON."""
    return json.dumps(
        {
            "stamp": event.stamp_ns / NS_PER_S,
            "stamp_ns": event.stamp_ns,
            "object": event.object_id,
            "place": event.configuration_id,
            "state": event.state,
            "confidence": round(event.confidence, 3),
            **_position(next(one for one in found.configurations if one.id == event.configuration_id)),
        }
    )


def doors_text(stamp_ns: int, frame: str, found: FoundObjects, states: States) -> str:
    """All objects with their places and states as JSON."""
    objects = []
    for one in found.objects:
        places = []
        for place in one.configurations:
            state, seen_ns = states[place.id]
            places.append({"id": place.id, "state": state, "last_seen": _seconds(seen_ns), **_position(place)})
        there = [i for i in (place.id for place in one.configurations) if states[i][0] == "occupied"]
        latest = max(there, key=lambda i: states[i][1] or 0, default=None)
        objects.append({"id": one.id, "place": latest, "places": places})
    return json.dumps({"stamp": stamp_ns / NS_PER_S, "stamp_ns": stamp_ns, "frame": frame, "objects": objects})


def door_markers(
    codec: ros.Codec, stamp_ns: int, frame: str, found: FoundObjects, states: States, width_m: float
) -> bytes:
    """Places of objects as lines: red where something stands, green where nothing does, grey before any look."""
    markers = [_marker(codec, stamp_ns, frame, number=0, action=DELETE_ALL)]
    for one in found.objects:
        for place in one.configurations:
            state, _ = states[place.id]
            ends = [ros.vector(codec, (x, y, 0.0), "geometry_msgs/msg/Point") for x, y in _ends(place)]
            markers.append(
                _marker(
                    codec,
                    stamp_ns,
                    frame,
                    number=place.id,
                    colour=COLOURS[state],
                    scale=(width_m, 0.0, 0.0),
                    points=ends,
                )
            )
            markers.append(
                _marker(
                    codec,
                    stamp_ns,
                    frame,
                    number=place.id,
                    space="names",
                    kind=TEXT,
                    scale=(0.0, 0.0, TEXT_M),
                    at=place.centre_m,
                    text=f"{one.id}: {state or 'unseen'}",
                )
            )
    return codec.encode(codec.make(MARKERS, markers=markers))


def cloud(codec: ros.Codec, stamp_ns: int, frame: str, points_map: NDArray[np.float64]) -> bytes:
    """A PointCloud2 of the centres of cells, at height 0."""
    return codec.encode(ros.point_cloud(codec, stamp_ns, frame, points_map))


def text(codec: ros.Codec, content: str) -> bytes:
    """A String."""
    return codec.encode(ros.string(codec, content))


def _marker(
    codec: ros.Codec,
    stamp_ns: int,
    frame: str,
    *,
    number: int,
    kind: int = LINE_STRIP,
    action: int = ADD,
    space: str = "places",
    at: tuple[float, float] = (0.0, 0.0),
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0),
    colour: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0),
    points: Sequence[Any] = (),
    text: str = "",
) -> Any:
    newer = {}
    if codec.version == "ros2":
        no_header = codec.make("std_msgs/msg/Header", stamp=codec.stamp(0), frame_id="")
        empty = np.empty(0, dtype=np.uint8)
        newer = {
            "texture_resource": "",
            "texture": codec.make("sensor_msgs/msg/CompressedImage", header=no_header, format="", data=empty),
            "uv_coordinates": [],
            "mesh_file": codec.make("visualization_msgs/msg/MeshFile", filename="", data=empty),
        }
    red, green, blue, alpha = colour
    return codec.make(
        "visualization_msgs/msg/Marker",
        header=codec.header(stamp_ns, frame),
        ns=f"tempog {space}",
        id=number,
        type=kind,
        action=action,
        pose=ros.pose(codec, *at),
        scale=ros.vector(codec, scale),
        color=codec.make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=alpha),
        lifetime=codec.make("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
        frame_locked=False,
        points=list(points),
        colors=[],
        text=text,
        mesh_resource="",
        mesh_use_embedded_materials=False,
        **newer,
    )


def _position(place: Configuration) -> dict[str, float]:
    x, y = place.centre_m
    return {"x": round(x, 3), "y": round(y, 3)}


def _ends(place: Configuration) -> list[tuple[float, float]]:
    """Where the longest line through a place's cells begins and ends, metres."""
    points = place.points_map
    centre = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - centre, full_matrices=False)
    along = (points - centre) @ axes[0]
    ends = centre + np.outer([along.min(), along.max()], axes[0])
    return [(float(x), float(y)) for x, y in ends]


def _seconds(stamp_ns: int | None) -> float | None:
    return None if stamp_ns is None else stamp_ns / NS_PER_S
