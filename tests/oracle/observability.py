"""What of a truth could be seen, beam by beam and cell by cell. Slow, obvious, never optimised."""

from __future__ import annotations

import math

from tempog.simulation.polygons import covered_cells

MOVING = -1
HAIR_M = 1e-6


def beam(truth, i, j):
    """Start and end of a true beam, and its direction."""
    share = j / (len(truth.angles) - 1)
    x, y, theta = (
        float(begin + share * (end - begin)) for begin, end in zip(truth.poses[i], truth.sweep_ends[i], strict=True)
    )
    angle = theta + float(truth.angles[j])
    return x, y, math.cos(angle), math.sin(angle), float(truth.distances[i, j])


def end_cell(truth, i, j, resolution):
    x, y, cos, sin, length = beam(truth, i, j)
    return (
        math.floor((y + (length + HAIR_M) * sin) / resolution),
        math.floor((x + (length + HAIR_M) * cos) / resolution),
    )


def crosses(truth, i, j, cell, resolution):
    """Clip the beam at the four sides of the cell: is anything left, and does the beam end on something behind it?"""
    x, y, cos, sin, length = beam(truth, i, j)
    if length == math.inf:  # it ended nowhere
        return False
    row, col = cell
    begin, end = 0.0, math.inf
    # The part of the beam with ``start + t * direction >= limit``, for each side seen from inside.
    for start, direction, limit in (
        (x, cos, col * resolution),
        (-x, -cos, -(col * resolution + resolution)),
        (y, sin, row * resolution),
        (-y, -sin, -(row * resolution + resolution)),
    ):
        if direction > 0:
            begin = max(begin, (limit - start) / direction)
        elif direction < 0:
            end = min(end, (limit - start) / direction)
        elif start <= limit:
            return False
    return begin < end < length


def periods_of(column, place):
    """Lists of scans, one for each time the place was occupied, and one for each time it was free."""
    periods = {"occupied": [], "free": []}
    before = None
    for i, at in enumerate(column):
        if at == MOVING:
            continue
        state = "occupied" if at == place else "free"
        if state != before:
            periods[state].append([])
        periods[state][-1].append(i)
        before = state
    return periods


def seen_place(truth, thing, place, resolution):
    """(seen cells, periods seen occupied, periods seen free, observable)."""
    corners = list(truth.things[thing].places.values())[place]
    covered = {(row, col) for row, col in covered_cells(corners, resolution).tolist()}
    n_beams = len(truth.angles)
    periods = periods_of(truth.places[:, thing].tolist(), place)

    ends = {}
    for i in range(len(truth.t)):
        for j in range(n_beams):
            if truth.hit_things[i, j] == thing and truth.places[i, thing] == place:
                cell = end_cell(truth, i, j, resolution)
                if cell in covered:
                    ends[i, j] = cell
    seen = set(ends.values())

    n_occupied = 0
    for scans in periods["occupied"]:
        there = [cell for (i, _), cell in ends.items() if i in scans]
        cells = set(there)
        if len(there) >= 3 and (len(cells) >= 0.3 * len(seen) or len(cells) * resolution >= 0.3):
            n_occupied += 1

    n_free = 0
    for scans in periods["free"]:
        crossed, crossing = set(), 0
        for i in scans:
            for j in range(n_beams):
                cells = {cell for cell in seen if crosses(truth, i, j, cell, resolution)}
                crossed |= cells
                crossing += bool(cells)
        if seen and crossing >= 3 and len(crossed) >= 0.3 * len(seen):
            n_free += 1
    return seen, n_occupied, n_free, n_occupied > 0 and n_free > 0 and len(seen) * resolution >= 0.15
