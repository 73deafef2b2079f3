"""Creases that relaxing has zipped up: those that open at least cost, until no more are bent."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse

from dtrepair.geometry import FloatArray, IntArray, dots, lengths, triangle_normals
from dtrepair.repair.crease import solve_patch
from dtrepair.repair.relax import STEP, relax
from dtrepair.repair.rigidity import Rigidity
from dtrepair.repair.surface import ANCHOR, BoolArray, Surface

# Beyond this angle between the normals of its triangles, 120 degrees, an edge counts as bent;
# the bent edges of a crease that are sharper than in the input by more than this are smoothed.
SHARP, SHARPER = -0.5, 1e-3
# Rounds, and how many times the bent edges to lose they aim at: contacts take some of it back.
ROUNDS, SPARE = 8, 1.25
# What a bent edge's cosine beyond the limit counts next to the edge itself, and the least gain.
DEPTH, LEAST = 0.5, 0.1
# Iterations of the smooth shape; the motion is full within so many rings of a crease's bent edges
# and ends at so many.
ITERATIONS, FULL_RINGS, FADED_RINGS = 3, 4, 12
# A bent edge less may cost so much: the sum of squared logarithms of the edges' length ratios. Less
# than the first does not tell cures apart.
CHEAPEST, DEAREST = 0.01, 15.0
# Diagonal of the cotangent Laplacian in the bending energy: the uniform one's at six neighbours.
VALENCE = 6.0


class Remedy(NamedTuple):
    """A way to smooth a crease: keeping its mesh or evening it, how strongly, how many rings."""

    even: bool
    bending: float
    rings: int


REMEDIES = (
    Remedy(even=False, bending=0.1, rings=1),
    Remedy(even=False, bending=0.5, rings=2),
    Remedy(even=True, bending=0.1, rings=1),
    Remedy(even=True, bending=0.3, rings=2),
    Remedy(even=True, bending=1.0, rings=2),
)


class Cure(NamedTuple):
    """What a remedy promises for one crease: bent edges fewer, and change of edges for each."""

    price: float
    crease: int
    gain: float
    remedy: int


def bent_edges(surface: Surface, points: FloatArray) -> BoolArray:
    """Which hinges (H,) of the surface are bent by more than 120 degrees."""
    return _cosines(surface, points) < SHARP


def unbend(
    surface: Surface,
    original: FloatArray,
    points: FloatArray,
    *,
    folds: int,
    step: float = STEP,
) -> tuple[FloatArray, int]:
    """A clean pose with no more bent edges than its original where that can be, and the rounds.

    Where surfaces close a crease, its bottom folds flat. In each round some creases become
    smooth, those that cost the least change of edges for each bent edge less, and one
    as-rigid-as-possible step with contacts leads there: both sides make room. What did not help a
    crease is not tried on it in the next round.
    """
    given = _cosines(surface, original)
    allowed = _sharpness(given)[0]
    failed: set[tuple[int, int]] = set()
    done = 0
    for _ in range(ROUNDS):
        creases = _Creases(surface, original, points, given)
        excess = creases.sharpness[0] - allowed
        if excess <= 0 or not creases.seeds.any():
            break
        chosen = creases.chosen(SPARE * excess, failed)
        if not chosen:
            break
        target, reach = creases.aim(chosen)
        trial, _ = relax(surface, target, points, cycles=1, folds=folds, reach=reach, step=step)
        cosines = _cosines(surface, trial)
        if _sharpness(cosines) < creases.sharpness:
            points, done = trial, done + 1
            failed.clear()
        left = creases.bent_in(cosines)
        failed |= {
            (c.crease, c.remedy) for c in chosen if left[c.crease] >= creases.sharp[c.crease]
        }
    return points, done


class _Creases:
    """The zipped creases of a pose, each with its surroundings and its name, a vertex."""

    def __init__(
        self, surface: Surface, original: FloatArray, points: FloatArray, given: FloatArray
    ) -> None:
        """Those with edges that are bent now and were not at the angles `given` (H,)."""
        self.surface, self.original, self.points = surface, original, points
        current = _cosines(surface, points)
        self.sharpness = _sharpness(current)
        sharper = (current < SHARP) & (current < given - SHARPER)
        self.seeds = surface.vertices_of(surface.hinges[sharper]) & ~surface.stiff
        self.owner = _owners(surface, self.seeds)
        new = surface.hinges[(current < SHARP) & (given >= SHARP)]
        self.names = np.unique(self.owner[surface.faces[new]])
        self.names = self.names[self.names >= 0]
        self.seeds &= np.isin(self.owner, self.names)
        self.sharp = self.bent_in(current)
        self.targets: list[FloatArray] = []

    def bent_in(self, cosines: FloatArray) -> FloatArray:
        """Number (V,) of bent hinges in each crease, at its name; very sharp ones count more."""
        sharp = np.flatnonzero(cosines < SHARP)
        weights = 1.0 + DEPTH * (SHARP - cosines[sharp])
        return self._sums(weights, self.surface.faces[self.surface.hinges[sharp, 0], 0])

    def chosen(self, excess: float, failed: set[tuple[int, int]]) -> list[Cure]:
        """The cheapest cures that together are enough, at most one for each crease."""
        before = _strains(self.surface, self.original, self.points)
        cures: list[Cure] = []
        for number, remedy in enumerate(REMEDIES):
            target = _smooth(self.surface, self.points, self.seeds, remedy)
            self.targets.append(target)
            gains = self.sharp - self.bent_in(_cosines(self.surface, target))
            strains = _strains(self.surface, self.original, target)
            costs = self._sums(strains - before, self.surface.edges[:, 0])
            cures += [
                Cure(max(costs[name], CHEAPEST) / gains[name], int(name), gains[name], number)
                for name in self.names
                if gains[name] > LEAST and (int(name), number) not in failed
            ]
        cures = [cure for cure in cures if cure.price <= DEAREST]
        best: dict[int, Cure] = {}
        for cure in sorted(cures):
            if sum(taken.gain for taken in best.values()) >= excess:
                break
            best.setdefault(cure.crease, cure)
        return list(best.values())

    def aim(self, chosen: list[Cure]) -> tuple[FloatArray, FloatArray]:
        """The pose (V, 3) to go to, creases not chosen as they are, and the reach (V,)."""
        target = self.points.copy()
        seeds = np.zeros_like(self.seeds)
        for cure in chosen:
            own = self.owner == cure.crease
            target[own] = self.targets[cure.remedy][own]
            seeds |= self.seeds & own
        rings = self.surface.rings_from(seeds, FADED_RINGS)
        fade = np.clip((FADED_RINGS - rings) / (FADED_RINGS - FULL_RINGS), 0.0, 1.0)
        return target, np.where(self.surface.stiff, 0.0, fade)

    def _sums(self, values: FloatArray, vertices: IntArray) -> FloatArray:
        """Sum (V,) over each crease, at its name, of values that belong to vertices."""
        owner = self.owner[vertices]
        inside = owner >= 0
        sums = np.bincount(owner[inside], values[inside], minlength=self.surface.count)
        return sums.astype(np.float64)


def _owners(surface: Surface, seeds: BoolArray) -> IntArray:
    """The name (V,) of the nearest crease within FADED_RINGS, or -1: its seeds' first vertex."""
    labels = surface.components(seeds)
    inside = np.flatnonzero(seeds)
    first = np.full(surface.count, surface.count, dtype=np.int32)
    np.minimum.at(first, labels[inside], inside.astype(np.int32))
    owner = np.where(seeds, first[labels], -1)
    for _ in range(FADED_RINGS):
        bare = owner < 0
        for start, stop in (surface.edges.T, surface.edges.T[::-1]):
            reached = bare[start] & (owner[stop] >= 0)
            owner[start[reached]] = owner[stop[reached]]
    return owner


def _smooth(surface: Surface, points: FloatArray, seeds: BoolArray, remedy: Remedy) -> FloatArray:
    """The pose (V, 3) with least edge strain plus bending around the seeds, contacts ignored.

    Bending is a multiple of sum |L x|^2 over the seeds' surroundings; edges stay as rigid as
    possible (Sorkine & Alexa 2007). L is the cotangent Laplacian, which bends the surface only, or
    the uniform one, which evens the mesh as well.
    """
    mask = surface.dilate(seeds, remedy.rings) & ~surface.stiff
    inner = np.flatnonzero(mask)
    bent = np.flatnonzero(surface.dilate(seeds))
    bending = surface.uniform[bent]
    if not remedy.even:
        diagonal = surface.laplacian.diagonal()[bent]
        bending = (sparse.diags(VALENCE / diagonal) @ surface.laplacian[bent]).tocsr()
    rows = surface.laplacian[inner] + ANCHOR * sparse.diags(surface.mass, format="csr")[inner]
    rows = (rows + remedy.bending * (bending[:, inner].T @ bending)).tocsr()
    known = rows @ np.where(mask[:, None], 0.0, points)
    system = rows[:, inner]
    rigidity = Rigidity(surface, points, region=mask)
    result = points
    for _ in range(ITERATIONS):
        right = rigidity.target(result)[inner] - known
        result = points.copy()
        result[inner] = solve_patch(system, right)
    return result


def _strains(surface: Surface, original: FloatArray, points: FloatArray) -> FloatArray:
    """Squared logarithm (E,) of each edge's length ratio."""
    first, second = surface.edges.T
    old, new = (lengths(p.take(first, axis=0) - p.take(second, axis=0)) for p in (original, points))
    return np.log(np.maximum(new, 1e-12) / np.maximum(old, 1e-12)) ** 2


def _sharpness(cosines: FloatArray) -> tuple[int, float]:
    """Number of bent edges, and by how much they are bent too far: smaller is better."""
    excess = SHARP - cosines[cosines < SHARP]
    return len(excess), float(excess.sum())


def _cosines(surface: Surface, points: FloatArray) -> FloatArray:
    """Cosine of the angle between the normals at each hinge (H,)."""
    normals = triangle_normals(points, surface.faces)
    first, second = surface.hinges.T
    return dots(normals.take(first, axis=0), normals.take(second, axis=0))
