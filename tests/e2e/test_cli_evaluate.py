"""`tempog evaluate` as a user calls it: maps and documents against the truth beside a log."""

from __future__ import annotations

import json

import pytest

from tempog import build_grid, save_map
from tempog.analysis.find_objects import find_objects
from tempog.analysis.objects_schema import read_objects
from tempog.evaluation import evaluate, truth_document
from tempog.scans.npz import write_npz
from tempog.simulation import load_world, simulate
from tempog.simulation.truth import Truth, read_truth, write_truth


@pytest.fixture(scope="module")
def hall(tmp_path_factory):
    """A folder with hall.tempog, the truth about hall.npz, and that truth as an answer."""
    folder = tmp_path_factory.mktemp("hall")
    simulation = simulate(load_world("hallway"), 90.0, people=5)
    write_truth(folder / "hall.npz", simulation)
    save_map(build_grid(simulation.scans), folder / "hall.tempog")
    document = truth_document(Truth.of(simulation), 0.05, scans=[0, 300, 600])
    (folder / "true.json").write_text(json.dumps(document))
    return folder


@pytest.mark.parametrize("suffix", ["", ".truth.json", ".truth.npz"])
def test_the_truth_as_a_document_is_right_in_everything(tempog, hall, suffix):
    code, out, err = tempog("evaluate", hall / "true.json", hall / f"hall.npz{suffix}")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0] == "hallway, method truth, 1 min 30 s, cells of 0.05 m"
    for name in ("static", "configurations", "on the move"):
        row = next(line for line in lines if line.startswith(name))
        assert row.count(" 1.00 (") == 2
    assert "false configurations: 0 at walls, 0 at doors and boxes, 0 elsewhere" in lines
    assert "missed" not in out
    code, out, _ = tempog("evaluate", hall / "true.json", hall / "hall.npz", "--json")
    assert code == 0
    assert json.loads(out) == evaluate(read_objects(hall / "true.json"), read_truth(hall / "hall.npz")).to_dict()


@pytest.mark.parametrize("method", ["paper", "paper-tuned"])
def test_a_map_is_scored_as_what_the_method_finds_in_it(tempog, hall, method):
    words = ["evaluate", hall / "hall.tempog", hall / "hall.npz", "--method", method, "--every", 10]
    code, out, err = tempog(*words, "--json")
    assert (code, err) == (0, "")
    scores = json.loads(out)
    from tempog.store.saved_map import open_map

    found = find_objects(open_map(hall / "hall.tempog"), method)
    document = found.document(found.high_dynamics(10.0))
    assert scores == evaluate(document, read_truth(hall / "hall.npz")).to_dict()
    assert scores["method"] == method
    assert scores["high_dynamic"]["n_scans"] == 9
    assert scores["static"]["f1"] > 0.8
    code, out, _ = tempog(*words)
    assert f"F1 {scores['static']['f1']:.2f}" in out
    missed = [p for p in scores["places"] if p["observable"] and p["configuration"] is None]
    assert ("missed: " in out) == bool(missed)


def test_what_a_document_says_is_scored_whatever_method_is_asked(tempog, hall, tmp_path):
    assert (
        tempog("objects", hall / "hall.tempog", "--json", tmp_path / "o.json", "--from", "+10", "--to", "+60")[0] == 0
    )
    code, out, err = tempog("evaluate", tmp_path / "o.json", hall / "hall.npz", "--method", "paper-tuned")
    assert (code, "--method ignored" in err) == (0, True)
    assert out.startswith("hallway, method evidence, 50.0 s, ")
    unknown = f"on the move     {'unknown':24}{'unknown':24}"
    assert f"{unknown}0 scans, tempog objects --high-dynamic writes them" in out


def test_a_map_of_another_log_is_scored_with_a_warning(tempog, hall, tmp_path):
    simulation = simulate(load_world("hallway"), 5.0)
    write_npz(tmp_path / "other.npz", simulation.scans)
    assert tempog("map", tmp_path / "other.npz", "-o", tmp_path / "other.tempog")[0] == 0
    code, out, err = tempog("evaluate", tmp_path / "other.tempog", hall / "hall.npz.truth.json")
    assert (code, out[:7]) == (0, "hallway")
    assert "is a map of other.npz, the truth is about hall.npz" in err
    write_truth(tmp_path / "other.npz", simulation)
    assert tempog("evaluate", tmp_path / "other.tempog", tmp_path / "other.npz")[2] == ""


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["{hall}/true.json", "{hall}/none.npz"], 1, "none.npz.truth.json: No such file"),
        (["{hall}/none.json", "{hall}/hall.npz"], 1, "cannot read "),
        (["{hall}/hall.npz.truth.json", "{hall}/hall.npz"], 1, "format is 'tempog-truth'; wanted \"tempog-objects\""),
        (["{hall}/hall.npz.truth.npz", "{hall}/hall.npz"], 1, "is no JSON; wanted a map"),
        (["{hall}", "{hall}/hall.npz"], 1, "map.json"),
        (["{hall}/true.json", "{hall}/hall.npz", "--method", "magic"], 2, "magic"),
        (["{hall}/true.json"], 2, "TRUTH"),
    ],
)
def test_what_cannot_be_scored_is_refused_in_one_message(tempog, hall, words, code, message):
    seen, out, err = tempog("evaluate", *(word.format(hall=hall) for word in words))
    assert (seen, out) == (code, "")
    assert message in err
    assert "Traceback" not in err


def test_a_document_of_another_log_is_refused(tempog, hall, tmp_path):
    document = json.loads((hall / "true.json").read_text())
    document["start_s"] -= 1e6
    document["stop_s"] -= 1e6
    (tmp_path / "o.json").write_text(json.dumps(document))
    code, _, err = tempog("evaluate", tmp_path / "o.json", hall / "hall.npz")
    assert code == 1
    assert "no scan from 1749000000.000 s to 1749000089.900 s; the truth covers" in err
