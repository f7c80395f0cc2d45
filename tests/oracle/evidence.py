"""The steps of the method ``evidence`` in slow, obvious Python: every course of states, every subset is tried.

A series is a list of ``(start, stop, state)`` in time order, without overlap; times are integers (nanoseconds), and
the state is whatever the function at hand says.
"""

from __future__ import annotations

import itertools
import math

from oracle.objects import stretches, value_during

SECOND = 1_000_000_000


def worth(seconds, worth_s):
    """What one stretch of a state counts for."""
    return 1 - math.exp(-seconds / worth_s)


def worth_of_stretches(timed_states, worth_s):
    """``{state: evidence}`` of ``(seconds, state)`` in time order: what is alike and adjacent is one stretch."""
    evidence = {}
    for state, stretch in itertools.groupby(timed_states, key=lambda one: one[1]):
        evidence[state] = evidence.get(state, 0.0) + worth(sum(seconds for seconds, _ in stretch), worth_s)
    return evidence


# States of a cell.


def log_odds_of_course(series, course, look, for_hit, for_free, max_looks, errors_last_s, dwell_s):
    """How likely the readings are with the cell in the states `course`, and these as such; log, up to a constant.

    Series have True for a hit. A cell changes to and fro, each way once in 2 `dwell_s` in the mean.
    """
    total = 0.0
    for (start, stop, hit), occupied in zip(series, course, strict=True):
        if occupied:
            independent = max(max_looks, (stop - start) / SECOND / errors_last_s)
            total += min((stop - start) / look, independent) * (for_hit if hit else for_free)
    for k in range(1, len(series)):
        seconds = (max(series[k][0] - series[k - 1][1], 0) + look) / SECOND
        p_changed = (1 - math.exp(-2 * seconds / dwell_s)) / 2
        total += math.log(p_changed if course[k] != course[k - 1] else 1 - p_changed)
    return total


def log_odds_of_best_course(series, *settings):
    """Of the likeliest of all courses."""
    courses = itertools.product([False, True], repeat=len(series))
    return max(log_odds_of_course(series, course, *settings) for course in courses)


def state_evidence(series, worth_s):
    """``(evidence, seconds)`` for having been free, and occupied."""
    timed = [((stop - start) / SECOND, state) for start, stop, state in series]
    evidence = worth_of_stretches(timed, worth_s)
    seconds = [sum(lasted for lasted, state in timed if state == wanted) for wanted in (0, 1)]
    return [evidence.get(wanted, 0.0) for wanted in (0, 1)], seconds


# Two cells.


def joint_evidence(left, right, worth_s):
    """For both free, right only, left only, both occupied, over the time in which both were seen."""
    timed = []
    for t0, t1 in stretches([left, right]):
        states = value_during(left, t0, t1), value_during(right, t0, t1)
        if None not in states:
            timed.append(((t1 - t0) / SECOND, states))
    evidence = worth_of_stretches(timed, worth_s)
    return [evidence.get(states, 0.0) for states in [(0, 0), (0, 1), (1, 0), (1, 1)]]


def likelihood_ratio(neither, right_only, left_only, both, disagreement):
    """Log, of one thing in both cells against one in each."""
    seen = {(0, 0): neither, (0, 1): right_only, (1, 0): left_only, (1, 1): both}
    total = sum(seen.values()) + 2
    p_left = (left_only + both + 1) / total
    p_right = (right_only + both + 1) / total
    p_either = (p_left + p_right) / 2
    ratio = 0.0
    for (left, right), evidence in seen.items():
        of_one = disagreement / 2 if left != right else (1 - disagreement) * (p_either if left else 1 - p_either)
        of_two = (p_left if left else 1 - p_left) * (p_right if right else 1 - p_right)
        ratio += evidence * math.log(of_one / of_two)
    return ratio


def merge(n, pairs, above):
    """``{frozenset of members}``; `pairs` is ``{(i, j): weight}``. All means are computed anew in each step."""
    groups = [frozenset([i]) for i in range(n)]
    while True:
        best, best_mean = None, above
        for a, b in itertools.combinations(groups, 2):
            mean = mean_across(a, b, pairs)
            if mean is not None and mean > best_mean:
                best, best_mean = (a, b), mean
        if best is None:
            return set(groups)
        groups = [group for group in groups if group not in best] + [best[0] | best[1]]


def mean_across(group, other, pairs):
    """Mean weight of the pairs with an end in each of two groups; None without one."""
    weights = [w for (i, j), w in pairs.items() if (i in group and j in other) or (j in group and i in other)]
    return sum(weights) / len(weights) if weights else None


# Groups of cells.


def hits_during(series, which, spells):
    """Seconds of hits of some series within spells; series have True for a hit."""
    total = 0
    for i in which:
        for start, stop, hit in series[i]:
            for since, until in spells:
                if hit:
                    total += max(0, min(stop, until) - max(start, since))
    return total / SECOND


def seconds_during(series, spells):
    """``[free, occupied]`` seconds of a series within spells."""
    seconds = [0, 0]
    for start, stop, state in series:
        for since, until in spells:
            seconds[state] += max(0, min(stop, until) - max(start, since))
    return [both / SECOND for both in seconds]


def course_of_group(several, seen_share):
    """``[start, stop, state]`` of a group: what most of its cells seen say, while a share of them is seen."""
    course = []
    for t0, t1 in stretches(several):
        said = [value_during(series, t0, t1) for series in several]
        said = [state for state in said if state is not None]
        if not said or len(said) < seen_share * len(several):
            continue
        state = sum(said) > len(said) / 2
        if course and course[-1][1] == t0 and course[-1][2] == state:
            course[-1][1] = t1
        else:
            course.append([t0, t1, state])
    return course


# Two places.


def state_or_guess(course, t0, t1):
    """``(state, guessed)``: in a gap the state before it if it is that after it, too; None if not to be known."""
    state = value_during(course, t0, t1)
    if state is not None:
        return state, False
    before = [state for _, stop, state in course if stop <= t0]
    after = [state for start, _, state in course if start >= t1]
    if before and after and before[-1] == after[0]:
        return after[0], True
    return None


def joint_periods(course, other, worth_s, one_at_a_time):
    """``[free or occupied][free or occupied]``; see the function of this name that is tested."""
    timed = []
    for t0, t1 in stretches([course, other]):
        first, second = state_or_guess(course, t0, t1), state_or_guess(other, t0, t1)
        if first is None or second is None:
            continue
        if first[1] or second[1]:
            if one_at_a_time and first[0] and second[0]:
                continue
            if not one_at_a_time and first[0] != second[0]:
                continue
        timed.append(((t1 - t0) / SECOND, (first[0], second[0])))
    evidence = worth_of_stretches(timed, worth_s)
    return [[evidence.get((a, b), 0.0) for b in (False, True)] for a in (False, True)]


def exclusion(course, other, worth_s, elsewhere, twice):
    """``(log odds, conflict)`` of one thing in either place at a time against a thing in each."""
    seen = joint_periods(course, other, worth_s, True)
    total = sum(map(sum, seen)) + 1
    p_first = (sum(seen[True]) + 0.5) / total
    p_second = (seen[False][True] + seen[True][True] + 0.5) / total
    too_much = max(1.0, (p_first + p_second) / (1 - elsewhere))
    p_one_thing = {
        (False, False): max(1 - (p_first + p_second) / too_much, elsewhere),
        (False, True): p_second / too_much,
        (True, False): p_first / too_much,
        (True, True): twice,
    }
    odds = 0.0
    for (a, b), of_one in p_one_thing.items():
        of_two = (p_first if a else 1 - p_first) * (p_second if b else 1 - p_second)
        odds += seen[a][b] * math.log(of_one / of_two)
    return odds, seen[True][True]


def best_disjoint_sum(sets):
    """The largest sum of log odds of ``(members, log odds)`` no two of which share a member."""
    best = 0.0
    for n in range(len(sets) + 1):
        for chosen in itertools.combinations(sets, n):
            members = [i for one, _ in chosen for i in one]
            if len(members) == len(set(members)):
                best = max(best, sum(odds for _, odds in chosen))
    return best
