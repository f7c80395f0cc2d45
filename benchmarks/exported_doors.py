"""How right exported maps and doors are: against the truth of simulated drives.

``python benchmarks/exported_doors.py [n_seeds [drift_m]]``. Poses drift by so many metres, and a sixth of that in
radians. A door counts as found if every place of one object lies on a place of its leaf. Of those: how far hinges and
leaf ends are off, and whether what blocks a way is the closed place. Of the planning map: how much of it lies at true
walls, and how much of the walls that were seen is in it, within a cell.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog import build_grid, find_objects, site_map
from tempog.export.map_server import OCCUPIED
from tempog.export.site_map import SiteMap, Thing
from tempog.simulation import PoseError, load_world, random_building, simulate
from tempog.simulation import Thing as TrueThing
from tempog.simulation.cell_sets import near, unique_cells
from tempog.simulation.polygons import covered_cells
from tempog.simulation.truth import Truth

WORLDS = (("hallway", 5), ("hallway", 20), ("office", 8), ("rooms", 3), ("ring", 10), ("random", 5), ("random", 20))
DRIVEN_S = 900.0
AT_PLACE = 0.6  # share of a place's cells that lie on a true one


class Found(NamedTuple):
    """A true door, what was found of it, and which of its places each of the thing's is."""

    door: TrueThing
    thing: Thing
    places: tuple[str, ...]


def found_doors(site: SiteMap, doors: list[TrueThing]) -> list[Found]:
    """The doors that some object with several places is."""
    found = []
    for door in doors:
        covered = {name: covered_cells(door.corners(name), site.extent.resolution_m) for name in door.places}
        for thing in site.things:
            names = []
            for place in thing.one.configurations:
                shares = {name: float(near(place.cells.astype(np.int64), at).mean()) for name, at in covered.items()}
                best = max(shares, key=lambda name: shares[name])
                if shares[best] >= AT_PLACE:
                    names.append(best)
            if len(names) == len(thing.one.configurations) > 1:
                found.append(Found(door, thing, tuple(names)))
    return found


def cells_of(site: SiteMap, mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    rows, cols = np.nonzero(mask)
    return np.stack([rows + site.extent.row0, cols + site.extent.col0], axis=-1)


def quantiles(values: list[float]) -> str:
    return "  ".join(f"{q:.0%} {np.quantile(values, q):.3f}" for q in (0.5, 0.9, 1.0))


def main(n_seeds: int, drift_m: float) -> None:
    drift = PoseError(drift_m=drift_m, drift_rad=drift_m / 6)
    hinge_m, tip_m, length_m = [], [], []
    n_found = n_hinged = n_wrong = n_places = n_blocks_right = 0
    print(f"{'world':<8} {'people':>6} {'seed':>4}  {'at walls':>8} {'walls in it':>11}  {'at things':>9}  doors")
    for name, people in WORLDS:
        for seed in range(1, n_seeds + 1):
            world = random_building(seed) if name == "random" else load_world(name)
            world = replace(world, pose_error=drift)
            drive = simulate(world, duration_s=DRIVEN_S, seed=seed, people=people)
            truth = Truth.of(drive)
            site = site_map(find_objects(build_grid(drive.scans)))
            size = site.extent.resolution_m
            walls = unique_cells(truth.static_cells(size), truth.static_cells(size, glass=True))
            planning = cells_of(site, site.planning == OCCUPIED)
            seen = near(truth.static_seen(size), planning)
            right = near(planning, walls)
            things = [covered_cells(one.corners(place), size) for one in world.things for place in one.places]
            at_things = near(planning[~right], unique_cells(*things)) if len(things) else np.zeros(0)
            doors = [one for one in world.things if one.kind == "hinged"]
            found = found_doors(site, doors)
            claimed = {thing.one.id for thing in site.things if thing.hinge is not None}
            n_found += len(found)
            n_wrong += len(claimed - {one.thing.one.id for one in found})
            for door, thing, places in found:
                shut = next(iter(door.places))
                n_places += len(places)
                n_blocks_right += sum(
                    (place == shut) == blocks for place, blocks in zip(places, thing.blocks, strict=True)
                )
                if thing.hinge is None:
                    continue
                n_hinged += 1
                x, y, _ = door.places[shut]
                hinge_m.append(float(np.hypot(thing.hinge.x - x, thing.hinge.y - y)))
                length_m.append(abs(thing.hinge.length_m - door.length_m))
                for place, tip in zip(places, thing.hinge.tips, strict=True):
                    x, y, theta = door.places[place]
                    end = x + door.length_m * np.cos(theta), y + door.length_m * np.sin(theta)
                    tip_m.append(float(np.hypot(tip[0] - end[0], tip[1] - end[1])))
            print(
                f"{name:<8} {people:>6} {seed:>4}  {right.mean():>8.4f} {seen.mean():>11.4f}"
                f"  {int(at_things.sum()):>9}  {len(found)} of {len(doors)}",
                flush=True,
            )
    print(f"\n{n_hinged} of {n_found} found doors have a hinge; {n_wrong} hinges where no door was found")
    print(f"metres: hinge off {quantiles(hinge_m)}   leaf's end {quantiles(tip_m)}   length {quantiles(length_m)}")
    print(f"{n_blocks_right} of {n_places} places: rightly said whether they block the way")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 3, float(sys.argv[2]) if len(sys.argv) > 2 else 0.0)
