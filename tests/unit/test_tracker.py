"""Known objects followed scan by scan: against the truth of the corridor, and by hand."""

from __future__ import annotations

import numpy as np
import pytest

from tempog import ObjectTracker, Scan, build_grid, find_objects
from tempog.errors import ConfigError, ScanError
from tempog.simulation import Hit, corridor, simulate


@pytest.fixture(scope="module")
def driven():
    simulation = simulate(corridor(seed=1), seed=1)
    found = find_objects(build_grid(simulation.scans))
    tracker = ObjectTracker(found)
    events, moving = [], []
    for scan in simulation.scans:
        events += tracker.update(scan)
        moving.append(tracker.high_dynamic)
    return simulation, found, tracker, events, moving


def test_every_event_is_true_and_every_change_in_sight_is_an_event(driven) -> None:
    simulation, found, tracker, events, _ = driven
    (door,) = found.objects
    closed, opened = door.configurations
    true = simulation.states(simulation.world.things[0].name)
    times = np.array([t for t, _ in true])
    for event in events:
        assert event.object_id == door.id
        t = event.stamp_ns / 1e9
        state = true[int(np.searchsorted(times, t, side="right")) - 1][1]
        is_there = {closed.id: "closed", opened.id: "open"}[event.configuration_id]
        assert (state == is_there) == (event.state == "occupied"), (t, event, state)
        assert event.confidence > 0.5
    # The door moves six times, the last three in sight.
    of_closed = [event.state for event in events if event.configuration_id == closed.id]
    assert of_closed == ["occupied", "free", "occupied", "free", "occupied", "free", "occupied"]
    in_sight = [t for t, state in true[-6:] if state != "moving"]
    told = [event.stamp_ns / 1e9 for event in events if event.configuration_id == closed.id][-3:]
    assert all(0 <= late <= 2.5 for late in np.subtract(told, in_sight)), (told, in_sight)
    assert tracker.where(door.id) == closed.id
    assert tracker.last_seen_ns(closed.id) <= int(simulation.scans[-1].stamp_ns)


def test_the_person_is_on_the_move_and_little_else(driven) -> None:
    simulation, _, _, _, moving = driven
    at_person = others = seen = missed = 0
    for k in range(300, len(moving)):
        person = simulation.people[k, 0]
        apart = np.hypot(*(moving[k].points_map - person).T)
        at_person += int((apart <= 0.25 + 0.1).sum())
        others += int((apart > 0.25 + 0.1).sum())
        n_hits = int((simulation.hits[k] == Hit.PERSON).sum())
        if n_hits >= 3:
            seen += 1
            missed += not (apart <= 0.35).any()
    assert seen > 500
    assert missed <= 0.02 * seen
    assert others <= 0.1 * at_person


def test_memory_grows_with_the_area_and_not_with_time(driven) -> None:
    simulation, found, *_ = driven
    tracker = ObjectTracker(found)
    sizes = []
    for lap in range(2):
        for scan in simulation.scans:
            later_ns = scan.stamp_ns + lap * 200 * 10**9
            tracker.update(
                Scan(0.0, (scan.x, scan.y, scan.theta), scan.angles, scan.ranges, scan.max_range, stamp_ns=later_ns)
            )
        sizes.append((tracker.tiles.n_tiles, tracker.surfaces.nbytes, len(tracker._place)))
    # Noise puts a few hits into cells that had none; nothing else is added.
    assert sizes[1][0] <= sizes[0][0] + 2
    assert sizes[1][1] <= 1.6 * sizes[0][1]


def test_what_is_not_confirmed_is_no_event(driven) -> None:
    simulation, found, *_ = driven
    hasty, patient = ObjectTracker(found, confirm_s=0.0), ObjectTracker(found, confirm_s=1000.0)
    scans = simulation.scans[:300]
    assert any(hasty.update(scan) for scan in scans)
    assert not any(patient.update(scan) for scan in scans)
    assert patient.where(found.objects[0].id) is None
    with pytest.raises(ScanError, match="time order"):
        hasty.update(scans[0])
    for wrong in (-1.0, float("nan"), 1e9):
        with pytest.raises(ConfigError, match="confirm_s"):
            ObjectTracker(found, confirm_s=wrong)
    for ask in (hasty.where, hasty.state, hasty.last_seen_ns):
        with pytest.raises(ConfigError, match="there is no"):
            ask(99)


def test_a_tracker_drives_into_what_the_map_does_not_have(driven) -> None:
    _, found, *_ = driven
    tracker = ObjectTracker(found)
    far = Scan(1.0, (200.0, 50.0, 0.0), np.linspace(-1, 1, 30), np.full(30, 3.0))
    assert tracker.update(far) == []
    assert len(tracker.high_dynamic.cells) > 20  # whatever it is, the map knows nothing of it
