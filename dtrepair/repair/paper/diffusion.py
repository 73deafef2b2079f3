"""Diffusion of a gradient over the surface: the factor on the CPU, a dense operator elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import torch
from scipy import sparse
from torch import Tensor

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.operators import Factor, Factorise
from dtrepair.repair.paper.gpu_diffusion import BlockDiffusion, BlockOptions


@dataclass(frozen=True, kw_only=True)
class DiffusionOptions:
    """How the operator is kept on a device.

    Args:
        dense: Vertices of the largest mesh whose operator is one dense matrix: blocks need less
            memory and traffic from some hundred vertices on, but more launches.
        columns: Right-hand sides of one solve while a dense matrix is built: what cholespy handles
            well.
        blocks: Parts of a larger mesh.
    """

    dense: int = 1000
    columns: int = 96
    blocks: BlockOptions = field(default_factory=BlockOptions)


class Diffuser(Protocol):
    """Diffuses fields (B, V, 3); calling it is `finish(begin(field))`."""

    def begin(self, field: Tensor) -> Tensor:
        """Return the first of the two solves: A^-1 field."""
        ...

    def finish(self, field: Tensor) -> Tensor:
        """Return the second: A^-1 Mass field."""
        ...

    def __call__(self, field: Tensor) -> Tensor:
        """Return both: A^-1 Mass A^-1 field."""
        ...


class Diffusion:
    """A^-1 Mass A^-1 with A = Mass + strength L, factored once (Jang et al. 2025, section 5.2).

    Without masses it is the paper's (I + strength L)^-2. The solves are in double on the CPU; for
    tensors on another device use `dense`.

    Args:
        laplacian: L (V, V), positive semidefinite.
        mass: Lumped masses (V,), positive; default: the identity.
        strength: lambda, 99 in the paper; larger is smoother.
        factor: What the matrix is factorised by.

    Raises:
        ValueError: a strength or a mass that is not positive, shapes that do not agree.
    """

    def __init__(
        self,
        laplacian: sparse.csr_matrix,
        *,
        mass: FloatArray | None = None,
        strength: float = 99.0,
        factor: Factorise = Factor,
    ) -> None:
        """Factor the matrix; see the class."""
        count = laplacian.shape[0]
        if laplacian.shape != (count, count):
            raise ValueError(f"laplacian should be square, got {laplacian.shape}")
        if not strength > 0:
            raise ValueError(f"strength should be positive, got {strength}: the paper has 99")
        if mass is not None and (mass.shape != (count,) or not (mass > 0).all()):
            raise ValueError(
                f"mass should be {count} positive numbers, got shape {mass.shape} "
                f"and minimum {mass.min(initial=np.inf)}: see lumped_mass"
            )
        self.strength = strength
        self.count = count
        self.mass = mass
        diagonal = sparse.identity(count) if mass is None else sparse.diags(mass)
        self.matrix = sparse.csc_matrix(diagonal + strength * laplacian)
        self.factor = factor(self.matrix)

    def begin(self, field: Tensor) -> Tensor:
        """Return A^-1 field (B, V, 3)."""
        return torch.from_numpy(self.factor.solve(field.numpy())).to(field.dtype)

    def finish(self, field: Tensor) -> Tensor:
        """Return A^-1 Mass field (B, V, 3)."""
        if self.mass is None:
            return self.begin(field)
        return self.begin(field * torch.from_numpy(self.mass).to(field.dtype)[:, None])

    def __call__(self, field: Tensor) -> Tensor:
        """Return A^-1 Mass A^-1 field (B, V, 3)."""
        return self.finish(self.begin(field))

    def on(
        self,
        points: FloatArray,
        *,
        device: str | torch.device,
        options: DiffusionOptions = DiffusionOptions(),
    ) -> Diffuser:
        """Return this operator for tensors on a device; points: positions (V, 3) of the mesh."""
        if self.count <= options.dense:
            return self.dense(device=device, columns=options.columns)
        matrix = sparse.csr_matrix(self.matrix)
        return BlockDiffusion(matrix, points, mass=self.mass, device=device, options=options.blocks)

    def dense(
        self, *, device: str | torch.device, columns: int = DiffusionOptions.columns
    ) -> DenseDiffusion:
        """Return this operator as a matrix (V, V) on a device; V solves, 8 V^2 bytes in float64."""
        inverse = torch.empty((self.count, self.count), dtype=torch.float64)
        for first in range(0, self.count, columns):
            own = np.arange(first, min(first + columns, self.count))
            identity = np.zeros((self.count, len(own)))
            identity[own, own - first] = 1.0
            inverse[:, first : first + columns] = torch.from_numpy(self.factor(identity))
        mass = None if self.mass is None else torch.from_numpy(self.mass).to(device)
        return DenseDiffusion(inverse.to(device), mass)


class DenseDiffusion:
    """A precomputed diffusion: one product of matrices a solve, on any device."""

    def __init__(self, inverse: Tensor, mass: Tensor | None = None) -> None:
        """Keep A^-1 (V, V), and the masses (V,) if there are any."""
        self.inverse, self.mass = inverse, mass

    def begin(self, field: Tensor) -> Tensor:
        """Return A^-1 field (B, V, 3)."""
        return _product(self.inverse, field)

    def finish(self, field: Tensor) -> Tensor:
        """Return A^-1 Mass field (B, V, 3)."""
        return self.begin(field if self.mass is None else field * self.mass[:, None])

    def __call__(self, field: Tensor) -> Tensor:
        """Return A^-1 Mass A^-1 field (B, V, 3)."""
        return self.finish(self.begin(field))


class BodyDiffusion:
    """One diffusion per body of a concatenated mesh (Jang et al. 2025, section 7.5.2).

    Args:
        bodies: (first vertex, last vertex + 1, diffusion) of each body; they cover 0..V in order.
        mobility: How freely each vertex moves (V,): 0 fixed, 1 free; default: all free.

    Raises:
        ValueError: bodies with gaps or overlaps.
    """

    def __init__(
        self, bodies: Sequence[tuple[int, int, Diffuser]], *, mobility: Tensor | None = None
    ) -> None:
        """Keep the bodies; see the class."""
        ends = [0] + [stop for _, stop, _ in bodies]
        if [first for first, _, _ in bodies] != ends[:-1]:
            raise ValueError(
                f"bodies should follow each other from vertex 0, got {[b[:2] for b in bodies]}"
            )
        self.bodies = tuple(bodies)
        self.mobility = mobility

    def begin(self, field: Tensor) -> Tensor:
        """Return A^-1 field (B, V, 3) of each body."""
        parts = [diffusion.begin(field[:, first:stop]) for first, stop, diffusion in self.bodies]
        return torch.cat(parts, dim=1)

    def finish(self, field: Tensor) -> Tensor:
        """Return A^-1 Mass field (B, V, 3) of each body, times the mobility."""
        parts = [diffusion.finish(field[:, first:stop]) for first, stop, diffusion in self.bodies]
        return self._moved(torch.cat(parts, dim=1))

    def __call__(self, field: Tensor) -> Tensor:
        """Return A^-1 Mass A^-1 field (B, V, 3) of each body, times the mobility."""
        parts = [diffusion(field[:, first:stop]) for first, stop, diffusion in self.bodies]
        return self._moved(torch.cat(parts, dim=1))

    def _moved(self, field: Tensor) -> Tensor:
        return field if self.mobility is None else field * self.mobility[:, None].to(field)


class SparseOperator:
    """A sparse matrix (V, V) applied to fields (B, V, 3) of CPU tensors through scipy."""

    def __init__(self, matrix: sparse.csr_matrix) -> None:
        """Keep the matrix, in compressed rows."""
        self.matrix = sparse.csr_matrix(matrix)

    def __call__(self, field: Tensor) -> Tensor:
        """Return matrix @ field of each frame."""
        result = torch.empty_like(field)
        for source, target in zip(field, result, strict=True):
            target.copy_(torch.from_numpy(self.matrix @ source.numpy()))
        return result


def _product(matrix: Tensor, field: Tensor) -> Tensor:
    """Return matrix @ field of every frame in one product."""
    frames, count, columns = field.shape
    flat = matrix @ field.permute(1, 0, 2).reshape(count, frames * columns)
    return flat.reshape(count, frames, columns).permute(1, 0, 2)
