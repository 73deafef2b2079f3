"""Energies of a corner against a plane: values and closed-form derivatives.

With d = c - v the offset of the plane's centroid c from the corner v, n the unit normal and A the
area, s = <n, d> is positive where v lies behind the plane. Normals, areas and radii are held fixed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from dtrepair.repair.options import RepairOptions


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
