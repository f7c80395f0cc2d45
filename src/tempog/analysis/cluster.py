"""A Dask cluster that works out parts of an analysis: of processes on this machine, or one that is running somewhere.

What is sent with a task is all that it takes; the scheduler keeps it until the task is done, so that what a lost
worker had begun is done by another.
"""

from __future__ import annotations

import pickle
import re
import time
import uuid
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from queue import Empty, SimpleQueue
from threading import Thread
from typing import TYPE_CHECKING, Any, TypeVar

from tempog._version import __version__
from tempog.errors import ClusterError, ConfigError

if TYPE_CHECKING:
    from distributed import Client, Future

CONNECT_S = 5.0  # a scheduler that is there answers within milliseconds
GRACE_S = 1.0  # for Dask to notice by itself
FIRST_WORKER_S = 10.0  # workers that were just started import first
WITHOUT_WORKERS_S = 60.0  # a worker that died is started again within seconds; who waits longer waits for nobody
ASK_EVERY_S = 2.0  # how often to see whether there is still anybody, while no task gets done
TASKS_PER_THREAD = 3  # on their way: one that runs, one that waits there, one that is being sent
BYTES_ON_THEIR_WAY = 2**29  # 512 MB; the client and the scheduler hold these tasks
MOST_PROCESSES = 999
LOCAL = re.compile(r"local:([1-9][0-9]{0,2})")
ADDRESS = re.compile(r"(tcp|tls)://(\[[0-9a-fA-F:.%]+\]|[^\s:/\[\]]+):([0-9]{1,5})")
INSTALL = "pip install 'tempog[cluster]'"

T = TypeVar("T")
U = TypeVar("U")
Progress = Callable[[str, int, int], None]
"""Told what is being worked out, how much of it is done, and how much there is."""


def check_cluster(text: str) -> str:
    """The text if it names a cluster.

    Raises
    ------
    ConfigError
        It names none.

    Examples
    --------
    >>> check_cluster("local:2"), check_cluster("tcp://127.0.0.1:8786")
    ('local:2', 'tcp://127.0.0.1:8786')
    """
    address = ADDRESS.fullmatch(text)
    if LOCAL.fullmatch(text) or (address and 0 < int(address[3]) < 2**16):
        return text
    raise ConfigError(
        f"{text!r} names no cluster; wanted local:N for N processes on this machine, 1 to {MOST_PROCESSES}, or"
        " tcp://HOST:PORT of a running Dask scheduler"
    )


class DaskWorkers:
    """Workers of a Dask cluster, see `tempog.analysis.evidence.elsewhere.Workers`.

    Parameters
    ----------
    client : distributed.Client
        Connected, and not asynchronous.
    progress : callable, optional

    Raises
    ------
    ClusterError
        No worker within `FIRST_WORKER_S`, or one with another version of tempog, or without.
    """

    def __init__(self, client: Client, progress: Progress | None = None) -> None:
        self.client = client
        self._progress = progress
        self._run = uuid.uuid4().hex
        try:
            client.wait_for_workers(1, timeout=FIRST_WORKER_S)
        except TimeoutError:
            raise ClusterError(
                f"the Dask scheduler at {self._address} has no workers; start some: dask worker {self._address}"
            ) from None
        self._check_versions()

    def each(self, what: str, work: Callable[[T], U], items: Iterable[T], n_items: int) -> list[U]:
        """``[work(item) for item in items]``, on any worker and in any order; few items are held at a time.

        Raises
        ------
        ClusterError
            The scheduler is gone, or all workers for `WITHOUT_WORKERS_S`, or several died of one item.
        """
        answers: dict[int, U] = {}
        on_their_way: dict[Future[bytes], tuple[int, int]] = {}
        done: SimpleQueue[Future[bytes]] = SimpleQueue()
        n_bytes = 0
        n_most = TASKS_PER_THREAD * max(1, self._n_threads())

        def take() -> int:
            future = self._next(done)
            k, n_sent = on_their_way.pop(future)
            answers[k] = unpacked(self._result(future))
            if self._progress is not None:
                self._progress(what, len(answers), n_items)
            return n_sent

        try:
            for k, item in enumerate(items):
                sent = packed((work, item))
                while on_their_way and (len(on_their_way) >= n_most or n_bytes + len(sent) > BYTES_ON_THEIR_WAY):
                    n_bytes -= take()
                future = self._send(f"{what} {k}", sent)
                on_their_way[future] = (k, len(sent))
                n_bytes += len(sent)
                future.add_done_callback(done.put)
            while on_their_way:
                take()
        finally:
            if on_their_way:
                self.client.cancel(list(on_their_way))
        return [answers[k] for k in range(len(answers))]

    @property
    def _address(self) -> str:
        return str(self.client.scheduler.address) if self.client.scheduler else "an unknown address"

    def _send(self, name: str, sent: bytes) -> Future[bytes]:
        import dask

        # Dask would rather have data loaded by workers; what a lost worker held would be lost then.
        with dask.config.set({"distributed.admin.large-graph-warning-threshold": 2 * BYTES_ON_THEIR_WAY}):
            return self.client.submit(_worker_side(), sent, key=f"tempog {name} {self._run}", pure=False)

    def _next(self, done: SimpleQueue[Future[bytes]]) -> Future[bytes]:
        """The next task that gets done, one way or the other."""
        since = time.monotonic()
        while True:
            with suppress(Empty):
                return done.get(timeout=ASK_EVERY_S)
            if self._n_threads():
                since = time.monotonic()
            elif time.monotonic() - since > WITHOUT_WORKERS_S:
                raise ClusterError(
                    f"the Dask scheduler at {self._address} has had no workers for {WITHOUT_WORKERS_S:.0f} s; start"
                    " some, and run this again"
                )

    def _n_threads(self) -> int:
        """Of all workers."""
        if self.client.status != "running":
            raise self._lost()
        try:
            return sum(self.client.nthreads().values())
        except OSError:
            raise self._lost() from None

    def _result(self, future: Future[bytes]) -> bytes:
        from distributed import CancelledError, KilledWorker

        try:
            answer: bytes = future.result()
        except KilledWorker as error:
            raise ClusterError(
                f"workers died of the same part of the map, one after the other, at last {error.last_worker.address}:"
                " probably it takes more memory than they have; give each more of it, or analyse a shorter period"
            ) from None
        except ModuleNotFoundError as error:
            raise ClusterError(
                f"a worker that came later has no module {error.name}; install tempog {__version__} there as well"
            ) from None
        except (CancelledError, OSError):
            raise self._lost() from None
        return answer

    def _lost(self) -> ClusterError:
        return ClusterError(f"the Dask scheduler at {self._address} is gone; start it, and run this again")

    def _check_versions(self) -> None:
        def version() -> str:  # sent as code: tempog may not be there
            try:
                from tempog._version import __version__ as here
            except ImportError:
                return "no tempog"
            return f"tempog {here}"

        for worker, there in self.client.run(version).items():
            if there != f"tempog {__version__}":
                raise ClusterError(
                    f"the worker at {worker} has {there}, but here is tempog {__version__}; install the same there"
                )


@contextmanager
def dask_workers(cluster: Client | str, progress: Progress | None = None) -> Iterator[DaskWorkers]:
    """Workers of a cluster, for a while.

    Parameters
    ----------
    cluster : distributed.Client or str
        A client is left as it is. ``"local:2"`` starts two processes and ends them afterwards; they listen on
        127.0.0.1 alone. ``"tcp://host:8786"`` connects to a running scheduler, and disconnects.
    progress : callable, optional

    Raises
    ------
    ConfigError
        `cluster` is neither.
    ClusterError
        Dask is not installed, no scheduler answers within `CONNECT_S`, no worker is there within `FIRST_WORKER_S`, or
        the workers have another tempog.
    """
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise ClusterError(f"a cluster needs Dask, and {error.name} is not installed: {INSTALL}") from None
    connected: AbstractContextManager[Client]
    if isinstance(cluster, Client):
        if cluster.asynchronous:
            raise ConfigError("cluster is an asynchronous client; wanted Client(..., asynchronous=False)")
        connected = nullcontext(cluster)
    elif not isinstance(cluster, str):
        raise ConfigError(
            f"cluster is a {type(cluster).__name__}; wanted a distributed.Client or text like 'local:2'"
        )
    else:
        local = LOCAL.fullmatch(check_cluster(cluster))
        connected = _local(int(local[1])) if local else _remote(cluster)
    with connected as client:
        yield DaskWorkers(client, progress)


@contextmanager
def _local(n_processes: int) -> Iterator[Client]:
    import logging

    from distributed import Client, LocalCluster

    with (
        LocalCluster(
            n_workers=n_processes,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address=None,
            scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},  # not 8787, which may be taken
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        yield client


@contextmanager
def _remote(address: str) -> Iterator[Client]:
    from distributed import Client

    answer: SimpleQueue[Client | Exception] = SimpleQueue()

    def connect() -> None:
        try:
            answer.put(Client(address, timeout=CONNECT_S, set_as_default=False))
        except Exception as error:  # whatever it is that listens there may answer anything
            answer.put(error)

    Thread(target=connect, daemon=True).start()  # Dask itself would wait for ever for one that is silent
    try:
        client = answer.get(timeout=CONNECT_S + GRACE_S)
    except Empty:
        client = TimeoutError("what listens there says nothing")
    if isinstance(client, Exception):
        raise ClusterError(
            f"no Dask scheduler answers at {address} ({type(client).__name__}: {client}); start one there with: dask"
            " scheduler"
        )
    with client:
        yield client


def packed(what: object) -> bytes:
    """Something pickled and compressed: over half of the bytes are saved, in less time than a local socket takes."""
    import pyarrow

    plain = pickle.dumps(what, protocol=pickle.HIGHEST_PROTOCOL)
    return pickle.dumps((len(plain), pyarrow.compress(plain, codec="lz4", asbytes=True)))


def unpacked(sent: bytes) -> Any:
    """What was packed."""
    import pyarrow

    size, compressed = pickle.loads(sent)
    return pickle.loads(pyarrow.decompress(compressed, size, codec="lz4"))


def _worker_side() -> Callable[[bytes], bytes]:
    """What workers run. A function within a function is sent as code: the scheduler loads it, and may lack tempog."""

    def work_out(sent: bytes) -> bytes:
        from tempog.analysis.cluster import packed, unpacked

        work, item = unpacked(sent)  # arrays that Dask itself sent would be read-only: kernels compiled once more
        return packed(work(item))

    return work_out
