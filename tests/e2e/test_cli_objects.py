"""``tempog objects`` as a user calls it."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from functools import partial
from importlib.resources import files
from itertools import pairwise
from pathlib import Path

import jsonschema
import pytest

from tempog import build_grid, save_map, write_npz
from tempog.analysis.objects_schema import check_objects
from tempog.cli.app import run
from tempog.simulation import PoseError, corridor, simulate

SCHEMA = json.loads((files("tempog") / "schemas/objects-1.json").read_text(encoding="utf-8"))
# Not the defaults, which find no object in the corridor: so that every part of the file is there to be checked.
PAPER = ["--method", "paper"]
GENEROUS = [*PAPER, "--set", "none_share=0.9", "--set", "both_share=0.9", "--set", "min_common_s=0.5"]


@pytest.fixture(scope="module")
def corridor_map(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("maps") / "corridor.tempog"
    save_map(build_grid(simulate(corridor(seed=0), duration_s=120, seed=0).scans), path)
    return path


@pytest.fixture
def tempog(tempog):
    """``tempog objects WORDS...``"""
    return partial(tempog, "objects")


def test_the_schema_is_one() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("words", [[], PAPER, GENEROUS, ["--from", "+20", "--to", "+60"]])
def test_the_file_follows_the_schema(tempog, corridor_map: Path, tmp_path: Path, words: list[object]) -> None:
    code, out, err = tempog(corridor_map, "--json", tmp_path / "o.json", "--high-dynamic", *words)
    assert (code, err) == (0, "")
    document = json.loads((tmp_path / "o.json").read_text())
    jsonschema.Draft202012Validator(SCHEMA).validate(document)
    assert document["static"]
    assert document["unassociated"] or document["objects"] or "--from" in words  # the door did not move in that time
    assert len(document["high_dynamic"]) == (401 if "--from" in words else 1200)
    assert any(measured["cells"] for measured in document["high_dynamic"])  # the person
    if words == GENEROUS:
        assert document["objects"]
    n_objects, n_lone = len(document["objects"]), len(document["unassociated"])
    counts = f"{n_objects} object{'s' * (n_objects != 1)}, {n_lone} place{'s' * (n_lone != 1)} in no object,"
    assert out.startswith(counts)
    ids = {place["id"] for one in document["objects"] for place in one["configurations"]}
    assert not ids & {place["id"] for place in document["unassociated"]}
    for one in document["objects"]:
        assert {state for _, _, state in one["timeline"]} <= {p["id"] for p in one["configurations"]} | {None}


def test_the_schema_refuses_what_is_wrong(tempog, corridor_map: Path, tmp_path: Path) -> None:
    tempog(corridor_map, "--json", tmp_path / "o.json", *GENEROUS)
    validator = jsonschema.Draft202012Validator(SCHEMA)
    for key, wrong in [("version", 2), ("static", [[1]]), ("objects", [{"id": 1}]), ("surprise", 1)]:
        document = json.loads((tmp_path / "o.json").read_text())
        document[key] = wrong
        assert not validator.is_valid(document), key
    document = json.loads((tmp_path / "o.json").read_text())
    document["objects"][0]["configurations"][0]["periods"][0][2] = "ajar"
    assert not validator.is_valid(document)


def test_a_period_is_the_files_period(tempog, corridor_map: Path, tmp_path: Path) -> None:
    tempog(corridor_map, "--json", tmp_path / "o.json", "--from", "+20", "--to", "+60")
    document = json.loads((tmp_path / "o.json").read_text())
    assert document["stop_s"] - document["start_s"] == pytest.approx(40.0)
    for place in document["unassociated"]:
        for start, stop, _ in place["periods"]:
            assert document["start_s"] <= start < stop <= document["stop_s"] + 0.1 + 1e-6  # a look lasts 0.1 s


def test_a_file_that_exists_is_not_overwritten_without_force(tempog, corridor_map: Path, tmp_path: Path) -> None:
    file = tmp_path / "o.json"
    file.write_text("precious")
    code, _, err = tempog(corridor_map, "--json", file)
    assert code == 1
    assert "--force" in err
    assert file.read_text() == "precious"
    assert tempog(corridor_map, "--json", file, "--force")[0] == 0
    assert json.loads(file.read_text())["format"] == "tempog-objects"
    assert [path.name for path in tmp_path.iterdir()] == ["o.json"]


@pytest.mark.parametrize(
    ("words", "code", "expected"),
    [
        (["--set", "max_states=1"], 2, "max_states"),
        ([*PAPER, "--set", "within_m=0"], 2, "within_m"),
        ([*PAPER, "--set", "distance-p=0"], 2, "distance_p"),
        (["--set", "distance_p=1"], 2, "distance_p=1 names no setting"),
        ([*PAPER, "--set", "both_share=2"], 2, "both_share"),
        ([*PAPER, "--set", "both_share=much"], 2, "no number"),
        (["--set", "within_m=none"], 2, "within_m = None cannot work; wanted a number"),
        (["--set", "both_share"], 2, "NAME=VALUE"),
        (["--method", "magic"], 2, "magic"),
        (["--from", "+1000", "--to", "+2000"], 1, "no scan"),
        (["--json", "no/such/place.json"], 1, "not a directory"),
    ],
)
def test_what_cannot_work_is_refused(
    tempog, corridor_map: Path, words: list[object], code: int, expected: str
) -> None:
    got, _, err = tempog(corridor_map, *words)
    assert (got, expected in err) == (code, True), err


def test_within_none_compares_all_pairs(tempog, corridor_map: Path, tmp_path: Path) -> None:
    words = [*PAPER, "--set", "within_m=none", "--set", "max_states=2", "--json", tmp_path / "o.json"]
    assert tempog(corridor_map, *words)[0] == 0
    assert json.loads((tmp_path / "o.json").read_text())["settings"]["within_m"] is None


def test_the_corridors_door_is_found_by_default(tempog, tmp_path: Path) -> None:
    save_map(build_grid(simulate(corridor(seed=0), seed=0).scans), tmp_path / "whole.tempog")
    code, out, _ = tempog(tmp_path / "whole.tempog", "--json", tmp_path / "o.json")
    assert code == 0
    assert "method evidence" in out
    document = json.loads((tmp_path / "o.json").read_text())
    (door,) = (one for one in document["objects"] if len(one["configurations"]) == 2)
    assert door["confidence"] > 0.5
    for place in door["configurations"]:
        assert all(6.4 < x < 7.6 and 2.4 < y < 3.6 for x, y in place["cells"])
    assert {place["id"] for place in door["configurations"]} == {where for _, _, where in door["timeline"] if where}


def test_poses_that_disagree_are_named_and_good_ones_are_not(monkeypatch, capsys, tmp_path: Path) -> None:
    bad = PoseError(drift_m=0.05, drift_rad=math.radians(0.8), drift_s=20.0)
    for name, error, consistent in (("good", PoseError(), True), ("bad", bad, False)):
        log, path, answer = (tmp_path / f"{name}{suffix}" for suffix in (".npz", ".tempog", ".json"))
        write_npz(log, simulate(replace(corridor(), pose_error=error), duration_s=120.0).scans)

        def call(*words: object) -> tuple[str, str]:
            monkeypatch.setattr(sys, "argv", ["tempog", *(str(word) for word in words)])
            with pytest.raises(SystemExit, match="0"):
                run()
            return capsys.readouterr()

        _, err = call("map", log, "-o", path)
        assert ("poses look inconsistent" in err) == (not consistent)
        measured = json.loads(call("map", log, "-o", path, "--force", "--json")[0])["poses"]
        assert measured["consistent"] is consistent
        assert json.loads(call("info", path, "--json")[0])["poses"] == measured
        out, _ = call("info", path)
        assert f"{measured['spread_m']:.3f} m displaced" in out
        assert ("poses      look inconsistent: " in out) == (not consistent)
        rows = [row for row in out.splitlines() if not row.startswith(("map", "source"))]  # those have paths
        assert max(map(len, rows)) <= 120
        _, err = call("objects", path, "--json", answer)
        assert ("objects found along walls may be wrong" in err) == (not consistent)
        assert "inconsistent" not in call("objects", path, "--quiet")[1]
        document = json.loads(answer.read_text())
        assert document["poses"] == measured
        jsonschema.validate(document, SCHEMA)


@pytest.fixture(scope="module")
def whole_map(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("maps") / "whole.tempog"
    save_map(build_grid(simulate(corridor(seed=0), seed=0).scans), path)
    return path


def test_an_object_has_a_row_and_a_course_that_agree_with_the_file(tempog, whole_map: Path, tmp_path: Path) -> None:
    code, out, err = tempog(whole_map, "--timeline", 1, "--json", tmp_path / "o.json")
    assert (code, err) == (0, "")
    assert max(map(len, out.splitlines())) <= 120
    document = json.loads((tmp_path / "o.json").read_text())
    jsonschema.Draft202012Validator(SCHEMA).validate(document)
    (door,) = document["objects"]
    assert door["n_moves"] == len(door["stays"]) - 1 == 6
    assert door["last"] == door["stays"][-1]
    assert sum(one["share"] for one in door["shares"]) == pytest.approx(1)
    assert sum(stay["seen_s"] for stay in door["stays"]) <= door["seen_s"]
    row = next(line for line in out.splitlines() if line.startswith("     1 ")).split()
    since, until = (f"+{door['last'][key] - document['start_s']:.1f}" for key in ("since_s", "last_seen_s"))
    assert row[1] == f"{door['confidence']:.2f}"
    assert row[4:8] == [str(door["last"]["configuration"]), since, until, "6"]
    course = out.split("object 1: 6 moves, ")[1].splitlines()[2:-1]
    assert sum(line.endswith("not seen") for line in course) >= len(door["gaps"]) > 0
    ends = [tuple(map(float, line.split()[:2])) for line in course]
    assert (ends[0][0], ends[-1][1]) == (0.0, pytest.approx(document["stop_s"] - document["start_s"], abs=0.11))
    assert all(later[0] == one[1] for one, later in pairwise(ends))


def test_files_from_before_there_were_stays_can_still_be_read(tempog, whole_map: Path, tmp_path: Path) -> None:
    tempog(whole_map, "--json", tmp_path / "o.json")
    document = json.loads((tmp_path / "o.json").read_text())
    for key in ("stays", "last", "n_moves", "gaps", "seen_s", "shares"):
        del document["objects"][0][key]
    jsonschema.Draft202012Validator(SCHEMA).validate(document)
    check_objects(document)


def test_the_course_of_an_object_that_is_not_there_is_refused(tempog, whole_map: Path, tmp_path: Path) -> None:
    code, out, err = tempog(whole_map, "--timeline", 7, "--json", tmp_path / "o.json")
    assert (code, out) == (2, "")
    assert "there is no object 7; wanted one of 1" in err
    assert not (tmp_path / "o.json").exists()
