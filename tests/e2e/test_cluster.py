"""Objects worked out by a Dask cluster of processes on this machine: the same as without, whoever gets lost."""

from __future__ import annotations

import importlib
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
import uuid
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from tempog import build_grid, find_objects, save_map
from tempog.analysis import cluster
from tempog.analysis.cluster import DaskWorkers, check_cluster, dask_workers
from tempog.analysis.find_objects import FoundObjects
from tempog.errors import ClusterError, ConfigError
from tempog.grid.history import History
from tempog.simulation import load_world, simulate

distributed = pytest.importorskip("distributed")
Client, LocalCluster, WorkerPlugin = distributed.Client, distributed.LocalCluster, distributed.WorkerPlugin
NO_PAGES = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}


def started(n_workers: int) -> LocalCluster:
    """Processes of one thread each, as ``local:N`` starts them."""
    return LocalCluster(
        n_workers=n_workers,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address=None,
        scheduler_kwargs=NO_PAGES,
        silence_logs=50,
    )


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    with started(2) as processes, Client(processes, set_as_default=False) as connected:
        yield connected


@pytest.fixture(scope="module")
def rooms() -> History:
    return build_grid(simulate(load_world("rooms"), 240.0, seed=4, people=8).scans)


@pytest.fixture(scope="module")
def rooms_map(rooms: History, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("maps") / "rooms.tempog"
    save_map(rooms, path)
    return path


@pytest.fixture
def tempog(tempog):
    """``tempog objects WORDS...``"""
    return partial(tempog, "objects")


def everything(found: FoundObjects) -> tuple[object, ...]:
    """All that was found, to the last bit."""
    places = [(one.id, one.cells.tobytes(), one.points_map.tobytes(), one.periods) for one in found.configurations]
    document = json.dumps(found.document(), sort_keys=True)
    return found.walls.dtype, found.walls.tobytes(), found.extent, places, document


def test_a_cluster_finds_what_one_process_finds(client: Client, rooms: History) -> None:
    told: list[tuple[str, int, int]] = []
    found = find_objects(rooms, cluster=client, progress=lambda *now: told.append(now))
    assert found.configurations
    assert everything(found) == everything(find_objects(rooms))
    assert [now[1] for now in told if now[0] == "blocks"] == list(range(1, told[0][2] + 1))
    assert {what for what, _, _ in told} >= {"blocks", "groups of cells", "places"}
    window = rooms.window("+10", "+60")
    assert everything(find_objects(window, cluster=client)) == everything(find_objects(window))


@pytest.mark.parametrize("where", ["local:2", "the scheduler that is running"])
def test_the_command_line_writes_the_same_file(
    tempog, client: Client, rooms_map: Path, tmp_path: Path, where: str
) -> None:
    address = where if where == "local:2" else client.scheduler.address
    code, alone, err = tempog(rooms_map, "--json", tmp_path / "alone.json")
    assert (code, err) == (0, "")
    code, together, err = tempog(rooms_map, "--json", tmp_path / "together.json", "--dask", address)
    assert (code, err) == (0, "")
    assert together.replace("together.json", "alone.json") == alone
    assert (tmp_path / "together.json").read_bytes() == (tmp_path / "alone.json").read_bytes()


class SlowBlocks(WorkerPlugin):
    """Every worker, restarted ones too, takes its time for a block, and leaves a note when it begins one."""

    def __init__(self, notes: str) -> None:
        self.notes = notes

    def setup(self, worker: object) -> None:
        from tempog.analysis.evidence import elsewhere

        real = elsewhere.look_at_block

        def slow(courses, rows, cols, own, *given):
            note = Path(self.notes, f"{uuid.uuid4().hex}.new")
            note.write_text(json.dumps([os.getpid(), int(rows[own][0]), int(cols[own][0])]))
            note.rename(note.with_suffix(".json"))
            time.sleep(0.5)
            return real(courses, rows, cols, own, *given)

        elsewhere.look_at_block = slow


def test_a_worker_that_is_killed_in_the_middle_of_a_block_changes_nothing(rooms: History, tmp_path: Path) -> None:
    killed: list[list[int]] = []

    def notes() -> list[list[int]]:
        return [json.loads(path.read_text()) for path in sorted(tmp_path.glob("*.json"), key=os.path.getmtime)]

    def kill_one_that_is_busy() -> None:
        while len(begun := notes()) < 4:
            time.sleep(0.01)
        killed.append(begun[-1])
        os.kill(begun[-1][0], signal.SIGKILL)

    with started(2) as processes, Client(processes, set_as_default=False) as client:
        client.register_plugin(SlowBlocks(str(tmp_path)))
        before = set(client.run(os.getpid).values())
        killer = threading.Thread(target=kill_one_that_is_busy)
        killer.start()
        found = find_objects(rooms, cluster=client)
        killer.join()
    ((pid, *block),) = killed
    assert pid in before
    by_whom = [one[0] for one in notes() if one[1:] == block]
    assert by_whom[0] == pid  # and another one began it again
    assert len(by_whom) > len([one for one in by_whom if one == pid]) == 1
    assert everything(found) == everything(find_objects(rooms))


def test_few_items_are_on_their_way_at_a_time(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    n_made, n_done, most = 0, 0, 0
    rng = random.Random(0)

    def items() -> Iterator[str]:
        nonlocal n_made, most
        for k in range(40):
            n_made += 1
            most = max(most, n_made - n_done)
            yield str(k) + "".join(rng.choices(" \t\n", k=50_000))

    def progress(what: str, done: int, n_all: int) -> None:
        nonlocal n_done
        n_done = done

    workers = DaskWorkers(client, progress)
    assert workers.each("numbers", int, items(), 40) == list(range(40))
    assert 2 <= most <= 2 * cluster.TASKS_PER_THREAD + 1
    n_made, n_done, most = 0, 0, 0
    monkeypatch.setattr(cluster, "BYTES_ON_THEIR_WAY", 25_000)
    assert workers.each("numbers", int, items(), 40) == list(range(40))
    assert most <= 3
    assert workers.each("nothing", int, [], 0) == []


def test_what_goes_wrong_in_the_work_is_not_hidden(client: Client) -> None:
    with pytest.raises(ValueError, match="invalid literal"):
        DaskWorkers(client).each("numbers", int, ["1", "two", *["3"] * 40], 42)
    assert DaskWorkers(client).each("numbers", int, ["1"], 1) == [1]


class Missing:
    """Is made by importing a module that is nowhere."""

    def __reduce__(self):
        return importlib.import_module, ("no_such_module",)


def test_a_worker_that_lacks_what_it_takes_is_named(client: Client) -> None:
    with pytest.raises(ClusterError, match="has no module no_such_module; install tempog"):
        DaskWorkers(client).each("modules", str, [Missing()], 1)


def test_a_scheduler_needs_no_tempog_to_pass_the_work_on() -> None:
    from distributed.protocol.pickle import dumps

    code = (
        "import pickle, sys; sys.modules['tempog'] = None; work_out = pickle.loads(sys.stdin.buffer.read());"
        " print(callable(work_out))"
    )
    answer = subprocess.run([sys.executable, "-c", code], input=dumps(cluster._worker_side()), capture_output=True)
    assert (answer.stdout.split(), answer.stderr) == ([b"True"], b"")


def test_what_kills_every_worker_is_given_up() -> None:
    with (
        started(1) as processes,
        Client(processes, set_as_default=False) as client,
        pytest.raises(ClusterError, match=r"died of the same part of the map.*more memory than they have"),
    ):
        DaskWorkers(client).each("ends", os._exit, [1], 1)


def test_a_cluster_that_loses_all_workers_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "ASK_EVERY_S", 0.1)
    monkeypatch.setattr(cluster, "WITHOUT_WORKERS_S", 0.5)
    with started(1) as processes, Client(processes, set_as_default=False) as client:
        workers = DaskWorkers(client)
        threading.Timer(0.5, lambda: processes.scale(0)).start()
        with pytest.raises(ClusterError, match="has had no workers for"):
            workers.each("naps", time.sleep, [2.5] * 3, 3)


def test_a_scheduler_that_goes_away_is_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "ASK_EVERY_S", 0.1)
    with started(1) as processes, Client(processes.scheduler_address, set_as_default=False) as client:
        workers = DaskWorkers(client)
        threading.Timer(0.5, processes.close).start()
        with pytest.raises(ClusterError, match="is gone"):
            workers.each("naps", time.sleep, [2.5] * 3, 3)


def test_workers_must_be_there_and_have_the_same_version(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "__version__", "0.0.0")
    with pytest.raises(ClusterError, match=r"has tempog .*, but here is tempog 0\.0\.0; install the same there"):
        DaskWorkers(client)
    monkeypatch.setattr(cluster, "FIRST_WORKER_S", 0.3)
    with (
        started(0) as processes,
        Client(processes, set_as_default=False) as lonely,
        pytest.raises(ClusterError, match="has no workers; start some: dask worker tcp://127"),
    ):
        DaskWorkers(lonely)


def test_what_is_no_cluster_is_refused(tempog, rooms_map: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for wrong in (
        "local",
        "local:0",
        "local:two",
        "local:1000",
        "tcp://a",
        "tcp://a:0",
        "http://a:1",
        "tcp://a:99999",
        "",
    ):
        with pytest.raises(ConfigError, match="names no cluster; wanted local:N"):
            check_cluster(wrong)
        code, out, err = tempog(rooms_map, "--dask", wrong)
        assert (code, out, "--dask: " in err) == (2, "", True)
    assert check_cluster("tls://[::1]:8786") == "tls://[::1]:8786"
    code, _, err = tempog(rooms_map, "--dask", "local:1", "--method", "paper")
    assert (code, "--method evidence only, not with paper" in err) == (2, True)
    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    code, out, err = tempog(rooms_map, "--dask", "tcp://127.0.0.1:1")
    assert (code, out) == (1, "")
    assert "no Dask scheduler answers at tcp://127.0.0.1:1" in err
    monkeypatch.setitem(sys.modules, "distributed", None)
    code, _, err = tempog(rooms_map, "--dask", "local:1")
    assert (code, "pip install 'tempog[cluster]'" in err) == (1, True)


def test_something_silent_at_the_address_is_no_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    import socket

    monkeypatch.setattr(cluster, "CONNECT_S", 0.3)
    monkeypatch.setattr(cluster, "GRACE_S", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(ClusterError, match="no Dask scheduler answers at"), dask_workers(address):
            pass


def test_the_library_refuses_what_it_cannot_use(client: Client, rooms: History) -> None:
    with pytest.raises(ConfigError, match="method paper cannot be worked out by a cluster"):
        find_objects(rooms, "paper", cluster=client)
    with pytest.raises(ConfigError, match=r"cluster is a int; wanted a distributed\.Client or text like 'local:2'"):
        find_objects(rooms, cluster=2)  # type: ignore[arg-type]
