"""The tutorial runs, and shows what it showed when it was written."""

from __future__ import annotations

import base64

import pytest

tutorial = pytest.importorskip("tutorial", reason="nbclient is not installed", exc_type=ImportError)
pytest.importorskip("xarray", reason="xarray is not installed")


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")  # of the packages that run it
def test_the_tutorial_says_what_it_said(tmp_path):
    written, now = tutorial.texts(tutorial.read()), tutorial.texts(tutorial.execute(tmp_path))
    for (source, was), (_, says) in zip(written, now, strict=True):
        assert says == was, f"{source}\n\nWrite the tutorial anew: python tests/tutorial.py"
    assert (tmp_path / "tutorial.html").is_file()


def test_the_tutorial_was_kept_as_executed_and_is_no_burden():
    notebook = tutorial.read()
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    assert not [output for cell in cells for output in cell.outputs if output.output_type == "error"]
    pictures = [
        base64.b64decode(output.data["image/png"])
        for cell in cells
        for output in cell.outputs
        if "image/png" in output.get("data", {})
    ]
    assert len(pictures) >= 5
    assert max(map(len, pictures)) < 200_000
    assert tutorial.TUTORIAL.stat().st_size < 700_000
    assert "/tmp" not in tutorial.TUTORIAL.read_text(encoding="utf-8")
