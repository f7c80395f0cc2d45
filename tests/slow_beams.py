"""How far a beam reaches, by solving the equations: slow and obvious."""

import math

import numpy as np


def slow_distances(x, y, angle, segments, discs):
    """Distance to each segment, then to each disc, by solving the equations; inf for a miss."""
    c, s = math.cos(angle), math.sin(angle)
    distances = []
    for x0, y0, x1, y1 in segments:
        # (x, y) + d (c, s) = (x0, y0) + u (x1 - x0, y1 - y0)
        coefficients = np.array([[c, x0 - x1], [s, y0 - y1]])
        if np.linalg.det(coefficients) == 0:
            distances.append(math.inf)
            continue
        d, u = np.linalg.solve(coefficients, [x0 - x, y0 - y])
        distances.append(d if d > 0 and 0 <= u <= 1 else math.inf)
    for mx, my, radius in discs:
        # |(x, y) + d (c, s) - (mx, my)| = radius
        half_b = c * (x - mx) + s * (y - my)
        rest = (x - mx) ** 2 + (y - my) ** 2 - radius**2
        root = math.sqrt(max(half_b**2 - rest, 0.0))
        ahead = [d for d in (-half_b - root, -half_b + root) if half_b**2 > rest and d > 0]
        distances.append(min(ahead, default=math.inf))
    return np.array(distances)
