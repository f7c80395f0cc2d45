"""How right `tempog.map_diff` is in simulated drives: what it says moved, appeared and vanished, against the truth.

python benchmarks/diff.py [--seeds N] [--first SEED] [--resolution M] [--for S] [--surface M]
"""

from __future__ import annotations

import argparse
from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from report import describe_run

from tempog import GridConfig, MapConfig, build_grid, find_objects, map_diff
from tempog.analysis.map_diff import MapDiff
from tempog.analysis.moved_objects import Move
from tempog.analysis.patches import Patch
from tempog.evaluation.experiment import Drive, drive_through
from tempog.evaluation.matching import match
from tempog.methods import FOR_S, SURFACE_M
from tempog.simulation.cell_sets import near
from tempog.simulation.crossing import count_crossings
from tempog.simulation.observability import SEEN_BEAMS, SEEN_SHARE, WIDER, SeenPlace, seen_places
from tempog.simulation.polygons import covered_cells
from tempog.simulation.simulation import MOVING
from tempog.simulation.truth import Truth

DRIVES = [(world, people) for world in ("hallway", "office", "ring") for people in (0, 20)]
PAIRS = ((0.25, 0.5), (0.25, 0.75), (0.5, 0.75), (0.5, 1.0), (0.25, 1.0))  # moments as shares of a drive
NEVER = -1  # for a place that was not seen yet
LOOK_NS = 200_000_000  # two scans of the simulated laser
Counts = Counter[str]


def scan_at(truth: Truth, stamp_ns: int) -> int:
    """The last scan up to a moment."""
    return int(np.searchsorted(truth.stamps_s, stamp_ns / 1e9 + 1e-6, side="right")) - 1


def place_states(truth: Truth, places: list[SeenPlace], resolution_m: float) -> NDArray[np.int8]:
    """(n_scans, n_places): whether each place was last seen occupied (1) or free (0), by the rules of `SeenPlace`.

    In one scan at rest: `SEEN_BEAMS` ended on the thing in it, or as many crossed `SEEN_SHARE` of its seen cells.
    """
    x, y, angle = truth.beams()
    cos, sin = np.cos(angle), np.sin(angle)
    reach = np.where(np.isfinite(truth.distances), truth.distances, 0.0)
    n_scans = len(truth.t)
    states = np.full((n_scans, len(places)), NEVER, dtype=np.int8)
    for k, place in enumerate(places):
        if not place.observable:
            continue
        stands_at = truth.places[:, place.thing]
        hit = ((truth.hit_things == place.thing).sum(axis=1) >= SEEN_BEAMS) & (stands_at == place.place)
        elsewhere = (stands_at != place.place) & (stands_at != MOVING)
        crossed = np.zeros((n_scans, len(place.seen)), dtype=np.bool_)
        n_beams = np.zeros(n_scans, dtype=np.int64)
        low = np.multiply(place.seen[:, ::-1], resolution_m, dtype=np.float64)
        middle = (low.min(axis=0) + low.max(axis=0) + resolution_m) / 2
        radius = float(np.hypot(*(low.max(axis=0) + resolution_m - middle))) * WIDER
        own = np.where(elsewhere, np.arange(n_scans), -1)
        count_crossings(x, y, cos, sin, reach, own, low, resolution_m, middle, radius, crossed, n_beams)
        free = (crossed.sum(axis=1) >= SEEN_SHARE * len(place.seen)) & (n_beams >= SEEN_BEAMS)
        latest = np.maximum.accumulate(np.where(hit | free, np.arange(n_scans), -1))
        states[latest >= 0, k] = hit[latest[latest >= 0]]
    return states


def move_is_right(move: Move, truth: Truth, place_of: dict[int, SeenPlace]) -> int | None:
    """The thing that stood where a move says when it was seen so; None if there is none.

    Of a thing that was seen to have left, or not to have come yet, only that is said: it may stand anywhere else.
    """
    wheres = (move.before, move.after)
    said = [place_of[where.configuration] for where in wheres if where.configuration in place_of]
    if len(said) < sum(where.configuration is not None for where in wheres) or len({one.thing for one in said}) > 1:
        return None
    thing = said[0].thing
    for where in wheres:
        # A stay lasts until just before the first look at which it was over.
        scans = [scan_at(truth, where.last_seen_ns - back) for back in (0, LOOK_NS)]
        stood_at = set(truth.places[scans, thing].tolist()) - {MOVING}
        wanted = stood_at - {one.place for one in said}
        if where.configuration is not None:
            wanted = stood_at & {place_of[where.configuration].place}
        if not wanted:
            return None
    return thing


def patch_is_right(patch: Patch, truth: Truth, resolution_m: float) -> int | None:
    """The thing that stood there when the patch says so, and not at the other time; None if there is none."""
    scans = [scan_at(truth, stamp) for stamp in (patch.last_before_ns - LOOK_NS, patch.first_after_ns)]
    there, away = scans[::-1] if patch.kind == "appeared" else scans
    for thing, one in enumerate(truth.things):
        for place, corners in enumerate(one.places.values()):
            if truth.places[there, thing] == place and truth.places[away, thing] != place:
                covered = covered_cells(corners, resolution_m)
                if 2 * np.count_nonzero(near(patch.cells.astype(np.int64), covered)) > len(patch.cells):
                    return thing
    return None


def count(
    diff: MapDiff, truth: Truth, places: list[SeenPlace], place_of: dict[int, SeenPlace], states: NDArray[np.int8]
) -> Counts:
    """What of one answer is right, and what it lacks."""
    resolution_m = diff.history.tiles.spec.resolution_m
    before, after = (states[scan_at(truth, stamp)] for stamp in (diff.before_ns, diff.after_ns))
    differs = (before != after) & (before != NEVER) & (after != NEVER)
    wanted = {places[k].thing for k in np.flatnonzero(differs)}
    moved = [move_is_right(move, truth, place_of) for move in diff.moved]
    patches = [patch_is_right(patch, truth, resolution_m) for patch in (*diff.appeared, *diff.vanished)]
    brief = [patch_is_right(patch, truth, resolution_m) for patch in diff.brief]
    found = {thing for thing in moved if thing is not None}
    return Counter(
        moves=len(moved),
        right_moves=sum(thing is not None for thing in moved),
        patches=len(patches),
        right_patches=sum(thing is not None for thing in patches),
        brief=len(brief),
        right_brief=sum(thing is not None for thing in brief),
        wanted=len(wanted),
        found=len(wanted & found),
        found_at_all=len(wanted & (found | {thing for thing in patches if thing is not None})),
    )


def judged(drive: Drive, resolution_m: float, settings: dict[str, Any]) -> Counts:
    """All pairs of moments of one drive."""
    grid = build_grid(drive.simulation.scans, MapConfig(grid=GridConfig(resolution_m=resolution_m)))
    found = find_objects(grid)
    places = seen_places(drive.truth, resolution_m)
    matched = match(
        [one.cells.astype(np.int64) for one in found.configurations],
        [place.seen for place in places],
        [place.observable for place in places],
    )
    place_of = {found.configurations[number].id: places[place] for number, (place, _) in matched.items()}
    states, counts = place_states(drive.truth, places, resolution_m), Counter[str]()
    for pair in PAIRS:
        t1, t2 = (np.datetime64(int(grid.stamps_ns[round(share * (grid.n_scans - 1))]), "ns") for share in pair)
        diff = map_diff(grid, t1, t2, found=found, **settings)
        counts.update(count(diff, drive.truth, places, place_of, states))
    return counts


def share(part: int, whole: int) -> str:
    """A share with its counts."""
    return f"{part / whole:.3f} ({part} of {whole})" if whole else "-"


def row(name: str, counts: Counts) -> str:
    """One line of the table."""
    cells = (
        share(counts["right_moves"], counts["moves"]),
        share(counts["found"], counts["wanted"]),
        share(counts["found_at_all"], counts["wanted"]),
        share(counts["right_patches"], counts["patches"]),
        share(counts["right_brief"], counts["brief"]),
    )
    return f"| {name} | " + " | ".join(cells) + " |"


def main() -> None:
    """Print the table, a row as soon as it is known."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--resolution", type=float, default=GridConfig.resolution_m, metavar="M")
    parser.add_argument("--for", type=float, default=FOR_S, dest="for_s", metavar="S")
    parser.add_argument("--surface", type=float, default=SURFACE_M, dest="surface_m", metavar="M")
    options = parser.parse_args()
    settings = {"for_s": options.for_s, "surface_m": options.surface_m}
    seeds = range(options.first, options.first + options.seeds)
    print(describe_run(1))
    print(
        f"seeds {seeds[0]} to {seeds[-1]}, cells of {options.resolution} m, {settings}, {len(PAIRS)} diffs a drive\n"
    )
    print("| drives | moves: right | moves: found | found, patches too | patches: right | brief: right |")
    print("| --- | --- | --- | --- | --- | --- |")
    total = Counter[str]()
    for world, people in DRIVES:
        counts = Counter[str]()
        for seed in seeds:
            counts.update(judged(drive_through(world, people, seed), options.resolution, settings))
        print(row(f"{world}, {people} people", counts), flush=True)
        total.update(counts)
    print(row("all", total))


if __name__ == "__main__":
    main()
