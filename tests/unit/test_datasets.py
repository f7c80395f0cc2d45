"""Datasets: fetched once from a server of our own, checked, and kept; what goes wrong is said."""

from __future__ import annotations

import hashlib
import socket
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from tempog.errors import ConfigError, DatasetError, ExtraError
from tempog.scans import datasets as module
from tempog.scans.datasets import Dataset, cache_folder, datasets, fetch

pytest.importorskip("pooch", reason="pooch, of the extra datasets, is not installed")
CONTENT = b"FLASER 1 2.0 0 0 0 0 0 0 1.0 host 1.0\n" * 5000
SHARED = Path(__file__).parents[3] / "shared/data"


class Server(ThreadingHTTPServer):
    asked = 0
    cut = False


class Handler(BaseHTTPRequestHandler):
    server: Server

    def do_GET(self) -> None:
        self.server.asked += 1
        if self.path != "/data/log.gz":
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Length", str(len(CONTENT)))
        self.end_headers()
        self.wfile.write(CONTENT[: len(CONTENT) // 2] if self.server.cut else CONTENT)

    def log_message(self, *words: object) -> None:
        pass


@pytest.fixture
def server() -> Iterator[Server]:
    with Server(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.fixture
def log(server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Dataset:
    """The one dataset there is, and a cache that is empty."""
    known = Dataset(
        name="log",
        what="a log",
        url=f"http://127.0.0.1:{server.server_address[1]}/data/log.gz",
        sha256=hashlib.sha256(CONTENT).hexdigest(),
        size=len(CONTENT),
        licence="ours",
        pitfalls=("short",),
        try_it="tempog map {file}",
    )
    offer(monkeypatch, known)
    monkeypatch.setenv("TEMPOG_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    return known


def offer(monkeypatch: pytest.MonkeyPatch, known: Dataset) -> None:
    monkeypatch.setattr(module, "datasets", lambda: {known.name: known})


def test_a_file_is_fetched_once_and_kept(log, server, tmp_path) -> None:
    path = fetch("log")
    assert path == tmp_path / "cache" / "log.gz"
    assert path.read_bytes() == CONTENT
    assert fetch("log") == path
    assert server.asked == 1
    path.write_bytes(b"damaged")
    assert fetch("log").read_bytes() == CONTENT
    assert server.asked == 2
    assert [one.name for one in path.parent.iterdir()] == ["log.gz"]


def test_a_copy_goes_where_it_is_wanted(log, tmp_path) -> None:
    path = fetch("log", to=tmp_path)
    assert path == tmp_path / "log.gz"
    assert fetch("log", to=tmp_path).read_bytes() == CONTENT
    path.write_bytes(b"mine")
    with pytest.raises(DatasetError, match="is another file"):
        fetch("log", to=tmp_path)
    assert path.read_bytes() == b"mine"
    with pytest.raises(ConfigError, match="is a file; name a folder"):
        fetch("log", to=path)
    assert fetch("log", to=tmp_path / "new" / "folder").is_file()


def test_another_file_in_its_place_is_not_kept(log, monkeypatch, tmp_path) -> None:
    offer(monkeypatch, replace(log, sha256="0" * 64))
    with pytest.raises(DatasetError, match=rf"SHA-256 is {log.sha256} .*wanted 0000.*Not kept"):
        fetch("log")
    assert list((tmp_path / "cache").iterdir()) == []


def test_a_transfer_cut_short_is_not_kept(log, server, tmp_path) -> None:
    server.cut = True
    with pytest.raises(DatasetError, match=r"Try again|online"):
        fetch("log")
    assert list((tmp_path / "cache").iterdir()) == []
    server.cut = False
    assert fetch("log").read_bytes() == CONTENT


def test_what_a_server_says_is_told(log, monkeypatch) -> None:
    offer(monkeypatch, replace(log, url=log.url.replace("log.gz", "gone.gz")))
    with pytest.raises(DatasetError, match=r"gone.gz answered 404.\n.*by hand"):
        fetch("log")


def test_offline_says_where_a_file_fetched_by_hand_goes(log, monkeypatch, tmp_path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        nobody = f"http://127.0.0.1:{free.getsockname()[1]}/data/log.gz"
    offer(monkeypatch, replace(log, url=nobody))
    with pytest.raises(DatasetError, match=r"online\?\n.*save it as .*log.gz: http"):
        fetch("log")
    (tmp_path / "cache" / "log.gz").write_bytes(CONTENT)
    assert fetch("log").read_bytes() == CONTENT


def test_a_cache_that_cannot_be_is_said(log, monkeypatch, tmp_path) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("TEMPOG_CACHE", str(tmp_path / "file" / "cache"))
    with pytest.raises(DatasetError, match=r"(?s)cannot .*TEMPOG_CACHE"):
        fetch("log")


def test_an_unknown_name_lists_the_known(log) -> None:
    with pytest.raises(ConfigError, match="'lag'; there are log"):
        fetch("lag")


def test_without_pooch_the_extra_is_named(log, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "pooch", None)
    with pytest.raises(ExtraError, match=r"tempog\[datasets\]"):
        fetch("log")


def test_the_cache_is_the_systems_unless_named(monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("TEMPOG_CACHE", str(tmp_path))
    assert cache_folder() == tmp_path
    monkeypatch.delenv("TEMPOG_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "x"))
    assert cache_folder().name == "tempog"


def test_every_dataset_is_told_in_full() -> None:
    for name, one in datasets().items():
        assert name == one.name
        assert len(one.sha256) == 64
        assert one.url.startswith("https://raw.githubusercontent.com/")
        assert any(len(part) == 40 for part in one.url.split("/")), "at a fixed commit"
        assert one.size > 0
        assert one.what
        assert one.pitfalls


@pytest.mark.skipif(not SHARED.is_dir(), reason="no copies of the real logs here")
def test_hashes_and_sizes_are_those_of_the_copies() -> None:
    copies = {path.name: path for path in SHARED.rglob("*")}
    for one in datasets().values():
        content = copies[one.file_name].read_bytes()
        assert (len(content), hashlib.sha256(content).hexdigest()) == (one.size, one.sha256)
