"""Diffusion of large meshes on a device: parts and what lies between them, all as dense blocks."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from torch import Tensor

from dtrepair.numerics.geometry import FloatArray

Index = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class BlockOptions:
    """Size of the parts that a mesh is cut into.

    Args:
        least_part: Least number of vertices of a part: smaller ones have more between them.
        balance: Parts of sqrt(balance x V) vertices need as little memory as the block of what lies
            between them.
    """

    least_part: int = 256
    balance: int = 7

    def part_of(self, count: int) -> int:
        """Return the vertices of a part of a mesh of `count` vertices."""
        return max(self.least_part, round(sqrt(self.balance * count)))


class BlockDiffusion:
    """A^-1 Mass A^-1 with A = Mass + strength L through a Schur complement, on any device.

    The vertices are cut into parts that only meet in separators; with inner vertices i and
    separators s, A^-1 b is x_s = S^-1 (b_s - A_si A_ii^-1 b_i), x_i = A_ii^-1 (b_i - A_is x_s).
    All inverses are built once, in double, and are dense blocks: a few batched products a solve,
    no host, the same sums in the same order every time. Memory is about V numbers times
    the size of a part, and the square of the separators (a sixth of V or less), where a dense
    operator has V^2.

    Args:
        matrix: A (V, V), symmetric and positive definite.
        points: Positions (V, 3) that the parts are cut by.
        mass: Lumped masses (V,); None is the identity.
        device: Where the blocks are kept.
        options: Size of the parts.
    """

    def __init__(
        self,
        matrix: sparse.csr_matrix,
        points: FloatArray,
        *,
        mass: FloatArray | None = None,
        device: str | torch.device = "cpu",
        options: BlockOptions = BlockOptions(),
    ) -> None:
        """Cut, invert and upload; see the class."""
        matrix = sparse.csr_matrix(matrix)
        parts, separators = cut(matrix, points, options.part_of(len(points)))
        inner = np.full((len(parts), max(map(len, parts))), len(points))
        for row, own in zip(inner, parts, strict=True):
            row[: len(own)] = own
        place = np.full(len(points) + 1, len(separators))
        place[separators] = np.arange(len(separators))
        inverses, couplings, near, schur = _blocks(matrix, parts, separators, place)

        def upload(values: NDArray[Any]) -> Tensor:
            return torch.from_numpy(np.ascontiguousarray(values)).to(device)

        self._inner, self._separators = upload(inner), upload(separators)
        self._near, self._inverses = upload(near), upload(inverses)
        self._couplings = upload(couplings)
        self._schur = torch.linalg.inv(upload(schur)) if len(schur) else upload(schur)
        self._terms = upload(_terms(near, len(separators)))
        self._place = upload(_places(inner, separators, len(points)))
        self.mass = None if mass is None else upload(mass)

    def begin(self, field: Tensor) -> Tensor:
        """Return A^-1 field (B, V, 3)."""
        frames, count, columns = field.shape
        flat = field.permute(1, 0, 2).reshape(count, frames * columns)
        padded = _padded(flat)
        inside = self._inverses @ padded[self._inner]
        # A_si A_ii^-1 b_i of each part; those of a separator are added in a fixed order.
        owed = self._couplings.transpose(1, 2) @ padded[self._inner]
        owed = _padded(owed.reshape(-1, frames * columns))[self._terms].sum(dim=1)
        between = self._schur @ (flat[self._separators] - owed)
        inside = inside - self._couplings @ _padded(between)[self._near]
        found = torch.cat([inside.reshape(-1, frames * columns), between])[self._place]
        return found.reshape(count, frames, columns).permute(1, 0, 2)

    def finish(self, field: Tensor) -> Tensor:
        """Return A^-1 Mass field (B, V, 3)."""
        return self.begin(field if self.mass is None else field * self.mass[:, None])

    def __call__(self, field: Tensor) -> Tensor:
        """Return A^-1 Mass A^-1 field (B, V, 3)."""
        return self.finish(self.begin(field))

    @property
    def numbers(self) -> int:
        """How many numbers the blocks hold."""
        return sum(block.numel() for block in (self._inverses, self._couplings, self._schur))


def cut(matrix: sparse.csr_matrix, points: FloatArray, part: int) -> tuple[list[Index], Index]:
    """Return parts of at most `part` vertices without entries between them, and separators (S,).

    Halves along the longest axis, again and again; of two neighbours in different halves the one
    in the first is a separator.
    """
    label = np.zeros(len(points), dtype=np.int64)
    waiting, found = [np.arange(len(points))], 0
    while waiting:
        own = waiting.pop()
        if len(own) <= part:
            label[own] = found
            found += 1
            continue
        axis = int(np.ptp(points[own], axis=0).argmax())
        order = own[np.argsort(points[own, axis], kind="stable")]
        waiting += [order[: len(order) // 2], order[len(order) // 2 :]]
    entries = matrix.tocoo()
    between = label[entries.row] < label[entries.col]
    is_separator = np.zeros(len(points), dtype=bool)
    is_separator[entries.row[between]] = True
    inner = np.flatnonzero(~is_separator)
    order = inner[np.argsort(label[inner], kind="stable")]
    bounds = np.flatnonzero(np.diff(label[order])) + 1
    return np.split(order, bounds), np.flatnonzero(is_separator)


def _blocks(
    matrix: sparse.csr_matrix, parts: list[Index], separators: Index, place: Index
) -> tuple[FloatArray, FloatArray, Index, FloatArray]:
    """Return A_ii^-1 (P, m, m), A_ii^-1 A_is (P, m, n), separators (P, n), Schur complement.

    Rows and columns beyond a part are zero; beyond its separators `near` names one more than all.
    """
    schur = matrix[separators][:, separators].toarray()
    size = max(map(len, parts))
    own, inverses, couplings = [], [], []
    for part in parts:
        rows = matrix[part]
        near = np.unique(place[rows.indices])
        near = near[near < len(separators)]
        inverse = np.linalg.inv(rows[:, part].toarray())
        across = rows[:, separators[near]].toarray()
        coupling = inverse @ across
        schur[np.ix_(near, near)] -= across.T @ coupling
        own.append(near)
        inverses.append(inverse)
        couplings.append(coupling)
    width = max(map(len, own))
    blocks = np.zeros((len(parts), size, size)), np.zeros((len(parts), size, width))
    names = np.full((len(parts), width), len(separators))
    for k, (near, inverse, coupling) in enumerate(zip(own, inverses, couplings, strict=True)):
        blocks[0][k, : len(inverse), : len(inverse)] = inverse
        blocks[1][k, : len(coupling), : len(near)] = coupling
        names[k, : len(near)] = near
    return *blocks, names, schur


def _terms(near: Index, separators: int) -> Index:
    """Return the places (S, t) in `near` (P, n), flat, that name a separator; else the end."""
    flat = near.ravel()
    slots = np.flatnonzero(flat < separators)
    slots = slots[np.argsort(flat[slots], kind="stable")]
    counts = np.bincount(flat[slots], minlength=separators)
    terms = np.full((separators, int(counts.max(initial=0))), len(flat))
    rank = np.arange(len(slots)) - np.repeat(np.cumsum(counts) - counts, counts)
    terms[flat[slots], rank] = slots
    return terms


def _places(inner: Index, separators: Index, count: int) -> Index:
    """Return where each vertex (V,) is in the rows of all parts, flat, then the separators."""
    place = np.zeros(count, dtype=np.int64)
    flat = inner.ravel()
    place[flat[flat < count]] = np.flatnonzero(flat < count)
    place[separators] = len(flat) + np.arange(len(separators))
    return place


def _padded(rows: Tensor) -> Tensor:
    """Return the rows (N, k) and one of zeros, for those that are not there."""
    return torch.cat([rows, rows.new_zeros(1, rows.shape[1])])
