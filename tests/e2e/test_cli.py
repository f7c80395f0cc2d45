"""The command line as a user calls it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest

from tempog import open_map
from tempog.scans.npz import write_npz
from tempog.simulation import corridor, simulate

DATA = Path(__file__).parents[3] / "shared/data/laser_logs"


Tempog = Callable[..., Any]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A minute of the corridor as .npz; the door is open from +15 s on."""
    path = tmp_path_factory.mktemp("logs") / "corridor.npz"
    write_npz(path, simulate(corridor(seed=0), duration_s=60, seed=0).scans)
    return path


@pytest.fixture(scope="module")
def corridor_map(log: Path) -> Path:
    path = log.with_suffix(".tempog")
    subprocess.run([sys.executable, "-m", "tempog", "map", log, "-o", path, "--quiet"], check=True)
    return path


def test_map_json_is_one_object_with_the_promised_keys(tempog: Tempog, log: Path, tmp_path: Path) -> None:
    result = tempog("map", log, "-o", tmp_path / "m.tempog", "--json")
    answer = json.loads(result.out)
    assert result.code == 0
    assert result.err == ""
    promised = {"n_scans", "duration_s", "n_cells", "n_intervals", "ingest_s", "scans_per_s", "bytes_on_disk"}
    assert promised <= answer.keys()
    assert answer["n_scans"] == 600
    assert answer["duration_s"] == pytest.approx(59.9)
    assert answer["n_intervals"] >= answer["n_cells"] > 10_000
    files = [file for file in (tmp_path / "m.tempog").rglob("*") if file.is_file()]
    assert answer["bytes_on_disk"] == sum(file.stat().st_size for file in files)


def test_map_says_what_it_read_and_made(tempog: Tempog, log: Path, tmp_path: Path) -> None:
    result = tempog("map", log, "-o", tmp_path / "m.tempog")
    assert result.code == 0
    assert "600 scans" in result.out
    assert "intervals" in result.out
    assert (tmp_path / "m.tempog" / "map.json").is_file()


def test_map_names_the_map_after_the_log(
    tempog: Tempog, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert tempog("map", log).code == 0
    assert (tmp_path / "corridor.tempog").is_dir()


def test_map_merges_two_logs_by_time(tempog: Tempog, tmp_path: Path) -> None:
    scans = simulate(corridor(seed=0), duration_s=20, seed=0).scans
    write_npz(tmp_path / "a.npz", scans[100:])
    write_npz(tmp_path / "b.npz", scans[:100])
    write_npz(tmp_path / "ab.npz", scans)
    answers = [
        json.loads(tempog("map", *inputs, "-o", tmp_path / name, "--json", "--gap", "1s").out)
        for inputs, name in [
            ([tmp_path / "a.npz", tmp_path / "b.npz"], "two.tempog"),
            ([tmp_path / "ab.npz"], "one.tempog"),
        ]
    ]
    assert answers[0]["n_intervals"] == answers[1]["n_intervals"]
    assert answers[0]["n_scans"] == 200


def test_an_existing_map_is_not_overwritten_without_force(tempog: Tempog, log: Path, tmp_path: Path) -> None:
    path = tmp_path / "m.tempog"
    tempog("map", log, "-o", path, "--quiet")
    before = (path / "map.json").read_bytes()
    refused = tempog("map", log, "-o", path, "--resolution", "0.1", "--quiet")
    assert refused.code == 1
    assert "--force" in refused.err
    assert (path / "map.json").read_bytes() == before
    assert tempog("map", log, "-o", path, "--resolution", "0.1", "--quiet", "--force").code == 0
    assert open_map(path).config.grid.resolution_m == 0.1


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--gap", "0.05s"], "shorter than the scan period"),
        (["--gap", "soon"], "not a duration"),
        (["--resolution", "0"], "resolution_m"),
        (["--max-range", "-3"], "max_range_m"),
        (["--tolerance", "2"], "tolerance"),
        (["--clock", "rate=fast"], "rate"),
        (["--evidence", "magic"], "magic"),
    ],
)
def test_wrong_usage_exits_2_with_a_message(
    tempog: Tempog, log: Path, tmp_path: Path, words: list[str], expected: str
) -> None:
    result = tempog("map", log, "-o", tmp_path / "m.tempog", *words)
    assert result.code == 2
    assert expected in result.err
    assert "Traceback" not in result.err
    assert not (tmp_path / "m.tempog").exists()


def test_bad_data_exits_1_with_one_message_and_writes_nothing(tempog: Tempog, tmp_path: Path) -> None:
    bad = tmp_path / "bad.log"
    bad.write_text("FLASER 2 1.0 zwei 0 0 0 0 0 0 1 host 1\n")
    result = tempog("map", bad, "-o", tmp_path / "m.tempog")
    assert result.code == 1
    assert result.err.startswith("tempog: ")
    assert "line 1" in result.err
    assert "--skip-bad" in result.err
    assert sorted(file.name for file in tmp_path.iterdir()) == ["bad.log"]


def test_a_corrupt_pose_stops_the_map_and_names_the_scan(tempog: Tempog, tmp_path: Path) -> None:
    lines = [f"FLASER 1 1.0 {x} 0 0 {x} 0 0 {t} host {t}" for t, x in enumerate([0, 0.1, 9.0e7, 0.3])]
    log = tmp_path / "far.log"
    log.write_text("\n".join(lines) + "\n")
    result = tempog("map", log, "-o", tmp_path / "m.tempog")
    assert result.code == 1
    assert "line 3" in result.err
    assert not (tmp_path / "m.tempog").exists()


def test_show_draws_every_layer(tempog: Tempog, corridor_map: Path, tmp_path: Path) -> None:
    for layer in ["occupancy", "static", "dynamics", "classic", "age", "objects", "high-dynamic", "timeline"]:
        picture = tmp_path / f"{layer}.png"
        assert tempog("show", corridor_map, "--layer", layer, "-o", picture).code == 0
        pixels = matplotlib.image.imread(picture)
        assert pixels.shape[0] > 300
        assert pixels.shape[1] > 800
        assert pixels[..., :3].std() > 0.05


def test_show_at_two_moments_gives_two_pictures(tempog: Tempog, corridor_map: Path, tmp_path: Path) -> None:
    for moment in ("+12", "+59"):
        assert tempog("show", corridor_map, "--at", moment, "-o", tmp_path / f"at{moment}.png").code == 0
    first, second = (matplotlib.image.imread(tmp_path / f"at{moment}.png") for moment in ("+12", "+59"))
    assert first.shape != second.shape or not np.array_equal(first, second)


@pytest.mark.parametrize(
    ("words", "code", "expected"),
    [
        (["--at", "+10", "--from", "+5"], 2, "--at"),
        (["--at", "+10", "--layer", "static"], 2, "--from"),
        (["--hold", 5, "--layer", "static"], 2, "--hold"),
        (["--method", "paper", "--layer", "static"], 2, "--method"),
        (["--at", "tomorrow"], 2, "tomorrow"),
        (["--from", "+20", "--to", "+10"], 2, "exchange"),
        (["--at", "+1000"], 1, "+59.9"),
        (["--from", "+1000", "--to", "+2000"], 1, "no scan"),
        (["--hold", "-1"], 2, "hold"),
        (["--layer", "smell"], 2, "smell"),
    ],
)
def test_show_refuses_what_it_cannot_draw(
    tempog: Tempog, corridor_map: Path, tmp_path: Path, words: list[str], code: int, expected: str
) -> None:
    result = tempog("show", corridor_map, "-o", tmp_path / "x.png", *words)
    assert (result.code, expected in result.err) == (code, True), result.err
    assert not (tmp_path / "x.png").exists()


def test_show_does_not_overwrite_a_picture_without_force(tempog: Tempog, corridor_map: Path, tmp_path: Path) -> None:
    picture = tmp_path / "mine.png"
    picture.write_bytes(b"precious")
    assert tempog("show", corridor_map, "-o", picture).code == 1
    assert picture.read_bytes() == b"precious"
    assert tempog("show", corridor_map, "-o", picture, "--force").code == 0
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_show_refuses_an_unknown_picture_format_and_leaves_nothing(
    tempog: Tempog, corridor_map: Path, tmp_path: Path
) -> None:
    result = tempog("show", corridor_map, "-o", tmp_path / "x.docx")
    assert result.code == 2
    assert ".png" in result.err
    assert list(tmp_path.iterdir()) == []


def test_history_takes_negative_coordinates(tempog: Tempog, corridor_map: Path) -> None:
    result = tempog("history", corridor_map, "3.0", "-1.0")
    assert result.code == 0
    assert "free" in result.out
    assert tempog("history", corridor_map, "-50", "-50").out.strip().endswith("never observed")


def test_history_json_tells_the_doors_states(tempog: Tempog, corridor_map: Path) -> None:
    answer = json.loads(tempog("history", corridor_map, "6.98", "2.53", "--json").out)
    probs = [interval["prob"] for interval in answer["intervals"]]
    assert probs[0] > 0.5 > probs[-1]
    starts = [interval["start_s"] for interval in answer["intervals"]]
    assert starts == sorted(starts)
    for gap in answer["gaps"]:
        assert gap["stop_s"] - gap["start_s"] > 1.0


def test_info_json_and_text_agree(tempog: Tempog, corridor_map: Path) -> None:
    answer = json.loads(tempog("info", corridor_map, "--json").out)
    text = tempog("info", corridor_map).out
    assert answer["n_scans"] == 600
    assert f"{answer['n_intervals']:,}".replace(",", " ") in text
    assert [session["n_scans"] for session in answer["sessions"]] == [600]
    (source,) = answer["sessions"][0]["sources"]
    assert source["path"].endswith("corridor.npz")
    assert len(source["sha256"]) == 64
    assert f"session    {answer['sessions'][0]['id']}: 600 scans" in text


def test_a_directory_that_is_no_map_is_refused(tempog: Tempog, tmp_path: Path) -> None:
    for command in (["info", tmp_path], ["history", tmp_path, 0, 0], ["show", tmp_path, "-o", tmp_path / "x.png"]):
        result = tempog(*command)
        assert result.code == 1
        assert "not a tempog map" in result.err


def test_demo_finds_the_door_again(tempog: Tempog, tmp_path: Path) -> None:
    result = tempog("demo", "-o", tmp_path / "demo", "--quiet")
    assert result.code == 0, result.err
    for name in ("door-open.png", "door-closed.png", "dynamics.png"):
        assert (tmp_path / "demo" / name).is_file()
    seen = next(line for line in result.out.splitlines() if line.strip().startswith("seen"))
    true = next(line for line in result.out.splitlines() if line.strip().startswith("true"))
    states = [
        [word for word in line.replace(",", " ").split() if word in ("open", "closed")] for line in (seen, true)
    ]
    assert states[0] == states[1]
    assert tempog("demo", "-o", tmp_path / "demo").code == 1  # not over what is there


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys, runpy\n"
        "sys.argv = ['tempog', '--help']\n"
        "try:\n    runpy.run_module('tempog', run_name='__main__')\n"
        "except SystemExit as stop:\n    assert not stop.code\n"
        "heavy = {'numba', 'scipy', 'pyarrow', 'matplotlib', 'llvmlite'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "map" in done.stdout


def test_importing_tempog_does_not_import_numba() -> None:
    code = "import sys, tempog; tempog.Scan; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.skipif(os.name != "posix", reason="signals are sent as on POSIX systems")
def test_an_interrupted_map_leaves_nothing_behind(log: Path, tmp_path: Path) -> None:
    path = tmp_path / "m.tempog"
    command = [sys.executable, "-m", "tempog", "map", *[str(log)] * 40, "-o", str(path), "--quiet"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE)
    time.sleep(1.5)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    if process.returncode == 0:
        pytest.skip("the machine was faster than the interrupt")
    assert process.returncode in (130, -signal.SIGINT)
    assert b"Traceback" not in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not DATA.is_dir(), reason="the public logs are not on this machine")
def test_freiburg_maps_as_a_building(tempog: Tempog, tmp_path: Path) -> None:
    path = tmp_path / "fr079.tempog"
    answer = json.loads(tempog("map", DATA / "freiburg-079-corrected.log.gz", "-o", path, "--json").out)
    assert answer["n_scans"] == 4791
    assert answer["bytes_on_disk"] / answer["n_intervals"] < 3
    # The building is about 38 m x 16 m with 500 m2 seen; streaks through walls would make it far more.
    assert 350 < answer["n_cells"] * 0.05**2 < 600


@pytest.mark.skipif(not DATA.is_dir(), reason="the public logs are not on this machine")
def test_csails_clock_is_refused_and_the_suggested_option_maps_it(tempog: Tempog, tmp_path: Path) -> None:
    log = DATA / "csail-corrected.log.gz"
    refused = tempog("map", log, "-o", tmp_path / "m.tempog")
    assert refused.code == 1
    assert "line " in refused.err
    assert "--clock rate=5" in refused.err
    assert "--clock sort" in refused.err
    answer = json.loads(tempog("map", log, "-o", tmp_path / "m.tempog", "--clock", "rate=5", "--json").out)
    assert (answer["n_scans"], answer["duration_s"]) == (406, 81.0)
