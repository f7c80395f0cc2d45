"""Serving the viewer: on a socket of its own, until it is told to stop."""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
import threading
from collections.abc import Callable
from datetime import UTC, tzinfo
from types import TracebackType
from typing import Any, Self, cast

from tempog._extras import need
from tempog.errors import ConfigError, TempogError
from tempog.methods import Method

need("uvicorn", extra="view")
need("starlette", extra="view")

from uvicorn import Config, Server  # noqa: E402
from uvicorn.protocols.http.h11_impl import H11Protocol  # noqa: E402

from tempog.views.web.app import make_app  # noqa: E402
from tempog.views.web.guard import Guard, is_loopback, new_token  # noqa: E402
from tempog.views.web.model import Model  # noqa: E402
from tempog.views.web.sources import Source  # noqa: E402

REQUEST_S = 10.0  # for a request's head to arrive
KEPT_S = 15  # that a connection may be idle between two requests
ANSWER_S = 60.0  # for a client to take in what was written
STOP_S = 2  # for answers to be finished once told to stop
MOST_CONNECTIONS = 256
MOST_HEAD_BYTES = 16 * 2**10
TRIED_PORTS = 20  # that follow one that is in use


class Patient(H11Protocol):  # type: ignore[misc, unused-ignore]
    """HTTP for clients that may be slow, but not for ever."""

    def connection_made(self, transport: Any) -> None:
        """Wait for a request's head, but not for ever."""
        super().connection_made(transport)
        self._due: asyncio.TimerHandle | None = None
        self._stuck: asyncio.TimerHandle | None = None
        self._expect()

    def data_received(self, data: bytes) -> None:
        """Go on waiting until the head is there."""
        super().data_received(data)
        if self.cycle is None or self.cycle.response_complete:
            self._expect()
        elif self._due is not None:
            self._due.cancel()
            self._due = None

    def on_response_complete(self) -> None:
        """Wait for the next request's head."""
        super().on_response_complete()
        if self._due is not None:
            self._due.cancel()
            self._due = None

    def pause_writing(self) -> None:
        """The client does not read: wait for it, but not for ever."""
        super().pause_writing()
        if self._stuck is None:
            self._stuck = self.loop.call_later(ANSWER_S, self.transport.abort)

    def resume_writing(self) -> None:
        """The client reads again."""
        super().resume_writing()
        if self._stuck is not None:
            self._stuck.cancel()
            self._stuck = None

    def connection_lost(self, error: Exception | None) -> None:
        """Nobody is waited for any more."""
        for timer in (self._due, self._stuck):
            if timer is not None:
                timer.cancel()
        super().connection_lost(error)

    def _expect(self) -> None:
        if self._due is None:
            self._due = self.loop.call_later(REQUEST_S, self._give_up)

    def _give_up(self) -> None:
        self._due = None
        if self.cycle is None or self.cycle.response_complete:
            self.transport.close()


class PromptServer(Server):  # type: ignore[misc, unused-ignore]
    """A server that ends at once while pages listen to it."""

    def __init__(self, config: Config, stopping: asyncio.Event) -> None:
        super().__init__(config)
        self._stopping = stopping

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Tell who listens that it is over, and cut off without a word what is not finished in time."""
        self._stopping.set()
        log = logging.getLogger("uvicorn.error")
        level = log.level
        log.setLevel(logging.CRITICAL)  # else each answer that is cut off leaves a traceback
        try:
            await super().shutdown(sockets)
        finally:
            log.setLevel(level)


class Viewer:
    """A map's viewer, served over HTTP.

    Parameters
    ----------
    source : Source
    host : str
        What to bind to. On others than loopback, a token is asked for.
    port : int
        0 for any that is free.
    search : bool
        Whether to take one of the next ports if this one is in use.
    method : "evidence", "paper" or "paper-tuned"
        How objects are found.
    zone : tzinfo
        In which hours and weekdays are told.

    Raises
    ------
    ConfigError
        Nothing can be bound to the host and port.
    ExtraError
        Starlette or Uvicorn is missing.

    Attributes
    ----------
    port : int
    token : str, optional
    """

    def __init__(
        self,
        source: Source,
        host: str = "127.0.0.1",
        port: int = 8765,
        *,
        search: bool = False,
        method: Method = "evidence",
        zone: tzinfo = UTC,
    ) -> None:
        self._socket = bound_socket(host, port, search)
        try:
            self.host, self.port = host, int(self._socket.getsockname()[1])
            self.token = None if is_loopback(host) else new_token()
            self.model = Model(source, method)
            app = make_app(self.model, zone)
            guarded = Guard(app, host, self.port, self.token)
            config = Config(
                guarded,
                http=Patient,
                ws="none",
                lifespan="on",
                log_config=None,
                log_level="error",
                access_log=False,
                server_header=False,
                proxy_headers=False,
                timeout_keep_alive=KEPT_S,
                timeout_graceful_shutdown=STOP_S,
                limit_concurrency=MOST_CONNECTIONS,
                h11_max_incomplete_event_size=MOST_HEAD_BYTES,
                backlog=128,
            )
            self._server = PromptServer(config, app.state.site.stopping)
        except BaseException:
            self._socket.close()
            raise
        self._thread: threading.Thread | None = None

    @property
    def url(self) -> str:
        """What to open in a browser; with the token, if there is one."""
        name = f"[{self.host}]" if ":" in self.host else self.host
        if self.host in ("0.0.0.0", "::", ""):
            name = socket.gethostname()
        return f"http://{name}:{self.port}/" + (f"?token={self.token}" if self.token else "")

    def run(self, when_ready: Callable[[], None] | None = None) -> None:
        """Serve until Ctrl-C, or until `stop` is called.

        Parameters
        ----------
        when_ready : callable, optional
            Called once requests are answered.
        """
        if when_ready is not None:
            threading.Thread(target=self._tell, args=[when_ready], daemon=True).start()
        try:
            self._server.run(sockets=[self._socket])
        except KeyboardInterrupt:
            pass
        finally:
            self._socket.close()

    def _tell(self, when_ready: Callable[[], None]) -> None:
        if self._wait_until_started():
            when_ready()

    def _wait_until_started(self) -> bool:
        pause = threading.Event()
        while not self._server.started:
            if self._server.should_exit or (self._thread is not None and not self._thread.is_alive()):
                return False
            pause.wait(0.02)
        return True

    def start(self) -> Self:
        """Serve in a thread; returns once requests are answered."""
        self._thread = threading.Thread(target=self.run, name="tempog view", daemon=True)
        self._thread.start()
        if not self._wait_until_started():
            raise TempogError(f"the viewer could not be started on {self.host}, port {self.port}")
        return self

    def stop(self) -> None:
        """End, and wait for that."""
        self._server.should_exit = True
        if self._thread is not None:
            self._thread.join(STOP_S + 10.0)

    def __enter__(self) -> Self:
        return self if self._thread is not None else self.start()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()


def serve_in_thread(
    source: Source,
    host: str = "127.0.0.1",
    port: int = 8765,
    *,
    search: bool = False,
    method: Method = "evidence",
    zone: tzinfo = UTC,
) -> Viewer:
    """Serve a map beside whatever else the process does: beside a robot's mapping, for example.

    Parameters
    ----------
    source, host, port, search, method, zone
        See `Viewer`.

    Returns
    -------
    Viewer
        With its `url`; call its `stop` at the end, or use it in a ``with`` statement.

    Examples
    --------
    >>> import json, urllib.request
    >>> from tempog import build_grid
    >>> from tempog.simulation import corridor, simulate
    >>> from tempog.views.web.sources import HistorySource
    >>> grid = build_grid(simulate(corridor(), duration_s=5.0).scans)
    >>> with serve_in_thread(HistorySource(grid, "corridor"), port=0) as viewer:
    ...     answer = json.load(urllib.request.urlopen(viewer.url + "api/map"))
    >>> answer["name"], answer["n_scans"]
    ('corridor', 50)
    """
    return Viewer(source, host, port, search=search, method=method, zone=zone).start()


def bound_socket(host: str, port: int, search: bool) -> socket.socket:
    """A socket that is bound to a port, or to one of the next if it is in use; ConfigError if it cannot be."""
    ports = range(port, min(port + TRIED_PORTS, 2**16)) if search and port else [port]
    for tried in ports:
        try:
            family, kind, protocol, _, address = socket.getaddrinfo(
                host or None, tried, type=socket.SOCK_STREAM, proto=socket.IPPROTO_TCP, flags=socket.AI_PASSIVE
            )[0]
            opened = socket.socket(family, kind, protocol)  # asyncio sends at once only if it knows that this is TCP
            try:
                opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                opened.bind(cast(Any, address))
                opened.listen(128)
            except BaseException:
                opened.close()
                raise
            return opened
        except OSError as error:
            trouble = error
            if error.errno != errno.EADDRINUSE:
                break
    if trouble.errno == errno.EADDRINUSE:
        raise ConfigError(
            f"port {port} of {host} is in use, perhaps by another viewer; choose another with --port, or 0 for any"
        )
    raise ConfigError(f"nothing can be served on {host}, port {port}: {trouble.strerror or trouble}")
