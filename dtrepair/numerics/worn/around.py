"""Which sheet, by itself or with a lining, goes round another part, however far away that is."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from dtrepair.numerics.geometry import FloatArray, dots, triangle_areas
from dtrepair.numerics.worn.measure import Solid, surrounds, worn_measure
from dtrepair.numerics.worn.parts import Parts
from dtrepair.numerics.worn.sides import LayerOptions, WornLayer


def find_worn(
    parts: Parts, first: int, second: int, pose: int, *, options: LayerOptions = LayerOptions()
) -> WornLayer | None:
    """Return the layer that a part is which goes round the other, however far away it is.

    An open part, or a thin closed one.
    """
    points, best, found = parts.poses[pose], options.worn, None
    for top, under in ((first, second), (second, first)):
        if not may_go_round(parts, top, pose, options):
            continue
        worn = worn_measure(*solids(parts, top, under, points), least=best)
        if worn.share >= best:
            own = points[parts.vertices[top]]
            radial = own - own.mean(axis=0)
            radial -= np.outer(radial @ worn.axis, worn.axis)
            best, found = worn.share, _outside(parts, top, under, pose, radial)
    return found


def find_around(
    parts: Parts, first: int, second: int, pose: int, *, options: LayerOptions = LayerOptions()
) -> WornLayer | None:
    """Return the layer that surrounds what is beside it: a robe over either leg or shoe.

    Of two that surround each other, as sheets that alternate, neither is.
    """
    points, both = parts.poses[pose], ((first, second), (second, first))
    found = [own for own in both if _surrounds(parts, *own, pose, options)]
    if len(found) != 1:
        return None
    top, under = found[0]
    # A hand in its sleeve is far off the middle of a coat.
    own, limb = points[parts.vertices[top]], points[parts.vertices[under]]
    away = own - limb[cKDTree(limb).query(own)[1]]
    return _outside(parts, top, under, pose, away)._replace(around=True)


def _surrounds(parts: Parts, top: int, under: int, pose: int, options: LayerOptions) -> bool:
    """Return whether a sheet goes all round another part that is not small beside it."""
    points = parts.poses[pose]
    whole, own = (float(triangle_areas(points, parts.triangles[k]).sum()) for k in (top, under))
    return own >= options.small * whole and _goes_all_round(parts, top, under, pose, options)


def _goes_all_round(parts: Parts, top: int, under: int, pose: int, options: LayerOptions) -> bool:
    """Return whether a part is a sheet that surrounds what of another one is beside it."""
    if not may_go_round(parts, top, pose, options):
        return False
    both = solids(parts, top, under, parts.poses[pose])
    return surrounds(*both, least=options.around).share >= options.around


def lies_inside(
    parts: Parts, part: int, sheet: int, pose: int, *, options: LayerOptions = LayerOptions()
) -> bool:
    """Return whether a part lies inside of a sheet that goes all round it, and so not over it.

    The sleeve of a shirt, which faces the lining of its jacket; not a cape around the jacket.
    """
    points, weights = parts.poses[pose], parts.area_shares(part)
    own, around = points[parts.vertices[part]], points[parts.vertices[sheet]]
    outwards = dots(around[cKDTree(around).query(own)[1]] - own, own - weights @ own)
    outside = float(weights @ np.sign(outwards)) > 0.0
    return outside and _goes_all_round(parts, sheet, part, pose, options)


def still_around(
    parts: Parts, layer: WornLayer, points: FloatArray, *, options: LayerOptions = LayerOptions()
) -> bool:
    """Return whether a pose (V, 3) has within a layer of `find_around` what it surrounds.

    A driver may leave his car, and lean on it; a foot that came through a robe is in it yet.
    """
    both = solids(parts, layer.top, layer.under, points)
    return surrounds(*both, least=options.worn).share >= options.worn


def may_go_round(parts: Parts, part: int, pose: int, options: LayerOptions) -> bool:
    """Return whether a part is a sheet, by itself or with a lining, as a pose has it."""
    return not parts.closed[part] or parts.thickness(part, pose) <= options.thin


def solids(parts: Parts, top: int, under: int, points: FloatArray) -> list[Solid]:
    """Return two parts as points (V, 3) have them."""
    return [Solid(points, parts.triangles[k], bool(parts.closed[k])) for k in (top, under)]


def _outside(parts: Parts, top: int, under: int, pose: int, away: FloatArray) -> WornLayer:
    """Return all of a part as a layer that goes round another one, `away` (N, 3) from it."""
    outwards = dots(parts.normals(top, pose), away)
    if not parts.closed[top]:
        outwards = np.full(len(outwards), (outwards * parts.area_shares(top)).sum())
    sides = np.where(outwards >= 0.0, 1.0, -1.0)
    return WornLayer(top, under, parts.vertices[top], sides, np.full(len(sides), np.inf))
