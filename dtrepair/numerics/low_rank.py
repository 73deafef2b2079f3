"""Displacements over time as few shapes with weights, and how few there can be."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class LowRankOptions:
    """How the fewest shapes are looked for.

    Attributes:
        compressed: part of the tolerance that is spent on compressing the displacements first;
            the search then works with as many numbers for each vertex as that needs.
        still: part of the tolerance that leaving out small offsets may cost.
        rounds: reweightings for each number of shapes; more of them rarely find a better fit.
    """

    compressed: float = 0.05
    still: float = 0.1
    rounds: int = 12


@dataclass(frozen=True)
class LowRank:
    """Shapes (K, M, 3) float32 and their weights (T, K) float32, the largest of each shape 1.

    least: no fewer shapes can be within the tolerance.
    """

    shapes: NDArray[np.float32]
    weights: NDArray[np.float32]
    least: int = 0

    @property
    def displacements(self) -> FloatArray:
        """What they add up to (T, M, 3)."""
        return np.tensordot(self.weights.astype(np.float64), self.shapes.astype(np.float64), 1)


def fewest_shapes(
    displacements: NDArray[np.floating],
    tolerance: float,
    *,
    scales: NDArray[np.floating] | None = None,
    options: LowRankOptions | None = None,
) -> LowRank:
    """Return few shapes whose weighted sums are displacements within a tolerance.

    The truncated singular value decomposition has the least sum of squared errors for a number of
    shapes (Eckart and Young 1936); the largest error is then levelled by weighting frames and
    vertices with what they have of it, as Lawson (1961) does for polynomials. That decomposition is
    a proof as well: where even the least weighted sum is more than errors within the tolerance
    could add up to, so many shapes cannot be enough.

    Args:
        displacements: (T, M, 3).
        tolerance: the largest distance of a vertex from where it should be, above 0.
        scales: how much of an error (T, M) is seen; None: 1.
        options: of the search.
    """
    chosen = options or LowRankOptions()
    given = np.asarray(displacements, dtype=np.float64)
    frames, vertices = given.shape[:2]
    seen = np.ones((frames, vertices)) if scales is None else np.asarray(scales, np.float64)
    if not frames or not vertices or not (_lengths(given) * seen > tolerance).any():
        return LowRank(np.zeros((0, vertices, 3), np.float32), np.zeros((frames, 0), np.float32))
    flat = given.reshape(frames, -1)
    basis = _basis(flat @ flat.T)
    within = (1.0 - chosen.still) * tolerance
    rank = _enough(basis, flat, seen, within)
    full = max(rank, _enough(basis, flat, seen, chosen.compressed * tolerance))
    small = basis[:, :full].T @ flat
    weights, shapes = basis[:, :rank], basis[:, :rank].T @ flat
    for count in range(rank - 1, 0, -1):
        fits = _fits(basis[:, :full], small, seen, count, chosen.rounds)
        found = _levelled(fits, seen, within)
        if found is None:
            break
        weights, shapes = found
    if weights.shape[1] == frames:  # nothing is saved: each frame has its own, as it is
        weights, shapes = np.eye(frames), flat
    found_shapes = _rounded(given, seen, weights, shapes.reshape(-1, vertices, 3), tolerance)
    # What was compressed is off by this part of the tolerance itself.
    most = (1.0 + chosen.compressed) * tolerance
    # Where so many are not enough, fewer are not.
    least, enough = 1, weights.shape[1]
    while least < enough:
        count = (least + enough) // 2
        fits = _fits(basis[:, :full], small, seen, count, chosen.rounds)
        if _impossible(fits, seen, most):
            least = count + 1
        else:
            enough = count
    return replace(found_shapes, least=least)


def _basis(gram: FloatArray) -> FloatArray:
    """Return eigenvectors (T, T) of a Gram matrix, that of the largest eigenvalue first."""
    return np.ascontiguousarray(np.linalg.eigh(gram)[1][:, ::-1])


def _lengths(vectors: FloatArray) -> FloatArray:
    """Return the lengths (T, M) of vectors (T, M, 3)."""
    return np.asarray(np.sqrt(np.einsum("tmi,tmi->tm", vectors, vectors)))


def _errors(left: FloatArray, seen: FloatArray) -> FloatArray:
    """Return how far vertices are off (T, M) by what is left (T, 3 M)."""
    return _lengths(left.reshape(*seen.shape, 3)) * seen


def _enough(basis: FloatArray, flat: FloatArray, seen: FloatArray, tolerance: float) -> int:
    """Return how many vectors of a basis leave no larger error; all if it takes so many."""
    left = flat.copy()
    for rank in range(1, len(basis)):
        vector = basis[:, rank - 1]
        left -= np.outer(vector, vector @ flat)
        if _errors(left, seen).max() <= tolerance:
            return rank
    return len(basis)


class _Fit(NamedTuple):
    """Weights (T, K) and shapes (K, 3 M), what they leave (T, 3 M), and what counts (T,), (M,)."""

    weights: FloatArray
    shapes: FloatArray
    left: FloatArray
    rows: FloatArray
    columns: FloatArray


def _fits(
    basis: FloatArray, small: FloatArray, seen: FloatArray, count: int, rounds: int
) -> Iterator[_Fit]:
    """Yield the fits of so many shapes that have the least weighted sum of squared errors.

    basis (T, R) and small (R, 3 M): displacements are their product. From one to the next frames
    and vertices with large errors count more.
    """
    flat = basis @ small
    rows, columns = np.ones(len(basis)), np.ones(seen.shape[1])
    for _ in range(rounds):
        weighted = small * np.repeat(columns, 3)
        scaled = basis * rows[:, None]
        vectors = _basis(scaled @ (weighted @ weighted.T) @ scaled.T)[:, :count]
        shapes, weights = vectors.T @ (flat * rows[:, None]), vectors / rows[:, None]
        left = flat - weights @ shapes
        yield _Fit(weights, shapes, left, rows.copy(), columns.copy())
        errors = _errors(left, seen)
        for each, own in ((rows, errors.max(axis=1)), (columns, errors.max(axis=0))):
            each *= np.sqrt(np.maximum(own / errors.max(), 1e-3))
            each /= each.max()
            np.maximum(each, 1e-3, out=each)


def _levelled(
    fits: Iterable[_Fit], seen: FloatArray, tolerance: float
) -> tuple[FloatArray, FloatArray] | None:
    """Return weights (T, K) and shapes (K, 3 M) of a fit that leaves no larger error, or None."""
    for fit in fits:
        if _errors(fit.left, seen).max() <= tolerance:
            return fit.weights, fit.shapes
    return None


def _impossible(fits: Iterable[_Fit], seen: FloatArray, tolerance: float) -> bool:
    """Return whether the weighting of a fit proves that so many shapes leave a larger error."""
    # What nobody sees may be off by anything.
    allowed = np.square(np.divide(tolerance, seen, out=np.full(seen.shape, np.inf), where=seen > 0))
    for fit in fits:
        counts = np.square(fit.rows[:, None] * fit.columns)
        squared = np.square(fit.left).reshape(*seen.shape, 3).sum(axis=2)
        # More than rounding can make of it.
        if (counts * squared).sum() > 1.001 * (counts * allowed).sum():
            return True
    return False


def _rounded(
    given: FloatArray,
    seen: FloatArray,
    weights: FloatArray,
    shapes: FloatArray,
    tolerance: float,
) -> LowRank:
    """Return shapes as they are stored: largest weight 1, and small offsets left out."""
    largest = weights[np.abs(weights).argmax(axis=0), np.arange(weights.shape[1])]
    scaled = (weights / largest).astype(np.float32)
    stored = (shapes * largest[:, None, None]).astype(np.float32)
    order = np.argsort(-np.abs(stored).max(axis=(1, 2)), kind="stable")
    scaled, stored = scaled[:, order], stored[order]
    size = _lengths(stored.astype(np.float64)) * seen.max(axis=0)
    for least in (tolerance / len(stored), 0.1 * tolerance / len(stored), 0.0):
        kept = LowRank(np.where((size > least)[:, :, None], stored, np.float32(0.0)), scaled)
        if (_lengths(kept.displacements - given) * seen).max() <= tolerance:
            break
    return kept
