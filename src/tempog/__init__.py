"""A map with a memory: every state each spot of an occupancy grid has had.

Start with `open_scans` and `build_grid`, or make `Scan` objects and feed a `TemporalGrid`.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from tempog._version import __version__

if TYPE_CHECKING:
    from tempog.analysis.configurations import Configuration, find_configurations
    from tempog.analysis.dynamics import map_dynamics
    from tempog.analysis.find_objects import FoundObjects, find_objects
    from tempog.analysis.growing import EvidenceAnalysis
    from tempog.analysis.high_dynamic import HighDynamic, high_dynamic, high_dynamics
    from tempog.analysis.map_diff import MapDiff, map_diff
    from tempog.analysis.objects import MovingObject, associate
    from tempog.analysis.occupancy import occupancy_grid
    from tempog.analysis.pose_consistency import PoseConsistency, pose_consistency
    from tempog.analysis.static import CellClass, static_map
    from tempog.analysis.tracker import ObjectTracker, PlaceEvent
    from tempog.analysis.turn_check import TurnCheck, turn_check
    from tempog.config import GridConfig, MapConfig, SensingConfig
    from tempog.errors import (
        ClockError,
        ClusterError,
        ConfigError,
        EmptyWindowError,
        ExtentError,
        MapError,
        ScanError,
        TempogError,
        TimeError,
    )
    from tempog.export.arrays import to_xarray
    from tempog.export.map_server import Nav2Map, read_nav2_map, write_nav2_map
    from tempog.export.nav2 import export_nav2
    from tempog.export.site_map import SiteMap, site_map
    from tempog.grid.history import CellHistory, Changes, History, Snapshot, Window
    from tempog.grid.temporal_grid import TemporalGrid
    from tempog.grid.time_index import TimeIndex
    from tempog.methods import EvidenceConfig, PaperConfig
    from tempog.pipeline import add_to_map, build_grid
    from tempog.scans.bag_choice import BagChoice
    from tempog.scans.bag_writer import write_bag
    from tempog.scans.npz import write_npz
    from tempog.scans.open import open_scans
    from tempog.scans.rosbag import open_bag
    from tempog.scans.scan import Scan, ScanLog
    from tempog.scans.trajectory import Trajectory, with_poses
    from tempog.scans.trajectory_file import read_trajectory
    from tempog.store.live_map import LiveMap
    from tempog.store.saved_map import SavedMap, open_map, save_map

# Numba takes a second to import, so nothing is loaded before it is used.
_HOMES = {
    "tempog.analysis.configurations": ["Configuration", "find_configurations"],
    "tempog.analysis.dynamics": ["map_dynamics"],
    "tempog.analysis.find_objects": ["FoundObjects", "find_objects"],
    "tempog.analysis.growing": ["EvidenceAnalysis"],
    "tempog.analysis.high_dynamic": ["HighDynamic", "high_dynamic", "high_dynamics"],
    "tempog.analysis.map_diff": ["MapDiff", "map_diff"],
    "tempog.analysis.objects": ["MovingObject", "associate"],
    "tempog.analysis.occupancy": ["occupancy_grid"],
    "tempog.analysis.pose_consistency": ["PoseConsistency", "pose_consistency"],
    "tempog.analysis.static": ["CellClass", "static_map"],
    "tempog.analysis.tracker": ["ObjectTracker", "PlaceEvent"],
    "tempog.analysis.turn_check": ["TurnCheck", "turn_check"],
    "tempog.config": ["GridConfig", "MapConfig", "SensingConfig"],
    "tempog.errors": [
        "ClockError",
        "ClusterError",
        "ConfigError",
        "EmptyWindowError",
        "ExtentError",
        "MapError",
        "ScanError",
        "TempogError",
        "TimeError",
    ],
    "tempog.export.arrays": ["to_xarray"],
    "tempog.export.map_server": ["Nav2Map", "read_nav2_map", "write_nav2_map"],
    "tempog.export.nav2": ["export_nav2"],
    "tempog.export.site_map": ["SiteMap", "site_map"],
    "tempog.grid.history": ["CellHistory", "Changes", "History", "Snapshot", "Window"],
    "tempog.grid.temporal_grid": ["TemporalGrid"],
    "tempog.grid.time_index": ["TimeIndex"],
    "tempog.methods": ["EvidenceConfig", "PaperConfig"],
    "tempog.pipeline": ["add_to_map", "build_grid"],
    "tempog.scans.bag_choice": ["BagChoice"],
    "tempog.scans.bag_writer": ["write_bag"],
    "tempog.scans.npz": ["write_npz"],
    "tempog.scans.open": ["open_scans"],
    "tempog.scans.rosbag": ["open_bag"],
    "tempog.scans.scan": ["Scan", "ScanLog"],
    "tempog.scans.trajectory": ["Trajectory", "with_poses"],
    "tempog.scans.trajectory_file": ["read_trajectory"],
    "tempog.store.live_map": ["LiveMap"],
    "tempog.store.saved_map": ["SavedMap", "open_map", "save_map"],
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "BagChoice",
    "CellClass",
    "CellHistory",
    "Changes",
    "ClockError",
    "ClusterError",
    "ConfigError",
    "Configuration",
    "EmptyWindowError",
    "EvidenceAnalysis",
    "EvidenceConfig",
    "ExtentError",
    "FoundObjects",
    "GridConfig",
    "HighDynamic",
    "History",
    "LiveMap",
    "MapConfig",
    "MapDiff",
    "MapError",
    "MovingObject",
    "Nav2Map",
    "ObjectTracker",
    "PaperConfig",
    "PlaceEvent",
    "PoseConsistency",
    "SavedMap",
    "Scan",
    "ScanError",
    "ScanLog",
    "SensingConfig",
    "SiteMap",
    "Snapshot",
    "TempogError",
    "TemporalGrid",
    "TimeError",
    "TimeIndex",
    "Trajectory",
    "TurnCheck",
    "Window",
    "__version__",
    "add_to_map",
    "associate",
    "build_grid",
    "export_nav2",
    "find_configurations",
    "find_objects",
    "high_dynamic",
    "high_dynamics",
    "map_diff",
    "map_dynamics",
    "occupancy_grid",
    "open_bag",
    "open_map",
    "open_scans",
    "pose_consistency",
    "read_nav2_map",
    "read_trajectory",
    "save_map",
    "site_map",
    "static_map",
    "to_xarray",
    "turn_check",
    "with_poses",
    "write_bag",
    "write_nav2_map",
    "write_npz",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'tempog' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME_OF[name]), name)


def __dir__() -> list[str]:
    return __all__
