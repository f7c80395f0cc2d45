"""How objects are found: the methods by name, and the settings of each.

Lengths are metres and durations seconds, never cells or scans, so that a setting means the same at every
resolution and scan rate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from tempog.config import Evidence, Measure, Weight, make_plain, require, require_choice

Candidates = Literal["occupied", "all"]
SeriesDistance = Literal["minkowski", "jaccard"]
Method = Literal["evidence", "paper", "paper-tuned"]


@dataclass(frozen=True)
class PaperConfig:
    """How walls, places that change together, objects and what is on the move are told apart (Fig. 6, 7, 10, 11).

    The defaults are the paper's algorithms to the letter; where it leaves something open, the choice has a name
    here. `METHODS` also has the settings that served these algorithms best.

    Parameters
    ----------
    static_measure : "mad" or "std"
        Spread of a cell's values for Fig. 6: the figure's mean absolute deviation, or the text's standard one.
    static_weight : "interval" or "duration"
        Whether an interval counts once however long it lasted, as in Fig. 5, or by its time.
    candidates : "occupied" or "all"
        Cells for Fig. 7, static ones left out: those occupied at some time, or all, as in the figure. With all
        of them the whole floor becomes one configuration.
    least_occupied : float, 0..1
        Cells that were occupied for a smaller share of the time they were seen are no candidates either: people
        pass by, a door stands.
    neighbourhood : 4 or 8
        Which cells around a cell are its neighbours.
    distance : "minkowski" or "jaccard"
        Of two cells' time series, over the time both were seen. ``minkowski`` compares P(occupied) with the
        power `distance_p`. ``jaccard`` is the share of the time in which either was occupied that the other was
        not: two floor cells that are free most of the time are not alike for that.
    distance_p : float
        p of the Minkowski distance; 1 is the paper's Manhattan distance.
    distance_below : float, 0..1
        Neighbouring cells whose series are closer belong to one configuration (Fig. 7). Of ``minkowski`` in
        units of P(occupied): with hits worth 0.9 and free 0.1, cells may disagree for an eighth of the time.
    min_common_s : float, seconds
        Series, and configurations, that were seen together for a shorter time are not compared: twenty looks of
        a common 10 Hz scanner.
    seen_share : float, 0..1
        A configuration's state counts only while this share of its cells was seen; else the cells at the hinge,
        which the open and the closed leaf share, would tell the state of the whole leaf.
    smallest_m : float, metres
        Configurations that reach less far, corner to corner, are dropped.
    max_states : int
        Objects have 2 to so many configurations; the paper's door D1 has 3.
    within_m : float, metres, optional
        Only configurations whose centres are this close can be one object; the centres of the two places of a
        common door leaf are 0.7 m apart, those of a wide one's 180-degree swing 1.2 m. None: any, as in Fig. 10.
    none_share : float, 0..1
        Share of the commonly seen time in which no configuration of an object need be occupied; 0 as in the
        text of section IV.C.1b.
    both_share : float, 0..1
        Share of the commonly seen time in which more than one may be occupied: somebody stands in the open door.
        The paper gives no number; somebody in the doorway for a tenth of the time is a busy door.
    near_m : float, metres
        What is this close to a static cell or a configuration is no high dynamic (Fig. 11); 0 as in the figure.
    """

    static_measure: Measure = "mad"
    static_weight: Weight = "interval"
    candidates: Candidates = "occupied"
    least_occupied: float = 0.0
    neighbourhood: int = 8
    distance: SeriesDistance = "minkowski"
    distance_p: float = 1.0
    distance_below: float = 0.1
    min_common_s: float = 2.0
    seen_share: float = 0.3
    smallest_m: float = 0.0
    max_states: int = 3
    within_m: float | None = 2.0
    none_share: float = 0.0
    both_share: float = 0.1
    near_m: float = 0.0

    def __post_init__(self) -> None:
        make_plain(self)
        require_choice("static_measure", self.static_measure, Measure)
        require_choice("static_weight", self.static_weight, Weight)
        require_choice("candidates", self.candidates, Candidates)
        require_choice("distance", self.distance, SeriesDistance)
        require(self.neighbourhood in (4, 8), "neighbourhood", self.neighbourhood, "4 or 8")
        require(0 < self.distance_p < math.inf, "distance_p", self.distance_p, "a number above 0")
        require(0 < self.distance_below <= 1, "distance_below", self.distance_below, "above 0, at most 1")
        require(0 <= self.min_common_s < math.inf, "min_common_s", self.min_common_s, "seconds, 0 or more")
        require(2 <= self.max_states <= 60, "max_states", self.max_states, "from 2 to 60")
        require(self.within_m is None or 0 < self.within_m < math.inf, "within_m", self.within_m, "metres above 0")
        for name in ("smallest_m", "near_m"):
            require(0 <= getattr(self, name) <= 100, name, getattr(self, name), "metres from 0 to 100")
        for name in ("least_occupied", "none_share", "both_share", "seen_share"):
            require(0 <= getattr(self, name) <= 1, name, getattr(self, name), "a share from 0 to 1")


@dataclass(frozen=True)
class EvidenceConfig:
    """How places and objects are found from evidence per state (method ``evidence``).

    Chosen on simulated drives through five kinds of world, with 0 to 60 people, good poses and bad; see
    docs/objects.md.

    Parameters
    ----------
    dwell_s : float, seconds
        Mean time that a cell keeps its state, for smoothing.
    worth_s : float, seconds
        A stretch of one state that was observed for so long counts for 0.63 of a certain one.
    least_evidence : float
        What must speak for a cell's having been occupied, and for its having been free, before it can be part of
        a place; with a `worth_s` of 2 s one stretch of 1 s is 0.39, one of 1.4 s is 0.5.
    reach_m : float, metres
        Cells this close are compared: over the gaps between sparse hits, and from one face of a leaf to the other.
    alike_above : float
        Log-likelihood ratio from which on two cells, or groups, change together.
    piece_m, smallest_m : float, metres
        Corner to corner, of a group that may be joined with another, and of a place. A chair's leg is smaller;
        the side of a chair is not.
    face_m : float, metres
        Groups this close that never contradict each other are faces of one thing.
    fragment_m : float, metres
        A group that is smaller may be the short side of another one at whose corner it lies.
    seen_share : float, 0..1
        Share of a group's cells that must be seen for its state to count.
    least_stay_s : float, seconds
        Observed for a shorter time, a stay counts for nothing: a swing of a door takes a second.
    long_stay_s : float, seconds
        What is found in place again after so long is no passer-by; people in the simulated worlds pause for 8 s in
        the mean.
    least_duty : float, 0..1
        What was occupied for a smaller share of the time seen may be people, for all that is known of a group.
    doubt_above, place_above : float
        Log odds from which on a group may be a place, if another place of the same thing speaks for it, and from
        which on it is one by itself; see `tempog.analysis.evidence.scorecard`.
    once_doubt : float
        Log odds lost by what changed but once and is linked with no other place: the pass before a jump of the
        poses shows every wall beside where the passes after it do. Poses of the simulated drives drift, but do not
        jump.
    together : float, 0..1
        Share of a group's cells that must be occupied while it is.
    ring_m : float, metres
        How far the ring around a place reaches.
    echo_m : float, metres
        What stands this close beside a place while it is free is an echo of it: poses of different passes disagree by
        a decimetre or two in most logs.
    hinge_m : float, metres
        Places this close may share a hinge.
    hinge_bonus : float
        Log odds for two places that may; others lose `distance_cost` per metre between them.
    distance_cost : float, per metre
    size_cost : float
        Log odds lost per e-fold by which the sizes of two places differ, beyond a third.
    within_m : float, metres
        Farther apart, places are not compared.
    max_conflict, conflict_share : float
        Evidence for two places of one thing being occupied at once, at most: so much, or so much per evidence that
        the thing moved. People stand in doorways.
    link_above, grow_above : float
        Log odds from which on places are of one thing, and may be part of a thing with more places.
    max_states : int
        Most places of one thing.
    view_above : float
        Log odds from which on a cell's states follow where it is seen from rather than when: glass, or a wall's rim.
        Such cells are uncertain, and what consists of them for the most part is no place. Neighbouring visits are not
        quite independent: at 3, twenty to one, one true place of 607 was lost in 27 simulated drives, at 6 none.
    static_share : float, 0..1
        Cells occupied for this share of the time or more, and part of no place, are static.
    near_m : float, metres
        What is this close to a static cell or a place is no high dynamic.
    """

    dwell_s: float = 30.0
    worth_s: float = 2.0
    least_evidence: float = 0.4
    reach_m: float = 0.2
    alike_above: float = 0.5
    piece_m: float = 0.12
    smallest_m: float = 0.3
    face_m: float = 0.11
    fragment_m: float = 0.5
    seen_share: float = 0.3
    least_stay_s: float = 0.5
    long_stay_s: float = 20.0
    least_duty: float = 0.05
    doubt_above: float = -1.0
    place_above: float = 0.2
    once_doubt: float = 3.0
    together: float = 0.85
    ring_m: float = 0.15
    echo_m: float = 0.25
    hinge_m: float = 0.3
    hinge_bonus: float = 3.0
    distance_cost: float = 0.5
    size_cost: float = 2.0
    within_m: float = 4.0
    max_conflict: float = 0.5
    conflict_share: float = 0.3
    link_above: float = 0.0
    grow_above: float = -2.0
    max_states: int = 5
    view_above: float = 6.0
    static_share: float = 0.75
    near_m: float = 0.1

    def __post_init__(self) -> None:
        make_plain(self)
        for name in ("dwell_s", "worth_s", "reach_m", "within_m"):
            require(0 < getattr(self, name) < math.inf, name, getattr(self, name), "a number above 0")
        for name, value in vars(self).items():
            if name in ("alike_above", "grow_above", "doubt_above", "place_above"):
                require(math.isfinite(value), name, value, "a number")
            else:
                require(0 <= value < math.inf, name, value, "a number, 0 or more")
        for name in ("seen_share", "least_duty", "together", "conflict_share", "static_share"):
            require(getattr(self, name) <= 1, name, getattr(self, name), "a share from 0 to 1")
        require(2 <= self.max_states <= 8, "max_states", self.max_states, "from 2 to 8")


METHODS: dict[Method, PaperConfig | EvidenceConfig] = {
    "evidence": EvidenceConfig(),
    "paper": PaperConfig(),
    # The best of sixty random choices on four drives through the hallway with 0, 20, 40 and 60 people.
    "paper-tuned": PaperConfig(
        static_weight="duration",
        least_occupied=0.3,
        distance="jaccard",
        distance_below=0.4,
        smallest_m=0.4,
        within_m=1.5,
        none_share=0.1,
        near_m=0.1,
    ),
}

# What a map should be made with for each method: the paper's algorithms get the paper's evidence.
SENSING: dict[Method, Evidence] = {"evidence": "surface", "paper": "literal", "paper-tuned": "surface"}

# What counts as a change between two moments, see `tempog.map_diff`.
FOR_S = 20.0  # people in the simulated worlds pause for 8 s in the mean: one pause of twelve lasts longer
SMALLEST_M = 0.3  # a chair's leg is smaller; the side of a chair is not
JOIN_M = 0.2  # over the gaps between sparse hits, and from one face of a thing to the other
SURFACE_M = 0.25  # poses of different passes disagree by a decimetre or two in most logs: `EvidenceConfig.echo_m`
