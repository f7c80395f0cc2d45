"""``tempog experiment`` as a user calls it."""

from __future__ import annotations

import json
import sys
from functools import partial
from pathlib import Path

import pytest

from tempog.cli.experiment import PICTURES


@pytest.fixture
def tempog(tempog):
    """``tempog experiment WORDS...``"""
    return partial(tempog, "experiment")


def rows_of(table: str) -> list[dict[str, str]]:
    heading, _, *rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in table.strip().splitlines())
    return [dict(zip(heading, row, strict=True)) for row in rows]


def test_one_experiment_gives_pictures_scores_and_a_table(tempog, tmp_path: Path) -> None:
    code, out, err = tempog("2a", "-o", tmp_path / "a", "--duration", 150, "--seed", 3)
    assert code == 0
    assert "1 run in" in err
    assert sorted(file.name for file in (tmp_path / "a").iterdir()) == sorted([*PICTURES, "scores.json", "table.md"])
    for picture in PICTURES:
        assert (tmp_path / "a" / picture).read_bytes().startswith(b"\x89PNG")
    (scores,) = json.loads((tmp_path / "a" / "scores.json").read_text())
    assert (scores["people"], scores["seed"], scores["method"], scores["evidence"]) == (20, 3, "evidence", "surface")
    assert scores["n_scans"] == 1500
    assert scores["scores"]["static"]["f1"] > 0.5
    assert all(seconds > 0 for seconds in scores["seconds"].values())
    (row,) = rows_of(out)
    assert row["static F1"] == f"{scores['scores']['static']['f1']:.2f}"
    assert row["people"] == "20"
    assert row["of"].isdigit()  # a count of one run, not a mean
    assert (tmp_path / "a" / "table.md").read_text() == out


def test_the_doors_of_the_empty_hallway_are_found_and_nothing_else(tempog, tmp_path: Path) -> None:
    code, _, _ = tempog("hallway", "--people", 0, "--seed", 7, "--method", "evidence", "-o", tmp_path, "--quiet")
    assert code == 0
    (run,) = json.loads((tmp_path / "scores.json").read_text())
    scores = run["scores"]
    assert scores["static"]["f1"] >= 0.97
    assert scores["configurations"]["recall_twice"]["share"] >= 0.9
    assert scores["configurations"]["precision"]["share"] >= 0.9
    assert scores["links"]["n_wrong"] == 0
    assert scores["links"]["precision"]["n"] >= 2  # of the five doors that were seen in two places


@pytest.mark.slow
def test_all_experiments_by_every_method_with_their_spread(tempog, tmp_path: Path) -> None:
    code, out, _ = tempog("all", "-o", tmp_path / "a", "--duration", 60, "--seeds", 2, "--resolution", 0.1, "--quiet")
    assert code == 0
    rows = rows_of(out)
    assert [(row["people"], row["method"]) for row in rows] == [
        (people, method) for people in ("0", "20", "40", "60") for method in ("evidence", "paper", "paper-tuned")
    ]
    assert {row["seeds"] for row in rows} == {"2"}
    runs = json.loads((tmp_path / "a" / "scores.json").read_text())
    assert len(runs) == 24
    false = [one["scores"]["configurations"] for one in runs if (one["people"], one["method"]) == (60, "paper")]
    counts = [one["precision"]["of"] - one["precision"]["n"] for one in false]
    assert len(counts) == 2
    mean = f"{sum(counts) / 2:.1f}"
    wanted = mean if counts[0] == counts[1] else f"{mean} ({min(counts):.1f}-{max(counts):.1f})"
    assert rows[10]["false places"] == wanted
    assert rows[0]["moving: precision"] == "-"  # nobody is there
    assert (tmp_path / "a" / "side-by-side.png").exists()
    for title in ("1", "2a", "2b", "2c"):
        assert {file.name for file in (tmp_path / "a" / title).iterdir()} == set(PICTURES)


def test_any_world_can_be_an_experiment(tempog, tmp_path: Path) -> None:
    code, out, _ = tempog("hallway", "--people", 3, "-o", tmp_path, "--duration", 20, "--method", "paper-tuned")
    assert code == 0
    assert rows_of(out)[0]["people"] == "3"


def test_buildings_by_chance_are_one_row_however_many_seeds(tempog, tmp_path: Path) -> None:
    code, out, _ = tempog("random", "-o", tmp_path, "--duration", 10, "--seeds", 2, "--resolution", 0.1)
    assert code == 0
    (row,) = rows_of(out)
    assert (row["world"], row["seeds"]) == ("random", "2")
    runs = json.loads((tmp_path / "scores.json").read_text())
    assert [run["world"] for run in runs] == ["random 0", "random 1"]


def test_a_narrow_terminal_gets_the_table_upright(tempog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    for columns, heading in ((100, "| world"), (400, "| world   | people")):
        monkeypatch.setenv("COLUMNS", str(columns))
        code, out, _ = tempog("1", "-o", tmp_path, "--duration", 10, "--force")
        assert (code, out.startswith(heading)) == (0, True)
        assert max(map(len, out.splitlines())) <= columns
        assert ("| people " in out.splitlines()[2]) == (columns == 100)
        assert (tmp_path / "table.md").read_text().startswith("| world   | people")


@pytest.mark.parametrize(
    ("words", "code", "expected"),
    [
        (["1", "--people", 5], 2, "--people"),
        (["1", "--method", "magic"], 2, "paper, paper-tuned"),
        (["1", "--resolution", -1], 2, "resolution_m"),
        (["hallway", "--duration", 1e9, "--resolution", 0.1, "--resolution", 1e-3], 2, "coarser resolution"),
        (["1", "--resolution", "nan"], 2, "resolution_m"),
        (["1", "--duration", -1], 2, "--duration -1"),
        (["hallway", "--people", -1], 2, "--people"),
        (["no-such-world"], 1, "hallway"),
        (["2A"], 1, "Experiments: 1, 2a, 2b, 2c, all."),
    ],
)
def test_what_cannot_work_is_refused(tempog, tmp_path: Path, words: list[object], code: int, expected: str) -> None:
    got, _, err = tempog(*words, "-o", tmp_path / "a")
    assert (got, expected in err) == (code, True), err
    assert not (tmp_path / "a").exists()


def test_a_setting_given_twice_counts_once_and_a_nameless_world_has_its_file_s_name(tempog, tmp_path: Path) -> None:
    world = tmp_path / "yard.toml"
    world.write_text("[robot]\nwaypoints = [[0, 0]]\n[[wall]]\nline = [[-1, 2], [1, 2]]\n")
    twice = ["--method", "paper", "--method", "paper", "--resolution", 0.1, "--resolution", 0.1]
    code, out, _ = tempog(world, "-o", tmp_path / "a", "--duration", 2, *twice)
    assert code == 0
    (row,) = rows_of(out)
    assert (row["seeds"], row["world"]) == ("1", "yard")


def test_results_are_not_overwritten_without_force(tempog, tmp_path: Path) -> None:
    (tmp_path / "scores.json").write_text("precious")
    words = ["1", "-o", tmp_path, "--duration", 10, "--quiet"]
    code, _, err = tempog(*words)
    assert (code, "--force" in err) == (1, True)
    assert (tmp_path / "scores.json").read_text() == "precious"
    assert tempog(*words, "--force")[0] == 0
    assert tempog("1", "-o", tmp_path / "scores.json")[0] == 1
