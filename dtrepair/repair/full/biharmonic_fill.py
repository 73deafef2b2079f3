"""What the push leaves near creases: patches around it, replaced by a smooth continuation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.operators import patch_factor
from dtrepair.repair.elastic.patch_shapes import PatchShapeOptions, patch_shapes
from dtrepair.repair.surface.defects import Defects, find_defects, update_defects
from dtrepair.repair.surface.surface import BoolArray, Surface
from dtrepair.repair.surface.ties import KeptOffsets, TieSystem

BILAPLACIAN, MEMBRANE = 0, 1

# The differential coordinates (V, 3) that a pose (V, 3) should rather have; None: it is good.
ShapesOf = Callable[[FloatArray], FloatArray | None]


@dataclass(frozen=True, kw_only=True)
class FillOptions:
    """Numbers of the patches that replace the surroundings of defects.

    Args:
        rounds: Usual rings by which a patch grows before it starts again as a membrane.
        largest: Fraction of a part, what edges connect, that patches may cover at most: a whole
            limb replaced is lost, and a whole sleeve shrinks into its arm.
        restart_rings: Usual rings that a patch loses where it starts again, as a membrane needs
            fewer.
        shapes: Of attached parts, which patches keep the shapes that they have at rest.
    """

    rounds: int = 8
    largest: float = 0.5
    restart_rings: int = 4
    shapes: PatchShapeOptions = PatchShapeOptions()


class Filled(NamedTuple):
    """The best pose (V, 3) so far and its defects."""

    points: FloatArray
    defects: Defects


class Candidate(NamedTuple):
    """A filled pose, its defects and distortion, and the ring limit of the phase that made it.

    astray: weighted, what of it goes another way than was asked for.
    """

    points: FloatArray
    defects: Defects
    distortion: float
    near: int
    astray: float = 0.0

    @property
    def clean(self) -> bool:
        """Whether nothing crosses."""
        return len(self.defects.crossings) == 0

    @property
    def rank(self) -> tuple[int, float]:
        """Crossings first, then distortion and what strays: smaller is better."""
        return len(self.defects.crossings), round(self.distortion + self.astray, 4)


class _Patches:
    """Vertices to replace: how many rings each seed reaches, how often it failed, by which fill."""

    def __init__(self, count: int) -> None:
        self.rings = np.zeros(count, dtype=np.int64)
        self.failures = np.zeros(count, dtype=np.int64)
        self.fill = np.zeros(count, dtype=np.int64)

    def mask(self, surface: Surface) -> BoolArray:
        """Return the vertices (V,) within the reach of any seed."""
        covered = np.zeros(surface.count, dtype=bool)
        for ring in range(int(self.rings.max(initial=0)), 1, -1):
            covered = surface.dilate(covered | (self.rings == ring))
        return covered | (self.rings > 0)

    def grow(self, surface: Surface, bad: BoolArray, options: FillOptions) -> None:
        """Grow every patch with a defect by a ring there; after some rounds it is a membrane."""
        touched = self.mask(surface) | bad
        labels = surface.components(touched)
        failing = touched & np.isin(labels, np.unique(labels[bad]))
        failures = np.zeros(surface.count, dtype=np.int64)
        np.maximum.at(failures, labels[failing], self.failures[failing] + 1)
        fill = np.zeros(surface.count, dtype=np.int64)
        np.maximum.at(fill, labels[failing], self.fill[failing])
        self.failures[failing] = failures[labels[failing]]
        self.fill[failing] = fill[labels[failing]]
        restart = (
            failing & (self.failures > surface.rings(options.rounds)) & (self.fill == BILAPLACIAN)
        )
        self.fill[restart], fewer = MEMBRANE, surface.rings(options.restart_rings)
        self.failures[restart] = 1
        self.rings[restart] = np.maximum(self.rings[restart] - fewer, 0)
        self.rings[bad] += 1

    def settle(self, surface: Surface, mask: BoolArray) -> IntArray:
        """Fill (V,) of each patch that has grown together: the later fill wins; -1 outside."""
        labels = surface.components(mask)
        fill = np.zeros(surface.count, dtype=np.int64)
        np.maximum.at(fill, labels[mask], self.fill[mask])
        self.fill[mask] = fill[labels[mask]]
        return np.where(mask, self.fill, -1)


def biharmonic_fill(
    surface: Surface,
    points: FloatArray,
    *,
    known: Defects | None = None,
    options: FillOptions = FillOptions(),
) -> Filled:
    """Replace the surroundings of every defect until none is left or the patches grew too often.

    A patch starts as the smoothest (bi-Laplacian) continuation of its surroundings, grows by a
    ring where it still fails, some times, and then starts again as a membrane. Folds count as
    defects. Fixed vertices and rigid bodies are never replaced. Where more than a share of what
    edges connect would be, the patch stays as large as it was; it ends where all patches do.
    known: the defects of `points`.
    """
    base = find_defects(surface, points) if known is None else known
    filled, defects = points, base
    best = Filled(points, base)
    patches, last = _Patches(surface.count), np.zeros(surface.count, dtype=bool)
    for _ in range(2 * surface.rings(options.rounds)):
        if len(defects.triangles) == 0:
            break
        patches.grow(surface, surface.vertices_of(defects.triangles), options)
        grown = patches.mask(surface) & ~surface.stiff
        mask, held = _bounded(surface, grown, last, options.largest)
        if not (grown & ~held).any():
            break
        last = mask
        kinds = patches.settle(surface, mask)
        filled = points
        if (own := kinds == BILAPLACIAN).any():
            shapes = None
            if surface.ties is not None:
                shapes = partial(patch_shapes, surface, points, mask=mask, options=options.shapes)
            filled = bilaplacian_fill(surface.uniform, points, own, surface.ties, shapes)
        if (own := kinds == MEMBRANE).any():
            filled = membrane_fill(surface.uniform, filled, own, surface.ties)
        defects = update_defects(surface, base, filled, mask)
        if defects.rank < best.defects.rank:
            best = Filled(filled, defects)
    return best


def _bounded(
    surface: Surface, grown: BoolArray, last: BoolArray, largest: float
) -> tuple[BoolArray, BoolArray]:
    """Return the mask (V,) of what is replaced, and which vertices (V,) it holds back.

    That is `grown` (V,), but `last` (V,) on the parts of which `grown` covers more than `largest`.
    """
    shell = surface.shell_of_vertex
    held = (np.bincount(shell, grown) > largest * np.bincount(shell))[shell]
    return np.where(held, last, grown), held


def membrane_fill(
    laplacian: sparse.csr_matrix,
    field: FloatArray,
    mask: BoolArray,
    ties: TieSystem | None = None,
) -> FloatArray:
    """Return a field (V, k) with the masked values replaced by the others' harmonic extension.

    With ties it is a pose (V, 3).
    """
    inner = np.flatnonzero(mask)
    rows = laplacian[inner]
    known = rows @ np.where(mask[:, None], 0.0, field)
    system = rows[:, inner]
    return _Patch(field, inner, system, ties)(-known)


def bilaplacian_fill(
    laplacian: sparse.csr_matrix,
    field: FloatArray,
    mask: BoolArray,
    ties: TieSystem | None = None,
    shapes: ShapesOf | None = None,
) -> FloatArray:
    """Return a field (V, k) whose masked values make sum |L field|^2 least.

    With ties or shapes it is a pose. shapes: may ask for differential coordinates (V, 3) that
    L field is near to, where it sees the field without them.
    """
    inner = np.flatnonzero(mask)
    near = np.flatnonzero(abs(laplacian) @ mask)
    rows = laplacian[near]
    system = rows[:, inner]
    known = rows @ np.where(mask[:, None], 0.0, field)
    patch = _Patch(field, inner, system.T @ system, ties)
    film = patch(-(system.T @ known))
    wanted = None if shapes is None else shapes(film)
    return film if wanted is None else patch(-(system.T @ (known - wanted[near])))


class _Patch:
    """The system (M, M) of what is replaced of a field (V, k), factored once.

    With ties, whose offsets turn with it, the field is a pose (V, 3).
    """

    def __init__(
        self,
        field: FloatArray,
        inner: NDArray[np.intp],
        system: sparse.csr_matrix,
        ties: TieSystem | None,
    ) -> None:
        self._field, self._inner = field, inner
        self._kept = None if ties is None else KeptOffsets(ties, inner, field)
        self._solve = patch_factor(system if self._kept is None else system + self._kept.matrix)

    def __call__(self, right: FloatArray) -> FloatArray:
        """Return the field (V, k) with the solution of a right-hand side (M, k)."""
        kept = self._kept
        if kept is None:
            return self._with(self._solve(right))
        filled = self._with(self._solve(right + kept.right_hand_side(None)))
        for _ in range(kept.turns):
            filled = self._with(self._solve(right + kept.right_hand_side(filled)))
        return filled

    def _with(self, values: FloatArray) -> FloatArray:
        result = self._field.copy()
        result[self._inner] = values
        return result
