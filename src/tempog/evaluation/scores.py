"""What `evaluate` says, as counts; shares that nothing speaks for are None, never 0 or 1."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Share:
    """`n` of `of`.

    >>> Share(3, 4).value, Share(0, 0).value
    (0.75, None)
    """

    n: int
    of: int

    @property
    def value(self) -> float | None:
        """n / of; None if `of` is 0."""
        return self.n / self.of if self.of else None


@dataclass(frozen=True)
class StaticScores:
    """Cells reported as static, against the walls' cells.

    Attributes
    ----------
    precision : Share
        Reported cells within a cell of a wall's cell, of those and the false ones.
    recall : Share
        Seen cells of walls within a cell of a reported one.
    n_neutral : int
        Other reported cells beside a seen place that is not observable, or beside glass; counted neither way.
    """

    precision: Share
    recall: Share
    n_neutral: int

    @property
    def f1(self) -> float | None:
        """2 P R / (P + R); None if either is."""
        precision, recall = self.precision.value, self.recall.value
        if precision is None or recall is None:
            return None
        return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


@dataclass(frozen=True)
class UncertainScores:
    """Cells reported as uncertain, against the glass's cells.

    Attributes
    ----------
    precision : Share
        Reported cells within a cell of glass, of all.
    recall : Share
        Cells of glass in which beams ended on it, within a cell of a reported one. Glass that returns most beams may
        as well be called static, which counts neither way.
    """

    precision: Share
    recall: Share


@dataclass(frozen=True)
class ConfigurationScores:
    """Reported configurations, against the places of things.

    Attributes
    ----------
    precision : Share
        Matched ones, of those and the false ones.
    recall : Share
        Observable places that are matched.
    recall_twice : Share
        The same of observable places that were seen occupied in two periods or more.
    n_neutral : int
        Configurations matched with a seen place that is not observable; counted neither way.
    n_at_walls, n_at_things, n_in_free_space : int
        False ones: more than half of the cells within a cell of a wall's or of glass; else of any place's; else the
        rest.
    """

    precision: Share
    recall: Share
    recall_twice: Share
    n_neutral: int
    n_at_walls: int
    n_at_things: int
    n_in_free_space: int


@dataclass(frozen=True)
class ObjectScores:
    """Things, against reported objects. Things without an observable place are left out.

    Attributes
    ----------
    associated : Share
        Things with two or more observable places that are fully associated: the configurations matched with all of
        them make one object. Configurations matched with its other places may be in it, nothing else.
    alone : Share
        Things with one observable place that was found, in no object with a configuration of anything else.
    two_places, three_places, more_places : Share
        `associated`, by number of observable places.
    hinged, sliding, box : Share
        `associated` and `alone` together, by kind of thing.
    """

    associated: Share
    alone: Share
    two_places: Share
    three_places: Share
    more_places: Share
    hinged: Share
    sliding: Share
    box: Share


@dataclass(frozen=True)
class LinkScores:
    """Pairs of configurations that share an object, against pairs of places of one thing.

    Attributes
    ----------
    precision : Share
        Right pairs, of those and the wrong ones. A right pair is matched with observable places of one thing.
    recall : Share
        Pairs of observable places of one thing whose configurations share an object.
    n_neutral : int
        Pairs matched with places of one thing that are not both observable; counted neither way.
    """

    precision: Share
    recall: Share
    n_neutral: int

    @property
    def n_wrong(self) -> int:
        """Pairs that are matched with places of two things, or not matched."""
        return self.precision.of - self.precision.n


@dataclass(frozen=True)
class HighDynamicScores:
    """Cells reported as on the move, against people, summed over the document's scans.

    Attributes
    ----------
    n_scans : int
    precision : Share
        Reported cells within a cell of where a beam ended on somebody, or with their centre within somebody's
        radius and a cell, of those and the false ones. 0 of 0 if nobody was there at any of the scans.
    recall : Share
        Cells where beams ended on somebody, within a cell of a reported one.
    false_share : Share
        False cells, of all cells in which beams ended on anything at these scans.
    n_neutral : int
        Reported cells within a cell of a moving leaf; counted neither way.
    """

    n_scans: int
    precision: Share
    recall: Share
    false_share: Share
    n_neutral: int


@dataclass(frozen=True)
class PlaceScore:
    """A seen place, and the configuration it is matched with; `configuration` and `iou` are None without one."""

    thing: str
    place: str
    n_cells: int
    n_occupied: int
    n_free: int
    observable: bool
    configuration: int | None
    iou: float | None


@dataclass(frozen=True)
class Scores:
    """All scores of a document; `to_dict` is ready for JSON."""

    world: str
    method: str
    resolution_m: float
    start_s: float
    stop_s: float
    static: StaticScores
    uncertain: UncertainScores
    configurations: ConfigurationScores
    objects: ObjectScores
    links: LinkScores
    high_dynamic: HighDynamicScores
    places: tuple[PlaceScore, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain values; a share is {"n", "of", "share"}."""
        answer: dict[str, Any] = _plain(self)
        answer["static"]["f1"] = self.static.f1
        answer["links"]["n_wrong"] = self.links.n_wrong
        return answer


def _plain(value: Any) -> Any:
    if isinstance(value, Share):
        return {"n": value.n, "of": value.of, "share": value.value}
    if dataclasses.is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, tuple):
        return [_plain(one) for one in value]
    return value
