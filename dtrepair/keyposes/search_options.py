"""Numbers of the search for clean poses between keys."""

from __future__ import annotations

from dataclasses import dataclass, field

from dtrepair.keyposes.changes import ChangeOptions


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """Numbers of the search.

    Args:
        finer: Fraction of its cost by which a split span may seem worse than before: its parts have
            finer samples, which show more.
        least_gain: Fraction of the cost of a span that must go where keys are moved without
            cleaning it: less is not worth the animator's surprise.
        shortest: No key is added between two that are nearer to each other than this fraction of
            the given span: keys crowd where contacts begin, and what lies between them pops.
        farther, near: No key goes farther than so many times what the repaired pose and the given
            keys around it went, and this fraction of the diagonal: an arm would fly out between two
            keys at which it hangs. What is left for that is told.
        trials: Most changes between two given keys, times the number of spans they may be split
            into.
        changes: Numbers of the changes that are tried.
    """

    finer: float = 0.5
    least_gain: float = 0.1
    shortest: float = 0.1
    farther: float = 1.5
    near: float = 0.01
    trials: int = 4
    changes: ChangeOptions = field(default_factory=ChangeOptions)
