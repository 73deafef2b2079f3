"""Meshes made in code: points (V, 3) float64 and faces (F, 3) int32, unless said otherwise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Mesh = tuple[NDArray[np.float64], NDArray[np.int32]]


def icosphere(level: int = 2, radius: float = 1.0) -> Mesh:
    """Icosahedron subdivided `level` times onto the sphere: 20 * 4 ** level triangles."""
    golden = (1.0 + 5.0**0.5) / 2.0
    half = [(s, t * golden) for s in (-1, 1) for t in (-1, 1)]
    corners = [(0, s, t) for s, t in half] + [(s, t, 0) for s, t in half]
    points = np.array(corners + [(t, 0, s) for s, t in half], dtype=np.float64)
    # The 20 faces are the triples at mutual distance 2, wound outward.
    near = np.isclose(np.linalg.norm(points[:, None] - points[None], axis=2), 2.0)
    triples = [
        (i, j, k)
        for i in range(12)
        for j in range(i + 1, 12)
        for k in range(j + 1, 12)
        if near[i, j] and near[j, k] and near[i, k]
    ]
    faces = np.array(triples, dtype=np.int32)
    inward = np.linalg.det(points[faces]) < 0
    faces[inward] = faces[inward][:, ::-1]
    for _ in range(level):
        points, faces = subdivided(points, faces)
    return radius * points / np.linalg.norm(points, axis=1, keepdims=True), faces


def subdivided(points: NDArray[np.float64], faces: NDArray[np.int32]) -> Mesh:
    """Every triangle split into four at the midpoints of its edges."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, middle = np.unique(edges, axis=0, return_inverse=True)
    ab, bc, ca = (len(points) + middle.reshape(3, -1)).astype(np.int32)
    a, b, c = faces.T
    quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    finer = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
    return np.concatenate([points, points[unique].mean(axis=1)]), finer


def grid_quads(columns: int, rows: int, size: float = 1.0) -> Mesh:
    """Flat square grid in the xy plane with quads (columns * rows, 4), counter-clockwise."""
    x, y = np.meshgrid(np.linspace(0, size, columns + 1), np.linspace(0, size, rows + 1))
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)[None]).ravel()
    quads = np.stack([corner, corner + 1, corner + columns + 2, corner + columns + 1], axis=1)
    return points, quads.astype(np.int32)


def grid(columns: int, rows: int, size: float = 1.0) -> Mesh:
    """Flat square grid in the xy plane, each square split in two triangles, normals up."""
    points, quads = grid_quads(columns, rows, size)
    return points, split_quads(quads)


def split_quads(quads: NDArray[np.int32]) -> NDArray[np.int32]:
    """Fan triangulation of quads (Q, 4): triangles 2q and 2q + 1 of quad q."""
    return np.stack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]], axis=1).reshape(-1, 3)


def torus_quads(
    around: int = 32, across: int = 16, radius: float = 1.0, tube_radius: float = 0.3
) -> Mesh:
    """Closed torus about the z axis with quads (around * across, 4), wound outward."""
    u = 2 * np.pi * np.arange(around) / around
    v = 2 * np.pi * np.arange(across) / across
    ring = radius + tube_radius * np.cos(v)
    x, y = np.cos(u)[:, None] * ring, np.sin(u)[:, None] * ring
    z = np.broadcast_to(tube_radius * np.sin(v), x.shape)
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
    quads = [((p % around) * across + q % across).ravel() for p, q in corners]
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    return points, np.stack(quads, axis=1).astype(np.int32)


def torus(
    around: int = 32, across: int = 16, radius: float = 1.0, tube_radius: float = 0.3
) -> Mesh:
    """Closed torus about the z axis, wound outward: 2 * around * across triangles."""
    points, quads = torus_quads(around, across, radius, tube_radius)
    return points, split_quads(quads)


def tube_quads(around: int = 16, along: int = 20, radius: float = 0.2, length: float = 2.0) -> Mesh:
    """Open tube along z, centred at the origin, with quads (around * along, 4), wound outward."""
    u = 2 * np.pi * np.arange(around) / around
    z = np.linspace(-length / 2, length / 2, along + 1)
    circle = radius * np.stack([np.cos(u), np.sin(u)], axis=1)
    rings = np.broadcast_to(circle, (along + 1, around, 2))
    heights = np.broadcast_to(z[:, None, None], (along + 1, around, 1))
    points = np.concatenate([rings, heights], axis=2).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(along), np.arange(around), indexing="ij")
    corners = [(i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j)]
    quads = [(p * around + q % around).ravel() for p, q in corners]
    return points, np.stack(quads, axis=1).astype(np.int32)


def tube(around: int = 16, along: int = 20, radius: float = 0.2, length: float = 2.0) -> Mesh:
    """Open tube along z, centred at the origin, wound outward: 2 * around * along triangles."""
    points, quads = tube_quads(around, along, radius, length)
    return points, split_quads(quads)


def bent_tube(angle: float, around: int = 16, along: int = 40, radius: float = 0.1) -> Mesh:
    """The tube of length 2 bent in the xz plane by `angle` radians: beyond pi it meets itself."""
    points, faces = tube(around, along, radius, 2.0)
    if angle == 0.0:
        return points, faces
    bend = 2.0 / angle
    turn = points[:, 2] / bend
    x = (bend + points[:, 0]) * np.cos(turn) - bend
    z = (bend + points[:, 0]) * np.sin(turn)
    return np.stack([x, points[:, 1], z], axis=1), faces


def joined(*meshes: Mesh) -> Mesh:
    """Several meshes as one, indices shifted."""
    starts = np.cumsum([0] + [len(points) for points, _ in meshes[:-1]])
    faces = [faces + start for (_, faces), start in zip(meshes, starts, strict=True)]
    return np.concatenate([points for points, _ in meshes]), np.concatenate(faces).astype(np.int32)


def crossing_tubes(around: int = 16, along: int = 20, offset: float = 0.05) -> Mesh:
    """Two open tubes that cross at right angles, their axes `offset` apart along y."""
    points, faces = tube(around, along)
    other = points[:, [2, 1, 0]] * (1.0, 1.0, -1.0) + (0.0, offset, 0.013)
    return joined((points, faces), (other, faces))


def overlapping_spheres(level: int = 2, distance: float = 1.5) -> Mesh:
    """Two unit spheres in one mesh, centres `distance` apart along x, the second one turned."""
    points, faces = icosphere(level)
    c, s = np.cos(0.4), np.sin(0.4)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    turn = turn @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    return joined((points, faces), (points @ turn.T + (distance, 0.0, 0.0), faces))


def swept(
    centre: NDArray[np.float64], radius: NDArray[np.float64], around: int, closed: bool
) -> Mesh:
    """Tube about a curve of centres (N, 3) with radii (N,): closed into a ring, or with two caps.

    Frames are carried along the curve without twist; a ring spreads the twist that is left.
    """
    ahead = np.roll(centre, -1, axis=0) - np.roll(centre, 1, axis=0)
    if not closed:
        ahead[0], ahead[-1] = centre[1] - centre[0], centre[-1] - centre[-2]
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    normal = np.zeros_like(centre)
    start = np.eye(3)[np.abs(ahead[0]).argmin()]
    for k in range(len(centre)):
        previous = start if k == 0 else normal[k - 1]
        normal[k] = previous - (previous @ ahead[k]) * ahead[k]
        normal[k] /= np.linalg.norm(normal[k])
    side = np.cross(ahead, normal)
    twist = np.zeros(len(centre))
    if closed:
        last = np.arctan2(normal[-1] @ side[0], normal[-1] @ normal[0])
        twist = -last * np.arange(len(centre)) / (len(centre) - 1)
    angle = 2 * np.pi * np.arange(around) / around + twist[:, None]
    circle = np.cos(angle)[..., None] * normal[:, None] + np.sin(angle)[..., None] * side[:, None]
    points = (centre[:, None] + radius[:, None, None] * circle).reshape(-1, 3)
    rings = len(centre) if closed else len(centre) - 1
    i, j = np.meshgrid(np.arange(rings), np.arange(around), indexing="ij")
    corners = [(i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j)]
    quads = [((p % len(centre)) * around + q % around).ravel() for p, q in corners]
    faces = split_quads(np.stack(quads, axis=1).astype(np.int32))
    if closed:
        return points, faces
    ring, count = np.arange(around), len(points)
    first = np.stack([np.full(around, count), (ring + 1) % around, ring], axis=1)
    base = (len(centre) - 1) * around
    last_cap = np.stack(
        [np.full(around, count + 1), base + ring, base + (ring + 1) % around], axis=1
    )
    tips = centre[[0, -1]] + 0.3 * radius[[0, -1], None] * ahead[[0, -1]] * [[-1.0], [1.0]]
    return np.concatenate([points, tips]), np.concatenate([faces, first, last_cap]).astype(np.int32)


def knot(along: int = 96, around: int = 10, tube_radius: float = 0.75) -> Mesh:
    """Closed trefoil tube, three-fold symmetric; it meets itself from a tube radius of 0.6 on."""
    t = 2 * np.pi * np.arange(along) / along
    x, y = np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t)
    centre = np.stack([x, y, -np.sin(3 * t)], axis=1)
    return swept(centre, np.full(along, tube_radius), around, closed=True)


def elbow(angle: float, along: int = 40, around: int = 12, radius: float = 0.2) -> Mesh:
    """Closed tube of length 2 bent by `angle` over its middle tenth: a deep crease beyond 1.5."""
    arc = np.linspace(-1.0, 1.0, along + 1)
    heading = angle * np.clip(arc / 0.1, -1.0, 1.0) / 2
    middle = 0.5 * (heading[1:] + heading[:-1])
    step = np.stack([np.sin(middle), np.zeros(along), np.cos(middle)], axis=1) * (2.0 / along)
    centre = np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])
    return swept(centre, np.full(along + 1, radius), around, closed=False)


def armed_body(curl: float, along: int = 60, around: int = 12) -> Mesh:
    """One closed mesh: a wide body, and a thin arm that turns by `curl` radians.

    From a curl of about 3.6 on the arm goes through the body it grows from.
    """
    arc = np.linspace(0.0, 4.0, along + 1)
    heading = curl * np.clip((arc - 1.2) / 2.0, 0.0, 1.0)
    middle = 0.5 * (heading[1:] + heading[:-1])
    step = np.stack([np.sin(middle), np.zeros(along), np.cos(middle)], axis=1) * (4.0 / along)
    centre = np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])
    blend = 1.0 / (1.0 + np.exp((arc - 1.0) / 0.06))
    return swept(centre, 0.12 + 0.38 * blend, around, closed=False)


def crossed_legs(angle: float, apart: float, along: int = 90, around: int = 14) -> Mesh:
    """One closed tube: two legs of length 2 and radius 0.12 from hips 0.9 apart.

    Each leg swings by `angle` towards the other one, and by `apart` to its own side in depth: from
    an angle of about 0.23 on they cross like an X, and meet where 2 `apart` is below 0.24.
    """
    arc = np.linspace(0.0, 4.9, along + 1)
    down = np.where(arc < 2.0, 2.0 - arc, np.maximum(arc - 2.9, 0.0))
    side = np.where(arc < 2.45, 1.0, -1.0)
    across = np.clip(arc - 2.0, 0.0, 0.9) - 0.45 + side * np.sin(angle) * down
    depth = side * apart * np.clip(down, 0.0, 1.0)
    centre = np.stack([across, depth, -np.cos(angle) * down], axis=1)
    padded = np.pad(centre, ((4, 4), (0, 0)), mode="edge")
    # Rounded, so that the hips have no crease.
    smooth = np.mean([padded[k : k + along + 1] for k in range(9)], axis=0)
    return swept(smooth, np.full(along + 1, 0.12), around, closed=False)


def klein_bottle(around: int = 24, across: int = 16) -> Mesh:
    """Figure-eight immersion of the Klein bottle: closed, not orientable, crossing on a curve."""
    u = 2 * np.pi * np.arange(around)[:, None] / around
    v = 2 * np.pi * (np.arange(across)[None] + 0.5) / across
    width = np.cos(u / 2) * np.sin(v) - np.sin(u / 2) * np.sin(2 * v)
    height = np.sin(u / 2) * np.sin(v) + np.cos(u / 2) * np.sin(2 * v)
    points = np.stack([(3 + width) * np.cos(u), (3 + width) * np.sin(u), height], axis=-1)
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    # Once around, the cross-section comes back mirrored: v becomes -v.
    corners = []
    for p, q in [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]:
        turned = np.where(p == around, across - 1 - q % across, q % across)
        corners.append(((p % around) * across + turned).ravel())
    return points.reshape(-1, 3), split_quads(np.stack(corners, axis=1).astype(np.int32))


def with_seam(points: NDArray[np.float64], faces: NDArray[np.int32], first: int) -> Mesh:
    """The mesh with every vertex of its triangles from `first` on duplicated, as on a UV seam."""
    used = np.unique(faces[first:])
    place = np.full(len(points), -1)
    place[used] = len(points) + np.arange(len(used))
    other = place[faces[first:]]
    return (
        np.concatenate([points, points[used]]),
        np.concatenate([faces[:first], other]).astype(np.int32),
    )
