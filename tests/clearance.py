"""How far bodies are from each other, and that nobody is ever inside anything."""

from itertools import combinations

import numpy as np


def gaps(points, corners):
    """Distances of points (n, 2) to polygons (n, k, 2) or (k, 2); 0 inside."""
    corners = np.broadcast_to(corners, (len(points), *np.shape(corners)[-2:]))
    p, q = corners, np.roll(corners, -1, axis=1)
    side, way = q - p, points[:, None] - p
    u = np.clip((way * side).sum(-1) / (side**2).sum(-1), 0, 1)
    gap = np.linalg.norm(p + u[..., None] * side - points[:, None], axis=-1).min(axis=1)
    left = side[..., 0] * way[..., 1] - side[..., 1] * way[..., 0]
    return np.where((left > 0).all(axis=1) | (left < 0).all(axis=1), 0.0, gap)


def assert_nobody_overlaps(simulation):
    world = simulation.world
    robot, people = simulation.poses[:, :2], simulation.people
    radius = world.people.radius_m
    everybody = [(robot, world.robot.radius_m), *((people[:, i], radius) for i in range(people.shape[1]))]
    for points, reach in everybody:
        for _, corners in world.solids:
            assert gaps(points, corners).min() >= reach
        for k in range(len(world.things)):
            there = np.isfinite(simulation.corners[:, k, 0, 0])
            assert gaps(points[there], simulation.corners[there, k]).min() >= reach
    for (one, reach), (two, other_reach) in combinations(everybody, 2):
        assert np.linalg.norm(one - two, axis=1).min() >= reach + other_reach
