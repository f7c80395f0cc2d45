"""``tempog info``: what a map holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from tempog.cli._output import JsonFlag, bytes_text, count_text, duration_text, print_json, wrapped

INDENT = 11  # columns before what a row says
MapArgument = Annotated[Path, typer.Argument(metavar="MAP", help="A map made by tempog map.")]


def info(map_path: MapArgument, json: JsonFlag = False) -> None:
    """Say what a map holds and how it was made."""
    from tempog.analysis.pose_consistency import pose_consistency
    from tempog.store.map_directory import open_map

    saved = open_map(map_path)
    saved.require_scans()
    manifest = saved.manifest
    x_min, x_max, y_min, y_max = saved.extent.bounds
    poses = pose_consistency(saved)
    answer: dict[str, Any] = {
        "map": str(map_path),
        "format_version": manifest["format_version"],
        "n_scans": saved.n_scans,
        "n_cells": manifest["n_cells"],
        "n_intervals": manifest["n_intervals"],
        "duration_s": saved.duration_s,
        "scan_period_s": saved.scan_period_s if saved.n_scans > 1 else None,
        "start_s": int(saved.stamps_ns[0]) / 1e9,
        "stop_s": int(saved.stamps_ns[-1]) / 1e9,
        "extent_m": {"x_min": x_min, "x_max": x_max, "y_min": y_min, "y_max": y_max},
        "bytes_on_disk": saved.bytes_on_disk,
        "poses": poses.to_dict(),
        "config": manifest["config"],
        "sources": manifest["sources"],
    }
    if json:
        print_json(answer)
        return
    settings = {**manifest["config"]["grid"], **manifest["config"]["sensing"]}
    rows = {
        "map": f"{map_path}, {bytes_text(saved.bytes_on_disk)}",
        "time": f"{saved.format_moment(int(saved.stamps_ns[0]))} to {saved.format_moment(int(saved.stamps_ns[-1]))}",
        "scans": f"{count_text(saved.n_scans)} in {duration_text(saved.duration_s)}",
        "area": f"x {x_min:.1f} to {x_max:.1f} m, y {y_min:.1f} to {y_max:.1f} m",
        "cells": f"{count_text(manifest['n_cells'])} seen",
        "intervals": count_text(manifest["n_intervals"]),
        "poses": (poses.warning or str(poses)).removeprefix("poses "),
        "settings": ", ".join(setting_text(name, value) for name, value in settings.items()),
    }
    for name, text in rows.items():
        # A path stays whole, so that it can be copied.
        typer.echo(f"{name:10} {text if name == 'map' else wrapped(text, INDENT)}")
    for source in manifest["sources"]:
        typer.echo(f"{'source':10} {source['path']}: {source['format']}, {count_text(source['n_scans'])} scans")
        for note in source["notes"]:
            typer.echo(f"{'':10} note: {note}")


def setting_text(name: str, value: Any) -> str:
    """A setting without the digits that only binary fractions have."""
    return f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}"
