"""A site and its history as an MCAP file of ROS 2 messages, for Foxglove, RViz and rosbag2."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tempog._files import whole_file
from tempog.analysis.objects import ObjectStay
from tempog.errors import ConfigError
from tempog.export.doors import outline_of
from tempog.export.layers import Cells, over
from tempog.export.map_server import OCCUPIED, UNKNOWN
from tempog.export.site_map import SiteMap, latest_stay
from tempog.ros.bag_writers import OutMessage, mcap_writer
from tempog.ros.messages import Codec, occupancy_grid, pose, string, vector
from tempog.times import NS_PER_S

Outline = list[tuple[float, float]]

FRAME = "map"
MOST_SNAPSHOTS = 200
MOST_STATES = 200_000  # of things in all messages; if they change more often, their states come with the snapshots
MOST_CELLS = 400_000_000  # in all snapshots: what a laptop reads and writes in some seconds
MAP_TOPIC, LOCALISATION_TOPIC, CURRENT_TOPIC = "/map", "/localisation_map", "/current_map"
HISTORY_TOPIC, MARKERS_TOPIC, OBJECTS_TOPIC = "/map_history", "/object_markers", "/objects"
MARKERS, MARKER = "visualization_msgs/msg/MarkerArray", "visualization_msgs/msg/Marker"
OPEN, CLOSED, THERE = (0.15, 0.65, 0.25), (0.8, 0.15, 0.1), (0.15, 0.35, 0.8)  # colours: red, green, blue
LINE_M, TEXT_M = 0.06, 0.25


class McapCounts(NamedTuple):
    """What was written: snapshots of the history, messages about things, and seconds from snapshot to snapshot."""

    n_snapshots: int
    n_states: int
    every_s: float


def write_mcap(path: Path, site: SiteMap, every_s: float | None = None) -> McapCounts:
    """Write the layers, the history and the states of things; needs the extra ``bags``.

    Parameters
    ----------
    path : Path
        Replaced if it is there.
    site : SiteMap
    every_s : float, seconds, optional
        From one snapshot to the next; the last is at the end. Default: ten, or as long as makes `MOST_SNAPSHOTS` of
        them, or `MOST_CELLS` cells in all.

    Raises
    ------
    ConfigError
        `every_s` is no such time, or makes more snapshots than there are scans.
    ExtraError
        rosbags or mcap is not installed.

    Notes
    -----
    ``/map`` and ``/localisation_map`` come first, at the begin of the period; ``/map_history`` is the map as last
    known at each snapshot; ``/current_map`` is at the site's moment. ``/object_markers`` and ``/objects`` (JSON) come
    whenever a thing was first seen in another state, each with all things. Messages are CDR, with their definitions.
    """
    if every_s is not None and not 0 < every_s < math.inf:
        raise ConfigError(f"every_s = {every_s!r} cannot work; wanted seconds above 0")
    every_s = default_every_s(site) if every_s is None else every_s
    least_s = site.history.duration_s / site.history.n_scans
    if every_s < least_s:
        raise ConfigError(
            f"every_s = {every_s:g} makes more snapshots than there are scans; wanted"
            f" {math.ceil(1000 * least_s) / 1000:g} s or more"
        )
    codec = Codec("ros2")
    counts: Counter[str] = Counter()
    with whole_file(path) as unfinished, mcap_writer(unfinished, "zstd", codec) as bag:
        for stamp_ns, topic, message in _messages(site, codec, every_s):
            bag.write(OutMessage(topic, stamp_ns, message, latched=True))
            counts[topic] += 1
    return McapCounts(counts[HISTORY_TOPIC], counts[OBJECTS_TOPIC], every_s)


def default_every_s(site: SiteMap) -> float:
    """Ten seconds, or more for a long history or a large map."""
    n_most = min(MOST_SNAPSHOTS, max(2, MOST_CELLS // site.planning.size))
    return max(10.0, math.ceil(site.history.duration_s / (n_most - 1)))


def _messages(site: SiteMap, codec: Codec, every_s: float) -> Iterator[tuple[int, str, Any]]:
    """Stamp, topic and message, in time order."""
    stamps = site.history.stamps_ns
    first_ns, last_ns = (int(stamps[k]) for k in (site.history.first_scan, site.history.last_scan))
    step_ns = max(1, round(every_s * NS_PER_S))
    snapshots = [*range(first_ns, last_ns, step_ns), last_ns]
    changes = _changes(site, first_ns)
    if len(changes) * len(site.things) > MOST_STATES:
        changes = snapshots
    moments = [
        *((stamp_ns, HISTORY_TOPIC) for stamp_ns in snapshots),
        *((stamp_ns, OBJECTS_TOPIC) for stamp_ns in changes),
        (site.at_ns, CURRENT_TOPIC),
    ]
    outlines = {
        place.id: outline_of(place, site.extent.resolution_m)
        for thing in site.things
        for place in thing.one.configurations
    }
    yield first_ns, MAP_TOPIC, _grid(site, codec, first_ns, site.planning)
    yield first_ns, LOCALISATION_TOPIC, _grid(site, codec, first_ns, site.localisation)
    for stamp_ns, topic in sorted(moments):
        if topic == HISTORY_TOPIC:
            yield stamp_ns, topic, _grid(site, codec, stamp_ns, _snapshot(site, stamp_ns))
        elif topic == CURRENT_TOPIC:
            yield stamp_ns, topic, _grid(site, codec, stamp_ns, site.current)
        else:
            states = [latest_stay(thing.one, stamp_ns) for thing in site.things]
            yield stamp_ns, MARKERS_TOPIC, _markers(site, codec, stamp_ns, states, outlines)
            yield stamp_ns, OBJECTS_TOPIC, string(codec, _states_text(site, stamp_ns, states))


def _changes(site: SiteMap, first_ns: int) -> list[int]:
    """When any thing was first seen in another state; and the begin."""
    return sorted({first_ns, *(max(first_ns, stay.start_ns) for thing in site.things for stay in thing.one.stays)})


def _snapshot(site: SiteMap, stamp_ns: int) -> Cells:
    """The map as last known at a moment: percent occupied, -1 unknown."""
    history, extent = site.history, site.extent
    value = history.at(np.datetime64(stamp_ns, "ns"), math.inf).value
    known = over(extent, value, history.extent, math.nan)
    sensing = history.config.sensing
    percent = np.clip((known - sensing.prob_free) / (sensing.prob_hit - sensing.prob_free), 0, 1) * OCCUPIED
    return np.where(np.isnan(percent), UNKNOWN, np.rint(np.nan_to_num(percent))).astype(np.int8)


def _grid(site: SiteMap, codec: Codec, stamp_ns: int, cells: Cells) -> Any:
    x_min, _, y_min, _ = site.extent.bounds
    return occupancy_grid(codec, stamp_ns, FRAME, site.extent.resolution_m, (x_min, y_min), cells)


def _states_text(site: SiteMap, stamp_ns: int, states: list[ObjectStay | None]) -> str:
    return json.dumps(
        {
            "t": stamp_ns / NS_PER_S,
            "objects": [
                {
                    "id": thing.one.id,
                    "kind": thing.kind,
                    "state": None if stay is None else stay.configuration,
                    "open": thing.is_open_in(stay),
                    "since": None if stay is None else stay.start_ns / NS_PER_S,
                }
                for thing, stay in zip(site.things, states, strict=True)
            ],
        }
    )


def _markers(
    site: SiteMap, codec: Codec, stamp_ns: int, states: list[ObjectStay | None], outlines: dict[int, Outline]
) -> Any:
    """An outline and a text per thing, by its state; all of them, so that a viewer can begin anywhere."""
    markers = []
    for thing, stay in zip(site.things, states, strict=True):
        place = next((p for p in thing.one.configurations if stay and p.id == stay.configuration), None)
        is_open = thing.is_open_in(stay)
        colour = THERE if is_open is None else OPEN if is_open else CLOSED
        word = "" if is_open is None else " open" if is_open else " closed"
        where = place if place is not None else thing.one.configurations[0]
        points = [*outlines[where.id], outlines[where.id][0]] if place is not None else []
        x, y = where.centre_m
        markers += [
            _marker(codec, stamp_ns, "outline", thing.one.id, 4, colour, points, (0.0, 0.0), ""),
            _marker(codec, stamp_ns, "text", thing.one.id, 9, colour, [], (x, y), f"{thing.one.id}{word}"),
        ]
    return codec.make(MARKERS, markers=markers)


def _marker(
    codec: Codec,
    stamp_ns: int,
    namespace: str,
    number: int,
    kind: int,
    colour: tuple[float, float, float],
    points: list[tuple[float, float]],
    at: tuple[float, float],
    text: str,
) -> Any:
    """A marker of type LINE_STRIP (4) or TEXT_VIEW_FACING (9); a line without points takes the last one away."""
    gone = kind == 4 and not points
    red, green, blue = colour
    return codec.make(
        MARKER,
        header=codec.header(stamp_ns, FRAME),
        ns=namespace,
        id=number,
        type=kind,
        action=2 if gone else 0,
        pose=pose(codec, *at),
        scale=vector(codec, (0.0, 0.0, TEXT_M) if text else (LINE_M, 0.0, 0.0)),
        color=codec.make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=1.0),
        lifetime=codec.make("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
        frame_locked=False,
        points=[vector(codec, (x, y, 0.0), "geometry_msgs/msg/Point") for x, y in points],
        colors=[],
        texture_resource="",
        texture=codec.make(
            "sensor_msgs/msg/CompressedImage",
            header=codec.header(0, ""),
            format="",
            data=np.empty(0, dtype=np.uint8),
        ),
        uv_coordinates=[],
        text=text,
        mesh_resource="",
        mesh_file=codec.make("visualization_msgs/msg/MeshFile", filename="", data=np.empty(0, dtype=np.uint8)),
        mesh_use_embedded_materials=False,
    )
