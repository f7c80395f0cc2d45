"""Sets of places, doubtful places, glass, and what hides behind doors, in slow, obvious Python."""

from __future__ import annotations

import itertools
import math

from oracle.evidence import exclusion, joint_periods, seconds_during, state_evidence
from oracle.places import at_most, centre, fit_line, mean_point, size

# Sets of places.


def log_odds_of_set(members, in_time, by_shape, around_hinge, hinge_bonus):
    """`in_time` and `by_shape` are by pair, `around_hinge` is ``{(place, end): other places}``."""
    pairs = list(itertools.combinations(sorted(members), 2))
    total = 0.0
    for pair in pairs:
        total += in_time[pair]
    shape = 0.0
    for pair in pairs:
        shape += by_shape[pair] / len(pairs)
    for place in members:
        for end in (0, 1):
            if all(other == place or other in around_hinge.get((place, end), ()) for other in members):
                shape = max(shape, hinge_bonus)
    return total + (len(members) - 1) * shape


def sets_of_places(courses, doubts, centres, by_shape, around_hinge, settings, elsewhere, twice):
    """``{members: log odds}`` of all sets, of up to `max_states` places, any two of which may be of one thing.

    `doubts` are what a place's own log odds take away from a set.
    """
    in_time = {}
    for i, j in itertools.combinations(range(len(courses)), 2):
        if not at_most(math.dist(centres[i], centres[j]), settings.within_m):
            continue
        odds, conflict, moves = exclusion_and_moves(courses[i], courses[j], settings.worth_s, elsewhere, twice)
        if conflict > max(settings.max_conflict, settings.conflict_share * moves):
            continue
        if odds > settings.grow_above and odds + by_shape[i, j] > settings.grow_above:
            in_time[i, j] = odds
    found = {}
    for n in range(2, settings.max_states + 1):
        for members in itertools.combinations(range(len(courses)), n):
            if all(pair in in_time for pair in itertools.combinations(members, 2)):
                odds = log_odds_of_set(members, in_time, by_shape, around_hinge, settings.hinge_bonus)
                odds -= sum(doubts[i] for i in members)
                if odds > settings.link_above:
                    found[members] = odds
    return found


def exclusion_and_moves(course, other, worth_s, elsewhere, twice):
    """`exclusion`, and evidence for the rarer of: in the first place only, in the second one only."""
    odds, conflict = exclusion(course, other, worth_s, elsewhere, twice)
    (_, second), (first, _) = joint_periods(course, other, worth_s, True)
    return odds, conflict, min(first, second)


def best_sum(sets):
    """The largest sum of the values of sets, ``{members: value}``, no two of which share a member."""
    if not sets:
        return 0.0
    (members, odds), *others = sets.items()
    apart = {one: value for one, value in others if not set(one) & set(members)}
    return max(best_sum(dict(others)), odds + best_sum(apart))


def without_doubtful(log_odds, n_changes, sets, place_above, once_doubt):
    """``(numbers of the places that stay, sets in new numbers)``; sets are ``(members, rivals)``."""
    stay = []
    for i in range(len(log_odds)):
        alone = log_odds[i] - once_doubt if n_changes[i] == 1 else log_odds[i]
        if alone > place_above or any(i in members for members, _ in sets):
            stay.append(i)
    renumbered = []
    for members, rivals in sets:
        renumbered.append(
            ([stay.index(i) for i in members], [stay.index(i) for i in rivals if i in stay]),
        )
    return stay, renumbered


# Glass.


def looks(series, stamps, look, every):
    """``(scan, state)`` of the looks at a cell: each `every`-th scan of a period."""
    found = []
    for start, stop, state in series:
        scans = [k for k, stamp in enumerate(stamps) if start <= stamp <= max(start, stop - look)]
        found += [(scan, state) for scan in scans[::every]]
    return found


def visits_of(series, point, stamps, poses, look, every, same_pass, n_directions):
    """``[(direction, occupied)]``: looks from one direction without a long pause are one, as most of them say."""
    visits = []
    before, before_stamp = None, None
    for scan, state in looks(series, stamps, look, every):
        towards = math.degrees(math.atan2(poses[scan][1] - point[1], poses[scan][0] - point[0]))
        direction = min(math.floor((towards + 180) / (360 / n_directions)), n_directions - 1)
        if before is None or direction != before or stamps[scan] - before_stamp > same_pass:
            visits.append((direction, []))
        visits[-1][1].append(bool(state))
        before, before_stamp = direction, stamps[scan]
    return [(direction, said.count(True) > said.count(False)) for direction, said in visits]


def log_evidence(n_free, n_occupied):
    """Of a course with so many of either, every share being as likely as any other."""
    n = n_free + n_occupied
    return -math.log((n + 1) * math.comb(n, n_occupied))


def advantage_of_view(visits):
    """By how much the direction explains visits better than keeping a state does, and than chance does."""
    by_view = 0.0
    for wanted in {direction for direction, _ in visits}:
        said = [occupied for direction, occupied in visits if direction == wanted]
        by_view += log_evidence(said.count(False), said.count(True))
    every = [occupied for _, occupied in visits]
    by_chance = log_evidence(every.count(False), every.count(True))
    by_time = math.log(0.5)
    for state in (False, True):
        after = [b for a, b in itertools.pairwise(every) if a == state]
        by_time += log_evidence(after.count(False), after.count(True))
    return by_view - max(by_time, by_chance)


# Hidden leaves.


def behind(cells, course, smoothed, resolution, settings, seen_while_closed):
    """Cells around a place that were never seen free, and seen only while the place was."""
    reach = math.ceil(1.6 * size(cells, resolution) / resolution)
    spells = {state: [(start, stop) for start, stop, said in course if said == state] for state in (False, True)}
    rows, cols = [row for row, _ in cells], [col for _, col in cells]
    found = []
    for row, col in sorted(smoothed):
        if not (min(rows) - reach <= row <= max(rows) + reach and min(cols) - reach <= col <= max(cols) + reach):
            continue
        evidence, _ = state_evidence(smoothed[row, col], settings.worth_s)
        if evidence[0] >= settings.least_evidence or evidence[1] < settings.least_evidence:
            continue
        _, while_free = seconds_during(smoothed[row, col], spells[False])
        while_taken = sum(seconds_during(smoothed[row, col], spells[True]))
        if while_free >= settings.least_stay_s and while_taken <= seen_while_closed * while_free:
            found.append((row, col))
    return found


def leaves_behind(cells, others, resolution, limits):
    """``[(score, cells of the leaf)]`` of each way in which a leaf may stand open at either end of a place."""
    points = [centre(cell, resolution) for cell in others]
    length = size(cells, resolution)
    line = fit_line(cells, resolution)
    found = []
    for end, inward in ((line.begin + resolution / 2, 1), (line.end - resolution / 2, -1)):
        x0, y0 = (mean_point([centre(cell, resolution) for cell in cells])[k] + end * line.along[k] for k in (0, 1))
        closed = math.atan2(inward * line.along[1], inward * line.along[0])
        n_steps = math.floor((limits.SWINGS_RAD[1] - limits.SWINGS_RAD[0]) / limits.STEP_RAD + 1e-6)
        for step, side in itertools.product(range(n_steps + 1), (1, -1)):
            angle = closed + side * (limits.SWINGS_RAD[0] + step * limits.STEP_RAD)
            on_leaf, beyond = {}, set()
            for cell, (x, y) in zip(others, points, strict=True):
                r = (x - x0) * math.cos(angle) + (y - y0) * math.sin(angle)
                off = abs((y - y0) * math.cos(angle) - (x - x0) * math.sin(angle))
                step_along = math.floor(r / resolution + 1e-6)
                if at_most(off, limits.BESIDE_M) and not at_most(r, 0) and at_most(r, 1.1 * length):
                    on_leaf[cell] = step_along, off
                if at_most(off, limits.BEYOND_M) and not at_most(r, 1.15 * length) and at_most(r, 1.65 * length):
                    beyond.add(step_along)
            covered = len({k for k, _ in on_leaf.values()}) * resolution / length
            goes_on = len(beyond) * resolution / (0.5 * length)
            if covered >= limits.LEAST_COVERED and goes_on <= limits.MOST_BEYOND:
                found.append((covered - sum(off for _, off in on_leaf.values()) / len(on_leaf), sorted(on_leaf)))
    return found
