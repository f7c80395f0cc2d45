"""Reference relations: read, matched to scans, and compared with their poses."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tempog import ConfigError, Scan, ScanError, open_scans
from tempog.scans.relations import Relations, read_relations, relation_error

S = 1_000_000_000
DATA = Path(__file__).parents[3] / "shared/data"


def scans_at(*poses: tuple[float, float, float, float]) -> list[Scan]:
    return [Scan(t, (x, y, theta), [0.0], [2.0]) for t, x, y, theta in poses]


def test_a_file_is_read_and_bad_rows_are_named(tmp_path) -> None:
    path = tmp_path / "r.relations"
    path.write_text("1.5 2.5 0.4 -0.1 0 0 0 3.1\n2.5 4 1 1 0 0.5 0 0\nnan 2 1 1 0 0 0 0\n2 3 inf 1 0 0 0 0\n1 2 3\n")
    with pytest.raises(ScanError, match=r"line 5: has 3 fields; wanted 8"):
        read_relations(path)
    relations = read_relations(path, skip_bad=True)
    assert (len(relations), relations.n_skipped) == (1, 4)
    assert (relations.first_ns[0], relations.second_ns[0]) == (1.5 * S, 2.5 * S)
    assert relations.moves[0].tolist() == [0.4, -0.1, 3.1]
    lines = path.read_text().splitlines()
    for line, said in zip(lines[1:4], ("roll and pitch", "usable seconds", "the move is"), strict=True):
        path.write_text(line)
        with pytest.raises(ScanError, match=f"line 1: .*{said}"):
            read_relations(path)
    path.write_text("")
    with pytest.raises(ScanError, match="is empty"):
        read_relations(path)


def test_true_poses_have_no_error_wherever_the_map_lies() -> None:
    rng = np.random.default_rng(3)
    scans = scans_at(*[(float(k), *rng.normal(size=2) * 5, rng.uniform(-9, 9)) for k in range(20)])
    first, second = rng.integers(0, 20, size=(2, 50))
    moves = []
    for i, j in zip(first, second, strict=True):
        a, b = scans[i], scans[j]
        away = complex(b.x - a.x, b.y - a.y) * complex(math.cos(a.theta), -math.sin(a.theta))
        moves.append((away.real, away.imag, math.remainder(b.theta - a.theta, 2 * math.pi)))
    true = Relations(first * S, second * S, np.array(moves))
    error = relation_error(scans[::-1], true)
    assert error.n_used == error.n == 50
    assert error.translation_m == pytest.approx(0, abs=1e-9)
    assert error.rotation_rad == pytest.approx(0, abs=1e-9)


def test_errors_are_means_of_lengths_and_angles() -> None:
    scans = scans_at((0, 0, 0, math.pi / 2), (1, 0, 1, math.pi / 2), (2, 0, 3, -math.pi))
    moves = np.array([(1.0, 0.3, 0.0), (2.4, 0.0, math.pi / 2 - 0.2)])
    error = relation_error(scans, Relations(np.array([0, 1]) * S, np.array([1, 2]) * S, moves))
    assert error.translation_m == pytest.approx(0.35)
    assert error.translation_sd_m == pytest.approx(0.05)
    assert error.rotation_rad == pytest.approx(0.1)
    assert str(error) == "0.350 ± 0.050 m and 5.73 ± 5.73 degrees over 2 of 2 relations"


def test_only_relations_between_scans_count() -> None:
    scans = scans_at((10, 0, 0, 0), (11, 1, 0, 0))
    relations = Relations(np.array([110.02, 110.5]) * S, np.array([111.0, 111.0]) * S, np.tile([1.0, 0, 0], (2, 1)))
    with pytest.raises(
        ScanError, match=r"they are of 110.020 to 111.000 s, the scans of 10.000 to 11.000 s.*\n.*offset_s"
    ):
        relation_error(scans, relations)
    assert relation_error(scans, relations, offset_s=-100, within_s=0.1).n_used == 1
    assert relation_error(scans, relations, offset_s=-100, within_s=1).n_used == 2
    for options in ({"offset_s": math.nan}, {"within_s": -1.0}):
        with pytest.raises(ConfigError, match="wanted seconds"):
            relation_error(scans, relations, **options)
    with pytest.raises(ConfigError, match="offset_s"):
        relation_error(scans, relations, offset_s=1e12)
    with pytest.raises(ScanError, match="no scans"):
        relation_error([], relations)


@pytest.mark.skipif(not DATA.is_dir(), reason="no copies of the real logs here")
@pytest.mark.parametrize(
    ("log", "relations", "offset_s", "within_s", "wanted"),
    [
        ("freiburg-079", "fr079", -1211.42, 0.1067, (0.058, 1659)),
        ("intel", "intel", -976052857.3373, 0.005, (0.064, 118)),
    ],
)
def test_the_public_logs_score_what_the_datasets_say(log, relations, offset_s, within_s, wanted) -> None:
    scans = open_scans(DATA / f"laser_logs/{log}-corrected.log.gz")
    true = read_relations(DATA / f"pose_relations/{relations}.relations")
    error = relation_error(scans, true, offset_s=offset_s, within_s=within_s)
    assert (round(error.translation_m, 3), error.n_used) == pytest.approx(wanted, rel=0.02)
