"""Polygons to triangles (numpy only).

Quads are always split into a fan from their first vertex, so that intersection counts of one file
are comparable between tools; so are convex polygons. Concave polygons of five and more sides are
split by ear clipping (Meisters 1975, "Polygons have ears") in the plane of their vector area.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Triangulation:
    """Triangles of a polygon mesh.

    Attributes:
        faces: vertex indices (F, 3) int32.
        polygons: source polygon of each triangle (F,) int32, ascending.
        holes: number of polygons left out because they are holes.
        degenerate: number of polygons left out because they have fewer than three different
            corners in a row.
    """

    faces: NDArray[np.int32]
    polygons: NDArray[np.int32]
    holes: int
    degenerate: int


def triangulate(
    counts: ArrayLike,
    indices: ArrayLike,
    points: NDArray[np.floating],
    *,
    holes: ArrayLike = (),
    flip: bool = False,
) -> Triangulation:
    """Return the triangles of a polygon mesh, in the order of the polygons.

    Args:
        counts: corners of each polygon (P,).
        indices: vertex of each corner (sum of counts,), all of them valid.
        points: positions (V, 3); they only decide which polygons are concave, and their ears.
        holes: polygons that are holes; they give no triangles.
        flip: reverse the winding (left-handed meshes).

    Polygons with fewer than three corners and triangles that name a vertex twice are left out;
    triangles of zero area stay.

    Raises:
        ValueError: counts and indices do not fit together, or an index is out of range.
    """
    counts = np.asarray(counts, dtype=np.int64).reshape(-1)
    indices = np.asarray(indices, dtype=np.int64).reshape(-1)
    check_topology(counts, indices, len(points))
    fans, polygons = _fans(counts, indices)
    starts = np.concatenate([[0], np.cumsum(counts)])
    many_sided = np.flatnonzero(counts >= 5).tolist()
    concave = [p for p in many_sided if not _is_convex(points, indices, starts, p)]
    if concave:
        fans, polygons = _replace_fans(fans, polygons, concave, points, indices, starts)
    hole = np.zeros(len(counts), dtype=bool)
    named = np.asarray(holes, dtype=np.int64).reshape(-1)
    hole[named[(named >= 0) & (named < len(counts))]] = True
    proper = (fans[:, 0] != fans[:, 1]) & (fans[:, 1] != fans[:, 2]) & (fans[:, 2] != fans[:, 0])
    covered = np.zeros(len(counts), dtype=bool)
    covered[polygons[proper]] = True
    keep = proper & ~hole[polygons]
    faces = fans[keep]
    if flip:
        faces = faces[:, [0, 2, 1]]
    return Triangulation(
        np.ascontiguousarray(faces, dtype=np.int32),
        np.ascontiguousarray(polygons[keep], dtype=np.int32),
        int(hole.sum()),
        int((~covered & ~hole).sum()),
    )


def check_topology(
    counts: NDArray[np.int64], indices: NDArray[np.int64], vertex_count: int
) -> None:
    """Raise ValueError unless counts and indices describe polygons over that many vertices."""
    if (counts < 0).any():
        polygon = int(np.flatnonzero(counts < 0)[0])
        raise ValueError(f"polygon {polygon} has {counts[polygon]} corners")
    if counts.sum() != len(indices):
        raise ValueError(
            f"expected {counts.sum()} face vertex indices (sum of the counts), got {len(indices)}"
        )
    wrong = np.flatnonzero((indices < 0) | (indices >= vertex_count))
    if len(wrong):
        raise ValueError(
            f"face vertex index {indices[wrong[0]]} at corner {wrong[0]} is out of range: "
            f"expected 0 to {vertex_count - 1} for {vertex_count} points"
        )


def nonmanifold_edges(faces: NDArray[np.int32]) -> int:
    """Return the number of edges with more than two triangles, of faces (F, 3)."""
    ends = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64), axis=1)
    if not len(ends):
        return 0
    _, uses = np.unique(ends[:, 0] * (int(ends.max()) + 1) + ends[:, 1], return_counts=True)
    return int((uses > 2).sum())


def _fans(
    counts: NDArray[np.int64], indices: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return fans from the first corner of every polygon.

    Triangles (N, 3) and their polygons (N,).
    """
    starts = np.cumsum(counts) - counts
    triangles = np.maximum(counts - 2, 0)
    polygons = np.repeat(np.arange(len(counts)), triangles)
    first = np.cumsum(triangles) - triangles
    step = np.arange(len(polygons)) - first[polygons]
    corner = starts[polygons]
    fans = np.stack([corner, corner + step + 1, corner + step + 2], axis=1)
    return indices[fans].reshape(-1, 3), polygons


def _plane(
    points: NDArray[np.floating], corners: NDArray[np.int64]
) -> tuple[NDArray[np.float64], float]:
    """Return corners (N, 2) in the plane of the polygon's vector area, and that area.

    The corners are counter-clockwise.
    """
    corners_3d = np.asarray(points[corners], dtype=np.float64)
    corners_3d = corners_3d - corners_3d[0]
    area = 0.5 * np.cross(corners_3d[1:-1], corners_3d[2:]).sum(axis=0)
    size = float(np.linalg.norm(area))
    if size == 0.0 or not np.isfinite(size):
        return np.zeros((len(corners), 2)), 0.0
    normal = area / size
    helper = np.eye(3)[np.argmin(np.abs(normal))]
    across = np.cross(helper, normal)
    across /= np.linalg.norm(across)
    return corners_3d @ np.stack([across, np.cross(normal, across)], axis=1), size


def _doubled_areas(
    first: NDArray[np.float64], second: NDArray[np.float64], third: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return twice the signed areas of triangles in the plane; corners (..., 2)."""
    one, two = second - first, third - first
    doubled: NDArray[np.float64] = one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0]
    return doubled


def _is_convex(
    points: NDArray[np.floating],
    indices: NDArray[np.int64],
    starts: NDArray[np.int64],
    polygon: int,
) -> bool:
    """Return whether the polygon is convex, or too degenerate to tell."""
    flat, size = _plane(points, indices[starts[polygon] : starts[polygon + 1]])
    turns = _doubled_areas(np.roll(flat, 1, axis=0), flat, np.roll(flat, -1, axis=0))
    return size == 0.0 or bool((turns >= -1e-6 * size).all())


def _replace_fans(
    fans: NDArray[np.int64],
    polygons: NDArray[np.int64],
    concave: list[int],
    points: NDArray[np.floating],
    indices: NDArray[np.int64],
    starts: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Replace the fans of concave polygons by ears: as many triangles, in the same places."""
    fans = fans.copy()
    for polygon in concave:
        corners = indices[starts[polygon] : starts[polygon + 1]]
        where = np.searchsorted(polygons, polygon)
        fans[where : where + len(corners) - 2] = corners[_ears(_plane(points, corners)[0])]
    return fans, polygons


def _ears(flat: NDArray[np.float64]) -> NDArray[np.int64]:
    """Clip the ears of a counter-clockwise polygon (N, 2): triangles (N - 2, 3) of its corners.

    Of all ears the one with the largest smallest height is cut, which keeps slivers away. If
    rounding or a self-crossing outline leaves no ear, the most convex corner is cut.
    """
    ring = list(range(len(flat)))
    triangles = []
    while len(ring) > 3:
        corners = [(ring[i - 1], ring[i], ring[(i + 1) % len(ring)]) for i in range(len(ring))]
        best = max(range(len(ring)), key=lambda i: _ear_quality(flat, corners[i], ring))
        triangles.append(corners[best])
        del ring[best]
    triangles.append((ring[0], ring[1], ring[2]))
    _flip_slivers(flat, triangles)
    return np.array(triangles, dtype=np.int64)


def _flip_slivers(flat: NDArray[np.float64], triangles: list[tuple[int, int, int]]) -> None:
    """Flip diagonals while that raises the smaller height of their two triangles.

    Ears alone can leave a triangle without area where corners of the outline are collinear.
    """
    # Heights only grow, so this ends; the bound is for rounding.
    for _ in range(len(triangles) ** 2):
        sides = {(t[k], t[k - 2]): (n, t[k - 1]) for n, t in enumerate(triangles) for k in range(3)}
        for (tail, head), (number, tip) in sides.items():
            other, apex = sides.get((head, tail), (-1, -1))
            if other < 0:
                continue
            old = min(_height(flat, triangles[number]), _height(flat, triangles[other]))
            pair = ((tip, tail, apex), (apex, head, tip))
            if min(_height(flat, pair[0]), _height(flat, pair[1])) > old + 1e-9 * abs(old):
                triangles[number], triangles[other] = pair
                break
        else:
            return


def _height(flat: NDArray[np.float64], triangle: tuple[int, int, int]) -> float:
    """Return the smallest height of a triangle in the plane; negative if it is clockwise."""
    first, middle, last = flat[list(triangle)]
    sides = (middle - first, last - middle, first - last)
    longest = max(float(np.linalg.norm(side)) for side in sides)
    return float(_doubled_areas(first, middle, last)) / longest if longest > 0.0 else 0.0


def _ear_quality(
    flat: NDArray[np.float64], corner: tuple[int, int, int], ring: list[int]
) -> tuple[bool, float]:
    """Return the sorting key of a corner: whether it is an ear, and its height."""
    first, middle, last = flat[list(corner)]
    height = _height(flat, corner)
    if height <= 0.0:
        return False, height
    others = flat[[i for i in ring if i not in corner]]
    # Copies of the corners (bridges to holes) touch the ear without entering it.
    inside = (
        (_doubled_areas(first, middle, others) > 0.0)
        & (_doubled_areas(middle, last, others) > 0.0)
        & (_doubled_areas(last, first, others) >= 0.0)
        & ~(others == first).all(axis=1)
        & ~(others == last).all(axis=1)
    )
    return not inside.any(), height
