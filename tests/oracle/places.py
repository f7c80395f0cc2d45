"""What the method ``evidence`` makes of groups of cells, in slow, obvious Python: traits, faces, hinges, sets, views.

Cells are ``(row, col)``; a course is a list of ``(start, stop, state)``, a stay a ``Stay``; points and lines are in
metres. Lengths on a lattice may be as long as a limit: that is settled here with some slack, and not by rounding.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

from oracle.evidence import SECOND, course_of_group, hits_during, joint_periods, seconds_during
from oracle.objects import stretches, value_during

SLACK = 1e-9


def at_most(value, limit):
    return value <= limit + SLACK


# Lines.


class Line(NamedTuple):
    middle: tuple[float, float]
    along: tuple[float, float]
    begin: float
    end: float
    depth: float


def centre(cell, resolution):
    """x and y."""
    return (cell[1] + 0.5) * resolution, (cell[0] + 0.5) * resolution


def mean_point(points):
    return sum(x for x, _ in points) / len(points), sum(y for _, y in points) / len(points)


def size(cells, resolution):
    """Corner to corner."""
    height = max(row for row, _ in cells) - min(row for row, _ in cells) + 1
    width = max(col for _, col in cells) - min(col for _, col in cells) + 1
    return math.hypot(height, width) * resolution


def moments(points):
    """``(sxx, sxy, syy)``: mean products of the offsets from the middle."""
    x0, y0 = mean_point(points)
    n = len(points)
    sxx = sum((x - x0) ** 2 for x, _ in points) / n
    sxy = sum((x - x0) * (y - y0) for x, y in points) / n
    syy = sum((y - y0) ** 2 for _, y in points) / n
    return sxx, sxy, syy


def has_direction(cells):
    """Whether cells extend farther one way than another."""
    sxx, sxy, syy = moments([centre(cell, 1.0) for cell in cells])
    return math.hypot(sxx - syy, 2 * sxy) > 1e-6


def fit_line(cells, resolution):
    """Least squares of the distances from the line, by the angle of the larger principal axis."""
    points = [centre(cell, resolution) for cell in cells]
    sxx, sxy, syy = moments(points)
    angle = math.atan2(2 * sxy, sxx - syy) / 2
    along = math.cos(angle), math.sin(angle)
    x0, y0 = mean_point(points)
    r = [(x - x0) * along[0] + (y - y0) * along[1] for x, y in points]
    off = [(x - x0) * along[1] - (y - y0) * along[0] for x, y in points]
    depth = math.sqrt(sum(one**2 for one in off) / len(off))
    return Line((x0, y0), along, min(r) - resolution / 2, max(r) + resolution / 2, depth)


def hinges(line, other, leaf_depth, leaf_length, off_limit, gap_limit, longer, least_turn):
    """Which ends of the first line, 0 or 1, the second turns about."""
    for one in (line, other):
        if one.depth > leaf_depth or not at_most(one.end - one.begin, leaf_length):
            return ()
    found = []
    for k in (0, 1):
        at = line.begin if k == 0 else line.end
        x = line.middle[0] + at * line.along[0] - other.middle[0]
        y = line.middle[1] + at * line.along[1] - other.middle[1]
        r = x * other.along[0] + y * other.along[1]
        off = abs(x * other.along[1] - y * other.along[0])
        if abs(r - other.begin) < abs(r - other.end):  # the other line begins near the hinge and leads away from it
            gap, leads = other.begin - r, 1
        else:
            gap, leads = r - other.end, -1
        inwards = 1 if k == 0 else -1
        cosine = inwards * leads * (line.along[0] * other.along[0] + line.along[1] * other.along[1])
        turn = math.acos(max(-1.0, min(1.0, cosine)))
        reach = gap + other.end - other.begin
        if turn < least_turn or not at_most(off, off_limit):
            continue
        if not at_most(-off_limit, gap) or not at_most(gap, gap_limit):
            continue
        if at_most(reach, longer * max(line.end - line.begin, other.end - other.begin)):
            found.append(k)
    return tuple(found)


def near_odds(cells, others, resolution, settings):
    """By the distance between the closest cells, and by size."""
    apart = min(math.dist(cell, other) for cell in cells for other in others) * resolution
    odds = settings.hinge_bonus if at_most(apart, settings.hinge_m) else -settings.distance_cost * apart
    differ = abs(math.log(size(cells, resolution)) - math.log(size(others, resolution)))
    if differ > 0.3:
        odds -= settings.size_cost * (differ - 0.3)
    return odds


# Traits.


class Stay(NamedTuple):
    occupied: bool
    start: int
    stop: int
    seconds: float
    together: float


def stays_of_group(several, seen_share, least_stay):
    """Stretches of one state of a group, gaps and all, if observed for long enough."""
    found = []
    course = course_of_group(several, seen_share)
    for state, stretch in itertools.groupby(course, key=lambda period: period[2]):
        periods = list(stretch)
        seconds = agree = 0.0
        for t0, t1 in stretches(several):
            if any(start <= t0 and t1 <= stop for start, stop, _ in periods):
                said = [value_during(series, t0, t1) for series in several]
                said = [bool(one) for one in said if one is not None]
                seconds += (t1 - t0) / SECOND
                agree += (t1 - t0) / SECOND * said.count(bool(state)) / len(said)
        if seconds >= least_stay:
            found.append(Stay(bool(state), periods[0][0], periods[-1][1], seconds, agree / seconds))
    return found


def traits(cells, smoothed, measured, evidence_free, comes_back, resolution, settings):
    """``{name: value}`` of a place; courses and evidence are by cell, of all cells that were ever hit."""
    stays = stays_of_group([smoothed[cell] for cell in cells], settings.seen_share, settings.least_stay_s)
    occupied = [stay for stay in stays if stay.occupied]
    free = [stay for stay in stays if not stay.occupied]
    occupied_seconds = sum(stay.seconds for stay in occupied)
    free_seconds = sum(stay.seconds for stay in free)
    n_long = 0
    for stay in occupied:
        if (stay.stop - stay.start) / SECOND >= settings.long_stay_s:
            n_long += 1
    return {
        "duty": occupied_seconds / (occupied_seconds + free_seconds),
        "free_worth": free_seconds / settings.worth_s,
        "leak": leak(cells, occupied, measured, evidence_free, comes_back, resolution, settings),
        "echo": echo(cells, free, smoothed, resolution, settings),
        "together": sum(stay.together * stay.seconds for stay in occupied) / occupied_seconds,
        "n_occupied": len(occupied),
        "n_long": n_long,
        "depth_m": fit_line(cells, resolution).depth,
        "size_m": size(cells, resolution),
    }


def leak(cells, occupied, measured, evidence_free, comes_back, resolution, settings):
    """Time of hits around a place per time of hits in it, from the beginnings to the ends of its occupied stays."""
    reach = max(1, round(settings.ring_m / resolution))
    ring = []
    for other in measured:
        if other in cells or other in comes_back or evidence_free[other] < settings.least_evidence:
            continue
        if any(abs(other[0] - row) <= reach and abs(other[1] - col) <= reach for row, col in cells):
            ring.append(other)
    spells = [(stay.start, stay.stop) for stay in occupied]
    inside = hits_during(measured, cells, spells)
    return hits_during(measured, ring, spells) / max(inside, 1e-9)


def echo(cells, free, smoothed, resolution, settings):
    """Share of cells with another one beside them that stood for most of the time in which the place was free."""
    spells = [(stay.start, stay.stop) for stay in free]
    standing = []
    for other in smoothed:
        if other not in cells:
            free_seconds, occupied_seconds = seconds_during(smoothed[other], spells)
            if occupied_seconds >= settings.least_stay_s and occupied_seconds > free_seconds:
                standing.append(other)
    along = fit_line(cells, resolution).along
    n_echoed = 0
    for row, col in cells:
        for other_row, other_col in standing:
            x, y = (other_col - col) * resolution, (other_row - row) * resolution
            lengthwise, sideways = abs(x * along[0] + y * along[1]), abs(x * along[1] - y * along[0])
            if at_most(sideways, settings.echo_m) and at_most(lengthwise, resolution):
                n_echoed += 1
                break
    return n_echoed / len(cells)


def place_odds(values, base, weights):
    """Log odds at some values of each trait, straight lines between them, level beyond."""
    odds = base
    for name, (at, odds_there) in weights.items():
        value = values[name]
        if value <= at[0]:
            odds += odds_there[0]
        elif value >= at[-1]:
            odds += odds_there[-1]
        else:
            k = max(k for k in range(len(at)) if at[k] <= value)
            share = (value - at[k]) / (at[k + 1] - at[k])
            odds += (1 - share) * odds_there[k] + share * odds_there[k + 1]
    return odds


# Faces.


def are_close(cells, others, resolution, face):
    """Whether the centres are no farther apart than the larger one's size, and the gap between faces."""
    apart = math.dist(mean_point(cells), mean_point(others)) * resolution
    return at_most(apart, max(size(cells, resolution), size(others, resolution)) + face)


def share_along(cells, others, resolution, face):
    """Share of the cells of the group of fewer within two faces' distance of the other; 0 if none is within one."""
    small, large = (cells, others) if len(cells) <= len(others) else (others, cells)
    apart = [min(math.dist(cell, other) for other in large) * resolution for cell in small]
    if not at_most(min(apart), face):
        return 0.0
    return sum(at_most(one, 2 * face) for one in apart) / len(small)


def without_doubles(groups, log_odds, resolution, face, same_place):
    """Numbers of groups that lie along no likelier one that is kept."""
    kept = []
    for k in sorted(range(len(groups)), key=lambda k: (-log_odds[k], min(groups[k]))):
        if not any(
            are_close(groups[j], groups[k], resolution, face)
            and share_along(groups[j], groups[k], resolution, face) >= same_place
            for j in kept
        ):
            kept.append(k)
    return sorted(kept)


def join_faces(groups, smoothed, resolution, settings, face_share, same_place, fragment_share):
    """Groups joined with each other, pair by pair in their order, each to where the first one of the pair is."""
    whole = {k: sorted(cells) for k, cells in enumerate(groups)}
    holder = list(range(len(groups)))  # which of the whole ones a group is part of
    for i, j in itertools.combinations(range(len(groups)), 2):
        if not are_close(groups[i], groups[j], resolution, settings.face_m):
            continue
        a, b = holder[i], holder[j]
        if a != b and is_one_thing(
            whole[a], whole[b], smoothed, resolution, settings, face_share, same_place, fragment_share
        ):
            whole[a] = sorted(whole[a] + whole.pop(b))
            holder = [a if k == b else k for k in holder]
    return [whole[k] for k in sorted(whole)]


def is_one_thing(cells, others, smoothed, resolution, settings, face_share, same_place, fragment_share):
    """Whether groups lie along each other, agree, and contradict each other a tenth of the time at most."""
    along = share_along(cells, others, resolution, settings.face_m)
    is_fragment = at_most(min(size(cells, resolution), size(others, resolution)), settings.fragment_m)
    if along < (fragment_share if is_fragment else face_share):
        return False
    course, other = (course_of_group([smoothed[cell] for cell in of], settings.seen_share) for of in (cells, others))
    (neither, second), (first, both) = joint_periods(course, other, settings.worth_s, False)
    if first + second > 0.1 * (neither + first + second + both):
        return False
    if along >= same_place:
        return True
    return both >= 0.5 and (along >= face_share or neither >= 0.5)
