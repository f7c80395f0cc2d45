"""Drive through a world: the scans a robot would take, and the truth behind every beam."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from tempog.errors import ConfigError
from tempog.scans.scan import Scan
from tempog.simulation.polygons import covered_cells, outline
from tempog.simulation.world import DoorState, Laser, RestState, World

START_S = 1_750_000_000  # s, Unix: every simulation starts on 15 June 2025, 15:06:40 UTC
SHORTEST_RANGE_M = 0.001  # m; noise on a beam that starts at a wall would else make it zero or negative


class Hit(IntEnum):
    """What a beam has hit."""

    NOTHING = 0
    WALL = 1
    DOOR = 2
    PERSON = 3
    BOX = 4


@dataclass(frozen=True, eq=False)
class Simulation:
    """Scans of a simulated drive, and the truth about them.

    Attributes
    ----------
    world : World
    duration_s : float, seconds
    scans : list of Scan
        With noise and drop-outs. Their poses are the true ones.
    t : (n_scans,) float64, seconds
        Since the start of the simulation; the scans' own clock starts at `START_S`.
    poses : (n_scans, 3) float64
        True pose of the laser in the map frame: x, y, theta; metres, metres, radians.
    distances : (n_scans, n_beams) float64, metres
        Without noise and drop-outs; +inf where there is nothing within the laser's range.
    hits : (n_scans, n_beams) uint8
        What each beam has hit (`Hit`), also where the return was lost.
    door_angles : (n_scans, n_doors) float64, radians
    people : (n_scans, n_people, 2) float64, metres
        Where each person was, x and y.
    """

    world: World
    duration_s: float
    scans: list[Scan]
    t: NDArray[np.float64]
    poses: NDArray[np.float64]
    distances: NDArray[np.float64]
    hits: NDArray[np.uint8]
    door_angles: NDArray[np.float64]
    people: NDArray[np.float64]

    def door_states(self, door: int = 0) -> list[tuple[float, DoorState]]:
        """A door's states as (t, state from then on); t in seconds of the scans' clock."""
        return [(START_S + t, state) for t, state in self.world.doors[door].states(self.duration_s)]

    def door_leaf_segments(self, state: RestState, door: int = 0) -> NDArray[np.float64]:
        """The four faces of a door's leaf when "open" or "closed"; (4, 4) metres: x0, y0, x1, y1."""
        leaf = self.world.doors[door]
        return outline(leaf.leaf_corners(leaf.rest_angle(state)))

    def door_leaf_cells(self, state: RestState, resolution_m: float, door: int = 0) -> NDArray[np.int64]:
        """The cells that a door's leaf covers when "open" or "closed".

        Returns
        -------
        (n_cells, 2) int64
            [row, col] = floor(y / resolution_m), floor(x / resolution_m); sorted, may be negative.
        """
        leaf = self.world.doors[door]
        return covered_cells(leaf.leaf_corners(leaf.rest_angle(state)), resolution_m)

    def truth_static_cells(self, resolution_m: float) -> NDArray[np.int64]:
        """The cells that walls cover, inside included: no laser sees more than their faces.

        Returns
        -------
        (n_cells, 2) int64
            [row, col] = floor(y / resolution_m), floor(x / resolution_m); sorted, each once, may be
            negative.
        """
        cells = [covered_cells(wall.corners, resolution_m) for wall in self.world.walls]
        return np.unique(np.concatenate([np.empty((0, 2), dtype=np.int64), *cells]), axis=0)


def simulate(world: World, duration_s: float | None = None, seed: int = 0) -> Simulation:
    """Take the scans that the robot of a world would take.

    Parameters
    ----------
    world : World
    duration_s : float, seconds, optional
        Default: `world.duration_s`. The first scan is taken at 0 s, the last before `duration_s`.
    seed : int
        Of the noise and the drop-outs. The same seed gives the same scans.

    Returns
    -------
    Simulation

    Raises
    ------
    ConfigError
        `duration_s` is not above 0.

    Examples
    --------
    >>> from tempog.simulation import corridor
    >>> simulation = simulate(corridor(), duration_s=20.0)
    >>> simulation.scans[0]
    Scan(t=1750000000, pose=(1.525, 0.725, 0.0), 181 beams, 165 returns)
    >>> [(t - START_S, state) for t, state in simulation.door_states()]
    [(0.0, 'closed'), (14.0, 'moving'), (15.0, 'open')]
    """
    from tempog.simulation.raycast import cast_beams  # here, so that describing a world needs no Numba

    duration_s = world.duration_s if duration_s is None else duration_s
    if not 0 < duration_s < np.inf:
        raise ConfigError(f"duration_s = {duration_s!r} leaves nothing to simulate; wanted seconds above 0")
    laser = world.laser
    n_scans = int(np.ceil(round(duration_s * laser.rate_hz, 6)))  # 0.07 * 100 is 7.000000000000001
    t = np.arange(n_scans) / laser.rate_hz
    poses = world.robot.poses(t)
    door_angles = np.empty((n_scans, len(world.doors)))
    for i, door in enumerate(world.doors):
        door_angles[:, i] = door.angles(t)
    people = np.empty((n_scans, len(world.people), 2))
    for i, person in enumerate(world.people):
        people[:, i] = person.positions(t)

    # Walls stay; leaves and people are written anew for each scan. `kinds[-1]` is for the id NOTHING.
    walls = [outline(wall.corners) for wall in world.walls]
    n_wall_segments = sum(len(faces) for faces in walls)
    segments = np.concatenate([*walls, np.zeros((4 * len(world.doors), 4))])
    discs = np.array([(0.0, 0.0, person.radius_m) for person in world.people]).reshape(-1, 3)
    kinds = np.full(len(segments) + len(discs) + 1, Hit.NOTHING, dtype=np.uint8)
    kinds[:n_wall_segments] = Hit.WALL
    kinds[n_wall_segments : len(segments)] = Hit.DOOR
    kinds[len(segments) : -1] = Hit.PERSON

    distances = np.empty((n_scans, laser.n_beams))
    ids = np.empty((n_scans, laser.n_beams), dtype=np.int32)
    for k, (x, y, theta) in enumerate(poses):
        for i, door in enumerate(world.doors):
            first = n_wall_segments + 4 * i
            segments[first : first + 4] = outline(door.leaf_corners(door_angles[k, i]))
        discs[:, :2] = people[k]
        angles_map = theta + laser.angles
        cast_beams(x, y, angles_map, segments, discs, float(laser.max_range_m), distances[k], ids[k])

    scans = take_scans(laser, t, poses, distances, np.random.default_rng(seed))
    return Simulation(
        world=world,
        duration_s=float(duration_s),
        scans=scans,
        t=t,
        poses=poses,
        distances=distances,
        hits=kinds[ids],
        door_angles=door_angles,
        people=people,
    )


def take_scans(
    laser: Laser,
    t: NDArray[np.float64],
    poses: NDArray[np.float64],
    distances: NDArray[np.float64],
    rng: np.random.Generator,
) -> list[Scan]:
    """True distances (n_scans, n_beams) as the laser tells them: with noise and drop-outs, at `poses`."""
    ranges = distances + rng.normal(0.0, laser.sigma_m, distances.shape)
    ranges = np.maximum(np.round(ranges, 3), SHORTEST_RANGE_M)  # a sensor tells whole millimetres
    lost = rng.random(distances.shape) < laser.dropout
    ranges[lost | (ranges >= laser.max_range_m)] = np.inf
    return [
        Scan(
            t=0.0,  # stamp_ns below is exact
            pose=(x, y, theta),
            angles=laser.angles,
            ranges=ranges[k],
            max_range=laser.max_range_m,
            stamp_ns=START_S * 1_000_000_000 + round(t[k] * 1e9),
        )
        for k, (x, y, theta) in enumerate(poses)
    ]
