"""Everything a scan will need, done once before the first comes: compiled code takes seconds to be there."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from tempog.analysis.find_objects import FoundObjects
from tempog.analysis.static import CellClass
from tempog.analysis.tracker import ObjectTracker
from tempog.config import MapConfig
from tempog.live import outgoing
from tempog.methods import METHODS
from tempog.ros.messages import Codec
from tempog.scans.scan import Scan
from tempog.store.live_map import LiveMap


def warm_up(config: MapConfig, codec: Codec) -> None:
    """Map a made-up room, follow nothing in it, and encode what would be published."""
    angles = np.linspace(-np.pi, np.pi, 90, endpoint=False)
    with tempfile.TemporaryDirectory() as folder, LiveMap(Path(folder, "warm"), config) as live:
        scans = [Scan(100.0 + k, (0.0, 0.0, 0.0), angles, np.full(90, 2.0 + k % 2), 8.0) for k in range(4)]
        for scan in scans:
            live.integrate(scan)
        live.flush()
        now = live.at(103.0, hold=float("inf"))
        walls = np.full(live.extent.shape, CellClass.FREE, dtype=np.int8)
        found = FoundObjects(live, "evidence", METHODS["evidence"], walls, live.extent, (), ())
        tracker = ObjectTracker(found)
        for scan in scans:
            tracker.update(scan)
        tracker.due()
        outgoing.grid(codec, 0, "map", now.extent, outgoing.current_cells(now.value))
        outgoing.cloud(codec, 0, "map", tracker.high_dynamic.points_map)
        outgoing.text(codec, outgoing.doors_text(0, "map", found, tracker.states()))
