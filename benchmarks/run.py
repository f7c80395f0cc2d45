"""Run the benchmarks: python benchmarks/run.py [--quick] [--only NAME...] [--markdown FILE]."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import breakdown
import cluster
import compression
import flatness
import ingest
import live
import logs
import objects
import queries
import simulate
import sizes
import startup
import storage
import tables
import view
from report import Section, describe_run

import bags

LOGS = ["freiburg-079", "intel"]
N_REPETITIONS = 5
N_REPETITIONS_QUICK = 3
N_SCANS_QUICK = 600  # of each log; targets are meant for whole logs

Benchmark = Callable[[list[str], int | None, int], list[Section]]
BENCHMARKS: dict[str, Benchmark] = {
    "ingest": ingest.run,
    "bags": bags.run,
    "breakdown": breakdown.run,
    "flatness": flatness.run,
    "queries": queries.run,
    "sizes": sizes.run,
    "compression": compression.run,
    "startup": startup.run,
    "simulate": simulate.run,
    "objects": objects.run,
    "cluster": cluster.run,
    "storage": storage.run,
    "live": live.run,
    "view": view.run,
}
# Half an hour of no use to a user of tempog, and parts of `storage`.
ON_REQUEST: dict[str, Benchmark] = {"tables": tables.run} | storage.PARTS


def main() -> None:
    """Print every section as soon as it is measured."""
    options = _parse()
    n_repetitions = N_REPETITIONS_QUICK if options.quick else N_REPETITIONS
    n_scans = N_SCANS_QUICK if options.quick else None
    head = [describe_run(n_repetitions), *_remarks(options.quick)]
    print("\n".join(head), flush=True)
    sections: list[Section] = []
    benchmarks = BENCHMARKS | ON_REQUEST
    for name in options.only or BENCHMARKS:
        for section in benchmarks[name](LOGS, n_scans, n_repetitions):
            print(f"\n{section.to_markdown()}", flush=True)
            sections.append(section)
    closing = _closing(sections)
    print(f"\n{closing}")
    if options.markdown:
        parts = ["\n".join(head), *(section.to_markdown() for section in sections), closing]
        options.markdown.write_text("\n\n".join(parts) + "\n", encoding="utf-8")


def _parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Time tempog against its peers; rows where it loses are kept.")
    names = [*BENCHMARKS, *ON_REQUEST]
    parser.add_argument("--quick", action="store_true", help=f"{N_SCANS_QUICK} scans of each log, fewer repetitions")
    parser.add_argument("--only", nargs="+", choices=names, metavar="NAME", help=", ".join(names))
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="also write everything there")
    return parser.parse_args()


def _remarks(quick: bool) -> list[str]:
    remarks = [
        f"- {logs.MAX_RANGE_M:g} m of range, {logs.RESOLUTION_M:g} m cells; beams without return are left out for all"
    ]
    if quick:
        remarks.append(f"- quick: only the first {N_SCANS_QUICK} scans of each log, so the verdicts are not final")
    absent = [name for name in LOGS if not logs.log_path(name).is_file()]
    if absent:
        remarks.append(f"- absent: {', '.join(absent)}; a simulated corridor takes their place")
    return remarks


def _closing(sections: list[Section]) -> str:
    rows = [(section.title, row) for section in sections for row in section.rows if row.target]
    verdicts = [row.verdict for _, row in rows]
    lines = [
        f"{verdicts.count('met')} targets met, {verdicts.count('LOST')} LOST,"
        f" {verdicts.count('not measured')} not measured."
    ]
    lines += [f"- LOST: {title.partition(',')[0]}: {row.what}" for title, row in rows if row.verdict == "LOST"]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
