"""``tempog export``: a map for other programs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from tempog._files import whole_file
from tempog.cli._maps import MapArgument, RobotOption, SessionOption, note_pruned, opened
from tempog.cli._output import (
    ForceFlag,
    QuietFlag,
    check_new_file,
    counted,
    print_note,
    status,
    wants_progress,
)
from tempog.cli.objects import MethodOption
from tempog.cli.show import MOMENT_HELP
from tempog.errors import ConfigError

if TYPE_CHECKING:
    from tempog.export.site_map import SiteMap
    from tempog.grid.history import History

SUFFIXES = {
    "--geojson": (".geojson", ".json"),
    "--npz": (".npz",),
    "--xarray": (".nc",),
    "--mcap": (".mcap",),
}


def export(
    map_path: MapArgument,
    nav2: Annotated[
        Path | None,
        typer.Option("--nav2", metavar="DIR", help="Maps, masks, parameters and objects for Nav2, into a folder."),
    ] = None,
    geojson_file: Annotated[
        Path | None, typer.Option("--geojson", metavar="FILE", help="Objects as features, in metres.")
    ] = None,
    npz: Annotated[Path | None, typer.Option("--npz", metavar="FILE", help="All layers as NumPy arrays.")] = None,
    xarray: Annotated[
        Path | None, typer.Option("--xarray", metavar="FILE", help="All layers as netCDF; wants the extra xarray.")
    ] = None,
    mcap: Annotated[
        Path | None,
        typer.Option(
            "--mcap",
            metavar="FILE",
            help="Maps, history and states of objects as ROS 2 messages, for Foxglove; wants the extra bags.",
        ),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(metavar="T", help=f"The moment of the current map and of objects' states: {MOMENT_HELP}."),
    ] = None,
    start: Annotated[str | None, typer.Option("--from", metavar="A", help="Begin of the period analysed.")] = None,
    stop: Annotated[str | None, typer.Option("--to", metavar="B", help="End of the period analysed.")] = None,
    mode: Annotated[
        Literal["trinary", "scale"],
        typer.Option(help="Of the maps: free, occupied and unknown, or also the share of time (as PNG)."),
    ] = "trinary",
    on_robot: Annotated[
        str | None,
        typer.Option("--on-robot", metavar="DIR", help="Where the folder will lie on the robot. Default: as here."),
    ] = None,
    swing_percent: Annotated[
        int, typer.Option("--swing-percent", min=1, max=100, help="Of the full speed, where doors swing.")
    ] = 50,
    people_percent: Annotated[
        int, typer.Option("--people-percent", min=1, max=100, help="Of the full speed, where people walk.")
    ] = 70,
    every_s: Annotated[
        str | None,
        typer.Option("--every", metavar="S", help="Seconds between the MCAP's snapshots. Default: at most 200."),
    ] = None,
    method: MethodOption = "evidence",
    sessions: SessionOption = None,
    robots: RobotOption = None,
    force: ForceFlag = False,
    quiet: QuietFlag = False,
) -> None:
    """Write a map for other programs: Nav2 and ROS 1 navigation, Foxglove, a GIS, NumPy.

    With --nav2: map (planning: no doors, furniture or people), localisation (every known place of them), current
    (as last seen), keepout and speed masks as map_server reads them, filters.yaml with the parameters that load them,
    and objects.yaml.
    """
    files = {"--geojson": geojson_file, "--npz": npz, "--xarray": xarray, "--mcap": mcap}
    if nav2 is None and not any(files.values()):
        raise ConfigError(f"nothing to write; give one or more of --nav2 DIR, {' FILE, '.join(files)} FILE")
    if at is not None and (start is not None or stop is not None):
        raise ConfigError("--at names a moment, --from and --to a period; give one or the other")
    every = _seconds(every_s) if every_s is not None else None
    for name, given in (("--mode", mode != "trinary"), ("--on-robot", on_robot is not None)):
        if given and nav2 is None:
            raise ConfigError(f"{name} is for --nav2 DIR, which is not asked for")
    if every is not None and mcap is None:
        raise ConfigError("--every is for --mcap FILE, which is not asked for")
    for name, path in files.items():
        if path is not None:
            if path.suffix.lower() not in SUFFIXES[name]:
                raise ConfigError(f"{name} {path}: wanted a name that ends in {' or '.join(SUFFIXES[name])}")
            check_new_file(path, force)
    _check_extras(xarray is not None, mcap is not None)
    from tempog.analysis.find_objects import find_objects
    from tempog.export.nav2 import check_folder, export_nav2
    from tempog.export.site_map import site_map

    if nav2 is not None:
        check_folder(nav2, mode, force)
    saved = opened(map_path, sessions, robots)
    history: History = saved if start is None and stop is None else saved.window(start, stop)
    if at is not None:
        saved.parse_moment(at)  # errors come before the work
    from tempog.analysis.pose_consistency import pose_consistency

    written: list[str] = []
    with status("finding objects", wants_progress(quiet)) as say:
        poses = pose_consistency(saved)
        site = site_map(find_objects(history, method), at, doubtful_are_walls=poses.consistent is False)
        say("writing")
        if nav2 is not None:
            export_nav2(
                site,
                nav2,
                mode=mode,
                on_robot=on_robot,
                swing_percent=swing_percent,
                people_percent=people_percent,
                force=force,
            )
            written.append(str(nav2))
        written += _write_files(site, every, geojson_file, npz, xarray, mcap)
    n_doors = sum(thing.hinge is not None for thing in site.things)
    others = counted(len(site.things) - n_doors, "other object", "other objects")
    floor_m2 = int((site.planning == 0).sum()) * site.extent.resolution_m**2
    typer.echo(f"{floor_m2:.1f} m² of floor, {counted(n_doors, 'door', 'doors')}, {others}, by method {method}")
    for text in written:
        typer.echo(f"Written: {text}")
    if not quiet:
        note_pruned(saved, *(saved.parse_moment(moment) for moment in (at, start, stop) if moment is not None))
        if poses.warning:
            print_note(poses.warning)
            print_note("so things of one place that were there for most of the time count as walls")
        if not site.things:
            print_note("no object was found, so that both maps are alike; tempog objects says what can be set")


def _write_files(
    site: SiteMap,
    every_s: float | None,
    geojson_file: Path | None,
    npz: Path | None,
    xarray: Path | None,
    mcap: Path | None,
) -> list[str]:
    from tempog.export.arrays import write_arrays, write_netcdf
    from tempog.export.mcap_file import write_mcap
    from tempog.export.object_entries import geojson

    written = []
    if geojson_file is not None:
        with whole_file(geojson_file) as unfinished:
            unfinished.write_text(json.dumps(geojson(site), allow_nan=False, indent=1) + "\n", encoding="utf-8")
        written.append(str(geojson_file))
    writers: list[tuple[Path | None, Callable[[Path, SiteMap], None]]] = [(npz, write_arrays), (xarray, write_netcdf)]
    for path, write in writers:
        if path is not None:
            write(path, site)
            written.append(str(path))
    if mcap is not None:
        counts = write_mcap(mcap, site, every_s)
        snapshots = counted(counts.n_snapshots, "snapshot", "snapshots")
        states = counted(counts.n_states, "message", "messages") + " of objects' states"
        written.append(f"{mcap}: {snapshots}, one every {counts.every_s:g} s; {states}")
    return written


def _check_extras(xarray: bool, mcap: bool) -> None:
    """Refuse before the work what could not be written after it."""
    from tempog._extras import need

    if xarray:
        need("xarray", extra="xarray")
    if mcap:
        need("mcap.writer", extra="bags")
        need("rosbags.typesys", extra="bags")


def _seconds(text: str) -> float:
    """Seconds, with or without their unit."""
    try:
        seconds = float(text.removesuffix("s"))
    except ValueError:
        seconds = float("nan")
    if not 0 < seconds < float("inf"):
        raise ConfigError(f"--every {text} cannot work; wanted seconds above 0, such as 10 or 10s")
    return seconds
