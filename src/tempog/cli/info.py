"""``tempog info``: what a map holds."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import typer

from tempog.cli._maps import MapArgument, opened
from tempog.cli._output import JsonFlag, bytes_text, count_text, counted, duration_text, print_json, wrapped

if TYPE_CHECKING:
    from tempog.store.manifest import Session
    from tempog.store.saved_map import SavedMap

INDENT = 11  # columns before what a row says


def info(map_path: MapArgument, json: JsonFlag = False) -> None:
    """Say what a map holds and how it was made."""
    from tempog.analysis.pose_consistency import pose_consistency
    from tempog.store.manifest import read_document

    saved = opened(map_path)
    saved.require_scans()
    manifest = saved.manifest
    x_min, x_max, y_min, y_max = saved.extent.bounds
    poses = pose_consistency(saved)
    answer: dict[str, Any] = {
        "map": str(map_path),
        "format_version": read_document(map_path)["format_version"],
        "n_scans": saved.n_scans,
        "n_cells": saved.n_cells,
        "n_intervals": saved.n_intervals,
        "duration_s": saved.duration_s,
        "scan_period_s": saved.scan_period_s if saved.n_scans > 1 else None,
        "start_s": int(saved.stamps_ns[0]) / 1e9,
        "stop_s": int(saved.stamps_ns[-1]) / 1e9,
        "extent_m": {"x_min": x_min, "x_max": x_max, "y_min": y_min, "y_max": y_max},
        "bytes_on_disk": saved.bytes_on_disk,
        "poses": poses.to_dict(),
        "config": manifest.config,
        "n_segments": len(saved.segments),
        "bytes_per_interval": saved.bytes_on_disk / max(saved.n_intervals, 1),
        "sessions": [dataclasses.asdict(session) for session in saved.sessions],
        "pruned": manifest.pruned,
        "repaired": saved.repaired,
    }
    if json:
        print_json(answer)
        return
    settings = {**manifest.config["grid"], **manifest.config["sensing"]}
    rows = {
        "map": f"{map_path}, {bytes_text(saved.bytes_on_disk)}",
        "time": f"{saved.format_moment(int(saved.stamps_ns[0]))} to {saved.format_moment(int(saved.stamps_ns[-1]))}",
        "scans": f"{count_text(saved.n_scans)} in {duration_text(saved.duration_s)}",
        "area": f"x {x_min:.1f} to {x_max:.1f} m, y {y_min:.1f} to {y_max:.1f} m",
        "cells": f"{count_text(saved.n_cells)} seen",
        "intervals": count_text(saved.n_intervals),
        "poses": (poses.warning or str(poses)).removeprefix("poses "),
        "settings": ", ".join(setting_text(name, value) for name, value in settings.items()),
    }
    for name, text in rows.items():
        # A path stays whole, so that it can be copied.
        typer.echo(f"{name:10} {text if name == 'map' else wrapped(text, INDENT)}")
    for session in saved.sessions:
        for line in session_lines(saved, session):
            typer.echo(line)
    n_older = saved.n_scans - sum(session.n_scans for session in saved.sessions)
    if n_older:
        typer.echo(
            f"{'older':10} {counted(n_older, 'scan', 'scans')} of sessions that were pruned: the last looks at cells"
        )
    for deleted in manifest.pruned:
        when = deleted["when"].replace("T", " ").replace("Z", " UTC")
        typer.echo(
            f"{'pruned':10} {when}: {counted(deleted['n_intervals'], 'interval', 'intervals')} from before"
            f" {saved.format_moment(deleted['before_ns'])}"
        )


def session_lines(saved: SavedMap, session: Session) -> Iterator[str]:
    """What is known of a session."""
    of_robot = f", robot {session.robot}" if session.robot else ""
    since, until = (saved.format_moment(stamp_ns) for stamp_ns in (session.start_ns, session.stop_ns))
    yield f"{'session':10} {session.id}{of_robot}: {counted(session.n_scans, 'scan', 'scans')}, {since} to {until}"
    for source in session.sources:
        yield f"{'source':10} {source['path']}: {source['format']}, {counted(source['n_scans'], 'scan', 'scans')}"
        for note in source["notes"]:
            yield f"{'':10} {wrapped(f'note: {note}', INDENT)}"


def setting_text(name: str, value: Any) -> str:
    """A setting without the digits that only binary fractions have."""
    return f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}"
