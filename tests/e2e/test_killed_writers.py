"""Processes that are killed while they write a map, at random moments and at every step that changes a file."""

from __future__ import annotations

import itertools
import os
import random
import shutil
import time
from pathlib import Path

import pytest

from same_history import CONFIG, assert_same, debris, grid_of, room_scans
from tempog import LiveMap, TemporalGrid, open_map
from tempog.scans.npz import write_npz
from tempog.store.manifest import read_manifest
from tempog.store.saved_map import save_map
from victims import Victims, acknowledged, wait_for

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="children are forked")

N_SCANS = 90
SCANS = room_scans(N_SCANS)
LATER = room_scans(12, start_s=1000.0, seed=3)


@pytest.fixture(scope="module")
def victims():
    victims = Victims()
    yield victims
    victims.close()


@pytest.fixture
def root(quick_path):
    return quick_path / "map"


@pytest.fixture
def acks(quick_path):
    return quick_path / "acks"


def check_what_is_left(root: Path, n_acknowledged: int, earlier: list = (), journaled: bool = True) -> int:
    """Every acknowledged scan is there, all answers are right, and mapping goes on; returns how many scans there are.

    At most one more is there: that which was written but not yet said to be.
    """
    n_committed = read_manifest(root).n_scans
    opened = open_map(root)
    n = opened.n_scans - len(earlier)
    assert n_acknowledged <= n <= n_acknowledged + 1
    held = [*earlier, *SCANS[:n]]
    if held:
        assert_same(opened, grid_of(held))
    if opened.n_scans > n_committed:
        (note,) = [note for note in opened.repaired if "never closed" in note]
        assert f"{opened.n_scans - n_committed} of its scans" in note
    left = debris(root)
    assert left == [] or not journaled  # then the next writer removes it
    again = open_map(root)
    assert (again.n_scans, again.repaired) == (len(held), [])
    with LiveMap(root, CONFIG, flush_s=0.4) as live:
        assert [name for name in left if name not in str(live.repaired)] == []
        assert bool(live.repaired) == bool(left)
        for scan in LATER:
            live.integrate(scan)
        assert_same(live, grid_of([*held, *LATER]))
    assert_same(open_map(root), grid_of([*held, *LATER]))
    assert debris(root) == []
    return n


def kill_at_random(victims, root, acks, seed) -> None:
    chance = random.Random(seed)
    pid = victims.start("live", path=str(root), acks=str(acks), n_scans=N_SCANS)
    wait_for(acks, chance.randint(1, N_SCANS - 1))
    time.sleep(chance.uniform(0, 0.01))
    code = victims.kill(pid)
    assert code in (-9, 0)
    check_what_is_left(root, acknowledged(acks))


@pytest.mark.parametrize("seed", range(3))
def test_a_killed_writer_loses_nothing(victims, root, acks, seed):
    kill_at_random(victims, root, acks, seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3, 73))
def test_a_killed_writer_loses_nothing_at_any_moment(victims, root, acks, seed):
    kill_at_random(victims, root, acks, seed)


def test_a_map_that_was_hardly_begun_is_opened_or_made_again(victims, root, acks):
    for k in range(6):
        pid = victims.start("live", path=str(root), acks=str(acks), n_scans=N_SCANS)
        time.sleep(0.004 * k)
        victims.kill(pid)
        if root.exists():
            check_what_is_left(root, acknowledged(acks))
        else:
            assert acknowledged(acks) == 0
        clear(root, acks)


def clear(root, acks) -> None:
    """Remove a map, and what was to become it when its maker died, which lies hidden beside it."""
    for folder in (root, *root.parent.glob(f".{root.name}.*.unfinished")):
        shutil.rmtree(folder, ignore_errors=True)
    acks.unlink(missing_ok=True)


def steps_of(victims, job, make, root, chosen):
    """Let a child die at the chosen ones of its steps, each time with what `make` makes; yields after each death."""
    for step in itertools.count(1):
        if step not in chosen and not step > max(chosen):
            continue
        make()
        code = victims.run(**job, die_at=step)
        assert code in (0, 9), step
        yield step, code
        if code == 0:
            return


EVERY = range(1, 10**6)
EVERY_THIRD = range(1, 10**6, 3)  # of a few hundred
SOME = pytest.param([2, 3, 9, 14, 30, 47, 10**6], id="some")
THIRD = pytest.param(EVERY_THIRD, id="third", marks=pytest.mark.slow)
ALL = pytest.param(EVERY, id="all", marks=pytest.mark.slow)


@pytest.mark.parametrize("chosen", [SOME, THIRD])
def test_a_writer_that_dies_at_a_step_loses_nothing(victims, root, acks, chosen):
    def make():
        clear(root, acks)

    job = {"job": "live", "path": str(root), "acks": str(acks), "n_scans": 14}
    n_deaths = 0
    for _, code in steps_of(victims, job, make, root, chosen):
        n_deaths += code != 0
        if (root / "map.json").exists():
            check_what_is_left(root, acknowledged(acks))
        else:
            assert acknowledged(acks) == 0
    assert n_deaths > (40 if chosen is EVERY_THIRD else 4)


@pytest.mark.parametrize("chosen", [SOME, ALL])
def test_a_repair_that_dies_at_a_step_is_made_good_by_the_next(victims, root, quick_path, chosen):
    crashed = quick_path / "crashed"
    live = LiveMap(crashed, CONFIG, flush_s=1.0)
    for scan in SCANS[:35]:
        live.integrate(scan)
    live.abandon()
    (crashed / "segments" / "0000000030-half").mkdir()
    (crashed / "segments" / "0000000030-half" / "scans.parquet").write_bytes(b"PAR1")
    n_committed = read_manifest(crashed).n_scans
    assert 0 < n_committed < 35

    def make():
        shutil.rmtree(root, ignore_errors=True)
        shutil.copytree(crashed, root)

    n_deaths = 0
    for _, code in steps_of(victims, {"job": "reopen", "path": str(root)}, make, root, chosen):
        n_deaths += code != 0
        assert read_manifest(root).n_scans in (n_committed, 35)
        check_what_is_left(root, 35)
    assert n_deaths > (15 if chosen is EVERY else 3)


@pytest.mark.parametrize("chosen", [SOME, ALL])
def test_a_log_that_is_appended_is_there_whole_or_not_at_all(victims, root, quick_path, chosen):
    log = quick_path / "log.npz"
    write_npz(log, SCANS[:50])
    earlier = room_scans(20, start_s=1.0, seed=5)
    before = quick_path / "before"
    save_map(grid_of(earlier), before)

    def make():
        shutil.rmtree(root, ignore_errors=True)
        shutil.copytree(before, root)

    seen = set()
    job = {"job": "append", "log": str(log), "path": str(root)}
    for _, code in steps_of(victims, job, make, root, chosen):
        n = open_map(root).n_scans
        assert n in (20, 70)
        assert code != 0 or n == 70
        seen.add((n, code))
        check_what_is_left(root, n - 20, earlier, journaled=False)
    assert {(20, 9), (70, 0)} <= seen


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_a_killed_append_adds_the_log_whole_or_not_at_all(victims, root, quick_path, seed):
    log = quick_path / "log.npz"
    write_npz(log, SCANS)
    earlier = room_scans(20, start_s=1.0, seed=5)
    save_map(grid_of(earlier), root)
    pid = victims.start("append", log=str(log), path=str(root))
    time.sleep(random.Random(seed).uniform(0, 0.4))
    victims.kill(pid)
    n = open_map(root).n_scans
    assert n in (20, 20 + N_SCANS)
    check_what_is_left(root, n - 20, earlier, journaled=False)


def test_a_log_is_not_appended_to_a_map_that_is_being_written(victims, root, quick_path):
    log = quick_path / "log.npz"
    write_npz(log, LATER)
    with LiveMap(root, CONFIG) as live:
        live.integrate(SCANS[0])
        assert victims.run("append", log=str(log), path=str(root)) == 1
        live.integrate(SCANS[1])
    assert victims.run("append", log=str(log), path=str(root)) == 0
    assert open_map(root).n_scans == 2 + len(LATER)


def test_readers_see_a_prefix_of_the_scans_while_they_are_written(victims, root, acks):
    """Commits, merges and journals come and go meanwhile; no answer is wrong and none is an error."""
    scans = room_scans(240)
    victims.start("live", path=str(root), acks=str(acks), n_scans=len(scans), grace_s=600.0)
    wait_for(acks, 1)
    grid, counts, n_merged = TemporalGrid(CONFIG), [], 0
    while not counts or counts[-1] < len(scans):
        opened = open_map(root)
        counts.append(opened.n_scans)
        assert opened.repaired == []
        assert counts[-1] >= grid.n_scans
        for scan in scans[grid.n_scans : counts[-1]]:
            grid.integrate(scan)
        if grid.n_scans and (len(counts) < 2 or counts[-1] > counts[-2]):
            time.sleep(0.005)  # the segments that it found may be merged by now
            assert_same(opened, grid)
            n_merged = max(n_merged, len(opened.manifest.retired))
    assert victims.end() == 0
    assert len(set(counts)) > 3
    assert n_merged > 0


def test_files_that_may_not_grow_refuse_scans_and_lose_none(victims, root, acks):
    assert victims.run("fill", path=str(root), acks=str(acks), n_scans=30, most_bytes=3000) == 0
    assert acknowledged(acks) > 3
    assert_same(open_map(root), grid_of(SCANS[:30]))
