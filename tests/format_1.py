"""Writes maps of format 1, as tempog did before maps had segments."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tempog.store.tables import MOMENTS


def save_format_1(grid, root: Path, sources: list | None = None, rows_per_group: int = 2**18) -> Path:
    """One data folder with four tables; the table of intervals holds those that may go on, too."""
    data = root / "data-0123abcd"
    data.mkdir(parents=True)
    poses, runs, tiles, surfaces = grid.poses, grid.all_runs(), grid.tiles, grid.surfaces
    used = slice(0, surfaces.n_slots)
    tables = {
        "scans": {"stamp_ns": grid.stamps_ns, "x": poses[:, 0], "y": poses[:, 1], "theta": poses[:, 2]},
        "tiles": {"row": tiles.tile_rows[: tiles.n_tiles], "col": tiles.tile_cols[: tiles.n_tiles]},
        "intervals": {
            "cell": runs.cell,
            "first_scan": runs.first,
            "span": runs.last - runs.first,
            "prob": runs.value,
        },
        "surfaces": {
            "cell": surfaces.cell_of_slot[used],
            "hits": surfaces.hit_count[used],
            **{name: surfaces.moments[used, k] for k, name in enumerate(MOMENTS)},
        },
    }
    for name, columns in tables.items():
        table = pa.table({column: np.ascontiguousarray(values) for column, values in columns.items()})
        statistics = ["cell"] if "cell" in columns else False
        pq.write_table(
            table,
            data / f"{name}.parquet",
            row_group_size=rows_per_group,
            write_statistics=statistics,
            compression="zstd",
            write_page_checksum=True,
        )
    manifest = {
        "format": "tempog-map",
        "format_version": 1,
        "tempog_version": "0.1.0",
        "data": data.name,
        "config": grid.config.to_dict(),
        "n_scans": grid.n_scans,
        "n_intervals": grid.n_intervals,
        "n_cells": grid.n_cells if grid.n_scans else 0,
        "start_ns": int(grid.stamps_ns[0]) if grid.n_scans else None,
        "stop_ns": int(grid.stamps_ns[-1]) if grid.n_scans else None,
        "sources": sources or [],
    }
    (root / "map.json").write_text(json.dumps(manifest, indent=2) + "\n")
    return root
