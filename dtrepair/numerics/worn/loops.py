"""Rings and the limbs that go through them: a belt, a strap, a sleeve, and whether it is still on.

What goes round something in the rest has a loop, the middle of it in each of several directions,
and what it goes round a core, its middle line. As long as the core passes through the loop, or one
somewhat wider, the ring is worn. Both are sums of vertices, so that any pose has them. A garment
has a ring at each of its hems: an arm may come out of a sleeve while the jacket stays on.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from functools import partial

import numpy as np

from dtrepair.numerics.enclosure import Dipoles
from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    lengths,
    triangle_areas,
)
from dtrepair.numerics.recent import Recent
from dtrepair.numerics.worn.around import may_go_round, solids
from dtrepair.numerics.worn.measure import surrounds, worn_measure
from dtrepair.numerics.worn.parts import Parts
from dtrepair.numerics.worn.ring import LoopOptions, Ring, hems_of, ring_about


class Rings:
    """The rings of a mesh, found when they are asked for.

    Args:
        parts: The parts; the first of their poses is the rest.
        stiff: Which parts cannot give way: of two of which one is stiff neither is worn.
        options: What counts as a ring, and what stands for it.
    """

    def __init__(
        self, parts: Parts, stiff: Collection[int] = (), *, options: LoopOptions = LoopOptions()
    ) -> None:
        self.parts, self.stiff, self.options = parts, frozenset(stiff), options
        rest = parts.poses[0]
        self._areas = np.array([triangle_areas(rest, own).sum() for own in parts.triangles])
        self._large = np.argsort(-self._areas, kind="stable")[: options.parts]
        self._low = np.stack([rest[own].min(axis=0) for own in parts.vertices])
        self._high = np.stack([rest[own].max(axis=0) for own in parts.vertices])
        sheets = (may_go_round(parts, part, 0, options.layers) for part in range(len(self._areas)))
        self._sheets = np.fromiter(sheets, dtype=bool)
        self._thinnest = (self._high - self._low).min(axis=1)
        self._known: dict[int, list[Ring]] = {}
        self._sections: dict[tuple[int, int], list[Ring]] = {}
        # Many corrections of one input are asked for.
        self._worn_before = Recent[_WornIn]()

    def taken_off(self, before: FloatArray, after: FloatArray) -> list[Ring]:
        """Return the rings that are on in one pose (V, 3), and off in another."""
        farthest = float(lengths(after - before).max()) / self.options.moved
        width = np.sort(self._high - self._low, axis=1)[:, 1]
        # A hem is narrower than its garment.
        narrow = (width < farthest) | self._sheets
        looked_at = self._large[narrow[self._large]].tolist()
        found = [ring for top in looked_at for ring in self.of(top)]
        found += [ring for top in looked_at for ring in self.sections(top, farthest)]
        near = [ring for ring in found if ring.width < farthest]
        was_worn = self._worn_before(_WornIn, before)
        worn = partial(Ring.worn, pose=after, wider=self.options.wider)
        return [ring for ring in near if was_worn(ring) and not worn(ring)]

    def concerned(self, off: Sequence[Ring], top: int) -> IntArray:
        """Return the vertices (N,) that rings of a part concern which are off.

        With one leg out of a robe they are those of both: what one did for the robe is of no use
        where the robe is given up.
        """
        own = [ring for ring in off if ring.top == top]
        found = np.unique(np.concatenate([ring.concerned for ring in own]))
        if not any((top, ring.under) in self._sections for ring in own):
            return found
        beside = (ring.concerned for ring in self.sections(top))
        both = [each for each in beside if np.isin(each, found).any()]
        return np.unique(np.concatenate([found, *both]))

    def of(self, top: int) -> list[Ring]:
        """Return what a part goes round in the rest."""
        if top not in self._known:
            self._known.setdefault(top, self._found(top))
        return self._known[top]

    def _found(self, top: int) -> list[Ring]:
        parts, options, rest = self.parts, self.options, self.parts.poses[0]
        rings: list[Ring] = []
        if top in self.stiff:
            return rings
        for hem in hems_of(parts.triangles[top]):
            axis = np.linalg.svd(rest[hem] - rest[hem].mean(axis=0), full_matrices=False)[2][2]
            for under in self._around(hem, top):
                rings += ring_about(
                    parts, hem, (top, under), axis, options, through=options.through
                )
        # The middle of a shirt with its sleeve says less than the hems at both of their ends.
        ends = Counter(ring.under for ring in rings)
        for under in self._around(parts.vertices[top], top):
            if ends[under] > 1:
                continue
            both = solids(parts, top, under, rest)
            worn = worn_measure(*both, least=options.worn.worn, options=options.worn)
            if worn.share >= options.worn.worn:
                rings += ring_about(parts, parts.vertices[top], (top, under), worn.axis, options)
        return rings

    def sections(self, top: int, farthest: float = np.inf) -> list[Ring]:
        """Return what of a part surrounds others, narrower than `farthest`, as rings of these.

        Length units. What it goes round in the rest has its own rings.
        """
        if top in self.stiff or not self._sheets[top]:
            return []
        known, found = {ring.under for ring in self.of(top)}, list[Ring]()
        beside = ((self._low[top] < self._high) & (self._low < self._high[top])).all(axis=1)
        # A ring is wider than what it goes round, and larger, as a robe than a leg.
        beside &= (self._thinnest < farthest) & (self._areas < self._areas[top])
        beside[list(self.stiff)] = False
        order = np.argsort(-self._areas, kind="stable")
        for under in order[beside[order]][: self.options.beside].tolist():
            if under not in known:
                if (top, under) not in self._sections:
                    self._sections.setdefault((top, under), self._section(top, under))
                found += self._sections[top, under]
        return found

    def _section(self, top: int, under: int) -> list[Ring]:
        """Return as a ring what of a part is beside the middle of what it surrounds."""
        parts, options, rest = self.parts, self.options, self.parts.poses[0]
        both, least = solids(parts, top, under, rest), options.layers.around
        if (worn := surrounds(*both, least=least, options=options.worn)).share < least:
            return []
        ring, limb = (rest[parts.vertices[k]] @ worn.axis for k in (top, under))
        low, high = max(ring.min(), limb.min()), min(ring.max(), limb.max())
        own = parts.vertices[top][np.abs(ring - 0.5 * (low + high)) <= 0.25 * (high - low)]
        if len(own) == 0:
            return []
        return ring_about(parts, own, (top, under), worn.axis, options, wide=True)

    def _around(self, vertices: IntArray, top: int) -> list[int]:
        """Return the parts that have the middle of some vertices (N,) of another one inside."""
        rest = self.parts.poses[0]
        middle = 0.5 * (rest[vertices].min(axis=0) + rest[vertices].max(axis=0))
        holds = ((self._low < middle) & (self._high > middle)).all(axis=1)
        holds[[top, *self.stiff]] = False
        return [
            under
            for under in np.flatnonzero(holds).tolist()
            if self._goes_round(under, middle) >= self.options.enclosed
        ]

    def _goes_round(self, part: int, point: FloatArray) -> float:
        """Return how often a part goes round a point (3,) in the rest, whichever way it faces."""
        corners = self.parts.poses[0][self.parts.triangles[part]]
        # An arm is thinner than what of its body counts as one from afar.
        return abs(float(Dipoles(corners, self.options.cells).enclose_closely(point[None])[0]))


class _WornIn:
    """Which rings a pose (V, 3) has on; they are kept while it is asked."""

    def __init__(self, pose: FloatArray) -> None:
        self._pose, self._known = pose.copy(), dict[int, bool]()

    def __call__(self, ring: Ring) -> bool:
        """Return whether the pose has a ring on."""
        if id(ring) not in self._known:
            self._known[id(ring)] = ring.worn(self._pose)
        return self._known[id(ring)]
