"""A process of its own for the benchmarks of storage: python table_child.py (write | open) STORE FOLDER [COMMITS].

`write` commits, and says after each commit how many there are; `open` says what importing and opening took.
"""

from __future__ import annotations

import itertools
import json
import sys
import time
from pathlib import Path

ROWS_PER_COMMIT = 2000
STORES = ("segments", "delta", "delta log")


def write(store_name: str, folder: Path, n_commits: int | None) -> None:
    """Commit until there are `n_commits`, or until killed; each number said is a promise."""
    import numpy as np
    import pyarrow as pa
    from table_stores import DeltaLog, DeltaTables, Segments, Store

    store: Store
    match store_name:
        case "segments":
            store = Segments(folder)
        case "delta":
            store = DeltaTables(folder)
        case _:
            store = DeltaLog(folder)
    rng = np.random.default_rng(0)
    cell = np.sort(rng.integers(0, 200_000, ROWS_PER_COMMIT).astype(np.int32))
    prob = np.full(ROWS_PER_COMMIT, 0.9, np.float32)
    for k in range(n_commits) if n_commits else itertools.count():
        first_scan = np.full(ROWS_PER_COMMIT, k, np.int32)
        span = rng.integers(0, 100, ROWS_PER_COMMIT).astype(np.int32)
        store.commit(pa.table({"cell": cell, "first_scan": first_scan, "span": span, "prob": prob}))
        sys.stdout.write(f"{k + 1}\n")
        sys.stdout.flush()
        store.tidy()


def open_store(store_name: str, folder: Path) -> None:
    """Seconds of the import and of opening, as far as the list of files with what each spans."""
    start = time.perf_counter()
    if store_name == "segments":
        import pyarrow.parquet  # noqa: F401  # what the files are read with
        from table_stores import open_segments

        imported = time.perf_counter()
        n_files = len(open_segments(folder)[0])
    else:
        from deltalake import DeltaTable

        imported = time.perf_counter()
        n_files = DeltaTable(folder).get_add_actions(flatten=True).num_rows
    opened = time.perf_counter()
    print(json.dumps({"import_s": imported - start, "open_s": opened - imported, "n_files": n_files}))


if __name__ == "__main__":
    action, name, root = sys.argv[1:4]
    if action == "write":
        write(name, Path(root), int(sys.argv[4]) if len(sys.argv) > 4 else None)
    else:
        open_store(name, Path(root))
