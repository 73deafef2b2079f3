"""Sheets whose normals point inwards, as those of a lining."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import border_edges, dots, lengths, triangle_areas
from dtrepair.numerics.worn.covering import near_sheets
from dtrepair.numerics.worn.parts import Parts
from dtrepair.numerics.worn.sides import LayerOptions, look_beside, upper_part


def linings(parts: Parts, *, options: LayerOptions = LayerOptions()) -> list[int]:
    """Return the sheets whose normals point inwards, and that lie over or under another sheet.

    A lining's point into the body. By them the coat around it would be beneath, and the trousers
    outside. A sheet that meets no other one needs no turning: what it covers tells which side is
    out (`find_layer`).
    """
    near: dict[int, set[int]] = {}
    for first, second in near_sheets(parts, options, ~parts.closed):
        near.setdefault(first, set()).add(second)
        near.setdefault(second, set()).add(first)
    solid = _solids(parts, options)
    sheets = [own for own in sorted(near) if not solid[own]]
    covered = {own: [other for other in near[own] if solid[other]] for own in sheets}
    inwards = [own for own in sheets if _points_inwards(parts, own, covered[own], options)]
    found = []
    for own in inwards:
        others = (other for other in near[own] if not solid[other])
        turned = ((other, None if other in inwards else own) for other in others)
        if any(upper_part(parts, own, *both, options=options) is not None for both in turned):
            found.append(own)
    return found


def _points_inwards(parts: Parts, own: int, solids: list[int], options: LayerOptions) -> bool:
    """Return whether a sheet's normals point into the solid part of which most is beside it."""
    weights = parts.area_shares(own)
    radial = parts.poses[0][parts.vertices[own]]
    radial = radial - weights @ radial
    outwards = float(weights @ dots(parts.normals(own, 0), radial))
    if outwards > options.ball * float(weights @ lengths(radial)):
        return False  # a ball in a shell, whose inner side faces it
    most, towards = options.share, 0.0
    for other in solids:
        found = look_beside(parts, own, other, 0, options)
        known = weights * found.known
        if (share := float(known.sum())) > most:
            most, towards = share, float((known * found.sides).sum()) / share
    return towards <= -options.one_sided


def _solids(parts: Parts, options: LayerOptions) -> NDArray[np.bool_]:
    """Return which parts (P,) are closed, or all but closed, as a body that ends at its neck."""
    rest, solid = parts.poses[0], parts.closed.copy()
    for part in np.flatnonzero(~parts.closed).tolist():
        triangles = parts.triangles[part]
        ends = rest[triangles.ravel()[border_edges(triangles, len(rest))]]
        border = float(lengths(ends[:, 0] - ends[:, 1]).sum())
        area = float(triangle_areas(rest, triangles).sum())
        solid[part] = border**2 / (4.0 * np.pi) <= options.hole * area
    return solid
