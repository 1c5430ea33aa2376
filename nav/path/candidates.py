"""The motions that a plan compares, and what each of them costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

COST_PARTS = ("way", "ground", "onward", "heading", "bend", "change", "turn", "unseen")


@dataclass(frozen=True)
class Candidates:
    """The motions that a plan compared, a of them: arcs, and turns in place with a straight drive after them.

    Costs are in metres of easy ground. Those of a motion that is not free far enough mean nothing: its `cost` is inf.
    """

    curvature: np.ndarray
    """(a,) curvature [1/m], positive to the left; 0 for a turn in place."""
    turn: np.ndarray
    """(a,) heading change in place before the drive [rad], positive to the left; 0 for an arc."""
    free: np.ndarray
    """(a,) free length [m]."""
    end: np.ndarray
    """(a,) distance on the motion at which it is compared [m]: where it costs least to leave it."""
    cost: np.ndarray
    """(a,) cost to reach the goal over the motion, the sum of `parts`; inf where it is not free far enough."""
    parts: Mapping[str, np.ndarray]
    """(a,) costs by COST_PARTS: "way", the length up to `end`; "ground", the extra cost of its ground; "onward", the
    way from there to the goal; "heading", the turn into that way; "bend" and "change", of the curvature; "turn", in
    place; "unseen", ground over which a turn in place would lay the footprint."""

    @classmethod
    def joined(cls, groups: Sequence[Candidates]) -> Candidates:
        """Return the motions of all groups, one after the other."""
        names = ("curvature", "turn", "free", "end", "cost")
        arrays = {name: np.concatenate([getattr(group, name) for group in groups]) for name in names}
        parts = {part: np.concatenate([group.parts[part] for group in groups]) for part in COST_PARTS}
        return cls(**arrays, parts=parts)
