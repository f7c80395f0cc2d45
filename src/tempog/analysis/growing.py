"""Objects of a map that grows: what has not changed since the last time is not worked out again."""

from __future__ import annotations

from tempog.analysis.evidence.blocks import BLOCK_TILES
from tempog.analysis.evidence.find import find_by_evidence
from tempog.analysis.evidence.known import Known
from tempog.analysis.find_objects import FoundObjects
from tempog.errors import ConfigError
from tempog.grid.history import History
from tempog.methods import EvidenceConfig


class EvidenceAnalysis:
    """Method ``evidence`` for a map that is asked time and again while it grows.

    It gives what `find_objects` gives, and remembers, for each block of the map, group of cells and place, what it
    came to and from what. Any history may follow any other: what is remembered is used where the same was measured
    from the same poses, to the nanosecond and the last bit, and nowhere else.

    Parameters
    ----------
    settings : EvidenceConfig, optional
    block_tiles : int
        Side of a block, in tiles of 8 cells. The answer does not depend on it.

    Raises
    ------
    ConfigError
        A `block_tiles` that is no number of tiles.

    Notes
    -----
    If the time between scans changes, in the median and to three digits, nothing that was worked out before is of
    use. What is compared anew with each update, though cheaply, is every interval; which places are of one object is
    worked out anew, too.

    Examples
    --------
    >>> from tempog import EvidenceAnalysis, TemporalGrid
    >>> from tempog.simulation import corridor, simulate
    >>> scans = simulate(corridor()).scans
    >>> grid, analysis = TemporalGrid(), EvidenceAnalysis()
    >>> grid.integrate_many(scans[:1500])
    >>> len(analysis.update(grid).configurations)
    2
    >>> grid.integrate_many(scans[1500:])
    >>> len(analysis.update(grid).configurations)
    2
    """

    def __init__(self, settings: EvidenceConfig | None = None, block_tiles: int = BLOCK_TILES) -> None:
        if not isinstance(block_tiles, int) or block_tiles < 1:
            raise ConfigError(f"block_tiles = {block_tiles!r} cannot work; wanted a whole number of tiles, 1 or more")
        if settings is not None and not isinstance(settings, EvidenceConfig):
            raise ConfigError(f"settings is a {type(settings).__name__}; wanted EvidenceConfig(...)")
        self.settings = settings or EvidenceConfig()
        self.block_tiles = block_tiles
        self._known = Known()

    def update(self, history: History) -> FoundObjects:
        """What is found in a history now; see `find_objects`.

        Raises
        ------
        TimeError
            An empty history.
        """
        history.require_scans()
        walls, configurations, objects = find_by_evidence(history, self.settings, self._known, self.block_tiles)
        return FoundObjects(
            history, "evidence", self.settings, walls, history.extent, tuple(configurations), tuple(objects)
        )

    @property
    def share_recalled(self) -> float:
        """Share of the answers about blocks, groups and places that the last update had from an earlier one."""
        n_asked = self._known.n_recalled + self._known.n_worked_out
        return self._known.n_recalled / n_asked if n_asked else 0.0
