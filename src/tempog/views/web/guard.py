"""Who may ask, and how: hosts, tokens, methods, and the headers that every answer carries."""

from __future__ import annotations

import hmac
import ipaddress
import re
import secrets
import socket
from collections.abc import Iterable
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qsl, urlencode

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
MOST_URL = 2048  # bytes of path and query
TOKEN_BYTES = 24
HOST = re.compile(r"(?:\[([0-9A-Fa-f:.]+)\]|([A-Za-z0-9._-]+))(?::[0-9]{1,5})?")
HEADERS = {
    "content-security-policy": (
        "default-src 'self'; img-src 'self' blob: data:; object-src 'none'; base-uri 'none'; form-action 'none';"
        " frame-ancestors 'none'"
    ),
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
}


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches a server that is bound to a host.

    >>> is_loopback("127.0.0.1"), is_loopback("localhost"), is_loopback("0.0.0.0"), is_loopback("robot")
    (True, True, False, False)
    """
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def new_token() -> str:
    """One that nobody guesses."""
    return secrets.token_urlsafe(TOKEN_BYTES)


def refusal(status: int, error: str) -> JSONResponse:
    """An answer that says what was wrong."""
    return JSONResponse({"error": error}, status)


class Guard:
    """Lets through what may be answered, and gives every answer its headers.

    A page elsewhere that points its own name at this machine is refused by the Host header that its requests
    carry; one bound to other addresses than loopback asks for a token, once: it is kept as a cookie.

    Parameters
    ----------
    app : ASGI application
    host : str
        What the server is bound to.
    port : int
    token : str, optional
        Asked of every request.
    names : iterable of str
        Further names by which the server may be called.
    """

    def __init__(
        self, app: ASGIApp, host: str, port: int, token: str | None = None, names: Iterable[str] = ()
    ) -> None:
        self.app, self.token = app, token
        self.cookie = f"tempog-{port}"
        self.anywhere = not is_loopback(host)
        self.names = {host.lower(), *(name.lower() for name in names)} | LOOPBACK_NAMES
        if self.anywhere:
            own = socket.gethostname().lower()
            self.names |= {own, f"{own.partition('.')[0]}.local"}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self.app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers[name] = value
                if "cache-control" not in headers:
                    headers["cache-control"] = "no-store"
            await send(message)

        answer = self._refused(scope)
        await (answer or self.app)(scope, receive, send_with_headers)

    def _refused(self, scope: Scope) -> Response | None:
        headers = Headers(scope=scope)
        if not self._is_known(headers.getlist("host")):
            return refusal(421, "this Host is not known here; open the address that was printed")
        if scope["method"] not in ("GET", "HEAD"):
            answer = refusal(405, f"{scope['method'][:20]} is not possible: this server only shows; use GET or HEAD")
            answer.headers["allow"] = "GET, HEAD"
            return answer
        if len(scope.get("raw_path") or b"") + len(scope["query_string"]) > MOST_URL:
            return refusal(414, f"the address is longer than {MOST_URL} bytes")
        return self._without_token(scope) if self.token is not None else None

    def _is_known(self, hosts: list[str]) -> bool:
        match = HOST.fullmatch(hosts[0]) if len(hosts) == 1 else None
        if match is None:
            return False
        name = (match[1] or match[2]).lower().rstrip(".")
        if name in self.names:
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        return self.anywhere or address.is_loopback

    def _without_token(self, scope: Scope) -> Response | None:
        """None if the request carries the token; it is sent on to an address without it, which makes a cookie."""
        request = Request(scope)
        query = parse_qsl(scope["query_string"].decode("latin-1"), keep_blank_values=True)
        given = [value for name, value in query if name == "token"]
        if any(self._matches(value) for value in given):
            if request.url.path != "/":
                return None
            rest = urlencode([pair for pair in query if pair[0] != "token"])
            onwards = RedirectResponse(f"/?{rest}" if rest else "/", 303)
            # Lax: a link to the page that comes from elsewhere, in a message, opens it. Nothing here can be changed.
            onwards.set_cookie(self.cookie, self.token or "", httponly=True, samesite="lax", path="/")
            return onwards
        kind, _, bearer = request.headers.get("authorization", "").partition(" ")
        if kind.lower() == "bearer" and self._matches(bearer.strip()):
            return None
        if any(self._matches(value) for value in _cookies(request.headers.get("cookie", ""), self.cookie)):
            return None
        answer = refusal(401, "this viewer asks for its token; open the whole address that was printed")
        answer.headers["www-authenticate"] = 'Bearer realm="tempog"'
        return answer

    def _matches(self, given: str) -> bool:
        return hmac.compare_digest(given.encode("utf-8", "surrogatepass"), (self.token or "").encode())


def _cookies(header: str, name: str) -> list[str]:
    try:
        cookies = SimpleCookie(header)
    except CookieError:
        return []
    return [cookies[name].value] if name in cookies else []
