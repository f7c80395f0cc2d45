"""``tempog map``: laser logs to a map with a memory."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from tempog.cli._maps import opened
from tempog.cli._output import (
    ForceFlag,
    JsonFlag,
    QuietFlag,
    bytes_text,
    count_text,
    counted,
    duration_text,
    print_json,
    print_note,
    status,
    track_bytes,
    track_scans,
    wants_progress,
)
from tempog.cli._poses import NOWHERE, other_poses
from tempog.config import DEFAULT_GAP, Evidence, GridConfig, MapConfig, NoReturn, SensingConfig, parse_gap
from tempog.errors import ConfigError, ScanError
from tempog.scans.bag_choice import BagChoice
from tempog.scans.trajectory import MAX_GAP_S
from tempog.times import NS_PER_S, parse_duration

if TYPE_CHECKING:
    from tempog.scans.scan import ScanLog

MAP_SUFFIX = ".tempog"
MAP_SETTINGS = ("resolution", "max_range", "gap", "tolerance", "evidence", "no_return", "max_cells")
LOG_SUFFIXES = {".gz", ".log", ".clf", ".npz", ".bag", ".mcap", ".db3", ".zstd"}
BAG_FLAGS = "--scan-topic, --fixed-frame, --base-frame, --pose-topic and --from-cloud"


def map_logs(
    context: typer.Context,
    inputs: Annotated[
        list[Path],
        typer.Argument(metavar="INPUT...", help="Laser logs: bags (.bag, .mcap, .db3, folders), CARMEN, .npz."),
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="MAP", help="The map to write. Default: INPUT.tempog here."),
    ] = None,
    resolution: Annotated[float, typer.Option(help="Side of a cell, metres.")] = GridConfig.resolution_m,
    max_range: Annotated[
        float, typer.Option(help="Readings beyond are no hits; such beams free cells up to here. Metres.")
    ] = SensingConfig.max_range_m,
    gap: Annotated[
        str, typer.Option(help="A cell unseen for longer starts a new interval: 2s, or 10scans.")
    ] = DEFAULT_GAP,
    tolerance: Annotated[
        float, typer.Option(help="Largest difference of P(occupied) within one interval.")
    ] = GridConfig.tolerance,
    evidence: Annotated[
        Evidence, typer.Option(help="surface: walls stay walls; literal: the paper's sensor model.")
    ] = "surface",
    no_return: Annotated[NoReturn, typer.Option(help="When a beam without return frees space.")] = "neighbours",
    clock: Annotated[
        str, typer.Option(help="auto: mend little, refuse worse; sort: by stamp; rate=HZ: ignore the stamps.")
    ] = "auto",
    laser: Annotated[Literal["front", "rear"], typer.Option(help="CARMEN: FLASER or RLASER lines.")] = "front",
    sensor_max_range: Annotated[
        float | None, typer.Option(help="The sensor's maximum, metres; readings from there on are no returns.")
    ] = None,
    scan_topic: Annotated[
        list[str] | None, typer.Option(metavar="TOPIC", help="Bags: a laser to map; may be repeated. Default: all.")
    ] = None,
    fixed_frame: Annotated[
        str, typer.Option(metavar="FRAME", help="Bags: the frame to map in. Default: map, else odom.")
    ] = "",
    base_frame: Annotated[str, typer.Option(metavar="FRAME", help="Bags: the robot's own frame.")] = "",
    pose_topic: Annotated[
        str, typer.Option(metavar="TOPIC", help="Bags: says where the robot was, in place of transforms.")
    ] = "",
    from_cloud: Annotated[
        str, typer.Option(metavar="LOW:HIGH", help="Bags: make scans of a point cloud between heights, metres.")
    ] = "",
    poses_from: Annotated[
        Path | None,
        typer.Option("--poses", metavar="FILE", help="Poses of the scans from a TUM or KITTI trajectory instead."),
    ] = None,
    pose_times: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="For KITTI: the time of each row. Default: a row for each scan."),
    ] = None,
    pose_offset: Annotated[float, typer.Option(help="Added to the stamps of --poses, seconds.")] = 0.0,
    pose_gap: Annotated[
        float, typer.Option(help="No pose between two of --poses farther apart, unless the robot stood. Seconds.")
    ] = MAX_GAP_S,
    laser_at: Annotated[
        str, typer.Option(metavar="X,Y,DEG", help="Where the laser sits on what --poses are of; metres, degrees.")
    ] = NOWHERE,
    max_cells: Annotated[
        int, typer.Option(help="Bound on the map's bounding rectangle, against corrupt poses.")
    ] = GridConfig.max_cells,
    skip_bad: Annotated[bool, typer.Option("--skip-bad", help="Leave out unusable lines, and count them.")] = False,
    append: Annotated[
        bool, typer.Option("--append", help="Add the logs to MAP, as a session with the map's own settings.")
    ] = False,
    robot: Annotated[str, typer.Option(metavar="NAME", help="Kept with the session.")] = "",
    session: Annotated[str, typer.Option(metavar="ID", help="A name for the session. Default: from the date.")] = "",
    window: Annotated[
        str | None,
        typer.Option(metavar="DURATION", help="How much history stays in memory, such as 24h; all is on disk."),
    ] = None,
    force: ForceFlag = False,
    quiet: QuietFlag = False,
    json: JsonFlag = False,
) -> None:
    """Map one or more laser logs; several are merged by time."""
    settings = MapConfig(
        SensingConfig(evidence=evidence, max_range_m=max_range, no_return=no_return),
        GridConfig(resolution_m=resolution, tolerance=tolerance, max_cells=max_cells),
    )
    parse_gap(gap, math.nan)  # says at once if it is no duration
    if window is not None:
        parse_duration(window)
    from_elsewhere = other_poses(poses_from, pose_times, pose_offset, pose_gap, laser_at, skip_bad)
    path = output or default_map_path(inputs[0])
    sources = {name: context.get_parameter_source(name) for name in MAP_SETTINGS}
    chosen = [name for name, source in sources.items() if source is not None and source.name == "COMMANDLINE"]
    if append and chosen:
        names = ", ".join(f"--{name.replace('_', '-')}" for name in chosen)
        raise ConfigError(f"--append goes on with the map's own settings; leave out {names}, or make another map")
    if append and force:
        raise ConfigError("--append adds to a map, --force replaces it; give one or the other")
    for source in inputs:
        if (source / "map.json").is_file():
            raise ScanError(f"{source} is a map, not a log; look at it with: tempog show {source} -o map.png")
    choice = BagChoice(
        tuple(scan_topic or ()), fixed_frame, base_frame, pose_topic, parse_band(from_cloud) if from_cloud else None
    )
    # These import Numba and pyarrow, which --help should not wait for.
    from tempog.analysis.pose_consistency import pose_consistency
    from tempog.analysis.turn_check import turn_check
    from tempog.pipeline import add_to_map
    from tempog.scans.open import open_scans, recognise
    from tempog.scans.rosbag import open_bag
    from tempog.store.manifest import read_manifest
    from tempog.store.saved_map import check_target, new_map

    if append:
        read_manifest(path)
    else:
        check_target(path, force)
    progress = wants_progress(quiet or json)
    logs = []
    bags = [source for source in inputs if recognise(source) == "bag"]
    if choice != BagChoice() and not bags:
        raise ConfigError(f"{BAG_FLAGS} are for bags, and {inputs[0]} is none; leave them out")
    reading = {"clock": clock, "skip_bad": skip_bad, "sensor_max_range": sensor_max_range}
    if bags:  # all are one recording, and share their transforms
        if from_elsewhere is not None:
            choice = replace(choice, trajectory=(trajectory := from_elsewhere.of_bag(choice)))
        with track_bytes(f"reading {bags[0]}", progress) as moved_on:
            logs += open_bag(bags, choice, progress=moved_on, **reading)  # type: ignore[arg-type]
        if from_elsewhere is not None:
            logs = from_elsewhere.noted(logs, trajectory)
    for source in inputs:
        if source not in bags:
            with status(f"reading {source}", progress):
                log = open_scans(source, laser=laser, **reading)  # type: ignore[arg-type]
                logs.append(log if from_elsewhere is None else from_elsewhere.placed(log))
    map_notes = overlaps(logs)
    if not quiet and not json:
        for log in logs:
            typer.echo(
                f"{log.source}: {log.format}, {counted(len(log), 'scan', 'scans')}, {duration_text(log.duration_s)}"
            )
            for note in log.notes:
                print_note(note)
    started = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with nullcontext(path) if append else new_map(path, force) as folder:
            name = add_to_map(
                logs,
                folder,
                None if append else settings,
                gap=None if append else gap,
                robot=robot,
                session=session,
                window=window,
                skip_far=skip_bad,
                track=track_scans if progress else None,
            )
    ingest_s = time.perf_counter() - started
    map_notes += [str(warning.message) for warning in caught]
    if not quiet and not json:
        for note in map_notes:
            print_note(note)
    saved = opened(path)
    poses = pose_consistency(saved)
    turns = [turn_check(log) for log in logs]
    added = next(one for one in saved.sessions if one.id == name)
    answer: dict[str, Any] = {
        "map": str(path),
        "session": name,
        "n_scans": added.n_scans,
        "n_scans_in_map": saved.n_scans,
        "duration_s": (added.stop_ns - added.start_ns) / NS_PER_S,
        "n_cells": saved.n_cells,
        "n_intervals": saved.n_intervals,
        "ingest_s": ingest_s,
        "scans_per_s": added.n_scans / ingest_s,
        "bytes_on_disk": saved.bytes_on_disk,
        "resolution_m": saved.config.grid.resolution_m,
        "gap_s": added.config["grid"]["gap_s"],
        "evidence": added.config["sensing"]["evidence"],
        "poses": poses.to_dict(),
        "notes": map_notes,
        "sources": [
            {
                "path": log.source,
                "format": log.format,
                "n_scans": len(log),
                "n_skipped": log.n_skipped,
                "notes": list(log.notes),
                "turns": turned.to_dict(),
            }
            for log, turned in zip(logs, turns, strict=True)
        ],
    }
    if json:
        print_json(answer)
        return
    typer.echo(
        f"{count_text(added.n_scans)} scans in {ingest_s:.1f} s ({count_text(round(answer['scans_per_s']))}/s):"
        f" {count_text(answer['n_cells'])} cells, {count_text(answer['n_intervals'])} intervals,"
        f" {bytes_text(answer['bytes_on_disk'])} in {path}"
    )
    if not quiet:
        for warning in (poses.warning, *(turned.warning for turned in turns)):
            if warning:
                print_note(warning)


def default_map_path(log: Path) -> Path:
    """Name of a log's map, in the current directory.

    >>> default_map_path(Path("logs/office.log.gz")).name
    'office.tempog'
    """
    name = log if log.name else log.absolute()  # the folder that one is in
    while name.suffix.lower() in LOG_SUFFIXES:
        name = name.with_suffix("")
    return Path(name.name + MAP_SUFFIX)


def parse_band(text: str) -> tuple[float, float]:
    """Heights as they are typed.

    >>> parse_band("0.2:0.4")
    (0.2, 0.4)
    """
    low, found, high = text.partition(":")
    try:
        if found:
            return float(low), float(high)
    except ValueError:
        pass
    raise ConfigError(f"--from-cloud {text} is no band of heights; wanted LOW:HIGH in metres, as in 0.2:0.4")


def overlaps(logs: Sequence[ScanLog]) -> list[str]:
    """A note for each log that begins before an earlier one has ended.

    >>> from tempog import Scan, ScanLog
    >>> spans = {"a": (0, 100), "b": (10, 20), "c": (50, 60), "d": (200, 300)}
    >>> logs = [ScanLog([Scan(t, (0, 0, 0), [], []) for t in span], source=name) for name, span in spans.items()]
    >>> [note[:13] for note in overlaps(logs)]
    ['a and b overl', 'a and c overl']
    """
    ordered = sorted(logs, key=lambda log: log[0].stamp_ns)
    notes, latest = [], ordered[0]
    for log in ordered[1:]:
        if log[0].stamp_ns <= latest[-1].stamp_ns and log.source != latest.source:
            notes.append(f"{latest.source} and {log.source} overlap in time; their scans are merged by stamp")
        latest = max(latest, log, key=lambda log: log[-1].stamp_ns)
    return notes
