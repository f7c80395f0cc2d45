"""``tempog diff`` as a user calls it."""

from __future__ import annotations

import json
from functools import partial
from importlib.resources import files
from pathlib import Path

import jsonschema
import matplotlib.image
import pytest

from tempog import build_grid, open_map, open_scans, save_map
from tempog.simulation import corridor, load_world, simulate

SCHEMA = json.loads((files("tempog") / "schemas/diff-1.json").read_text(encoding="utf-8"))
DATA = Path(__file__).parents[3] / "shared/data/laser_logs"


@pytest.fixture(scope="module")
def corridor_map(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("maps") / "corridor.tempog"
    save_map(build_grid(simulate(corridor(seed=0), seed=0).scans), path)
    return path


@pytest.fixture
def tempog(tempog):
    """``tempog diff WORDS...``"""
    return partial(tempog, "diff")


def test_the_schema_is_one() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


def test_a_door_that_opened_is_printed_drawn_and_written(tempog, corridor_map: Path, tmp_path: Path) -> None:
    picture, file = tmp_path / "d.png", tmp_path / "d.json"
    code, out, err = tempog(corridor_map, "--between", "+66", "+100", "-o", picture, "--json", file)
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0].startswith("+66.0 s to +100.0 s: 1 moved, 0 appeared, 0 vanished, in ")
    assert lines[2].startswith("   1 moved ")
    assert "object 1: 2 (7.4, 3.2) -> 1 (7.0, 2.5); 1 move; last seen " in lines[2]
    assert lines[3].startswith("not seen again: ")
    assert lines[-2:] == [f"Written: {picture}", f"Written: {file}"]
    assert matplotlib.image.imread(picture).ndim == 3
    document = json.loads(file.read_text())
    jsonschema.Draft202012Validator(SCHEMA).validate(document)
    (move,) = document["changes"]
    assert (move["number"], move["kind"], move["object"]) == (1, "moved", 1)
    assert (move["before"]["configuration"], move["after"]["configuration"]) == (2, 1)
    assert move["before"]["last_seen_s"] <= document["before_s"] < move["after"]["since_s"] <= document["after_s"]


@pytest.mark.parametrize("form", ["offset", "seconds", "date"])
def test_moments_take_all_forms(tempog, corridor_map: Path, form: str) -> None:
    start_s = int(open_map(corridor_map).stamps_ns[0]) / 1e9
    moments = {
        "offset": ("+66", "+100s"),
        "seconds": (start_s + 66, start_s + 100),
        "date": ("2025-06-15T15:07:46Z", "2025-06-15T15:08:20Z"),
    }[form]
    code, out, _ = tempog(corridor_map, "--between", *moments)
    assert code == 0
    assert out.startswith("+66.0 s to +100.0 s: 1 moved, 0 appeared, 0 vanished")


def test_patches_are_in_the_file_with_numbers_of_the_text(tempog, tmp_path: Path) -> None:
    path = tmp_path / "office.tempog"
    save_map(build_grid(simulate(load_world("office"), duration_s=420.0, seed=210, people=5).scans), path)
    code, out, _ = tempog(path, "--between", "+150", "+410", "--json", tmp_path / "d.json", "--for", "0")
    assert code == 0
    document = json.loads((tmp_path / "d.json").read_text())
    jsonschema.Draft202012Validator(SCHEMA).validate(document)
    kinds = [change["kind"] for change in document["changes"]]
    assert {"moved", "appeared", "vanished"} == set(kinds)
    rows = [line.split()[:2] for line in out.splitlines()[2 : 2 + len(kinds)]]
    assert rows == [[str(k + 1), kind] for k, kind in enumerate(kinds)]
    assert document["brief"] == []
    assert max(len(line) for line in out.splitlines() if not line.startswith("Written")) <= 120
    for change in document["changes"]:
        if change["kind"] != "moved":
            assert change["area_m2"] == pytest.approx(len(change["cells"]) * 0.05**2)
            assert change["last_before_s"] <= change["first_after_s"]
    _, out, _ = tempog(path, "--between", "+150", "+410", "--json", tmp_path / "e.json")
    document = json.loads((tmp_path / "e.json").read_text())
    assert document["brief"]
    assert f"not listed: {len(document['brief'])} patch" in out


def test_the_schema_refuses_what_is_wrong(tempog, corridor_map: Path, tmp_path: Path) -> None:
    tempog(corridor_map, "--between", "+66", "+100", "--json", tmp_path / "d.json")
    validator = jsonschema.Draft202012Validator(SCHEMA)
    for key, wrong in [("version", 2), ("changes", [{"number": 1}]), ("brief", [1]), ("surprise", 1), ("areas", {})]:
        document = json.loads((tmp_path / "d.json").read_text())
        assert validator.is_valid(document)
        document[key] = wrong
        assert not validator.is_valid(document), key


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["--between", "+100", "+66"], 2, "comes after the second"),
        (["--between", "+66", "+9999"], 1, "nothing is known of"),
        (["--between", "+66", "soon"], 2, "'soon' is not a moment"),
        (["--between", "+66"], 2, "requires 2 arguments"),
        ([], 2, "Missing option '--between'"),
        (["--between", "+66", "+100", "--for", "-1"], 2, "for_s = -1"),
        (["--between", "+66", "+100", "--hold", "-1"], 2, "hold = -1"),
        (["--between", "+66", "+100", "-o", "picture.txt"], 2, "names no picture format"),
    ],
)
def test_errors_are_one_message(tempog, corridor_map: Path, words: list[str], code: int, message: str) -> None:
    found, out, err = tempog(corridor_map, *words)
    assert (found, out) == (code, "")
    assert message in err
    assert "Traceback" not in err


def test_nothing_is_overwritten(tempog, corridor_map: Path, tmp_path: Path) -> None:
    for option, name in (("-o", "d.png"), ("--json", "d.json")):
        (tmp_path / name).write_text("mine")
        words = (corridor_map, "--between", "+66", "+100", option, tmp_path / name)
        code, _, err = tempog(*words)
        assert code == 1
        assert "exists already; use --force" in err
        assert (tmp_path / name).read_text() == "mine"
        assert tempog(*words, "--force")[0] == 0
        assert (tmp_path / name).read_bytes() != b"mine"


def test_a_missing_map_is_bad_data(tempog, tmp_path: Path) -> None:
    code, _, err = tempog(tmp_path / "none.tempog", "--between", "+1", "+2")
    assert code == 1
    assert "is not a tempog map" in err


@pytest.mark.skipif(not DATA.is_dir(), reason="the public logs are not on this machine")
@pytest.mark.parametrize("name", ["freiburg-079", "intel"])
def test_walls_of_real_logs_do_not_change(tempog, tmp_path: Path, name: str) -> None:
    grid = build_grid(open_scans(DATA / f"{name}-corrected.log.gz"))
    save_map(grid, tmp_path / "m.tempog")
    code, _, err = tempog(
        tmp_path / "m.tempog",
        "--between",
        f"+{grid.duration_s / 2}",
        f"+{grid.duration_s - 1}",
        "--for",
        "5",
        "--json",
        tmp_path / "d.json",
    )
    assert code == 0
    assert "note: poses look inconsistent" in err
    document = json.loads((tmp_path / "d.json").read_text())
    jsonschema.Draft202012Validator(SCHEMA).validate(document)
    assert len(document["changes"]) + len(document["brief"]) <= 25
    assert document["areas"]["compared_m2"] > 200
