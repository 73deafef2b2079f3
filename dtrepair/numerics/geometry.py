"""Triangle meshes as plain arrays: areas, normals, edges, adjacency, components, weld maps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse import csgraph

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]


def as_mesh(points: ArrayLike, faces: ArrayLike) -> tuple[FloatArray, IntArray]:
    """Return points (V, 3) as float64 and faces (F, 3) as int32, checked.

    Raises ValueError for other shapes, numbers that are not finite and indices out of range.
    """
    vertices = as_points(points)
    triangles = np.asarray(faces)
    if triangles.ndim != 2 or triangles.shape[1] != 3:
        cure = "triangulate polygons first" if triangles.size else "np.zeros((0, 3), int) is none"
        raise ValueError(f"faces should have shape (F, 3), got {triangles.shape}: {cure}")
    if triangles.size and not np.issubdtype(triangles.dtype, np.integer):
        raise ValueError(f"faces should be integers, got {triangles.dtype}")
    if triangles.size:
        lowest, highest = int(triangles.min()), int(triangles.max())
        if lowest < 0 or highest >= len(vertices):
            wrong = lowest if lowest < 0 else highest
            raise ValueError(
                f"faces should index 0..{len(vertices) - 1}, got index {wrong}: "
                "check that points and faces belong together"
            )
    return vertices, np.ascontiguousarray(triangles, dtype=np.int32)


def as_points(points: ArrayLike, count: int | None = None) -> FloatArray:
    """Return points (V, 3) as float64, checked to be finite and, if given, `count` of them.

    Raises ValueError that names the first vertex that is not finite, or the shape.
    """
    vertices = np.ascontiguousarray(points, dtype=np.float64)
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise ValueError(f"points should have shape (V, 3), got {vertices.shape}")
    if count is not None and len(vertices) != count:
        raise ValueError(
            f"points should have {count} rows as the rest mesh has, got {len(vertices)}: "
            "a pose must have the topology of its rest"
        )
    finite = np.isfinite(vertices)
    if not finite.all():
        first = int(np.flatnonzero(~finite.all(axis=1))[0])
        raise ValueError(f"points should be finite, got {vertices[first]} at vertex {first}")
    return vertices


def vector_areas(points: FloatArray, faces: IntArray) -> FloatArray:
    """Return normal times area of each triangle (F, 3), squared length units."""
    a, b, c = (points.take(corner, axis=0) for corner in faces.T)
    return 0.5 * cross(b - a, c - a)


def triangle_areas(points: FloatArray, faces: IntArray) -> FloatArray:
    """Return the area of each triangle (F,), squared length units."""
    return lengths(vector_areas(points, faces))


def triangle_normals(points: FloatArray, faces: IntArray) -> FloatArray:
    """Return the unit normal of each triangle (F, 3); it is zero where the area is zero."""
    vectors = vector_areas(points, faces)
    length = lengths(vectors)[:, None]
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def triangle_frames(corners: FloatArray) -> FloatArray:
    """Return axes (N, 3, 3), as columns, that turn with triangles of corners (N, 3, 3).

    They lie along the first edge, across it in the plane, and along the normal; of a triangle
    without area the last two are 0.
    """
    along, other = (unit_vectors(corners[:, k] - corners[:, 0]) for k in (1, 2))
    normal = cross(along, other)
    # The normal of three points on a line is rounding.
    normal = unit_vectors(np.where(lengths(normal)[:, None] > 1e-7, normal, 0.0))
    return np.stack([along, cross(normal, along), normal], axis=2)


def vertex_areas(points: FloatArray, faces: IntArray) -> FloatArray:
    """Return a third of the incident triangle areas of each vertex (V,), squared length units."""
    thirds = np.repeat(triangle_areas(points, faces) / 3.0, 3)
    return np.bincount(faces.ravel(), thirds, len(points)).astype(np.float64)


def unique_edges(faces: IntArray) -> IntArray:
    """Return the edges (E, 2) of faces (F, 3), each once, i < j, sorted."""
    low, high = _sides_of(faces)
    # Sorting and comparing neighbours is several times faster than numpy's unique on large meshes.
    keys = np.sort((low << 32 | high)[low < high])
    keys = keys[np.concatenate([keys[:1] == keys[:1], keys[1:] != keys[:-1]])]
    return np.stack([keys >> 32, keys & 0xFFFFFFFF], axis=1).astype(np.int32)


def shared_edges(faces: IntArray) -> NDArray[np.int64]:
    """Return the pairs (K, 2) of triangles with a common edge.

    Three or more triangles around one edge give all their pairs.
    """
    low, high = _sides_of(faces)
    keys = low << 32 | high
    order = np.argsort(keys, kind="stable")
    keys, triangles = keys[order], order // 3
    by_step = []
    for step in range(1, len(keys)):
        same = keys[step:] == keys[:-step]
        if not same.any():
            break
        by_step.append(np.stack([triangles[:-step][same], triangles[step:][same]], axis=1))
    pairs = np.concatenate(by_step) if by_step else np.zeros((0, 2), dtype=np.int64)
    distinct: NDArray[np.int64] = pairs[pairs[:, 0] != pairs[:, 1]]
    return distinct


def _sides_of(faces: IntArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the smaller and the larger end (3F,) of the sides of faces (F, 3), face by face."""
    starts = np.asarray(faces, dtype=np.int64)
    ends = starts.take([1, 2, 0], axis=1)
    return np.minimum(starts, ends).ravel(), np.maximum(starts, ends).ravel()


def border_edges(faces: IntArray, count: int) -> NDArray[np.int64]:
    """Return which sides of triangles (F, 3) no other one has: corners (E, 2) in the flat array.

    count: of vertices. A triangle two corners of which are one vertex has no border there.
    """
    low, high = _sides_of(faces)
    first, uses = np.unique(low * count + high, return_index=True, return_counts=True)[1:]
    lone = first[(uses == 1) & (low[first] != high[first])]
    return np.stack([lone, lone - lone % 3 + (lone % 3 + 1) % 3], axis=1)


def adjacency(faces: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Return the neighbours of `count` vertices as compressed rows.

    indptr (count + 1,): where the row of each vertex starts; indices (2E,): neighbours, sorted.
    """
    low, high = unique_edges(faces).astype(np.int64).T
    keys = np.sort(np.concatenate([low << 32 | high, high << 32 | low]))
    starts = np.searchsorted(keys, np.arange(count + 1) << 32)
    return starts.astype(np.int32), (keys & 0xFFFFFFFF).astype(np.int32)


def components(faces: IntArray, count: int) -> IntArray:
    """Return the label (count,) of the connected component of each vertex.

    A vertex that no face uses is a component of its own.
    """
    # Two sides of each triangle connect its corners.
    ends = faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    graph = sparse.coo_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), (count, count))
    labels: IntArray = csgraph.connected_components(graph, directed=False)[1].astype(np.int32)
    return labels


def closed_parts(faces: IntArray, part: NDArray[np.integer], count: int) -> NDArray[np.bool_]:
    """Return which parts (count,) are closed: edges have as many triangles one way as the other.

    part: the part (F,) of each triangle.
    """
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    low, high = ends.min(axis=1), ends.max(axis=1)
    _, edge = np.unique(low << 32 | high, return_inverse=True)
    balance = np.bincount(edge, np.where(ends[:, 0] < ends[:, 1], 1, -1))
    closed = np.ones(count, dtype=bool)
    closed[np.tile(part, 3)[(balance != 0)[edge] & (low != high)]] = False
    return closed


def weld_map(points: ArrayLike) -> IntArray:
    """Return for each vertex (V,) the smallest index of a vertex at the same float32 position.

    -0.0 and 0.0 are one position. Vertices duplicated along texture seams weld into one.
    """
    return weld_maps([np.asarray(points)])


def weld_maps(meshes: Sequence[ArrayLike]) -> IntArray:
    """Return `weld_map` of meshes (V, 3) in a row as indices (sum of V,) into all their vertices.

    Vertices of different meshes never weld. Many small meshes cost as one.
    """
    points = [np.asarray(mesh, dtype=np.float32).reshape(-1, 3) for mesh in meshes]
    positions = np.concatenate(points) + np.float32(0.0)
    if _surely_distinct(positions, [len(own) for own in points]):
        return np.arange(len(positions), dtype=np.int32)
    order = np.lexsort((positions[:, 2], positions[:, 1], positions[:, 0]))
    if len(points) > 1:
        # Short numbers are sorted in linear time; stable, so that positions stay sorted.
        kind = np.uint16 if len(points) < 2**16 else np.int64
        mesh = np.repeat(np.arange(len(points), dtype=kind), [len(own) for own in points])
        order = order[np.argsort(mesh[order], kind="stable")]
    ordered = positions[order]
    starts = np.ones(len(order), dtype=bool)
    starts[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    if len(points) > 1:
        starts[1:] |= np.diff(mesh) != 0
    # lexsort is stable, so the first of a run is its smallest index.
    first = order[starts][np.cumsum(starts) - 1] if len(order) else order
    weld = np.empty(len(order), dtype=np.int32)
    weld[order] = first
    return weld


def _surely_distinct(positions: NDArray[np.float32], counts: Sequence[int]) -> bool:
    """Return whether no two positions (V, 3) of a mesh are one, by hashes: mostly so, and quick.

    counts: of vertices of each mesh. Equal hashes prove nothing.
    """
    hashed = np.repeat(np.arange(len(counts), dtype=np.uint64), counts)
    for column in positions.view(np.uint32).T:
        hashed = (hashed ^ column) * np.uint64(0x9E3779B97F4A7C15)  # odd: no bit is lost
        hashed ^= hashed >> np.uint64(32)
    hashed.sort()
    return not (hashed[1:] == hashed[:-1]).any()


def extent(points: ArrayLike) -> float:
    """Return the longest side of the bounding box: the unit of length of the repair."""
    vertices = np.asarray(points)
    return float(_sides(vertices).max()) if vertices.size else 0.0


def extents(points: FloatArray, label: NDArray[np.integer]) -> FloatArray:
    """Return the largest coordinate range of the points (V, 3) of each label (V,), from 0 on."""
    low = np.full((int(label.max(initial=-1)) + 1, 3), np.inf)
    high = -low
    np.minimum.at(low, label, points)
    np.maximum.at(high, label, points)
    return np.asarray((high - low).max(axis=1))


def diagonal(points: ArrayLike) -> float:
    """Return the diagonal of the bounding box: the unit of the reported displacements."""
    vertices = np.asarray(points, dtype=np.float64)
    if not vertices.size:
        return 0.0
    return float(np.linalg.norm(_sides(vertices)))


def _sides(vertices: NDArray[Any]) -> NDArray[Any]:
    """Return the sides (3,) of the bounding box of vertices (V, 3)."""
    # Column by column: reductions over the first axis are ten times slower.
    return np.array([np.ptp(column) for column in vertices.T])


def lengths(vectors: FloatArray) -> FloatArray:
    """Return the length (N,) of each vector (N, 3)."""
    return np.sqrt(dots(vectors, vectors))


def unit_vectors(vectors: FloatArray) -> FloatArray:
    """Return vectors (N, 3) of length 1, zero where there is no length."""
    length = lengths(vectors)[:, None]
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def dots(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the scalar product (N,) of each vector (N, 3) of one array with that of another."""
    # Columns side by side are added three times as fast as rows are.
    products = first * second
    total = products[:, 0] + products[:, 1]
    total += products[:, 2]
    return total


def cross(first: NDArray[Any], second: NDArray[Any]) -> NDArray[Any]:
    """Return the cross product (..., 3) of vectors (..., 3), which are broadcast.

    The bits of `np.cross`, three times as fast for few vectors and seven times for many.
    """
    a, b, c = (first[..., axis] for axis in range(3))
    u, v, w = (second[..., axis] for axis in range(3))
    shape = np.broadcast_shapes(first.shape, second.shape)
    product = np.empty(shape, dtype=np.result_type(first, second))
    np.subtract(b * w, c * v, out=product[..., 0])
    np.subtract(c * u, a * w, out=product[..., 1])
    np.subtract(a * v, b * u, out=product[..., 2])
    return product


def differing(first: FloatArray, second: FloatArray) -> NDArray[np.bool_]:
    """Return whether each point (N, 3) of one array differs from that of another, (N,)."""
    unequal = first != second
    differs: NDArray[np.bool_] = unequal[:, 0] | unequal[:, 1] | unequal[:, 2]
    return differs


def as_numpy(points: Any) -> NDArray[Any]:
    """Return an array, or a tensor of any device, as an array."""
    return points.detach().cpu().numpy() if hasattr(points, "detach") else np.asarray(points)


def as_given(points: FloatArray, given: Any) -> Any:
    """Return points in the type and, for tensors, on the device of `given`."""
    if hasattr(given, "detach"):
        import torch

        return torch.as_tensor(points, dtype=given.dtype, device=given.device)
    kind = np.asarray(given).dtype
    return points.astype(kind if np.issubdtype(kind, np.floating) else np.float64)


def pair_keys(pairs: IntArray) -> NDArray[np.int64]:
    """Return one number for each pair (K, 2): first * 2^32 + second."""
    return pairs[:, 0].astype(np.int64) << 32 | pairs[:, 1].astype(np.int64)


def among(keys: NDArray[np.int64], known: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which keys (K,) are known ones: as `numpy.isin`, which takes longer for many known."""
    if not len(known):
        return np.zeros(len(keys), dtype=bool)
    ordered = np.sort(known)
    place = np.searchsorted(ordered, keys)
    return np.asarray(ordered[np.minimum(place, len(ordered) - 1)] == keys)
