"""Ties of attached parts in the operators of a surface: one part carries the other along.

A vertex tied to a triangle is joined to its three corners by edges of the barycentric weights. Such
edges stand in the Laplacian of diffusion and of the as-rigid-as-possible system; where a patch is
replaced, the offset from the triangle to the vertex is held (T'T with a row e_a - sum w e_b for
each tie). Bodies that ties connect form a cluster, which is diffused with one factor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from dtrepair.numerics.attachments import Attachments
from dtrepair.numerics.geometry import IntArray


@dataclass(frozen=True, kw_only=True)
class TieOptions:
    """How strongly ties hold.

    Args:
        weight: Weight of a tie's edges next to cotangent weights. With a weight of 1 both sides of
            a contact hang on one host so strongly that corrections spread over the whole character.
        hold: Weight of a kept offset in fills and fairing, times `weight`.
    """

    weight: float = 0.1
    hold: float = 20.0


@dataclass(frozen=True, eq=False)
class TieSystem:
    """What ties add to a surface.

    laplacian: (V, V), added to the cotangent Laplacian; links: (V, V), positive where a tie joins
    two vertices; offsets: (V, V), T'T times the weight of kept offsets.
    """

    laplacian: sparse.csr_matrix
    links: sparse.csr_matrix
    offsets: sparse.csr_matrix


def tie_system(
    attachments: Attachments,
    faces: IntArray,
    count: int,
    *,
    options: TieOptions = TieOptions(),
) -> TieSystem | None:
    """The ties of attachments on a mesh with triangles (F, 3) and `count` vertices, if any."""
    vertices, triangles, weights = attachments.every_tie
    number = len(vertices)
    if number == 0 or options.weight == 0.0:
        return None
    rows, columns = np.repeat(vertices, 3), faces[triangles].ravel()
    entries = options.weight * weights.ravel()
    half = sparse.coo_matrix((entries, (rows, columns)), shape=(count, count))
    links = (half + half.T).tocsr()
    links.eliminate_zeros()
    laplacian = (sparse.diags(np.asarray(links.sum(axis=1)).ravel()) - links).tocsr()
    each = np.arange(number)
    offset = sparse.csr_matrix(
        (
            np.concatenate([np.ones(number), -weights.ravel()]),
            (np.concatenate([each, np.repeat(each, 3)]), np.concatenate([vertices, columns])),
        ),
        shape=(number, count),
    )
    offsets = (options.hold * options.weight * (offset.T @ offset)).tocsr()
    return TieSystem(laplacian, links, offsets)
