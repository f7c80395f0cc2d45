"""The whole of section IV on one screen: walls, places, objects, what is on the move."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.configurations import Configuration, find_configurations
from tempog.analysis.evidence.find import find_by_evidence
from tempog.analysis.high_dynamic import HighDynamic, high_dynamic, high_dynamics, moving_intervals
from tempog.analysis.objects import MovingObject, associate
from tempog.analysis.objects_file import objects_document
from tempog.analysis.static import CellClass, static_map
from tempog.errors import ConfigError
from tempog.grid.history import History
from tempog.grid.segments import Runs
from tempog.methods import METHODS, EvidenceConfig, Method, PaperConfig
from tempog.sensing.grid_spec import Extent
from tempog.texts import counted
from tempog.times import Moment

if TYPE_CHECKING:
    from distributed import Client

    from tempog.analysis.cluster import Progress


@dataclass(frozen=True, eq=False)
class FoundObjects:
    """What a method found in a history.

    Attributes
    ----------
    history : History
        The one it was found in; a window if a window was asked.
    method : str
    settings : PaperConfig or EvidenceConfig
    walls : (n_rows, n_cols) int8, values of `CellClass`
        The static map that was used.
    extent : Extent
        Where `walls` lies. A grid that is being mapped may reach farther by now.
    configurations : tuple of Configuration
        All places, whether part of an object or not.
    objects : tuple of MovingObject
    """

    history: History
    method: Method
    settings: PaperConfig | EvidenceConfig
    walls: NDArray[np.int8]
    extent: Extent
    configurations: tuple[Configuration, ...]
    objects: tuple[MovingObject, ...]

    def __repr__(self) -> str:
        n_objects, n_lone = len(self.objects), len(self.unassociated)
        objects, places = counted(n_objects, "object", "objects"), counted(n_lone, "place", "places")
        return f"<FoundObjects: {objects}, {places} in no object, method {self.method}>"

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        from tempog.views.notebook import found_html, shown

        return shown(self, found_html)

    @property
    def unassociated(self) -> tuple[Configuration, ...]:
        """Configurations that are part of no object."""
        associated = {place.id for one in self.objects for place in one.configurations}
        return tuple(place for place in self.configurations if place.id not in associated)

    @property
    def static_points_map(self) -> NDArray[np.float64]:
        """Centres of the static cells, (n, 2) metres; row by row."""
        return self._centres(CellClass.STATIC)

    def _centres(self, what: CellClass) -> NDArray[np.float64]:
        rows, cols = np.nonzero(self.walls == what)
        return self.history.tiles.spec.centres(rows + self.extent.row0, cols + self.extent.col0)

    def walls_over(self, extent: Extent) -> NDArray[np.int8]:
        """`walls` laid over another extent: cells of it that `walls` does not reach are unexplored."""
        walls = np.full(extent.shape, CellClass.UNEXPLORED, dtype=np.int8)
        walls[self.extent.part_of(extent)] = self.walls[extent.part_of(self.extent)]
        return walls

    @property
    def uncertain_points_map(self) -> NDArray[np.float64]:
        """Centres of the cells that are occupied or free by where they are seen from, (n, 2) metres: glass."""
        return self._centres(CellClass.UNCERTAIN)

    def high_dynamic(self, at: Moment | None = None) -> HighDynamic:
        """What was on the move at one measurement (Fig. 11); default: the last. See `high_dynamic`."""
        return high_dynamic(self.history, at, **self._explained)

    def high_dynamics(self, every_s: float = 0.0) -> list[HighDynamic]:
        """What was on the move at each measurement, or at one every so many seconds. See `high_dynamics`."""
        return high_dynamics(self.history, every_s, **self._explained)

    def moving_intervals(self) -> Runs:
        """When each cell was occupied by something on the move, at all measurements. See `moving_intervals`."""
        return moving_intervals(self.history, **self._explained)

    @property
    def _explained(self) -> dict[str, Any]:
        return {
            "walls": self.walls_over(self.history.extent),
            "configurations": self.configurations,
            "near_m": self.settings.near_m,
            "in_free_places": self.method == "evidence",
        }

    def document(self, moving: Sequence[HighDynamic] = ()) -> dict[str, Any]:
        """All of it as the schema ``tempog/schemas/objects-1.json`` has it, ready for `json.dumps`.

        Parameters
        ----------
        moving : sequence of HighDynamic
            For the part "high_dynamic": the answer of `high_dynamics`, for example.
        """
        stamps, period = self.history.stamps_ns, (self.history.first_scan, self.history.last_scan)
        return objects_document(
            method=self.method,
            settings=dataclasses.asdict(self.settings),
            resolution_m=self.history.tiles.spec.resolution_m,
            start_ns=int(stamps[period[0]]),
            stop_ns=int(stamps[period[1]]),
            static_points_map=self.static_points_map,
            uncertain_points_map=self.uncertain_points_map,
            objects=self.objects,
            unassociated=self.unassociated,
            high_dynamic=moving,
        )


def find_objects(
    history: History,
    method: Method = "evidence",
    settings: PaperConfig | EvidenceConfig | None = None,
    *,
    cluster: Client | str | None = None,
    progress: Progress | None = None,
) -> FoundObjects:
    """Walls, places that things come to stand in, and which of them are places of one object.

    Parameters
    ----------
    history : History
        A grid, a saved map, or a window of either: then only that period counts (section IV.D).
    method : "evidence", "paper" or "paper-tuned"
        ``evidence``: from what is known of each state, however long it lasted; see `tempog.analysis.evidence`.
        ``paper``: Fig. 6, 7 and 10 to the letter. ``paper-tuned``: the same with the settings that served it best,
        see `tempog.methods.METHODS`.
    settings : EvidenceConfig or PaperConfig, optional
        Default: those of the method.
    cluster : distributed.Client or str, optional
        A Dask cluster that works out method ``evidence``, with the same answer; see docs/cluster.md.
        ``"tcp://host:8786"`` is a running scheduler. ``"local:2"`` starts two processes for it; as they import the
        script that asks, that needs ``if __name__ == "__main__":``.
    progress : callable, optional
        With a cluster, is told what is being worked out, how much of it is done, and how much there is.

    Returns
    -------
    FoundObjects

    Raises
    ------
    ConfigError
        An unknown method, settings of another one, or a cluster for another method than ``evidence``.
    ClusterError
        The cluster cannot be reached or used, or is lost.
    TimeError
        An empty history.

    Examples
    --------
    >>> from tempog import build_grid
    >>> from tempog.simulation import corridor, simulate
    >>> grid = build_grid(simulate(corridor(), duration_s=60.0).scans)
    >>> found = find_objects(grid, "paper-tuned")
    >>> len(found.static_points_map) > 100, len(found.high_dynamics(every_s=1.0))
    (True, 60)
    """
    if method not in METHODS:
        raise ConfigError(f"method = {method!r} is unknown; wanted one of {', '.join(METHODS)}")
    history.require_scans()
    chosen = settings or METHODS[method]
    if type(chosen) is not type(METHODS[method]):
        wanted = type(METHODS[method]).__name__
        raise ConfigError(f"method {method} takes its settings as {wanted}, not {type(chosen).__name__}")
    if isinstance(chosen, PaperConfig):
        if cluster is not None:
            raise ConfigError(f"method {method} cannot be worked out by a cluster; leave it out, or use evidence")
        walls, configurations, objects = find_by_paper(history, chosen)
    elif cluster is None:
        walls, configurations, objects = find_by_evidence(history, chosen)
    else:
        from tempog.analysis.cluster import dask_workers

        with dask_workers(cluster, progress) as workers:
            walls, configurations, objects = find_by_evidence(history, chosen, workers=workers)
    return FoundObjects(history, method, chosen, walls, history.extent, tuple(configurations), tuple(objects))


def find_by_paper(
    history: History, settings: PaperConfig
) -> tuple[NDArray[np.int8], list[Configuration], list[MovingObject]]:
    """The paper's steps one after the other."""
    walls = static_map(history, measure=settings.static_measure, weight=settings.static_weight)  # Fig. 6
    configurations = find_configurations(  # Fig. 7
        history,
        walls,
        distance="jaccard" if settings.distance == "jaccard" else settings.distance_p,
        threshold=settings.distance_below,
        min_common_s=settings.min_common_s,
        neighbourhood=settings.neighbourhood,
        seen_share=settings.seen_share,
        smallest_m=settings.smallest_m,
        candidates=settings.candidates,
        least_occupied=settings.least_occupied,
    )
    objects = associate(  # Fig. 9, 10
        configurations,
        max_states=settings.max_states,
        within_m=settings.within_m,
        none_share=settings.none_share,
        both_share=settings.both_share,
        min_common_s=settings.min_common_s,
    )
    return walls, configurations, objects
