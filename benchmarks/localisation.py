"""How well a robot localises on the exported maps: on that for planning, on that for localisation, and on others.

``python benchmarks/localisation.py [n_seeds]``. A simulated robot maps a world; then it drives through it again, on
another day: doors and furniture stand elsewhere, other people walk. A particle filter localises it on each map by
laser and noisy odometry, with amcl's motion model, and weighs beams in two ways: as amcl's likelihood field does, or
more sharply. The error is that of the mean particle after every update of the second drive.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from tempog import build_grid, find_objects, site_map
from tempog.export.map_server import OCCUPIED, UNKNOWN
from tempog.export.site_map import SiteMap
from tempog.simulation import Simulation, World, load_world, random_building, simulate

WORLDS = (("hallway", 0), ("hallway", 20), ("office", 8), ("rooms", 3), ("random", 5))  # and how many people
MAPPED_S, DRIVEN_S = 900.0, 400.0
N_PARTICLES, N_BEAMS = 500, 60  # as amcl has them by default
STEP_M, STEP_RAD = 0.25, 0.2  # of movement before an update, as amcl's
FARTHEST_M = 2.0  # of the likelihood field
FILTERS = {"amcl": 0.2, "sharp": 0.1}  # and the standard deviation of a hit, metres: amcl's default, and half of it
SHARP_POWER = 0.3  # of the product over all beams, which depend on each other
SHARE_HIT, SHARE_RANDOM = 0.5, 0.5
ODOMETRY = 0.2  # each of amcl's four alphas: of turning and of driving, by turning and by driving
START_OFF_M, START_OFF_RAD = 0.2, 0.1


@dataclass(frozen=True)
class Field:
    """The distance from each cell to the nearest occupied one, metres."""

    distance_m: NDArray[np.float32]
    x0: float
    y0: float
    resolution_m: float

    @classmethod
    def of(cls, site: SiteMap, cells: NDArray[np.int8]) -> Field:
        away = distance_transform_edt(cells != OCCUPIED) * site.extent.resolution_m
        x0, _, y0, _ = site.extent.bounds
        return cls(np.minimum(away, FARTHEST_M).astype(np.float32), x0, y0, site.extent.resolution_m)

    def at(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float32]:
        row = ((y - self.y0) / self.resolution_m).astype(np.int64)
        col = ((x - self.x0) / self.resolution_m).astype(np.int64)
        n_rows, n_cols = self.distance_m.shape
        inside = (row >= 0) & (row < n_rows) & (col >= 0) & (col < n_cols)
        found = np.full(row.shape, FARTHEST_M, dtype=np.float32)
        found[inside] = self.distance_m[row[inside], col[inside]]
        return found


def weights_of(off_m: NDArray[np.float32], max_range_m: float, kind: str) -> NDArray[np.float64]:
    """Weights of particles, from the distance of each one's beam ends (n_particles, n_beams) to the map."""
    hit = np.exp(-(off_m.astype(np.float64) ** 2) / (2 * FILTERS[kind] ** 2))
    p = SHARE_HIT * hit + SHARE_RANDOM / max_range_m
    if kind == "amcl":
        weights = 1 + (p**3).sum(axis=1)
    else:
        logs = SHARP_POWER * np.log(p).sum(axis=1)
        weights = np.exp(logs - logs.max())
    return np.asarray(weights / weights.sum())


def localise(drive: Simulation, field: Field, kind: str, seed: int) -> NDArray[np.float64]:
    """Errors (n_updates, 2): metres from the true position, radians from the true heading."""
    rng = np.random.default_rng(seed)
    true = drive.poses
    particles = true[0] + rng.normal(size=(N_PARTICLES, 3)) * (START_OFF_M, START_OFF_M, START_OFF_RAD)
    last, errors = 0, []
    for k in range(1, len(true)):
        step = true[k] - true[last]
        turned = (step[2] + np.pi) % (2 * np.pi) - np.pi
        if np.hypot(*step[:2]) < STEP_M and abs(turned) < STEP_RAD:
            continue
        particles = moved(particles, odometry(true[last], step, turned, rng), rng)
        last = k
        scan = drive.scans[k]
        returns = np.flatnonzero(np.isfinite(scan.ranges) & (scan.ranges < scan.max_range))
        if len(returns):
            chosen = returns[np.linspace(0, len(returns) - 1, min(N_BEAMS, len(returns))).astype(int)]
            angle = particles[:, 2, None] + scan.angles[chosen]
            x = particles[:, 0, None] + scan.ranges[chosen] * np.cos(angle)
            y = particles[:, 1, None] + scan.ranges[chosen] * np.sin(angle)
            weights = weights_of(field.at(x, y), scan.max_range, kind)
        else:
            weights = np.full(N_PARTICLES, 1 / N_PARTICLES)
        mean = weights @ particles[:, :2]
        heading = np.arctan2(weights @ np.sin(particles[:, 2]), weights @ np.cos(particles[:, 2]))
        off_rad = abs((heading - true[k, 2] + np.pi) % (2 * np.pi) - np.pi)
        errors.append((np.hypot(*(mean - true[k, :2])), off_rad))
        positions = (rng.random() + np.arange(N_PARTICLES)) / N_PARTICLES
        particles = particles[np.minimum(np.searchsorted(np.cumsum(weights), positions), N_PARTICLES - 1)]
    return np.array(errors)


def odometry(
    at: NDArray[np.float64], step: NDArray[np.float64], turned: float, rng: np.random.Generator
) -> tuple[float, float, float]:
    """A movement as odometry measures it: turn, drive, turn."""
    way = float(np.hypot(*step[:2]))
    first = (np.arctan2(step[1], step[0]) - at[2] + np.pi) % (2 * np.pi) - np.pi if way > 0.01 else 0.0
    second = (turned - first + np.pi) % (2 * np.pi) - np.pi
    spread = ODOMETRY / 2  # the filter expects worse than it gets, as a careful user sets it
    return (
        first + rng.normal() * spread * (abs(first) + way),
        way + rng.normal() * spread * (way + abs(first) + abs(second)),
        second + rng.normal() * spread * (abs(second) + way),
    )


def moved(
    particles: NDArray[np.float64], by: tuple[float, float, float], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Particles after a movement, each with its own noise."""
    first, way, second = by
    n = len(particles)
    a = first + rng.normal(size=n) * ODOMETRY * (abs(first) + way)
    d = way + rng.normal(size=n) * ODOMETRY * (way + abs(first) + abs(second))
    b = second + rng.normal(size=n) * ODOMETRY * (abs(second) + way)
    heading = particles[:, 2] + a
    return np.column_stack(
        [particles[:, 0] + d * np.cos(heading), particles[:, 1] + d * np.sin(heading), heading + b]
    )


def maps(site: SiteMap) -> Mapping[str, NDArray[np.int8]]:
    """The exported maps, and what an ordinary mapper would have kept: the state when the drive ended."""
    value = site.history.at(np.datetime64(site.at_ns, "ns"), np.inf).value
    as_left = np.full(site.extent.shape, np.nan, dtype=np.float32)
    as_left[site.history.extent.part_of(site.extent)] = value[site.extent.part_of(site.history.extent)]
    last = np.where(np.isnan(as_left), UNKNOWN, np.where(as_left > 0.5, OCCUPIED, 0)).astype(np.int8)
    return {"planning": site.planning, "localisation": site.localisation, "current": site.current, "as left": last}


def world_of(name: str, seed: int) -> World:
    return random_building(seed) if name == "random" else load_world(name)


def main(n_seeds: int) -> None:
    names = f"{'world':<8} {'people':>6} {'seed':>4}  {'filter':<6} {'map':<13}"
    print(f"{names} {'median m':>8} {'rms m':>7} {'p95 m':>7} {'rms deg':>7}")
    over: dict[tuple[str, str], list[list[float]]] = {}
    for name, people in WORLDS:
        for seed in range(1, n_seeds + 1):
            world = world_of(name, seed)
            mapped = simulate(world, duration_s=MAPPED_S, seed=seed, people=people)
            site = site_map(find_objects(build_grid(mapped.scans)))
            drive = simulate(world, duration_s=DRIVEN_S, seed=1000 + seed, people=people)
            for kind in FILTERS:
                found = {}
                for label, cells in maps(site).items():
                    off_m, off_rad = localise(drive, Field.of(site, cells), kind, seed).T
                    found[label] = [float(np.median(off_m)), float(np.sqrt((off_m**2).mean()))]
                    print(
                        f"{name:<8} {people:>6} {seed:>4}  {kind:<6} {label:<13} {found[label][0]:>8.3f}"
                        f" {found[label][1]:>7.3f} {np.quantile(off_m, 0.95):>7.3f}"
                        f" {np.degrees(np.sqrt((off_rad**2).mean())):>7.2f}",
                        flush=True,
                    )
                for label, values in found.items():
                    ratios = [one / other for one, other in zip(values, found["localisation"], strict=True)]
                    over.setdefault((kind, label), []).append(ratios)
    print("\nover that on the localisation map: geometric mean, best and worst of median, and of rms")
    for (kind, label), pairs in over.items():
        texts = [f"{np.exp(np.log(r).mean()):.2f} ({r.min():.2f} to {r.max():.2f})" for r in np.array(pairs).T]
        print(f"{kind:<6} {label:<13} {'   '.join(texts)}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 3)
