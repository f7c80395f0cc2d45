"""The tutorial: executed here, and written anew with ``python tests/tutorial.py``."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

TUTORIAL = Path(__file__).parent.parent / "docs" / "tutorial.ipynb"
CELL_S = 300


def read(path: Path = TUTORIAL) -> Any:
    """The notebook, with what it showed when it was written."""
    return nbformat.read(path, as_version=4)


def execute(folder: Path) -> Any:
    """The notebook with what it shows now; its files go to a folder. CellExecutionError if a cell fails."""
    notebook = read()
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    where = {"metadata": {"path": str(folder)}}
    NotebookClient(notebook, timeout=CELL_S, kernel_name="python3", resources=where).execute(cleanup_kc=True)
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)  # when it ran
    return notebook


def texts(notebook: Any) -> list[tuple[str, str]]:
    """What each code cell says, in words: source and text, pictures left out."""
    shown = []
    for cell in notebook.cells:
        if cell.cell_type != "code":
            continue
        parts = []
        for output in cell.outputs:
            if output.output_type == "stream":
                parts.append(output.text)
            elif output.output_type in ("execute_result", "display_data"):
                plain = output.data.get("text/plain", "")
                parts.append("" if plain.startswith("<Figure") else plain)
        shown.append((cell.source, "\n".join(parts)))
    return shown


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        executed = execute(Path(folder))
    executed.metadata["language_info"] = {"name": "python"}
    nbformat.write(executed, TUTORIAL)
    sys.stdout.write(f"{TUTORIAL}: {TUTORIAL.stat().st_size / 1000:.0f} kB\n")
