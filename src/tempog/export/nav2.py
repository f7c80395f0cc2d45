"""A folder of files for Nav2: maps, masks, the parameters that load them, and the objects."""

from __future__ import annotations

import shutil
import uuid
from pathlib import Path, PurePosixPath
from typing import Any, get_args

from tempog.errors import MapError
from tempog.export.map_server import Mode, check_mode, write_nav2_map
from tempog.export.masks import PEOPLE_PERCENT, SWING_PERCENT, keepout_mask, speed_mask
from tempog.export.object_entries import objects_entry
from tempog.export.site_map import SiteMap
from tempog.export.yaml_text import to_yaml

PARAMETERS, OBJECTS = "filters.yaml", "objects.yaml"
MAPS = {
    "map": "For planning: what never moves, without doors, furniture and people.",
    "localisation": "For localisation: with every known place of doors and furniture.",
    "current": "What stood there at the moment of the export, as it was last seen.",
    "keepout": "Mask of nav2_costmap_2d::KeepoutFilter: where a thing stands for most of the time.",
    "speed": "Mask of nav2_costmap_2d::SpeedFilter: percent of the full speed, 0 for no limit.",
}


def file_names(mode: Mode) -> tuple[str, ...]:
    """The files that an export to a folder writes, those that name others after them."""
    suffix = {
        name: "png" if mode == "scale" and name in ("map", "localisation", "current") else "pgm" for name in MAPS
    }
    return (*(f"{name}.{suffix[name]}" for name in MAPS), *(f"{name}.yaml" for name in MAPS), OBJECTS, PARAMETERS)


def export_nav2(
    site: SiteMap,
    folder: str | Path,
    *,
    mode: Mode = "trinary",
    on_robot: str | None = None,
    swing_percent: int = SWING_PERCENT,
    people_percent: int = PEOPLE_PERCENT,
    force: bool = False,
) -> tuple[Path, ...]:
    """Write a site's maps, masks, parameters and objects into a folder, all of them or none.

    Parameters
    ----------
    site : SiteMap
    folder : path
        Made if it is not there; its parent must be.
    mode : "trinary" or "scale"
        Of the maps; with ``scale`` what belongs to no thing has the percent of the time in which it was occupied.
    on_robot : str, optional
        Where the files will lie on the robot, for the parameters. Default: where they are written.
    swing_percent, people_percent : int
        See `speed_mask`.
    force : bool
        Replace files of these names.

    Returns
    -------
    tuple of Path
        The files.

    Raises
    ------
    MapError
        Files of these names are there, or the folder cannot be made.
    ConfigError
        An unknown mode, or a percent that is none.
    """
    folder = Path(folder)
    check_folder(folder, mode, force)
    speed = speed_mask(site, swing_percent=swing_percent, people_percent=people_percent)
    unfinished = folder.absolute().with_name(f".{uuid.uuid4().hex[:8]}.unfinished.{folder.name}")
    unfinished.mkdir()
    try:
        layers = {"map": site.planning, "localisation": site.localisation, "current": site.current}
        for name, cells in layers.items():
            shown = site.with_shares(cells) if mode == "scale" else cells
            write_nav2_map(unfinished / name, site.as_nav2(shown), mode, comment=MAPS[name])
        write_nav2_map(unfinished / "keepout", site.as_nav2(keepout_mask(site)), "trinary", comment=MAPS["keepout"])
        write_nav2_map(unfinished / "speed", site.as_nav2(speed), "raw", comment=MAPS["speed"])
        (unfinished / OBJECTS).write_text(
            to_yaml(objects_entry(site), "Objects with several places. Metres in the map frame, seconds of the log."),
            encoding="utf-8",
        )
        there = PurePosixPath(on_robot if on_robot is not None else folder.absolute().as_posix())
        (unfinished / PARAMETERS).write_text(to_yaml(parameters(there), PARAMETERS_HEAD), encoding="utf-8")
        if folder.exists():
            for name in file_names(mode):
                (unfinished / name).replace(folder / name)
            for name in (name for other in get_args(Mode) for name in set(file_names(other)) - set(file_names(mode))):
                (folder / name).unlink(missing_ok=True)  # a picture of the other mode, which nothing names any more
        else:
            unfinished.replace(folder)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
    return tuple(folder / name for name in file_names(mode))


def check_folder(folder: Path, mode: Mode, force: bool) -> None:
    """Refuse to write over files unless told to, and where no folder can be."""
    check_mode(mode)
    if folder.exists() and not folder.is_dir():
        raise MapError(f"{folder} is a file; name a folder for the files of --nav2")
    if not folder.absolute().parent.is_dir():
        raise MapError(
            f"{folder.parent} is not a directory; make it first, or choose another place for {folder.name}"
        )
    there = [name for name in file_names(mode) if (folder / name).exists()]
    if there and not force:
        raise MapError(
            f"{folder} has {', '.join(there[:3])}{' and others' if len(there) > 3 else ''} already; use --force to"
            " replace them, or choose another folder"
        )


PARAMETERS_HEAD = """\
Parameters for Nav2: give this file to the nodes after your own (--params-file may be repeated).
Nodes that your bringup does not start: localisation_map_server, keepout_filter_mask_server and
speed_filter_mask_server (nav2_map_server map_server), keepout_costmap_filter_info_server and
speed_costmap_filter_info_server (nav2_map_server costmap_filter_info_server), and
lifecycle_manager_site (nav2_lifecycle_manager lifecycle_manager), which starts them up.
If your costmaps have filters already, add these to their list: the last file's list wins."""


def parameters(folder: PurePosixPath) -> dict[str, Any]:
    """Parameters of the servers of maps and masks, of AMCL and of the costmaps, for files in a folder."""

    def server(name: str, topic: str) -> dict[str, Any]:
        return {"yaml_filename": str(folder / f"{name}.yaml"), "topic_name": topic, "frame_id": "map"}

    def info(kind: int, name: str) -> dict[str, Any]:
        return {
            "type": kind,
            "filter_info_topic": f"/{name}_filter_info",
            "mask_topic": f"/{name}_filter_mask",
            "base": 0.0,
            "multiplier": 1.0,
        }

    keepout = {
        "plugin": "nav2_costmap_2d::KeepoutFilter",
        "enabled": True,
        "filter_info_topic": "/keepout_filter_info",
    }
    speed = {
        "plugin": "nav2_costmap_2d::SpeedFilter",
        "enabled": True,
        "filter_info_topic": "/speed_filter_info",
        "speed_limit_topic": "/speed_limit",
    }
    nodes = {
        "map_server": server("map", "map"),
        "localisation_map_server": server("localisation", "localisation_map"),
        "amcl": {"map_topic": "localisation_map"},
        "keepout_filter_mask_server": server("keepout", "keepout_filter_mask"),
        "keepout_costmap_filter_info_server": info(0, "keepout"),
        "speed_filter_mask_server": server("speed", "speed_filter_mask"),
        "speed_costmap_filter_info_server": info(1, "speed"),
        "lifecycle_manager_site": {
            "autostart": True,
            "node_names": [
                "localisation_map_server",
                "keepout_filter_mask_server",
                "keepout_costmap_filter_info_server",
                "speed_filter_mask_server",
                "speed_costmap_filter_info_server",
            ],
        },
    }
    document: dict[str, Any] = {name: {"ros__parameters": own} for name, own in nodes.items()}
    document["global_costmap"] = {
        "global_costmap": {
            "ros__parameters": {
                "filters": ["keepout_filter", "speed_filter"],
                "keepout_filter": keepout,
                "speed_filter": speed,
            }
        }
    }
    document["local_costmap"] = {
        "local_costmap": {"ros__parameters": {"filters": ["keepout_filter"], "keepout_filter": keepout}}
    }
    return document
