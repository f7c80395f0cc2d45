"""The viewer's routes: what each address answers. All of them only read."""

from __future__ import annotations

import asyncio
import json
import logging
import math
import mimetypes
from collections.abc import AsyncIterator, Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from datetime import UTC, tzinfo
from functools import partial
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any, TypeVar

import anyio
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from tempog.errors import TempogError
from tempog.views.web import answers
from tempog.views.web.blocks import Where
from tempog.views.web.guard import refusal
from tempog.views.web.layers import LAYERS, THEMES
from tempog.views.web.model import Model
from tempog.views.web.openapi import openapi_document
from tempog.views.web.parameters import BadParameterError, Parameters

T = TypeVar("T")

RENDERED_AT_ONCE = 4  # tiles; more wait, and those whose client went away meanwhile are dropped
ANSWERED_AT_ONCE = 4  # other short answers
MOST_TILES = 64  # in one answer
LONG_AT_ONCE = 1  # differences and snapshots
MOST_LISTENERS = 32  # of events
LOOK_EVERY_S = 1.0
HEARTBEAT_S = 10.0
WAIT_S = 60.0  # for what is worked out for the whole map
FOREVER = "public, max-age=31536000, immutable"
_log = logging.getLogger(__name__)
GONE = 499  # nobody reads the answer: the client went away


class Desk:
    """Some threads that answer requests; who comes while all are busy waits.

    Parameters
    ----------
    n_threads : int
    """

    def __init__(self, n_threads: int) -> None:
        self._threads = ThreadPoolExecutor(n_threads)
        self._free = asyncio.Semaphore(n_threads)

    async def answer(self, request: Request, work: Callable[[], T]) -> T:
        """What the work comes to, once it is this request's turn; ClientDisconnect if nobody waits any more."""
        waits = self._free.locked()
        async with self._free:
            if waits and await request.is_disconnected():
                raise ClientDisconnect
            return await asyncio.get_running_loop().run_in_executor(self._threads, work)

    def close(self) -> None:
        """Take no more work."""
        self._threads.shutdown(wait=False, cancel_futures=True)


class Site:
    """The routes, and what they share.

    Parameters
    ----------
    model : Model
    zone : tzinfo
        In which hours and weekdays are told.
    """

    def __init__(self, model: Model, zone: tzinfo = UTC) -> None:
        self.model, self.zone = model, zone
        self.stopping = asyncio.Event()
        self._n_listeners = 0
        self._pages = page_files()
        self._diffs: dict[tuple[Any, ...], dict[str, Any]] = {}
        self._objects: tuple[str, bytes] | None = None

    def routes(self) -> list[Route]:
        """All of them."""
        handlers: dict[str, Callable[[Request], Awaitable[Response]]] = {
            "/": self.page,
            "/page/{name:path}": self.page,
            "/openapi.json": self.openapi,
            "/api/map": self.map,
            "/api/tiles/{layer}/{z}/{col}/{row}.png": self.tile,
            "/api/activity": self.activity,
            "/api/objects": self.objects,
            "/api/cell": self.cell,
            "/api/diff": self.diff,
            "/api/snapshot": self.snapshot,
            "/api/now": self.now,
            "/api/events": self.events,
        }
        return [Route(path, _answering(handler), methods=["GET"]) for path, handler in handlers.items()]

    @asynccontextmanager
    async def lifespan(self, app: Starlette) -> AsyncIterator[None]:
        """Watch the map while the server runs."""
        self._rendering, self._answering, self._long = (
            Desk(RENDERED_AT_ONCE),
            Desk(ANSWERED_AT_ONCE),
            Desk(LONG_AT_ONCE),
        )
        self.model.warm_up()
        watcher = asyncio.create_task(self._watch())
        try:
            yield
        finally:
            self.stopping.set()
            watcher.cancel()
            for desk in (self._rendering, self._answering, self._long):
                desk.close()
            self.model.close()

    async def _watch(self) -> None:
        said = ""
        while True:
            await asyncio.sleep(LOOK_EVERY_S)
            try:
                await asyncio.to_thread(self._look)
            except Exception as error:  # what was read last is shown on
                if str(error) != said:
                    said = str(error)
                    _log.warning("the map could not be read again: %s", error)

    def _look(self) -> None:
        self.model.look()
        self.model.tidy()

    # The page.

    async def page(self, request: Request) -> Response:
        """The page, or one of its files, by a name in a table: no address becomes a path."""
        name = request.path_params.get("name", "index.html")
        found = self._pages.get(name)
        if found is None:
            return refusal(404, "there is no such file")
        return Response(found[0], media_type=found[1], headers={"cache-control": "no-cache"})

    async def openapi(self, request: Request) -> Response:
        """What this server answers, as OpenAPI has it."""
        return JSONResponse(openapi_document())

    # The map.

    async def map(self, request: Request) -> Response:
        """What the map is."""
        Parameters(request, [])
        return _json(await self._answering.answer(request, partial(answers.map_entry, self.model)))

    async def tile(self, request: Request) -> Response:
        """A tile of the picture."""
        given = Parameters(request, ["t", "v", "hold", "theme", "cols", "rows"])
        model = self.model
        layer = request.path_params["layer"]
        if layer not in LAYERS:
            return refusal(404, f"there is no such layer; wanted one of {', '.join(LAYERS)}")
        z, col, row = (given.whole(name, request.path_params[name]) for name in ("z", "col", "row"))
        if not 0 <= z <= model.top_zoom:
            return refusal(404, f"there is no zoom {z}; wanted 0 to {model.top_zoom}")
        n_cols, n_rows = (given.whole(name, given.text(name) or "1", 1, MOST_TILES) for name in ("cols", "rows"))
        if n_cols * n_rows > MOST_TILES:
            return refusal(400, f"{n_cols} x {n_rows} are too many tiles for one answer; wanted {MOST_TILES} at most")
        theme = given.choice("theme", THEMES, "light")
        t, hold_s = given.seconds("t"), given.duration("hold", math.inf)
        period = LAYERS[layer].kind == "period"
        if layer in ("static", "dynamics"):
            with anyio.fail_after(WAIT_S):
                await asyncio.shield(asyncio.wrap_future(model.prepared()))
        version = model.version.name
        asked = model.asked(layer, Where(z, row, col), theme, t, hold_s)
        # Asked before it is drawn: what is worked out meanwhile may come too late for this picture.
        lasting = given.text("v") == version and (t is not None or period) and model.is_settled(layer)
        picture = model.recalled(asked) if n_cols * n_rows == 1 else None
        if picture is None:
            work = partial(model.rendered, asked)
            if n_cols * n_rows > 1:
                work = partial(model.spanned, asked, n_cols, n_rows)
            picture = await self._rendering.answer(request, work)
        headers = {"cache-control": FOREVER if lasting else "no-store"}
        return Response(picture, media_type="image/png", headers=headers)

    async def activity(self, request: Request) -> Response:
        """When much changed."""
        given = Parameters(request, ["bins", "v"])
        n_bins = given.whole("bins", given.text("bins") or "400", 1, 4000)
        with anyio.fail_after(WAIT_S):
            prepared = await asyncio.shield(asyncio.wrap_future(self.model.prepared()))
        work = partial(answers.activity_entry, self.model, prepared, n_bins)
        return _json(await self._answering.answer(request, work))

    async def objects(self, request: Request) -> Response:
        """The objects, once they are found."""
        Parameters(request, ["v"])
        findings = self.model.findings()
        if findings is None:
            return self._unfound()
        if self._objects is None or self._objects[0] != findings.version:
            work = partial(answers.objects_text, self.model, findings, self.zone)
            self._objects = findings.version, await self._answering.answer(request, work)
        return Response(self._objects[1], media_type="application/json")

    def _unfound(self) -> Response:
        finder = self.model.finder
        if finder.state == "failed":
            return _json({"state": "failed", "error": finder.error})
        return _json({"state": "working", "progress": None}, 202)

    async def cell(self, request: Request) -> Response:
        """Every state of one cell."""
        given = Parameters(request, ["x", "y", "v"])
        x, y = given.number("x"), given.number("y")
        return _json(await self._answering.answer(request, partial(answers.cell_entry, self.model, x, y)))

    async def diff(self, request: Request) -> Response:
        """What appeared, vanished or moved between two moments."""
        given = Parameters(request, ["a", "b", "v"])
        a, b = given.number("a"), given.number("b")
        findings = self.model.findings()
        if findings is None:
            return self._unfound()
        key = (self.model.version.name, findings.version, a, b)
        if key not in self._diffs:
            work = partial(answers.diff_entry, self.model, findings, a, b)
            found = await self._long.answer(request, work)
            if len(self._diffs) > 32:
                self._diffs.clear()
            self._diffs[key] = found
        return _json(self._diffs[key])

    async def snapshot(self, request: Request) -> Response:
        """The whole map at a moment."""
        given = Parameters(request, ["t", "format", "hold", "theme", "v"])
        t, hold_s = given.number("t"), given.duration("hold", math.inf)
        kind = given.choice("format", ("png", "npz"), "png")
        theme = given.choice("theme", THEMES, "light")
        work = partial(answers.snapshot_bytes, self.model, t, hold_s, kind, theme)
        content = await self._long.answer(request, work)
        media = "image/png" if kind == "png" else "application/x-npz"
        name = f"{self.model.source.name}-{t:g}.{kind}".encode("ascii", "ignore").decode().replace('"', "")
        return Response(content, media_type=media, headers={"content-disposition": f'inline; filename="{name}"'})

    # The present.

    async def now(self, request: Request) -> Response:
        """Where everything is now."""
        Parameters(request, ["v"])
        return _json(await self._answering.answer(request, partial(answers.now_entry, self.model)))

    async def events(self, request: Request) -> Response:
        """Server-sent events: one at once, then one whenever the map grew."""
        Parameters(request, [])
        if self._n_listeners >= MOST_LISTENERS:
            answer = refusal(503, f"{MOST_LISTENERS} pages listen already; close one")
            answer.headers["retry-after"] = "30"
            return answer
        if request.method == "HEAD":
            return Response(media_type="text/event-stream")
        return StreamingResponse(self._events(), media_type="text/event-stream")

    async def _events(self) -> AsyncIterator[str]:
        self._n_listeners += 1
        told = ("", "")
        try:
            yield "retry: 2000\n\n"
            while not self.stopping.is_set():
                version, findings = self.model.version, self.model.finder.findings
                tell = version.name, findings.version if findings else ""
                if tell != told:
                    told = tell
                    data = {"version": version.name, "t": version.duration_s, "objects": tell[1] or None}
                    yield f"event: map\ndata: {json.dumps(data)}\n\n"
                else:
                    yield "event: alive\ndata: {}\n\n"
                with anyio.move_on_after(HEARTBEAT_S):
                    await self._changed(tell)
        finally:
            self._n_listeners -= 1

    async def _changed(self, told: tuple[str, str]) -> None:
        while not self.stopping.is_set():
            findings = self.model.finder.findings
            if told != (self.model.version.name, findings.version if findings else ""):
                return
            await asyncio.sleep(LOOK_EVERY_S / 4)


def make_app(model: Model, zone: tzinfo = UTC) -> Starlette:
    """The application, without the guard at its door."""
    site = Site(model, zone)
    app = Starlette(routes=site.routes(), lifespan=site.lifespan, exception_handlers={404: _unknown})
    app.router.redirect_slashes = False
    app.state.site = site
    return app


async def _unknown(request: Request, error: Exception) -> Response:
    return refusal(404, "there is nothing at this address; see /openapi.json")


def page_files() -> dict[str, tuple[bytes, str]]:
    """The page's files by their names, with their media types; read once."""
    found: dict[str, tuple[bytes, str]] = {}

    def collect(folder: Traversable, before: str) -> None:
        for entry in folder.iterdir():
            if entry.is_dir():
                if not entry.name.startswith("__"):
                    collect(entry, f"{before}{entry.name}/")
            elif not entry.name.endswith(".py"):
                found[before + entry.name] = entry.read_bytes(), _media_type(entry.name)

    folder = resources.files("tempog.views.web") / "page"
    if folder.is_dir():
        collect(folder, "")
    return found


def _media_type(name: str) -> str:
    known = {"js": "text/javascript", "css": "text/css", "html": "text/html", "svg": "image/svg+xml"}
    return known.get(name.rpartition(".")[2]) or mimetypes.guess_type(name)[0] or "application/octet-stream"


def _json(content: Any, status: int = 200) -> Response:
    return Response(json.dumps(content, allow_nan=False), status, media_type="application/json")


def _answering(handler: Callable[[Request], Awaitable[Response]]) -> Callable[[Request], Awaitable[Response]]:
    """A handler whose errors are answers."""

    async def answering(request: Request) -> Response:
        try:
            return await handler(request)
        except BadParameterError as error:
            return refusal(400, str(error))
        except ClientDisconnect:
            return Response(status_code=GONE)
        except TimeoutError:
            answer = refusal(503, "the map is still being read; ask again")
            answer.headers["retry-after"] = "5"
            return answer
        except answers.UnanswerableError as error:
            return refusal(400, str(error))
        except (TempogError, OSError, MemoryError) as error:
            return refusal(503, str(error) or "there is not enough memory for this")

    return answering
