"""A document of found objects as sets of cells."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tempog.errors import AnswerError, ConfigError
from tempog.simulation.cell_sets import cells_at, unique_cells


@dataclass(frozen=True, eq=False)
class Answer:
    """What a document reports.

    Attributes
    ----------
    static, uncertain : (n_cells, 2) int64
    ids : list of int
        Of each configuration; those of one id and with the same cells are one configuration.
    configurations : list of (n_cells, 2) int64
    objects : list of frozenset of int
        The configurations in each object.
    """

    static: NDArray[np.int64]
    uncertain: NDArray[np.int64]
    ids: list[int]
    configurations: list[NDArray[np.int64]]
    objects: list[frozenset[int]]


def read_answer(document: dict[str, Any]) -> Answer:
    """The cells of a document that follows the schema."""
    resolution_m = document["resolution_m"]
    ids: list[int] = []
    configurations: list[NDArray[np.int64]] = []
    numbers: dict[tuple[int, bytes], int] = {}

    def number(configuration: dict[str, Any], where: str) -> int:
        cells = document_cells(configuration["cells"], resolution_m, where)
        key = (int(configuration["id"]), cells.tobytes())
        if key not in numbers:
            numbers[key] = len(ids)
            ids.append(key[0])
            configurations.append(cells)
        return numbers[key]

    objects = [
        frozenset(number(place, f"objects[{k}].configurations[{i}]") for i, place in enumerate(one["configurations"]))
        for k, one in enumerate(document["objects"])
    ]
    for k, place in enumerate(document["unassociated"]):
        number(place, f"unassociated[{k}]")
    static, uncertain = (
        document_cells(document.get(name, []), resolution_m, name) for name in ("static", "uncertain")
    )
    return Answer(static, uncertain, ids, configurations, objects)


def document_cells(points: list[list[float]], resolution_m: float, where: str) -> NDArray[np.int64]:
    """The cells (n, 2) around some centres, sorted, each once."""
    try:
        return unique_cells(cells_at(points, resolution_m))
    except ConfigError as error:
        raise AnswerError(f"{where}: {error}") from error
