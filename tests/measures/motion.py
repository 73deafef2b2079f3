"""What a repair did to a character: moves, edges, volumes, jitter; lengths over the diagonal."""

from __future__ import annotations

import numpy as np

from tests.measures.surfaces import Floats, Surface, areas, volumes

# A closed part whose volume is less than this times (area ^ 3/2) is a sheet: it has none to keep.
# A ball has 0.094, a plate of 1 x 1 x 0.01 0.003.
LEAST_VOLUME = 0.002


def box_diagonal(points: Floats) -> float:
    """Diagonal of the bounding box of points (V, 3)."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def moves(before: Floats, after: Floats) -> Floats:
    """How far each point (V, 3) moved (V,), over the diagonal."""
    result: Floats = np.linalg.norm(after - before, axis=1) / (box_diagonal(before) or 1.0)
    return result


def edge_ratios(surface: Surface, before: Floats, after: Floats) -> Floats:
    """Length of each edge (E,) over what it was; 1 for an edge that had none."""
    first, second = surface.edges.T
    old, new = (np.linalg.norm(own[first] - own[second], axis=1) for own in (before, after))
    ratio: Floats = np.divide(new, old, out=np.ones_like(old), where=old > 0)
    return ratio


def spoilt_edges(surface: Surface, before: Floats, after: Floats, factor: float = 4.0) -> int:
    """Edges that became `factor` times longer or shorter."""
    ratio = edge_ratios(surface, before, after)
    return int(((ratio > factor) | (ratio < 1.0 / factor)).sum())


def volume_changes(surface: Surface, before: Floats, after: Floats) -> Floats:
    """Change of the volume of each closed part (P,) over what it was; NaN for others."""
    old, new = volumes(before, surface), volumes(after, surface)
    area = np.bincount(surface.part_of_face, areas(before, surface.faces), surface.parts)
    with np.errstate(invalid="ignore"):
        solid = np.abs(old) > LEAST_VOLUME * area**1.5
    return np.where(solid, (new - old) / np.where(solid, old, 1.0), np.nan)


def jitter(before: Floats, after: Floats) -> float:
    """Root mean square second difference of the displacement (T, V, 3) over the diagonal."""
    if len(before) < 3:
        return 0.0
    second = np.diff(after - before, n=2, axis=0)
    rms = float(np.sqrt((second**2).sum(axis=2).mean()))
    return rms / (box_diagonal(before[0]) or 1.0)
