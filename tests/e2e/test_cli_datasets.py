"""``tempog datasets`` as a user calls it; files that are in the cache need no network."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

SHARED = Path(__file__).parents[3] / "shared/data/laser_logs"


def test_list_says_names_sizes_and_pitfalls(tempog) -> None:
    result = tempog("datasets", "list")
    assert result.code == 0
    assert "freiburg-079" in result.out
    assert "2.0 MB" in result.out
    assert "no licence stated" in result.out
    assert max(len(line) for line in result.out.splitlines()) <= 120
    listed = json.loads(tempog("datasets", "list", "--json").out)["datasets"]
    assert {"name", "url", "sha256", "size", "licence", "pitfalls"} <= listed[0].keys()


def test_an_unknown_name_is_wrong_usage(tempog) -> None:
    result = tempog("datasets", "get", "freiburg")
    assert result.code == 2
    assert "freiburg-079" in result.err


@pytest.mark.skipif(not SHARED.is_dir(), reason="no copies of the real logs here")
def test_get_gives_a_path_that_map_takes(tempog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pooch", reason="pooch, of the extra datasets, is not installed")
    monkeypatch.setenv("TEMPOG_CACHE", str(tmp_path))
    shutil.copy(SHARED / "seattle-corrected.log.gz", tmp_path)
    result = tempog("datasets", "get", "seattle")
    assert result.code == 0
    path = result.out.strip()
    assert path == str(tmp_path / "seattle-corrected.log.gz")
    assert f"try: tempog map {path}" in result.err
    assert tempog("map", path, "-o", tmp_path / "m.tempog", "--quiet").code == 0
    (tmp_path / "here").mkdir()
    answer = json.loads(tempog("datasets", "get", "seattle", "--to", tmp_path / "here", "--json").out)
    assert Path(answer["path"]).read_bytes() == Path(path).read_bytes()
