"""Kernels: one scan period of a world, in which everybody waits for everybody.

Arrays in (bundled by whom they are about), arrays out, metres, radians and seconds in the map frame. No
validation: `simulate` has already cast everything that arrives here. Things, the robot and people move in
turn, and each step is taken only if it leads into nobody; so whoever starts clear stays clear. Only people
who are replayed mind nobody.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tempog._jit import kernel
from tempog.simulation.state import FAR_M, Floor, People, Robot, Things, Tracks

UNREACHED = 2**30  # in a distance field
GAP_M = 0.01  # kept between bodies, far above rounding errors
BLOCKED_S = 4.0  # a leaf held up for longer swings back and tries again
ASIDE_S = 2.0  # somebody in the way steps aside for this long
STUCK_S = 3.0  # somebody who cannot get on for longer thinks of another goal
NEAR_GOAL = 10  # field units, two cells
SMOOTH = 0.3  # share of the wanted direction in a person's new heading, per step
SWAY_KEPT = 0.98  # of a change of direction, per step: half is left after 1.7 s
THING_IN_WAY = -3  # for a leaf or box; people count from 0, -2 is the robot
TOUCHING_M = 1e-6
LEAF_PLAY_M = 0.01  # two leaves of a double door are so much longer across their corners than along their faces
N_SWEEP = 10  # places of a leaf on its way that must be clear before it starts
FAR_SHARE = 0.05  # of the goals people choose; for the others they compare a few
STRAIGHT_RAD = 1e-9  # a robot that looks this close to its waypoint drives
SAME_TIME_S = 1e-9  # as for `Track`
ALERT_S = 1.5  # people look this far ahead for somebody who will not wait for them
DODGE_S = 0.3
DODGE_M = 0.1  # beside the bodies themselves


@kernel
def disc_meets_quad(corners: NDArray[np.float64], x: float, y: float, radius: float) -> bool:
    """Whether a disc and a convex quadrilateral share a point."""
    n_left = 0
    for i in range(4):
        j = (i + 1) % 4
        px, py = corners[i, 0], corners[i, 1]
        sx, sy = corners[j, 0] - px, corners[j, 1] - py
        u = ((x - px) * sx + (y - py) * sy) / (sx * sx + sy * sy)
        u = min(max(u, 0.0), 1.0)
        dx, dy = px + u * sx - x, py + u * sy - y
        if dx * dx + dy * dy < radius * radius:
            return True
        if sx * (y - py) - sy * (x - px) > 0.0:
            n_left += 1
    return n_left == 0 or n_left == 4


@kernel
def place_thing(
    rectangle: NDArray[np.float64],
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    fraction: float,
    corners: NDArray[np.float64],
) -> None:
    """Corners (4, 2) of a thing on its way between two poses.                                   [corners updated]"""
    x = start[0] + (end[0] - start[0]) * fraction
    y = start[1] + (end[1] - start[1]) * fraction
    theta = start[2] + (end[2] - start[2]) * fraction
    c, s = math.cos(theta), math.sin(theta)
    for i in range(4):
        corners[i, 0] = x + c * rectangle[i, 0] - s * rectangle[i, 1]
        corners[i, 1] = y + s * rectangle[i, 0] + c * rectangle[i, 1]


@kernel
def quads_meet(a: NDArray[np.float64], b: NDArray[np.float64], play: float) -> bool:
    """Whether two convex quadrilaterals overlap by more than `play`: no side of either parts them."""
    for axis in range(2):
        if a[:, axis].max() <= b[:, axis].min() + play or b[:, axis].max() <= a[:, axis].min() + play:
            return False
    for which in range(2):
        p = a if which == 0 else b
        for i in range(4):
            j = (i + 1) % 4
            nx, ny = p[j, 1] - p[i, 1], p[i, 0] - p[j, 0]
            a_low, a_high, b_low, b_high = np.inf, -np.inf, np.inf, -np.inf
            for k in range(4):
                along_a = a[k, 0] * nx + a[k, 1] * ny
                along_b = b[k, 0] * nx + b[k, 1] * ny
                a_low, a_high = min(a_low, along_a), max(a_high, along_a)
                b_low, b_high = min(b_low, along_b), max(b_high, along_b)
            slack = play * math.hypot(nx, ny)
            if a_high <= b_low + slack or b_high <= a_low + slack:
                return False
    return True


@kernel
def meets_another(k: int, trial: NDArray[np.float64], things: Things, sweeps: bool) -> bool:
    """Whether thing k at `trial` is in another thing, or (if `sweeps`) where another on its way is or will be.

    Things that overlap already do not hold each other up.
    """
    scratch = np.empty((4, 2))
    for other in range(things.corners.shape[0]):
        if other == k:
            continue
        play = TOUCHING_M if things.carried[k] or things.carried[other] else LEAF_PLAY_M
        there = things.corners[other]
        if quads_meet(trial, there, play) and not quads_meet(things.corners[k], there, play):
            return True
        if not sweeps or things.fraction[other] >= 1.0:
            continue
        left, headed = things.travel[other, 0], things.travel[other, 1]
        for part in range(N_SWEEP if things.carried[other] else 0, N_SWEEP + 1):
            place_thing(things.rectangles[other], things.places[left], things.places[headed], part / N_SWEEP, scratch)
            if quads_meet(trial, scratch, play):
                return True
    return False


@kernel
def who_is_in(
    corners: NDArray[np.float64],
    robot: NDArray[np.float64],
    robot_reach: float,
    people: NDArray[np.float64],
    person_reach: float,
) -> int:
    """The first person whose disc meets a quadrilateral; -2 for the robot, -1 for nobody."""
    if disc_meets_quad(corners, robot[0], robot[1], robot_reach):
        return -2
    for i in range(people.shape[0]):
        if disc_meets_quad(corners, people[i, 0], people[i, 1], person_reach):
            return i
    return -1


@kernel
def fill_field(
    blocked: NDArray[np.uint8],
    row: int,
    col: int,
    field: NDArray[np.int32],
    queue: NDArray[np.int32],
    queued: NDArray[np.uint8],
) -> None:
    """Way from every free cell to (row, col): 5 per straight step, 7 per diagonal one.            [field updated]"""
    n_rows, n_cols = blocked.shape
    field[:] = UNREACHED
    queued[:] = 0
    n = n_rows * n_cols
    head, count = 0, 1
    queue[0] = row * n_cols + col
    field[row, col] = 0
    while count > 0:
        cell = queue[head]
        head = (head + 1) % n
        count -= 1
        r, c = cell // n_cols, cell % n_cols
        queued[r, c] = 0
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                if (dr == 0 and dc == 0) or not (0 <= r + dr < n_rows and 0 <= c + dc < n_cols):
                    continue
                if blocked[r + dr, c + dc] or blocked[r + dr, c] or blocked[r, c + dc]:
                    continue
                cost = field[r, c] + (7 if dr != 0 and dc != 0 else 5)
                if cost < field[r + dr, c + dc]:
                    field[r + dr, c + dc] = cost
                    if not queued[r + dr, c + dc]:
                        queued[r + dr, c + dc] = 1
                        queue[(head + count) % n] = (r + dr) * n_cols + c + dc
                        count += 1


@kernel
def block_things(
    free_mask: NDArray[np.uint8],
    rest_corners: NDArray[np.float64],
    x0: float,
    y0: float,
    cell_m: float,
    radius: float,
    blocked: NDArray[np.uint8],
) -> None:
    """Cells where a person's middle cannot be, for walls or things at rest.                     [blocked updated]"""
    n_rows, n_cols = blocked.shape
    blocked[:] = free_mask
    for k in range(rest_corners.shape[0]):
        quad = rest_corners[k]
        first_row = max(0, int((quad[:, 1].min() - radius - y0) / cell_m) - 1)
        last_row = min(n_rows - 1, int((quad[:, 1].max() + radius - y0) / cell_m) + 1)
        first_col = max(0, int((quad[:, 0].min() - radius - x0) / cell_m) - 1)
        last_col = min(n_cols - 1, int((quad[:, 0].max() + radius - x0) / cell_m) + 1)
        for r in range(first_row, last_row + 1):
            for c in range(first_col, last_col + 1):
                if disc_meets_quad(quad, x0 + (c + 0.5) * cell_m, y0 + (r + 0.5) * cell_m, radius):
                    blocked[r, c] = 1


@kernel
def can_stand(
    i: int,
    x: float,
    y: float,
    walls: NDArray[np.float64],
    corners: NDArray[np.float64],
    robot: NDArray[np.float64],
    robot_radius: float,
    people: NDArray[np.float64],
    n_walkers: int,
    radius: float,
) -> bool:
    """Whether person i may be at (x, y): clear of walls, things, the robot and all others.

    Who has been walked into by somebody replayed may go wherever that one is farther away.
    """
    for j in range(people.shape[0]):
        dx, dy = people[j, 0] - x, people[j, 1] - y
        square = dx * dx + dy * dy
        if j != i and square < (2 * radius + GAP_M) ** 2:
            was = (people[j, 0] - people[i, 0]) ** 2 + (people[j, 1] - people[i, 1]) ** 2
            if j < n_walkers or square <= was:
                return False
    reach = robot_radius + radius + GAP_M
    if (robot[0] - x) ** 2 + (robot[1] - y) ** 2 < reach * reach:
        return False
    reach = radius + GAP_M
    for k in range(walls.shape[0]):
        ax, ay, bx, by = walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3]
        if min(ax, bx) > x + reach or max(ax, bx) < x - reach or min(ay, by) > y + reach or max(ay, by) < y - reach:
            continue
        sx, sy = bx - ax, by - ay
        u = min(max(((x - ax) * sx + (y - ay) * sy) / (sx * sx + sy * sy), 0.0), 1.0)
        dx, dy = ax + u * sx - x, ay + u * sy - y
        if dx * dx + dy * dy < reach * reach:
            return False
    for k in range(corners.shape[0]):
        if abs(corners[k, 0, 0] - x) < FAR_M / 2 and disc_meets_quad(corners[k], x, y, reach):
            return False
    return True


@kernel
def choose_goal(rng: np.random.Generator, goals: NDArray[np.int32], n_compared: int, row: float, col: float) -> int:
    """A goal, mostly a near one: people who all crossed the whole building would jam its doors."""
    chosen = int(rng.integers(0, goals.shape[0]))
    if rng.random() < FAR_SHARE:
        return chosen
    for _ in range(n_compared - 1):
        other = int(rng.integers(0, goals.shape[0]))
        to_chosen = (goals[chosen, 0] - row) ** 2 + (goals[chosen, 1] - col) ** 2
        if (goals[other, 0] - row) ** 2 + (goals[other, 1] - col) ** 2 < to_chosen:
            chosen = other
    return chosen


@kernel
def dodge(i: int, people: People, tracks: Tracks) -> None:
    """Let person i step out of the way of somebody who is replayed and will not wait."""
    first = people.mind.shape[0]
    for j in range(tracks.velocity.shape[0]):
        vx, vy = tracks.velocity[j, 0], tracks.velocity[j, 1]
        dx, dy = people.where[i, 0] - people.where[first + j, 0], people.where[i, 1] - people.where[first + j, 1]
        v = math.hypot(vx, vy)
        if v < 1e-6 or math.hypot(dx, dy) > 2 * people.radius + DODGE_M + v * ALERT_S:
            continue
        soon = min(max((dx * vx + dy * vy) / (v * v), 0.0), ALERT_S)
        off_x, off_y = dx - vx * soon, dy - vy * soon
        off = math.hypot(off_x, off_y)
        if off > 2 * people.radius + DODGE_M or (soon == 0.0 and off > 2 * people.radius + GAP_M):
            continue
        if off < 1e-6:
            off_x, off_y = -vy, vx
        people.mind[i, 1] = 0.0
        people.mind[i, 2] = DODGE_S
        people.mind[i, 3], people.mind[i, 4] = off_x, off_y


@kernel
def replay(now: float, dt: float, tracks: Tracks, people: People) -> None:
    """Put replayed people where they are at `now`: straight between samples, FAR_M away while absent."""
    first = people.mind.shape[0]
    for j in range(tracks.stop.shape[0]):
        begin = tracks.stop[j - 1] if j > 0 else 0
        end = tracks.stop[j]
        k = tracks.next[j]
        while k < end and tracks.samples[k, 0] < now - SAME_TIME_S:
            k += 1
        tracks.next[j] = k
        x, y = FAR_M, FAR_M
        if k < end and tracks.samples[k, 0] <= now + SAME_TIME_S:
            x, y = tracks.samples[k, 1], tracks.samples[k, 2]
        elif begin < k < end:
            t0, t1 = tracks.samples[k - 1, 0], tracks.samples[k, 0]
            u = (now - t0) / (t1 - t0)
            x = tracks.samples[k - 1, 1] + (tracks.samples[k, 1] - tracks.samples[k - 1, 1]) * u
            y = tracks.samples[k - 1, 2] + (tracks.samples[k, 2] - tracks.samples[k - 1, 2]) * u
        was_x, was_y = people.where[first + j, 0], people.where[first + j, 1]
        there = x < FAR_M / 2 and was_x < FAR_M / 2
        tracks.velocity[j, 0] = (x - was_x) / dt if there else 0.0
        tracks.velocity[j, 1] = (y - was_y) / dt if there else 0.0
        people.where[first + j, 0], people.where[first + j, 1] = x, y


@kernel
def move_things(
    now: float,
    dt: float,
    things: Things,
    robot: Robot,
    people: People,
    epoch: NDArray[np.int32],
) -> None:
    """Move leaves and boxes on by one step, unless somebody is in their way."""
    rectangles, carried, move_s, places = things.rectangles, things.carried, things.move_s, things.places
    event_t, event_place, event_stop, event_next = (
        things.event_t,
        things.event_place,
        things.event_stop,
        things.event_next,
    )
    travel, fraction, held_s, corners = things.travel, things.fraction, things.held_s, things.corners
    robot_radius, stop_m = robot.drive[2], robot.drive[3]
    where, radius, mind = people.where, people.radius, people.mind
    n_things = rectangles.shape[0]
    trial = np.empty((4, 2))
    for k in range(n_things):
        while event_next[k] < event_stop[k] and event_t[event_next[k]] <= now + 1e-9:
            travel[k, 2] = event_place[event_next[k]]
            event_next[k] += 1
        in_way = -1
        if fraction[k] >= 1.0:
            if travel[k, 1] == travel[k, 2]:
                continue
            first = N_SWEEP if carried[k] else 1
            for part in range(first, N_SWEEP + 1):
                place_thing(rectangles[k], places[travel[k, 1]], places[travel[k, 2]], part / N_SWEEP, trial)
                in_way = who_is_in(trial, robot.pose, robot_radius + stop_m + GAP_M, where, radius + 2 * GAP_M)
                if in_way == -1 and meets_another(k, trial, things, True):
                    in_way = THING_IN_WAY
                if in_way != -1:
                    break
            if in_way == -1:
                travel[k, 0] = travel[k, 1]
                travel[k, 1] = travel[k, 2]
                early = max(event_t[event_next[k] - 1] - (now - dt), 0.0)  # of this step, before the move is due
                fraction[k] = -early / move_s[k]
                held_s[k] = 0.0
                epoch[0] += 1
        if fraction[k] < 1.0:
            further = fraction[k] + dt / move_s[k]
            if further > 1.0 - 1e-9:
                further = 1.0
            place_thing(rectangles[k], places[travel[k, 0]], places[travel[k, 1]], further, trial)
            if carried[k] and further < 1.0:
                fraction[k] = further
                corners[k] = FAR_M
                corners[k, 1, 0] += 1.0  # no side without length
                corners[k, 2] += 1.0
                corners[k, 3, 1] += 1.0
                continue
            in_way = who_is_in(trial, robot.pose, robot_radius + GAP_M, where, radius + GAP_M)
            if in_way == -1 and meets_another(k, trial, things, False):
                in_way = THING_IN_WAY
            if in_way == -1:
                corners[k] = trial
                fraction[k] = further
                held_s[k] = 0.0
                if further == 1.0:
                    epoch[0] += 1
            else:
                held_s[k] += dt
                if held_s[k] > BLOCKED_S and not carried[k]:
                    left = travel[k, 0]
                    travel[k, 0] = travel[k, 1]
                    travel[k, 1] = left
                    fraction[k] = 1.0 - fraction[k]
                    held_s[k] = 0.0
        if 0 <= in_way < mind.shape[0] and mind[in_way, 2] <= 0.0:
            away_x = where[in_way, 0] - (trial[0, 0] + trial[2, 0]) / 2
            away_y = where[in_way, 1] - (trial[0, 1] + trial[2, 1]) / 2
            mind[in_way, 1] = 0.0
            mind[in_way, 2] = ASIDE_S
            mind[in_way, 3] = away_x
            mind[in_way, 4] = away_y


@kernel
def drive_robot(dt: float, robot: Robot, things: Things, people: People) -> None:
    """Turn or drive the robot on by one step, unless somebody or something is ahead of it."""
    route, target, pose = robot.route, robot.target, robot.pose
    speed, turn_rate, robot_radius, stop_m = robot.drive[0], robot.drive[1], robot.drive[2], robot.drive[3]
    where, radius, mind = people.where, people.radius, people.mind
    corners, swing_m = things.corners, things.swing_m
    if route.shape[0] < 2:
        return
    way_x, way_y = route[target[0], 0] - pose[0], route[target[0], 1] - pose[1]
    way = math.hypot(way_x, way_y)
    if way < 1e-9:
        target[0] = (target[0] + 1) % route.shape[0]
        way_x, way_y = route[target[0], 0] - pose[0], route[target[0], 1] - pose[1]
        way = math.hypot(way_x, way_y)
    wanted = math.atan2(way_y, way_x)
    turn = (wanted - pose[2] + math.pi) % (2 * math.pi) - math.pi
    if abs(turn) > STRAIGHT_RAD and way > 1e-9:
        turn = min(max(turn, -turn_rate * dt), turn_rate * dt)
        pose[2] = (pose[2] + turn + math.pi) % (2 * math.pi) - math.pi
    elif way > 1e-9:
        c, s = way_x / way, way_y / way
        ahead = min(speed * dt, way)
        last = ahead >= way - 1e-9
        next_x = route[target[0], 0] if last else pose[0] + c * ahead
        next_y = route[target[0], 1] if last else pose[1] + s * ahead
        look = min(stop_m, way - ahead)
        waits = False
        for i in range(where.shape[0]):
            u = (where[i, 0] - next_x) * c + (where[i, 1] - next_y) * s
            u = min(max(u, 0.0), look)
            dx, dy = where[i, 0] - next_x - u * c, where[i, 1] - next_y - u * s
            reach = robot_radius + radius + GAP_M
            if dx * dx + dy * dy < reach * reach:
                waits = True
                if i < mind.shape[0] and mind[i, 2] <= 0.0:
                    side = 1.0 if c * dy - s * dx >= 0.0 else -1.0
                    mind[i, 1] = 0.0
                    mind[i, 2] = ASIDE_S
                    mind[i, 3] = -s * side
                    mind[i, 4] = c * side
        for k in range(corners.shape[0]):
            look = min(stop_m + swing_m[k], way - ahead)
            n_parts = int(look / robot_radius) + 1  # discs less than a radius apart leave no gap
            for part in range(n_parts + 1):
                px, py = next_x + c * look * part / n_parts, next_y + s * look * part / n_parts
                if disc_meets_quad(corners[k], px, py, robot_radius + GAP_M):
                    waits = True
        if not waits:
            pose[0], pose[1] = next_x, next_y


@kernel
def walk(
    dt: float,
    rng: np.random.Generator,
    walls: NDArray[np.float64],
    things: Things,
    robot: Robot,
    people: People,
    tracks: Tracks,
    floor: Floor,
) -> None:
    """Let everybody who is not replayed walk on by one step."""
    rectangles, places, travel, corners = things.rectangles, things.places, things.travel, things.corners
    where, mind, traits, goal, radius, pause_mean_s = (
        people.where,
        people.mind,
        people.traits,
        people.goal,
        people.radius,
        people.pause_mean_s,
    )
    goals, fields, field_epoch, epoch = floor.goals, floor.fields, floor.field_epoch, floor.epoch
    blocked, queue, queued = floor.blocked, floor.queue, floor.queued
    x0, y0, cell_m = floor.x0, floor.y0, floor.cell_m
    n_rows, n_cols = blocked.shape
    robot_radius = robot.drive[2]
    n_walkers = mind.shape[0]
    if epoch[1] != epoch[0]:
        rest = np.empty((rectangles.shape[0], 4, 2))
        for k in range(rectangles.shape[0]):
            place_thing(rectangles[k], places[travel[k, 1]], places[travel[k, 1]], 1.0, rest[k])
        block_things(floor.wall_mask, rest, x0, y0, cell_m, radius + GAP_M, blocked)
        epoch[1] = epoch[0]

    for i in range(n_walkers):
        x, y = where[i, 0], where[i, 1]
        chance = rng.random()
        dodge(i, people, tracks)
        if mind[i, 2] > 0.0:
            mind[i, 2] -= dt
            dir_x, dir_y = mind[i, 3], mind[i, 4]
        elif mind[i, 1] > 0.0:
            mind[i, 1] -= dt
            continue
        else:
            if chance < traits[i, 1] * dt:
                mind[i, 5] = rng.uniform(-2.0, 2.0)
                if rng.random() < 0.5:
                    goal[i] = choose_goal(rng, goals, floor.n_compared, (y - y0) / cell_m, (x - x0) / cell_m)
            g = goal[i]
            if field_epoch[g] != epoch[0]:
                fill_field(blocked, goals[g, 0], goals[g, 1], fields[g], queue, queued)
                field_epoch[g] = epoch[0]
            row, col = int((y - y0) / cell_m), int((x - x0) / cell_m)
            here = fields[g, row, col]
            if here <= NEAR_GOAL:
                goal[i] = choose_goal(rng, goals, floor.n_compared, (y - y0) / cell_m, (x - x0) / cell_m)
                if rng.random() < 0.5:
                    mind[i, 1] = rng.exponential(pause_mean_s)
                continue
            best, best_row, best_col = UNREACHED, row, col
            ring = 1 if here < UNREACHED else 2
            for r in range(max(row - ring, 0), min(row + ring + 1, n_rows)):
                for c_ in range(max(col - ring, 0), min(col + ring + 1, n_cols)):
                    if fields[g, r, c_] < best:
                        best, best_row, best_col = fields[g, r, c_], r, c_
            if best == UNREACHED:
                mind[i, 1] = 0.5 + chance  # closed in, for all this goal says: think of another one
                goal[i] = choose_goal(rng, goals, floor.n_compared, (y - y0) / cell_m, (x - x0) / cell_m)
                continue
            dir_x = x0 + (best_col + 0.5) * cell_m - x
            dir_y = y0 + (best_row + 0.5) * cell_m - y
        length = math.hypot(dir_x, dir_y)
        if length < 1e-9:
            continue
        look_x = (1.0 - SMOOTH) * math.cos(mind[i, 0]) + SMOOTH * dir_x / length
        look_y = (1.0 - SMOOTH) * math.sin(mind[i, 0]) + SMOOTH * dir_y / length
        mind[i, 0] = math.atan2(look_y, look_x)
        mind[i, 5] *= SWAY_KEPT
        moved = False
        for attempt in range(13):
            # Straight on first, then ever more to the right and to the left, in turn.
            bend = 0.25 * ((attempt + 1) // 2) * (1.0 if attempt % 2 == 0 else -1.0)
            bend *= 1.0 + 0.3 * ((attempt + 1) // 2) / 3.0
            way = mind[i, 0] + mind[i, 5] * (1.0 if attempt < 12 else 0.0) + bend
            next_x = x + traits[i, 0] * dt * math.cos(way)
            next_y = y + traits[i, 0] * dt * math.sin(way)
            if can_stand(i, next_x, next_y, walls, corners, robot.pose, robot_radius, where, n_walkers, radius):
                where[i, 0], where[i, 1] = next_x, next_y
                moved = True
                break
        mind[i, 6] = 0.0 if moved else mind[i, 6] + dt
        if mind[i, 6] > STUCK_S:
            mind[i, 6] = 0.0
            mind[i, 0] = rng.uniform(-math.pi, math.pi)
            goal[i] = choose_goal(rng, goals, floor.n_compared, (y - y0) / cell_m, (x - x0) / cell_m)


@kernel
def advance(
    t: float,
    dt: float,
    n_steps: int,
    rng: np.random.Generator,
    walls: NDArray[np.float64],
    things: Things,
    robot: Robot,
    people: People,
    tracks: Tracks,
    floor: Floor,
) -> None:
    """Move everything on by `n_steps` of `dt` from time `t`."""
    for step in range(n_steps):
        now = t + (step + 1) * dt
        replay(now, dt, tracks, people)
        move_things(now, dt, things, robot, people, floor.epoch)
        drive_robot(dt, robot, things, people)
        walk(dt, rng, walls, things, robot, people, tracks, floor)


@kernel
def advance_without_walkers(
    t: float,
    dt: float,
    n_steps: int,
    things: Things,
    robot: Robot,
    people: People,
    tracks: Tracks,
    epoch: NDArray[np.int32],
) -> None:
    """The same where nobody walks by themselves: most of the code above need not be compiled."""
    for step in range(n_steps):
        now = t + (step + 1) * dt
        replay(now, dt, tracks, people)
        move_things(now, dt, things, robot, people, epoch)
        drive_robot(dt, robot, things, people)
