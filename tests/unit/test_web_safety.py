"""The viewer's server and those who mean harm, or vanish."""

from __future__ import annotations

import http.client
import json
import socket
import threading
import time
from collections.abc import Iterator

import httpx
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from tempog import build_grid, find_objects
from tempog.errors import ConfigError
from tempog.simulation import corridor, simulate
from tempog.views.web import app, guard, serve
from tempog.views.web.serve import Viewer, serve_in_thread
from tempog.views.web.sources import HistorySource
from waiting import wait_for

SECRETS = ("root:", "import ", "def ", "[project]")  # of files that somebody might want to see

FOREIGN = ["evil.example", "evil.example:{port}", "127.0.0.1.evil.example", "localhost.evil.example", "10.0.0.1"]
FOREIGN += ["0.0.0.0", "[2001:db8::1]", ""]
FOREIGN += ["localhost evil", "localhost/evil", "[::1", "user@localhost", "localhost:port"]  # no hosts at all
HEAD = b"GET / HTTP/1.1\r\nHost: localhost\r\n"
NO_HTTP = [b"", b"\r\n", b"\x00" * 100, b"GET", b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03"]
NO_HTTP += [
    b"GET / HTTP/9.9\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost localhost\r\n\r\n",
    b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
]
NO_HTTP += [b"GET /" + b"a" * 100_000, HEAD + b"X: " + b"a" * 100_000, HEAD + b"X: 1\r\n" * 10_000]
NO_HTTP += [HEAD + b"Content-Length: -1\r\n\r\n", HEAD + b"Transfer-Encoding: chunked\r\n\r\nzz\r\n"]


@pytest.fixture(scope="module")
def source() -> HistorySource:
    grid = build_grid(simulate(corridor(), duration_s=20.0).scans)
    return HistorySource(grid, "corridor", find_objects(grid))


@pytest.fixture(scope="module")
def viewer(source) -> Iterator[Viewer]:
    with serve_in_thread(source, port=0) as viewer:
        yield viewer


@pytest.fixture(scope="module")
def client(viewer) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=viewer.url, timeout=30) as client:
        yield client


@pytest.fixture(scope="module")
def locked(source) -> Iterator[Viewer]:
    """One that is bound to all addresses."""
    with serve_in_thread(source, "0.0.0.0", port=0) as viewer:
        yield viewer


def raw(port: int, request: bytes, *, is_all: bool = False) -> bytes:
    """What comes back for some bytes, until the other side closes; it may wait for more unless that is all."""
    with socket.create_connection(("127.0.0.1", port), timeout=20) as connection:
        parts = []
        try:
            connection.sendall(request)
            if is_all:
                connection.shutdown(socket.SHUT_WR)
            while part := connection.recv(65536):
                parts.append(part)
        except (ConnectionResetError, BrokenPipeError):  # it was not read to the end
            pass
    return b"".join(parts)


def status_of(answer: bytes) -> int:
    return int(answer.split(b" ", 2)[1])


def get(port: int, target: str, *headers: str, method: str = "GET") -> bytes:
    lines = [f"{method} {target} HTTP/1.1", *(headers or ["Host: 127.0.0.1"]), "Connection: close", "", ""]
    return raw(port, "\r\n".join(lines).encode("latin-1"))


def assert_well(port: int) -> None:
    """It still answers."""
    answer = get(port, "/api/map")
    assert status_of(answer) == 200
    assert json.loads(answer.partition(b"\r\n\r\n")[2])["name"] == "corridor"


# Hosts.


@pytest.mark.parametrize(
    "host", ["127.0.0.1:{port}", "localhost:{port}", "[::1]:{port}", "LOCALHOST", "127.0.0.2", "localhost."]
)
def test_names_of_this_machine_are_answered(viewer, host):
    assert status_of(get(viewer.port, "/api/map", f"Host: {host.format(port=viewer.port)}")) == 200


@pytest.mark.parametrize("host", FOREIGN)
def test_other_names_are_refused(viewer, host):
    answer = get(viewer.port, "/api/map", f"Host: {host.format(port=viewer.port)}")
    assert status_of(answer) in (400, 421)
    assert b"duration_s" not in answer


@pytest.mark.parametrize(
    "headers", [["X-None: 1"], ["Host: localhost", "Host: localhost"], ["Host: localhost", "Host: evil"]]
)
def test_a_request_has_one_host(viewer, headers):
    assert status_of(get(viewer.port, "/api/map", *headers)) in (400, 421)


def test_a_host_that_another_header_names_does_not_count(viewer):
    answer = get(viewer.port, "/api/map", "Host: evil.example", "X-Forwarded-Host: localhost")
    assert status_of(answer) == 421


# Methods, headers.


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "FOO"])
def test_nothing_can_be_changed(viewer, method):
    for path in ("/", "/api/map", "/page/main.js", "/nowhere"):
        answer = get(viewer.port, path, method=method)
        assert status_of(answer) == 405
        assert b"\r\nallow: GET, HEAD\r\n" in answer


def test_the_head_alone_may_be_asked_for(viewer):
    for path in ("/api/map", "/api/tiles/occupancy/0/0/0.png", "/api/events"):
        answer = get(viewer.port, path, method="HEAD")
        assert status_of(answer) == 200
        assert answer.endswith(b"\r\n\r\n")


@pytest.mark.parametrize(
    "path", ["/", "/api/map", "/nowhere", "/api/cell?x=nan", "/api/tiles/age/0/0/0.png", "/page/x"]
)
def test_every_answer_says_what_browsers_may_do_with_it(viewer, client, path):
    headers = client.get(path).headers
    assert headers["content-security-policy"].startswith("default-src 'self';")
    assert "unsafe" not in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["x-frame-options"] == "DENY"
    assert headers["cross-origin-resource-policy"] == "same-origin"
    assert "access-control-allow-origin" not in headers
    assert "cache-control" in headers
    assert "server" not in headers
    assert status_of(get(viewer.port, path, "Host: evil.example")) == 421


# Tokens.


def test_this_machine_needs_no_token(viewer):
    assert viewer.token is None
    assert viewer.url == f"http://127.0.0.1:{viewer.port}/"


def test_other_addresses_ask_for_the_token(locked):
    assert locked.token is not None
    assert len(locked.token) >= 32
    assert locked.url.endswith(f":{locked.port}/?token={locked.token}")
    with httpx.Client(base_url=f"http://127.0.0.1:{locked.port}") as client:
        wrong = [
            {},
            {"params": {"token": "wrong"}},
            {"params": {"token": ""}},
            {"params": {"token": locked.token[:-1]}},
            {"params": {"token": "\u00fc\u2028\x00"}},
            {"headers": {"authorization": "Bearer wrong"}},
            {"headers": {"authorization": f"Basic {locked.token}"}},
            {"headers": {"cookie": f"tempog-{locked.port}=wrong"}},
            {"headers": {"cookie": f"tempog-1={locked.token}"}},
            {"headers": {"cookie": b"\xff=;;;="}},
        ]
        for path in ("/", "/api/map", "/page/main.js", "/openapi.json", "/nowhere"):
            for given_ in wrong:
                answer = client.get(path, **given_)
                assert answer.status_code == 401
                assert "tempog" in answer.headers["www-authenticate"]
                assert locked.token not in answer.text
                assert "set-cookie" not in answer.headers
                client.cookies.clear()


def test_the_token_becomes_a_cookie_and_leaves_the_address(locked):
    with httpx.Client(base_url=f"http://127.0.0.1:{locked.port}") as client:
        answer = client.get("/", params={"token": locked.token, "more": "1"})
        assert answer.status_code == 303
        assert answer.headers["location"] == "/?more=1"
        cookie = answer.headers["set-cookie"].lower()
        assert "httponly" in cookie
        assert "samesite=lax" in cookie  # links from elsewhere open the page
        assert client.get("/api/map").status_code == 200


def test_programs_may_send_the_token_with_each_request(locked):
    with httpx.Client(base_url=f"http://127.0.0.1:{locked.port}") as client:
        assert client.get("/api/map", params={"token": locked.token}).status_code == 200
        assert client.get("/api/map", headers={"authorization": f"Bearer {locked.token}"}).status_code == 200


def test_addresses_by_number_are_answered_where_a_token_is_asked_for_and_names_are_not(locked):
    bearer = f"Authorization: Bearer {locked.token}"
    assert status_of(get(locked.port, "/api/map", "Host: 192.168.1.5", bearer)) == 200
    assert status_of(get(locked.port, "/api/map", f"Host: {socket.gethostname()}", bearer)) == 200
    assert status_of(get(locked.port, "/api/map", "Host: evil.example", bearer)) == 421


def test_tokens_differ():
    assert len({guard.new_token() for _ in range(100)}) == 100


# Paths.

CLIMBS = [
    "../../../../../../etc/passwd",
    "..%2f..%2f..%2f..%2fetc%2fpasswd",
    "%2e%2e/%2e%2e/app.py",
    "..\\..\\app.py",
]
CLIMBS += ["/etc/passwd", "//etc/passwd", "....//....//app.py", "%00", "main.js%00.png", "__init__.py", "../serve.py"]
CLIMBS += ["..%252f..%252fapp.py", "%c0%ae%c0%ae/app.py", "file:///etc/passwd", ".", "..", "%2e", "~/.ssh/id_rsa"]


@pytest.mark.parametrize("climb", CLIMBS)
@pytest.mark.parametrize("before", ["/page/", "/", "/api/tiles/", "/api/tiles/occupancy/0/0/"])
def test_no_address_reaches_the_file_system(viewer, before, climb):
    answer = get(viewer.port, before + climb)
    assert 400 <= status_of(answer) < 500
    assert not any(secret.encode() in answer.partition(b"\r\n\r\n")[2] for secret in SECRETS)


@pytest.mark.parametrize(
    "target", ["http://evil.example/api/map", "*", "//evil.example/api/map", "api/map", "?", "/\x7f", "/é"]
)
def test_strange_targets_are_refused_or_answered_as_paths(viewer, target):
    assert 400 <= status_of(get(viewer.port, target)) < 500 or "api/map" in target
    assert_well(viewer.port)


NUMBERS = st.sampled_from(
    [
        "0",
        "-1",
        "1",
        "50",
        "1e3",
        "nan",
        "inf",
        "-inf",
        "1e400",
        "9" * 50,
        "",
        " 1",
        "1_0",
        "0x1",
        "٣",
        "--1",
        "1.5",
        "2147483648",
    ]
)
WORDS = (
    NUMBERS
    | st.text(max_size=8)
    | st.sampled_from(["occupancy", "static", "age", "people", "png", "npz", "dark", "../.."])
)
NAMES = st.sampled_from(["t", "v", "hold", "theme", "bins", "x", "y", "a", "b", "format", "token", "nonsense"])
PLACES = st.sampled_from(
    [
        "/api/map",
        "/api/activity",
        "/api/objects",
        "/api/cell",
        "/api/diff",
        "/api/snapshot",
        "/api/now",
        "/openapi.json",
    ]
)


@settings(
    max_examples=1000, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    path=PLACES
    | st.tuples(WORDS, NUMBERS, NUMBERS, NUMBERS).map(lambda parts: "/api/tiles/{}/{}/{}/{}.png".format(*parts))
    | st.lists(WORDS, max_size=6).map(lambda parts: "/" + "/".join(parts)),
    query=st.lists(st.tuples(NAMES | st.text(max_size=4), WORDS), max_size=4),
)
def test_no_request_ends_in_an_error_of_the_server(client, path, query):
    try:
        answer = client.get(httpx.URL(path=path), params=query)
    except httpx.InvalidURL:
        assume(False)
    assert answer.status_code < 500
    if answer.status_code >= 400 and answer.headers["content-type"] == "application/json":
        assert answer.json()["error"]
    assert "Traceback" not in answer.text


@pytest.mark.parametrize("request_", NO_HTTP)
def test_what_is_no_http_is_refused(viewer, request_):
    answer = raw(viewer.port, request_, is_all=True)
    assert not answer or 400 <= status_of(answer) < 500
    assert b"Traceback" not in answer
    assert_well(viewer.port)


@settings(
    max_examples=100, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    st.lists(
        st.binary(max_size=20)
        | st.sampled_from([b"GET ", b"/api/map", b" HTTP/1.1\r\n", b"Host: localhost\r\n", b"\r\n"])
    )
)
def test_any_bytes_may_come(viewer, parts):
    answer = raw(viewer.port, b"".join(parts), is_all=True)
    assert not answer or 200 <= status_of(answer) < 500


def test_long_addresses_are_refused(viewer):
    assert status_of(get(viewer.port, "/api/cell?x=" + "1" * 5000)) == 414
    assert status_of(get(viewer.port, "/" + "a" * 5000)) == 414


def test_errors_show_only_a_little_of_what_was_sent(viewer):
    answer = get(viewer.port, "/api/cell?y=1&x=" + "<script>" * 100)
    assert status_of(answer) == 400
    assert len(answer.partition(b"\r\n\r\n")[2]) < 200
    assert b"application/json" in answer


# Slow clients, vanished ones, many.


def test_who_does_not_finish_a_request_is_let_go(source, monkeypatch):
    monkeypatch.setattr(serve, "REQUEST_S", 0.3)
    with serve_in_thread(source, port=0) as viewer:
        beginnings = [
            b"",
            b"GET /api",
            b"GET /api/map HTTP/1.1\r\nHost: local",
            b"GET /api/map HTTP/1.1\r\nHost: localhost\r\n",
        ]
        idle = [socket.create_connection(("127.0.0.1", viewer.port), timeout=20) for _ in beginnings]
        for connection, begin in zip(idle, beginnings, strict=True):
            connection.sendall(begin)
        for connection in idle:
            while connection.recv(1000):  # a refusal may come first
                pass
            connection.close()
        # Also after a request that was answered.
        with socket.create_connection(("127.0.0.1", viewer.port), timeout=20) as connection:
            connection.sendall(b"GET /api/map HTTP/1.1\r\nHost: localhost\r\n\r\n")
            assert b"200 OK" in connection.recv(65536)
            connection.sendall(b"GET /api/ma")
            while connection.recv(65536):
                pass
        assert_well(viewer.port)


def test_a_slow_client_keeps_a_connection_that_it_uses(viewer):
    """Longer than a request's head may take, but each head in time."""
    connection = http.client.HTTPConnection("127.0.0.1", viewer.port, timeout=20)
    for _ in range(3):
        connection.request("GET", "/api/map")
        assert connection.getresponse().read()
        time.sleep(0.1)
    connection.close()


def test_who_does_not_take_in_an_answer_is_let_go(source, monkeypatch):
    monkeypatch.setattr(serve, "ANSWER_S", 0.3)
    with serve_in_thread(source, port=0) as viewer:
        with socket.socket() as connection:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            connection.settimeout(30)
            connection.connect(("127.0.0.1", viewer.port))
            request = b"GET /openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n"
            with pytest.raises((ConnectionResetError, BrokenPipeError)):
                connection.sendall(request * 200_000)
        assert_well(viewer.port)


def test_nothing_is_drawn_for_those_who_went_away(source):
    with serve_in_thread(source, port=0) as viewer:
        model, drawn, go = viewer.model, [], threading.Event()
        wait_for(lambda: model.finder.state == "ready")
        draw = model.rendered

        def slowly(asked):
            drawn.append(asked.moment.until)
            go.wait(20)
            return draw(asked)

        model.rendered = slowly
        connections = []
        for k in range(40):
            connection = socket.create_connection(("127.0.0.1", viewer.port), timeout=20)
            request = f"GET /api/tiles/occupancy/0/0/0.png?t={k / 10} HTTP/1.1\r\nHost: localhost\r\n\r\n"
            connection.sendall(request.encode())
            connections.append(connection)
        wait_for(lambda: len(drawn) == app.RENDERED_AT_ONCE)
        patient = connections.pop()
        for connection in connections:
            connection.close()
        # Other questions are answered while pictures are waited for.
        assert_well(viewer.port)
        go.set()
        assert b"200 OK" in patient.recv(65536)
        patient.close()
        assert_well(viewer.port)
        assert app.RENDERED_AT_ONCE <= len(drawn) < 20


def test_listeners_are_few_and_leave_no_trace(source, monkeypatch):
    monkeypatch.setattr(app, "MOST_LISTENERS", 3)
    monkeypatch.setattr(app, "HEARTBEAT_S", 0.1)
    with serve_in_thread(source, port=0) as viewer:
        request = b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n"

        def listen() -> socket.socket:
            connection = socket.create_connection(("127.0.0.1", viewer.port), timeout=20)
            connection.sendall(request)
            return connection

        listeners = [listen() for _ in range(3)]
        for listener in listeners:
            heard = b""
            while b"event: map" not in heard:
                heard += listener.recv(65536)
        refused = listen()
        assert b"503" in refused.recv(65536)
        refused.close()
        for listener in listeners:
            listener.close()

        def is_welcome() -> bool:
            with listen() as another:
                return b"200 OK" in another.recv(65536)

        wait_for(is_welcome)


def test_a_viewer_ends_while_somebody_listens(source, caplog):
    viewer = serve_in_thread(source, port=0)
    listener = socket.create_connection(("127.0.0.1", viewer.port), timeout=20)
    listener.sendall(b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
    assert b"200 OK" in listener.recv(65536)
    begin_s = time.monotonic()
    viewer.stop()
    assert time.monotonic() - begin_s < serve.STOP_S  # answers were finished, not cut off
    assert not caplog.records
    while listener.recv(65536):
        pass
    listener.close()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", viewer.port), timeout=5)


def test_an_answer_that_takes_too_long_is_cut_off_at_the_end_without_a_word(source, monkeypatch, caplog):
    monkeypatch.setattr(serve, "STOP_S", 0.2)
    begun, go_on = threading.Event(), threading.Event()

    def slowly(*given) -> bytes:
        begun.set()
        go_on.wait(60)
        return b""

    monkeypatch.setattr(app.answers, "snapshot_bytes", slowly)
    viewer = serve_in_thread(source, port=0)
    with socket.create_connection(("127.0.0.1", viewer.port), timeout=20) as asker:
        asker.sendall(b"GET /api/snapshot?t=1 HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert begun.wait(20)
        viewer.stop()
        go_on.set()
    assert not caplog.records


# Ports.


def test_a_port_in_use_is_said_or_stepped_over(source):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match=f"port {port} of .* is in use"):
            Viewer(source, port=port)
        with serve_in_thread(source, port=port, search=True) as viewer:
            assert port < viewer.port <= port + serve.TRIED_PORTS


def test_an_address_that_is_none_is_said(source):
    with pytest.raises(ConfigError, match="nothing can be served on nowhere"):
        Viewer(source, "nowhere.invalid", 0)
