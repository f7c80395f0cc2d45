"""Run a world: the scans its robot takes, and the truth about everything in it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tempog.errors import WorldError
from tempog.scans.scan import Scan
from tempog.simulation.legs import LEG_RADIUS_M, Legs
from tempog.simulation.polygons import outline
from tempog.simulation.room import Room
from tempog.simulation.simulation import MOVING, START_S, Hit, Simulation, beams_of, turned
from tempog.simulation.state import FAR_M, People, Robot, Things, Tracks
from tempog.simulation.world import Laser, PoseError, World

LONGEST_STEP_S = 0.05  # nobody moves more than 8 cm at once, less than half of anybody
SHORTEST_RANGE_M = 0.001  # m; noise on a beam that starts at a wall would else make it zero or negative


def simulate(
    world: World,
    duration_s: float | None = None,
    seed: int = 0,
    people: int | None = None,
    track: Callable[[Sequence[int]], Iterable[int]] | None = None,
) -> Simulation:
    """Take the scans that the robot of a world would take.

    Doors wait until nobody is in their way; the robot stops for leaves and people; people walk around walls,
    closed doors, the robot and each other. Nobody ever overlaps anything; only people who are replayed
    (`Crowd.tracks`) mind nobody. Walkers step out of their way where they can.

    Parameters
    ----------
    world : World
    duration_s : float, seconds, optional
        Default: `world.duration_s`. The first scan is taken at 0 s, the last before `duration_s`.
    seed : int
        Of people, dwell times, glass, noise and pose error. The same seed gives the same simulation.
    people : int, optional
        How many walk, instead of `world.people.number`; tracks are replayed all the same.
    track : callable, optional
        Takes the numbers of the scans and gives them back one by one: a progress bar.

    Returns
    -------
    Simulation

    Raises
    ------
    WorldError
        A `duration_s` not above 0, or more people than there is room for.

    Examples
    --------
    >>> from tempog.simulation import load_world
    >>> simulation = simulate(load_world("hallway"), duration_s=60.0, people=5)
    >>> len(simulation.scans), simulation.people.shape
    (600, (600, 5, 2))
    """
    from tempog.simulation.floor import plan_floor, start_places
    from tempog.simulation.raycast import cast_beams  # here, so that describing a world needs no Numba
    from tempog.simulation.walking import advance, advance_without_walkers, replay

    if people is not None:
        world = replace(world, people=replace(world.people, number=people))
    duration_s = world.duration_s if duration_s is None else duration_s
    if not 0 < duration_s < np.inf:
        raise WorldError(f"duration_s = {duration_s!r} leaves nothing to simulate; wanted seconds above 0")
    laser, robot, crowd, things = world.laser, world.robot, world.people, world.things
    noise_rng = np.random.default_rng(seed)
    error_rng, people_rng, glass_rng, *thing_rngs = (
        np.random.default_rng(sequence) for sequence in np.random.SeedSequence(seed).spawn(3 + len(things))
    )
    n_scans = int(np.ceil(round(duration_s * laser.rate_hz, 6)))
    t = np.arange(n_scans) / laser.rate_hz
    n_steps = int(np.ceil(round(1.0 / laser.rate_hz / LONGEST_STEP_S, 6)))
    dt = 1.0 / laser.rate_hz / n_steps

    # Things: all their places in one array, all their moves in another.
    place_poses = [pose for thing in things for pose in thing.places.values()]
    place_start = np.cumsum([0, *(len(thing.places) for thing in things)])
    event_t: list[float] = []
    event_place: list[int] = []
    event_stop: list[int] = []
    at = []
    for thing, first, rng in zip(things, place_start[:-1], thing_rngs, strict=True):
        names = list(thing.places)
        for when, place in thing.schedule.moves(names, thing.initial, duration_s, rng):
            event_t.append(when)
            event_place.append(int(first) + names.index(place))
        event_stop.append(len(event_t))
        at.append(int(first) + names.index(thing.initial))
    pose = np.array([*robot.round_trip[0], robot.heading_rad])
    if len(robot.round_trip) > 1:
        (x0, y0), (x1, y1) = robot.round_trip[:2]
        pose[2] = np.arctan2(y1 - y0, x1 - x0)
    corners = np.array([thing.corners(thing.initial) for thing in things]).reshape(-1, 4, 2)
    moving_things = Things(
        rectangles=np.array([thing.rectangle for thing in things]).reshape(-1, 4, 2),
        carried=np.array([thing.kind == "box" for thing in things], dtype=np.uint8),
        move_s=np.array([thing.move_s for thing in things], dtype=np.float64),
        swing_m=np.array([thing.length_m * (thing.kind == "hinged") for thing in things], dtype=np.float64),
        places=np.array(place_poses, dtype=np.float64).reshape(-1, 3),
        event_t=np.array(event_t, dtype=np.float64),
        event_place=np.array(event_place, dtype=np.int32),
        event_stop=np.array(event_stop, dtype=np.int32),
        event_next=np.array([0, *event_stop][: len(things)], dtype=np.int32),
        travel=np.column_stack([at, at, at]).astype(np.int32).reshape(-1, 3),
        fraction=np.ones(len(things)),
        held_s=np.zeros(len(things)),
        corners=corners,
    )
    moving_robot = Robot(
        route=np.array(robot.round_trip),
        drive=np.array([robot.speed_m_s, robot.turn_rad_s, robot.radius_m, robot.stop_m], dtype=np.float64),
        target=np.array([1 % len(robot.round_trip)], dtype=np.int32),
        pose=pose,
    )

    solid = np.concatenate([np.empty((0, 4)), *(outline(corners) for _, corners in world.solids)])
    walls, panes = np.split(solid, [len(solid) - 4 * len(world.glass)])
    n, n_people = crowd.number, crowd.number + len(crowd.tracks)
    where = np.full((n_people, 2), FAR_M)
    floor = None
    if n:
        room = Room(world)
        floor = plan_floor(world, room, people_rng)
        where[:n] = start_places(world, room, corners, people_rng)
    traits = np.column_stack([people_rng.uniform(*crowd.speed_m_s, n), people_rng.uniform(*crowd.turn_rate_hz, n)])
    mind = np.zeros((n, 7))
    mind[:, 0] = people_rng.uniform(-np.pi, np.pi, n)
    moving_people = People(
        where=where,
        mind=mind,
        traits=traits,
        goal=people_rng.integers(0, len(floor.goals) if floor else 1, n).astype(np.int32),
        radius=float(crowd.radius_m),
        pause_mean_s=float(crowd.pause_s),
    )
    stops = np.cumsum([len(track.samples) for track in crowd.tracks]).astype(np.int32)
    tracks = Tracks(
        samples=np.concatenate([np.empty((0, 3)), *(track.samples for track in crowd.tracks)]),
        stop=stops,
        next=np.array([0, *stops][: len(stops)], dtype=np.int32),
        velocity=np.zeros((len(stops), 2)),
    )

    segments = np.concatenate([walls, np.zeros((4 * len(things), 4)), panes])
    things_at = slice(len(walls), len(walls) + 4 * len(things))
    passes = np.zeros((len(world.glass), laser.n_beams), dtype=np.uint8)
    pass_share = np.array([[pane.pass_share] for pane in world.glass]).reshape(-1, 1)
    ends = np.array([(pane.start, pane.end) for pane in world.glass]).reshape(-1, 2, 2)
    along = np.arctan2(*(ends[:, 1] - ends[:, 0]).T[::-1])[:, None]
    seen_within_rad = np.radians([pane.seen_within_deg for pane in world.glass]).reshape(-1, 1)
    least_square = np.where(seen_within_rad < np.pi / 2, np.cos(seen_within_rad), 0.0)
    legs = Legs(n_people, crowd.radius_m) if crowd.legs else None
    all_legs = np.empty((n_scans, n_people, 2, 2)) if crowd.legs else None
    discs = np.full((n_people, 3), crowd.radius_m) if legs is None else np.full((2 * n_people, 3), LEG_RADIUS_M)
    kinds = np.full(len(segments) + len(discs) + 1, Hit.NOTHING, dtype=np.uint8)  # the last is for the id NOTHING
    owner = np.full(len(kinds), -1, dtype=np.int16)
    kinds[: len(walls)] = Hit.WALL
    for k, thing in enumerate(things):
        faces = slice(len(walls) + 4 * k, len(walls) + 4 * k + 4)
        kinds[faces] = Hit.BOX if thing.kind == "box" else Hit.DOOR
        owner[faces] = k
    kinds[things_at.stop : len(segments)] = Hit.GLASS
    kinds[len(segments) : -1] = Hit.PERSON

    poses, sweep_ends = np.empty((n_scans, 3)), np.empty((n_scans, 3))
    positions = np.empty((n_scans, n_people, 2))
    all_corners = np.empty((n_scans, len(things), 4, 2))
    places = np.empty((n_scans, len(things)), dtype=np.int16)
    distances = np.empty((n_scans, laser.n_beams))
    ids = np.empty((n_scans, laser.n_beams), dtype=np.int32)
    epoch = np.zeros(2, dtype=np.int32)
    replay(0.0, dt, tracks, moving_people)
    for i in track(range(n_scans)) if track else range(n_scans):
        poses[i] = pose
        positions[i] = np.where(where < FAR_M / 2, where, np.nan)
        all_corners[i] = np.where(corners < FAR_M / 2, corners, np.nan)
        places[i] = np.where(moving_things.fraction >= 1.0, moving_things.travel[:, 1] - place_start[:-1], MOVING)
        segments[things_at, :2] = all_corners[i].reshape(-1, 2)
        segments[things_at, 2:] = np.roll(all_corners[i], -1, axis=1).reshape(-1, 2)
        if legs is None or all_legs is None:
            discs[:, :2] = positions[i]
        else:
            all_legs[i] = legs.step(positions[i])
            discs[:, :2] = all_legs[i].reshape(-1, 2)
        if floor is None:
            advance_without_walkers(t[i], dt, n_steps, moving_things, moving_robot, moving_people, tracks, epoch)
        else:
            advance(t[i], dt, n_steps, people_rng, solid, moving_things, moving_robot, moving_people, tracks, floor)
        sweep_ends[i] = poses[i]
        if laser.sweep_s:
            sweep_ends[i] += turned(pose - poses[i]) * laser.sweep_s * laser.rate_hz
        starts, angles = beams_of(laser, poses[i], sweep_ends[i])
        if len(passes):
            passes[:] = glass_rng.random(passes.shape) < pass_share
            passes |= abs(np.sin(angles - along)) < least_square
        cast_beams(
            starts[:, 0],
            starts[:, 1],
            angles,
            segments,
            discs,
            passes,
            float(laser.max_range_m),
            distances[i],
            ids[i],
        )

    told = poses + pose_errors(world.pose_error, t, error_rng)
    return Simulation(
        world=world,
        duration_s=float(duration_s),
        scans=take_scans(laser, t, told, distances, noise_rng),
        t=t,
        poses=poses,
        sweep_ends=sweep_ends,
        distances=distances,
        hits=kinds[ids],
        hit_things=owner[ids],
        places=places,
        corners=all_corners,
        people=positions,
        legs=all_legs,
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


def pose_errors(error: PoseError, t: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """What poses are off by, (n_scans, 3): white noise, plus a drift that forgets itself in `drift_s`."""
    white = rng.normal(size=(len(t), 3)) * (error.white_m, error.white_m, error.white_rad)
    kicks = rng.normal(size=(len(t), 3))
    kept = np.exp(-np.diff(t, prepend=t[0]) / error.drift_s)
    drift = np.empty_like(kicks)
    state = kicks[0]
    for i in range(len(t)):
        state = kept[i] * state + np.sqrt(1.0 - kept[i] ** 2) * kicks[i]
        drift[i] = state
    return white + drift * (error.drift_m, error.drift_m, error.drift_rad)
