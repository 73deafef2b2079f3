"""Sheets whose normals point inwards, as those of a lining."""

from __future__ import annotations

import numpy as np

from dtrepair.numerics.geometry import dots, extent
from dtrepair.numerics.worn.parts import Parts
from dtrepair.numerics.worn.sides import LayerOptions, look_beside, upper_part


def linings(parts: Parts, *, options: LayerOptions = LayerOptions()) -> list[int]:
    """Return the open parts whose normals point inwards, and that lie over or under another one.

    A lining's point into the body. By them the coat around it would be beneath, and the trousers
    outside. A sheet that meets no other one needs no turning: what it covers tells which side is
    out (`find_layer`).
    """
    sheets = np.flatnonzero(~parts.closed).tolist()
    closed = np.flatnonzero(parts.closed).tolist()
    if not closed or len(sheets) < 2:
        return []
    inwards = [own for own in sheets if _points_inwards(parts, own, closed, options)]
    return [own for own in inwards if _meets_sheet(parts, own, sheets, options)]


def _points_inwards(parts: Parts, own: int, closed: list[int], options: LayerOptions) -> bool:
    """Return whether an open part's normals point into that closed part which it covers most."""
    rest, weights = parts.poses[0], parts.area_shares(own)
    radial = rest[parts.vertices[own]]
    radial = radial - weights @ radial
    if weights @ dots(parts.normals(own, 0), radial) > 0.0:
        return False  # a ball in a shell, whose inner side faces it
    near = [other for other in closed if _boxes_meet(parts, own, other)]
    near.sort(key=lambda other: -extent(rest[parts.vertices[other]]))
    most, towards = options.share, 0.0
    for other in near[: options.beneath]:
        found = look_beside(parts, own, other, 0, options)
        known = weights * found.known
        if (share := float(known.sum())) > most:
            most, towards = share, float((known * found.sides).sum()) / share
    return towards <= -options.one_sided


def _meets_sheet(parts: Parts, own: int, sheets: list[int], options: LayerOptions) -> bool:
    """Return whether a part whose normals count reversed lies over or under another sheet."""
    near = (other for other in sheets if other != own and _boxes_meet(parts, own, other))
    return any(upper_part(parts, own, other, [0], own, options) is not None for other in near)


def _boxes_meet(parts: Parts, first: int, second: int) -> bool:
    """Return whether the bounding boxes of two parts meet at rest."""
    one, other = (parts.poses[0][parts.vertices[part]] for part in (first, second))
    meet = (one.min(axis=0) <= other.max(axis=0)) & (one.max(axis=0) >= other.min(axis=0))
    return bool(meet.all())
