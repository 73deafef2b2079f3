"""Energies of intersecting triangle pairs and the shape term: values and closed-form gradients.

Every pair acts both ways: each corner v of one triangle meets the plane of the OTHER triangle of
the same pair. With c the centroid, n the unit normal and A the area of that plane, d = c - v and
s = <n, d> (positive where v lies behind the plane), an energy is the sum of a kernel k(d, n, A).
The corner receives -dk/dd and each corner of the plane's triangle +dk/dd / 3. Normals, areas and
radii are held fixed in the gradient; centroids are not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from dtrepair.repair.options import RepairOptions

# Directions of two regions whose cosine is beyond this are one: they do not part the regions.
PARALLEL = 0.95


class Planes(NamedTuple):
    """What a plane's triangle contributes, for each of M = 2 K directed pairs."""

    normals: Tensor
    """Unit normals (M, 3); zero for a zero-area triangle."""
    areas: Tensor
    """Areas (M,), squared length units."""
    radii: Tensor
    """Largest distance of a corner from the centroid (M,), length units."""


class Kernel(Protocol):
    """Energy density of a corner against a plane."""

    @property
    def rate_factor(self) -> float:
        """Factor of the learning rate that suits the size of its forces."""
        ...

    def __call__(self, offsets: Tensor, planes: Planes) -> tuple[Tensor, Tensor]:
        """Return values (M, 3) and derivatives (M, 3, 3) by the offsets d = c - v (M, 3, 3)."""
        ...


@dataclass(frozen=True, kw_only=True)
class SignedTangentPoint:
    """k = A s^exponent / |d|^power: pushes a corner along the plane's normal (Jang et al., Eq. 3).

    The exponent is odd, so the sign of s survives: a corner in front of the plane is not pulled
    back. The default (1, 1) is the ratio s / |d| of the authors' code; their text has (3, 6), whose
    forces between nearly touching triangles are too stiff for the usual step sizes (`docs/method`).

    Args:
        exponent: Of the height s; see above.
        power: Of the distance |d|; see above.
        nearest: Distances below this fraction of the triangle's size, the root of its area, count
            as this fraction, so that forces are bounded.
        rate_factor: Factor of the learning rate.

    Raises:
        ValueError: an even or non-positive exponent, which would lose the sign.
    """

    exponent: int = 1
    power: float = 1.0
    nearest: float = 1e-3
    rate_factor: float = 1.0

    def __post_init__(self) -> None:
        """Check the exponent."""
        if self.exponent < 1 or self.exponent % 2 == 0:
            raise ValueError(
                f"exponent should be odd and positive, got {self.exponent}: "
                "an even one loses the sign; use UnsignedTangentPoint for that"
            )

    def __call__(self, offsets: Tensor, planes: Planes) -> tuple[Tensor, Tensor]:
        """Return the values (M, 3) and derivatives (M, 3, 3)."""
        heights = _heights(offsets, planes)
        numerator = heights**self.exponent
        slope = self.exponent * heights ** (self.exponent - 1)
        return _over_distance(
            offsets, planes, numerator, slope, power=self.power, nearest=self.nearest
        )


@dataclass(frozen=True, kw_only=True)
class UnsignedTangentPoint:
    """k = A |s|^exponent / |d|^power: the tangent-point energy (Yu et al. 2021), a baseline.

    Blind to the side a corner is on. The default numbers are those of the signed energy, so that
    the sign is the only difference.
    """

    exponent: float = SignedTangentPoint.exponent
    power: float = SignedTangentPoint.power
    nearest: float = SignedTangentPoint.nearest
    rate_factor: float = SignedTangentPoint.rate_factor

    def __call__(self, offsets: Tensor, planes: Planes) -> tuple[Tensor, Tensor]:
        """Return the values (M, 3) and derivatives (M, 3, 3)."""
        heights = _heights(offsets, planes)
        numerator = heights.abs() ** self.exponent
        slope = self.exponent * heights.abs() ** (self.exponent - 1) * heights.sign()
        return _over_distance(
            offsets, planes, numerator, slope, power=self.power, nearest=self.nearest
        )


@dataclass(frozen=True, kw_only=True)
class PointToPlane:
    """k = A s^2 for corners behind the plane, else 0: a baseline without any distance falloff.

    Its forces are areas times depths, far smaller than the others': hence the rate factor.
    """

    rate_factor: float = 100.0

    def __call__(self, offsets: Tensor, planes: Planes) -> tuple[Tensor, Tensor]:
        """Return the values (M, 3) and derivatives (M, 3, 3)."""
        depth = _heights(offsets, planes).clamp_min(0.0)
        areas = planes.areas[:, None]
        derivatives = (2.0 * areas * depth)[..., None] * planes.normals[:, None]
        return areas * depth**2, derivatives


@dataclass(frozen=True, kw_only=True)
class ConicalField:
    """Conical distance field around each triangle (Tzionas et al. 2016, Eq. 8 to 10), a baseline.

    k = A ((1 - phi) u(h))^2 inside the cone, else 0, with h the height of the corner over the
    plane, u a quadratic that falls to 0 at h = `height` and continues linearly below -`height`, and
    phi the distance from the axis over the cone's radius at h. The circle is centred at the
    centroid, not at the circumcentre, which slivers throw far away. `height` is in length units:
    one twentieth of the mesh, where the published half a metre hardly separates anything. The cone
    is never narrower than `nearest` times the circle. Its forces have another size than the
    tangent-point energies': hence the rate factor.
    """

    height: float = 0.05
    nearest: float = SignedTangentPoint.nearest
    rate_factor: float = 2.0

    def __call__(self, offsets: Tensor, planes: Planes) -> tuple[Tensor, Tensor]:
        """Return the values (M, 3) and derivatives (M, 3, 3)."""
        top, normals = self.height, planes.normals[:, None]
        over = -_heights(offsets, planes)
        radial = -offsets - over[..., None] * normals
        distance = radial.norm(dim=-1)
        tiny = torch.finfo(offsets.dtype).tiny
        solid = (planes.areas > 0)[:, None]
        narrowing = (1.0 - over / top).clamp_min(self.nearest)
        radius = torch.where(solid, planes.radii[:, None], 1.0) * narrowing
        ratio = distance / radius
        inside = solid & (over < top) & (ratio < 1.0)

        quadratic = (1 - 2 * top) / (4 * top**2)
        curved = -quadratic * over**2 - over / (2 * top) + (3 - 2 * top) / 4
        curved_slope = -2 * quadratic * over - 1 / (2 * top)
        below = over <= -top
        profile = torch.where(below, 1.0 - top - over, curved)
        slope = torch.where(below, -torch.ones_like(over), curved_slope)

        field = torch.where(inside, (1.0 - ratio) * profile, 0.0)
        outward = radial / distance.clamp_min(tiny)[..., None]
        ratio_slope = outward / radius[..., None]
        ratio_slope = ratio_slope + (ratio / (top * narrowing))[..., None] * normals
        by_corner = ((1.0 - ratio) * slope)[..., None] * normals - profile[..., None] * ratio_slope
        areas = planes.areas[:, None]
        # Offsets are c - v: the derivative changes sign.
        return areas * field**2, -2.0 * (areas * field)[..., None] * by_corner


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


def _heights(offsets: Tensor, planes: Planes) -> Tensor:
    return (offsets * planes.normals[:, None]).sum(dim=-1)


def _over_distance(
    offsets: Tensor,
    planes: Planes,
    numerator: Tensor,
    slope: Tensor,
    *,
    power: float,
    nearest: float,
) -> tuple[Tensor, Tensor]:
    """Return A numerator(s) / |d|^power and its derivative by d, given numerator'(s)."""
    areas = planes.areas[:, None]
    squared = offsets.square().sum(dim=-1)
    floor = nearest**2 * areas + torch.finfo(offsets.dtype).tiny ** 0.25
    near = squared < floor
    squared = torch.where(near, floor, squared)
    scale = areas * squared ** (-0.5 * power)
    along = (scale * slope)[..., None] * planes.normals[:, None]
    falloff = torch.where(near, 0.0, power * scale * numerator / squared)
    return scale * numerator, along - falloff[..., None] * offsets


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


@dataclass(frozen=True, kw_only=True)
class EnergyOptions:
    """The energies that can be chosen, with their numbers.

    Args:
        signed_tpe: The published one.
        tpe: The same without the sign, a baseline.
        point_to_plane: A baseline without falloff.
        conical: A baseline of another kind.
    """

    signed_tpe: SignedTangentPoint = SignedTangentPoint()
    tpe: UnsignedTangentPoint = UnsignedTangentPoint()
    point_to_plane: PointToPlane = PointToPlane()
    conical: ConicalField = ConicalField()

    def chosen(self, choices: RepairOptions) -> Kernel:
        """Return the energy that a user chose, with the exponents that were given for it."""
        kernel = self.by_name[choices.energy]
        if not isinstance(kernel, SignedTangentPoint | UnsignedTangentPoint):
            return kernel
        if choices.kernel_exponent is not None:
            kernel = replace(kernel, exponent=choices.kernel_exponent)
        if choices.kernel_power is not None:
            kernel = replace(kernel, power=choices.kernel_power)
        return kernel

    @property
    def by_name(self) -> dict[str, Kernel]:
        """The energies by the names that a user gives."""
        return {
            "signed-tpe": self.signed_tpe,
            "tpe": self.tpe,
            "point-to-plane": self.point_to_plane,
            "conical": self.conical,
        }
