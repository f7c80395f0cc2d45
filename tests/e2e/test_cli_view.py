"""``tempog view`` as a process of its own."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import httpx
import pytest

from tempog import build_grid, save_map
from tempog.simulation import corridor, simulate


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    return save_map(
        build_grid(simulate(corridor(), duration_s=20.0).scans), tmp_path_factory.mktemp("view") / "site.tempog"
    )


@contextmanager
def viewing(*words: object) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The process, and the address that it printed."""
    command = [sys.executable, "-m", "tempog", "view", *(str(word) for word in words)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process, process.stdout.readline().partition(" ")[0].strip()
        finally:
            process.kill()


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_the_page_s_address_is_printed_and_ctrl_c_ends_it(site, ending):
    with viewing(site, "--no-open", "--port", 0) as (process, url):
        entry = httpx.get(f"{url}api/map").json()
        assert (entry["name"], entry["n_scans"]) == ("site", 200)
        process.send_signal(ending)
        out, err = process.communicate(timeout=30)
        assert (out, err) == ("", "")
        assert process.returncode in (0, -ending)


def test_other_addresses_are_printed_with_a_token(site):
    with viewing(site, "--no-open", "--port", 0, "--host", "0.0.0.0") as (_, url):
        port = httpx.URL(url).port
        assert httpx.get(f"http://127.0.0.1:{port}/api/map").status_code == 401
        token = httpx.URL(url).params["token"]
        assert httpx.get(f"http://127.0.0.1:{port}/api/map", params={"token": token}).status_code == 200


def test_a_port_in_use_is_an_error_where_it_was_asked_for(site, tempog):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        answer = tempog("view", site, "--no-open", "--port", port)
    assert answer.code == 2
    assert f"port {port} of 127.0.0.1 is in use" in answer.err
    assert "--port" in answer.err


def test_the_default_port_gives_way(site):
    with socket.socket() as taken:
        try:
            taken.bind(("127.0.0.1", 8765))
            taken.listen()
        except OSError:
            pass  # somebody else has it already
        with viewing(site, "--no-open") as (process, url):
            port = httpx.URL(url).port
            assert 8765 < port <= 8785
            assert httpx.get(f"{url}api/map").status_code == 200
            process.terminate()
            assert f"note: port 8765 is in use, so this is on {port}" in process.communicate(timeout=30)[1]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--tz", "Nowhere/Land"], "no time zone"),
        (["--tz", "../../etc/passwd"], "no time zone"),
        (["--host", "nowhere.invalid"], "nothing can be served on nowhere.invalid"),
    ],
)
def test_what_cannot_be_is_refused(site, tempog, words, said):
    answer = tempog("view", site, "--no-open", *words)
    assert answer.code == 2
    assert said in answer.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--rerun", "--rrd", "site.rrd"], "one or the other"),
        (["--rerun", "--port", "1234"], "leave them out"),
        (["--rrd", "site.rrd", "--tz", "Europe/Athens"], "leave them out"),
        (["--no-open", "--force"], "--rrd"),
    ],
)
def test_options_that_do_not_go_together_are_refused(site, tempog, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    answer = tempog("view", site, *words)
    assert answer.code == 2
    assert said in answer.err
    assert not list(tmp_path.iterdir())


def test_a_recording_for_rerun_is_written_instead(site, tempog, tmp_path):
    pytest.importorskip("rerun")
    recording = tmp_path / "site.rrd"
    answer = tempog("view", site, "--rrd", recording)
    assert (answer.code, answer.out) == (0, f"{recording}: a recording of {site}; open it with rerun\n")
    assert recording.read_bytes()[:4] == b"RRF2"
    again = tempog("view", site, "--rrd", recording)
    assert again.code == 1
    assert "exists already" in again.err
    assert tempog("view", site, "--rrd", recording, "--force").code == 0


def test_no_map_no_viewer(tmp_path, tempog):
    answer = tempog("view", tmp_path / "nothing.tempog", "--no-open")
    assert answer.code == 1
    assert "nothing.tempog" in answer.err


def test_what_the_viewer_needs_is_named_where_it_is_missing(site, tempog, monkeypatch):
    for name in [name for name in sys.modules if name.startswith("tempog.views.web.serve")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    answer = tempog("view", site, "--no-open")
    assert answer.code == 1
    assert "pip install 'tempog[view]'" in answer.err


def test_other_commands_do_not_load_what_the_viewer_needs():
    script = "import sys, tempog.cli.app; print([m for m in sys.modules if m in ('starlette', 'uvicorn', 'numba')])"
    assert subprocess.run([sys.executable, "-c", script], capture_output=True, text=True).stdout == "[]\n"
