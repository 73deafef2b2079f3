"""The largest share of a correction that keeps the bounds, region by region, eased in time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.numerics.temporal import eased_in_time
from dtrepair.repair.strain.bounds import Excess
from dtrepair.repair.strain.meter import StrainMeter

# Motions up to this, units of the diagonal, are none.
ROUNDING = 1e-9
# What comes and goes at once: a share of the correction does not have about that share of it.
ABRUPT = (StrainKind.EDGES, StrainKind.FLIPS, StrainKind.WORN)
# Makes the pose (V, 3) of a share (V,) of the correction.
Blend = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, kw_only=True)
class ShareOptions:
    """How much of a correction is given up, and where.

    Args:
        step: A region gives up this share of its correction at a time at most, ...
        more, least: ... or so many times the part of what is measured that is beyond its bound, but
            so much at least: a hair's breadth does not cost a quarter. Where these small steps
            do not end within the rounds, whole ones are taken.
        rings: A region is what is strained and so many rings of edges and ties around it.
        widths: The share comes back to 1 over so many times the longest motion of the region: over
            a shorter way it would be strained there. Tried in turn, ...
        steep: ... and these as well: within the bounds, and they bring fewer contacts back.
        rounds: Times that regions are measured again, until they keep the bounds.
        unseen: Motions up to this, units of the diagonal, are kept beside a frame that gives up its
            own: to go in between would bring their contacts back as well.
        spoilt: A frame within its bounds takes part in that only where so many pairs come back at
            most: else it stays as it is, and what its neighbours give up jumps.
        time: Frames over which shares of neighbouring frames go over into each other, the standard
            deviation of a Gaussian: nothing may pop.
        follow: Frames without a fault move for those around them, weighted by a Gaussian of this
            standard deviation, in frames: of what these give up, they give up as much.
    """

    step: float = 0.25
    more: float = 1.5
    least: float = 0.02
    rings: int = 2
    widths: tuple[float, ...] = (3.0, 8.0)
    steep: tuple[float, ...] = (1.0, 0.3)
    rounds: int = 12
    unseen: float = 0.015
    spoilt: int = 4
    time: float = 0.75
    follow: float = 2.0


class ShareSearch:
    """Finds shares of one correction within the bounds.

    Args:
        meter: Measures what is beyond its bound.
        before: The pose (V, 3) of the input.
        after: That of the correction.
        blend: Makes the pose of a share; 1 gives `after`, and 0 `before`.
        loosely: Whether the looser bounds hold, see `StrainMeter`.
        options: The numbers.
    """

    def __init__(
        self,
        meter: StrainMeter,
        before: FloatArray,
        after: FloatArray,
        blend: Blend,
        *,
        loosely: bool = False,
        options: ShareOptions = ShareOptions(),
    ) -> None:
        self.meter, self.before, self.blend, self.options = meter, before, blend, options
        self.loosely = loosely
        self.motion = lengths(after - before)
        self.graph = meter.parts.distances(before)

    def shares(self) -> Iterator[FloatArray]:
        """Yield shares (V,) within the bounds: lowered in regions, at once to 0 there, even."""
        wide = (self.lowered(width) for width in self.options.widths)
        if (share := next((share for share in wide if share is not None), None)) is not None:
            yield share
        for width in self.options.steep:
            if (share := self.lowered(width)) is not None:
                yield share
        if (share := self._put_back()) is not None:
            yield share
        yield self.uniform()

    def put_back(self) -> FloatArray:
        """Return shares (V,) where what is strained is as in the input."""
        share = self._put_back()
        return self.uniform() if share is None else share

    def _put_back(self) -> FloatArray | None:
        tried = (self.lowered(width, at_once=True) for width in self.options.widths)
        return next((share for share in tried if share is not None), None)

    def uniform(self) -> FloatArray:
        """Return the largest share (V,), the same everywhere."""
        count = round(1.0 / self.options.step)
        for step in range(1, count):
            share = np.full(len(self.before), 1.0 - step * self.options.step)
            if not self._beyond(share):
                return share
        return np.zeros(len(self.before))

    def lowered(self, width: float, *, at_once: bool = False) -> FloatArray | None:
        """Return shares (V,) lowered step by step, or at once to 0, where it is strained.

        width: of the way back to 1, in longest motions; None where no share keeps the bounds.
        """
        if at_once:
            return self._lowered(width, lambda _: 1.0)
        fine = self._lowered(width, self._step)
        return self._lowered(width, lambda _: self.options.step) if fine is None else fine

    def _lowered(self, width: float, step: Callable[[Excess], float]) -> FloatArray | None:
        """Return the same by steps that what is beyond its bound asks for."""
        level = np.ones(len(self.before))
        core = np.zeros(len(self.before), dtype=bool)
        for _ in range(self.options.rounds):
            share = self._field(level, core, width)
            found = self._beyond(share)
            if not found:
                return share
            hit = _vertices(found, len(core))
            core |= self.meter.parts.grown(hit, self.options.rings)
            region, given = self._regions(core), np.zeros(len(core))
            lowest = np.full(len(core), np.inf)
            np.minimum.at(lowest, region[core], level[core])
            for own in found:
                struck = np.unique(region[own.vertices])
                given[struck] = np.maximum(given[struck], step(own))
            level[core] = np.maximum(lowest - given, 0.0)[region[core]]
        return None

    def _step(self, excess: Excess) -> float:
        """Return which share is given up for what is beyond its bound: about as much as it is."""
        options = self.options
        if excess.kind in ABRUPT:
            return options.step
        beyond = 1.0 - excess.bound / excess.value
        return float(np.clip(options.more * beyond, options.least, options.step))

    def _beyond(self, share: FloatArray) -> list[Excess]:
        """Return what is beyond its bound with a share (V,)."""
        return self.meter(self.before, self.blend(share), loosely=self.loosely)

    def _field(self, level: FloatArray, core: NDArray[np.bool_], width: float) -> FloatArray:
        """Return shares (V,): the level (V,) in the core, smoothly up to 1 beyond it."""
        share = np.ones(len(level))
        for value in np.unique(level[core]):
            inner = np.flatnonzero(core & (level == value))
            reach = width * float(self.motion[inner].max())
            if reach == 0.0:
                continue
            away = csgraph.dijkstra(self.graph, indices=inner, min_only=True, limit=reach) / reach
            part = np.minimum(away, 1.0)
            share = np.minimum(share, value + (1.0 - value) * part * part * (3.0 - 2.0 * part))
        return share

    def _regions(self, core: NDArray[np.bool_]) -> NDArray[np.int32]:
        """Return the connected region (V,) of each vertex of the core."""
        links = self.meter.parts.links
        own = links[core[links].all(axis=1)]
        shape = (len(core), len(core))
        joined = sparse.coo_matrix((np.ones(len(own), np.int8), (own[:, 0], own[:, 1])), shape)
        label: NDArray[np.int32] = csgraph.connected_components(joined, directed=False)[1]
        return label


def _vertices(found: list[Excess], count: int) -> NDArray[np.bool_]:
    """Return the vertices (V,) that what is beyond its bound concerns."""
    mask = np.zeros(count, dtype=bool)
    for excess in found:
        mask[excess.vertices] = True
    return mask


def eased_shares(
    shares: FloatArray,
    frames: FloatArray,
    motions: FloatArray,
    *,
    options: ShareOptions = ShareOptions(),
) -> FloatArray:
    """Return shares (T, V) that are smooth in time and nowhere above those that are given.

    frames: times (T,) in frame units; motions: how far corrections move vertices (T, V), units of
    the diagonal. What is 1 throughout stays 1; so does a neighbour's short motion.
    """
    result = shares.copy()
    lowered = np.flatnonzero((shares < 1.0).any(axis=0))
    spread = eased_in_time(1.0 - shares[:, lowered], frames, options.time)
    seen = np.clip(1.0 - options.unseen / np.maximum(motions[:, lowered], 1e-300), 0.0, 1.0)
    result[:, lowered] = np.minimum(1.0 - seen * spread, shares[:, lowered])
    return np.clip(result, 0.0, 1.0)


def followed_shares(
    shares: FloatArray,
    frames: FloatArray,
    motions: FloatArray,
    faulty: NDArray[np.bool_],
    *,
    options: ShareOptions = ShareOptions(),
) -> FloatArray:
    """Return shares (T, V) with which frames without a fault still ease into those around them.

    They need nothing themselves: of what their neighbours give up they give up as much, as far as
    they would move more than these let expect.

    frames: times (T,) in frame units; motions: how far corrections move vertices (T, V); faulty:
    the frames (T,) that have something to correct. What moves in none of these keeps its share.
    """
    result = shares.copy()
    lowered = np.flatnonzero((shares[faulty] < 1.0).any(axis=0))
    if not len(lowered) or faulty.all():
        return result
    away = (frames[~faulty, None] - frames[None, faulty]) / options.follow
    moved, own = motions[np.ix_(faulty, lowered)], motions[np.ix_(~faulty, lowered)]
    kept = moved * shares[np.ix_(faulty, lowered)]
    # Only ratios count: the nearest weighs 1, or far ones would all vanish.
    weights = np.exp(-0.5 * (away**2 - (away**2).min(axis=1, keepdims=True)))
    alike = _over(weights @ kept, weights @ moved)
    bell = np.exp(-0.5 * away**2)
    expected = np.stack([(row[:, None] * kept).max(axis=0) for row in bell])
    most = np.maximum(alike, _over(expected, own))
    result[np.ix_(~faulty, lowered)] = np.minimum(shares[np.ix_(~faulty, lowered)], most)
    return result


def _over(part: FloatArray, whole: FloatArray) -> FloatArray:
    """Return part / whole, at most 1, and 1 where the whole is nothing but rounding."""
    some = whole > ROUNDING
    return np.minimum(np.divide(part, whole, out=np.ones_like(whole), where=some), 1.0)
