"""Energies of intersecting triangle pairs and the shape term: values and closed-form gradients.

Every pair acts both ways: each corner v of one triangle meets the plane of the OTHER triangle of
the same pair. With c the centroid, n the unit normal and A the area of that plane, d = c - v and
s = <n, d> (positive where v lies behind the plane), an energy is the sum of a kernel k(d, n, A).
The corner receives -dk/dd and each corner of the plane's triangle +dk/dd / 3. Normals, areas and
radii are held fixed in the gradient; centroids are not.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from dtrepair.repair.paper.corner_energy import Kernel, Planes

# Directions of two regions whose cosine is beyond this are one: they do not part the regions.
PARALLEL = 0.95


def pair_energy(
    points: Tensor,
    faces: Tensor,
    pairs: Tensor,
    *,
    kernel: Kernel,
    weights: Tensor | None = None,
    direction: Tensor | None = None,
    planes: Planes | None = None,
) -> tuple[Tensor, Tensor]:
    """Return the energy of each frame (B,) and its gradient (B, V, 3) over intersecting pairs.

    Zero-area triangles exert no force (their corners still feel the other triangle), so values and
    gradients are finite for every finite input.

    Args:
        points: Positions (B, V, 3), unit size.
        faces: Triangles (F, 3), int64.
        pairs: Pairs (K, 3), int64: frame, triangle, triangle.
        kernel: Energy of one corner against one plane.
        weights: Weight of each pair (K,); default 1. A pair of weight 0 takes no part.
        direction: Preferred direction (F, 3) of the triangles of a region, zero rows elsewhere
            (Jang et al., section 7.4): the normal of a triangle that meets one is replaced by it,
            so that the region moves this way. Of two that meet each moves along its own.
        planes: Fixed planes instead of those of `points` (a test of the gradient needs it).
    """
    frames, vertices = points.shape[:2]
    frame = pairs[:, 0].repeat(2)
    moving = torch.cat([pairs[:, 1], pairs[:, 2]])
    fixed = torch.cat([pairs[:, 2], pairs[:, 1]])
    corner_ids, plane_ids = faces[moving], faces[fixed]
    corners = points[frame[:, None], plane_ids]
    centroids = corners.mean(dim=1)
    reacting: Tensor | None = None
    if planes is None:
        planes = triangle_planes(corners)
        if direction is not None:
            planes, reacting = _redirected(planes, direction[moving], direction[fixed])
    offsets = centroids[:, None] - points[frame[:, None], corner_ids]
    values, derivatives = kernel(offsets, planes)
    if weights is not None:
        twice = weights.repeat(2)[:, None]
        values, derivatives = values * twice, derivatives * twice[..., None]
    reaction = derivatives.sum(dim=1, keepdim=True).expand(-1, 3, -1) / 3.0
    if reacting is not None:
        reaction = reaction * reacting[:, None, None]
    rows = torch.cat([corner_ids, plane_ids], dim=1) + frame[:, None] * vertices
    forces = torch.cat([-derivatives, reaction], dim=1)
    gradient = accumulate(forces.reshape(-1, 3), rows.reshape(-1), frames * vertices)
    energy = accumulate(values.sum(dim=1, keepdim=True), frame, frames)[:, 0]
    return energy, gradient.view(frames, vertices, 3)


def triangle_planes(corners: Tensor) -> Planes:
    """Return the normals, areas and radii of triangles given by their corners (M, 3, 3)."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normals = torch.linalg.cross(first, second)
    doubled = normals.norm(dim=1)
    # Below this a normal is rounding error: the area counts as zero.
    noise = 8.0 * torch.finfo(corners.dtype).eps * first.norm(dim=1) * second.norm(dim=1)
    solid = doubled > noise
    normals = normals / torch.where(solid, doubled, torch.inf)[:, None]
    radii = (corners - corners.mean(dim=1, keepdim=True)).norm(dim=2).amax(dim=1)
    return Planes(normals, torch.where(solid, 0.5 * doubled, 0.0), radii)


def triangle_directions(direction: Tensor, faces: Tensor) -> Tensor:
    """Return the preferred directions of triangles (F, 3) from those of vertices (V, 3).

    The sum over the corners where all three have one; else zero: the region ends there.
    """
    corners = direction[faces]
    chosen = (corners != 0).any(dim=2).all(dim=1)
    return torch.where(chosen[:, None], corners.sum(dim=1), 0.0)


def accumulate(rows: Tensor, index: Tensor, count: int) -> Tensor:
    """Return the sum of rows (K, k) by index (K,) into (count, k), always in the same order.

    In float64, whatever the input's type: PyTorch adds these one after another on the CPU and
    sorts them on CUDA, so that runs repeat to the bit.
    """
    total = torch.zeros((count, rows.shape[1]), dtype=torch.float64, device=rows.device)
    return total.index_put_((index,), rows.double(), accumulate=True).to(rows.dtype)


def shape_term(
    points: Tensor, target: Tensor, *, laplacian: Callable[[Tensor], Tensor], strength: float
) -> tuple[Tensor, Tensor]:
    """Return strength |L x - target|^2 of each frame (B,) and its gradient (B, V, 3) (Eq. 5).

    Args:
        points: Positions x (B, V, 3).
        target: Differential coordinates delta (B, V, 3), of the input: L x0.
        laplacian: Applies the symmetric L to (B, V, 3).
        strength: Weight beta.
    """
    residual = laplacian(points) - target
    return strength * residual.square().sum(dim=(1, 2)), 2.0 * strength * laplacian(residual)


def mean_square_strength(strength: float, vertices: int) -> float:
    """Return the weight of the sum of squares that is `strength` times the mean of 3 V numbers.

    The published 1e6 is meant so: a plain sum would need a smaller step on every larger mesh.
    """
    return strength / (3.0 * max(vertices, 1))


def _redirected(planes: Planes, moving: Tensor, fixed: Tensor) -> tuple[Planes, Tensor]:
    """Return planes; triangles that meet a directed one take its direction as normal.

    Also returned is the weight (M,) of the reaction on the plane's triangle: 0 where both have a
    direction, so that each is moved along its own alone. Two of one direction cannot part that way:
    there the normals stay.
    """
    own, other = _unit(moving), _unit(fixed)
    directed = (moving != 0).any(dim=1)
    both = directed & (fixed != 0).any(dim=1)
    parting = both & ((own * other).sum(dim=1) < PARALLEL)
    replaced = directed & (~both | parting)
    normals = torch.where(replaced[:, None], own, planes.normals)
    return planes._replace(normals=normals), (~parting).to(moving.dtype)


def _unit(vectors: Tensor) -> Tensor:
    length = vectors.norm(dim=1, keepdim=True)
    unit: Tensor = vectors / length.clamp_min(torch.finfo(vectors.dtype).tiny)
    return unit
