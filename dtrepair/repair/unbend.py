"""Creases that relaxing has zipped up: their sharpest edges opened until no more are bent."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from dtrepair.geometry import FloatArray, dots, triangle_normals
from dtrepair.repair.crease import solve_patch
from dtrepair.repair.relax import STEP, relax
from dtrepair.repair.rigidity import Rigidity
from dtrepair.repair.surface import ANCHOR, BoolArray, Surface

# Beyond this angle between the normals of its triangles, 120 degrees, an edge counts as bent.
SHARP = -0.5
# What bending counts in each round, next to edges of weight about 1; iterations of the shape.
BENDING, ITERATIONS = (0.1, 0.1, 0.2, 0.2), 3
# The shape is smoothed within so many rings of bent edges, and the motion fades out over these.
SMOOTH_RINGS, FULL_RINGS, FADED_RINGS = 1, 4, 12


def bent_edges(surface: Surface, points: FloatArray) -> BoolArray:
    """Which hinges (H,) of the surface are bent by more than 120 degrees."""
    return _cosines(surface, points) < SHARP


def unbend(
    surface: Surface,
    original: FloatArray,
    points: FloatArray,
    *,
    folds: int,
    step: float = STEP,
) -> tuple[FloatArray, int]:
    """A clean pose with no more bent edges than its original where that can be, and the rounds.

    Where surfaces close a crease, its bottom folds flat. In each round the surroundings of the
    edges that are bent more than in the original become smooth, and one as-rigid-as-possible step
    with contacts leads there: both sides make room. It ends where a round does not help.
    """
    given = _cosines(surface, original)
    allowed = _sharpness(given)[0]
    current = _cosines(surface, points)
    for done, bending in enumerate(BENDING):
        sharpness = _sharpness(current)
        if sharpness[0] <= allowed:
            return points, done
        seeds = surface.vertices_of(surface.hinges[(current < SHARP) & (current < given)])
        seeds &= ~surface.stiff
        if not seeds.any():
            return points, done
        rings = surface.rings_from(seeds, FADED_RINGS)
        fade = np.clip((FADED_RINGS - rings) / (FADED_RINGS - FULL_RINGS), 0.0, 1.0)
        trial, _ = relax(
            surface,
            _smooth(surface, points, seeds, bending),
            points,
            cycles=1,
            folds=folds,
            reach=np.where(surface.stiff, 0.0, fade),
            step=step,
        )
        current = _cosines(surface, trial)
        if _sharpness(current) >= sharpness:
            return points, done
        points = trial
    return points, len(BENDING)


def _smooth(surface: Surface, points: FloatArray, seeds: BoolArray, strength: float) -> FloatArray:
    """The pose (V, 3) with least edge strain plus bending around the seeds, contacts ignored.

    Bending is `strength` times sum |L x|^2 over the seeds' surroundings, L the uniform Laplacian;
    edges stay as rigid as possible (Sorkine & Alexa 2007).
    """
    mask = surface.dilate(seeds, SMOOTH_RINGS) & ~surface.stiff
    inner = np.flatnonzero(mask)
    bending = surface.uniform[np.flatnonzero(surface.dilate(seeds))]
    rows = surface.laplacian[inner] + ANCHOR * sparse.diags(surface.mass, format="csr")[inner]
    rows = (rows + strength * (bending[:, inner].T @ bending)).tocsr()
    known = rows @ np.where(mask[:, None], 0.0, points)
    system = rows[:, inner]
    rigidity = Rigidity(surface, points, region=mask)
    result = points
    for _ in range(ITERATIONS):
        right = rigidity.target(result)[inner] - known
        result = points.copy()
        result[inner] = solve_patch(system, right)
    return result


def _sharpness(cosines: FloatArray) -> tuple[int, float]:
    """Number of bent edges, and by how much they are bent too far: smaller is better."""
    excess = SHARP - cosines[cosines < SHARP]
    return len(excess), float(excess.sum())


def _cosines(surface: Surface, points: FloatArray) -> FloatArray:
    """Cosine of the angle between the normals at each hinge (H,)."""
    normals = triangle_normals(points, surface.faces)
    first, second = surface.hinges.T
    return dots(normals.take(first, axis=0), normals.take(second, axis=0))
