"""The null space of the transfer made explicit: where the root, the other pieces and pins go."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from dtrepair.numerics.geometry import FloatArray, IntArray, components, diagonal, triangle_areas

Pieces = Literal["seated", "separate"]


@dataclass(frozen=True)
class Match:
    """Both rests and what ties them: all that placement needs to know about a correspondence."""

    source: FloatArray  # (Vs, 3), in target axes
    source_faces: IntArray  # (Fs, 3)
    target: FloatArray  # (Vt, 3)
    target_faces: IntArray  # (Ft, 3)
    average: sparse.csr_matrix  # (Ft, Fs), rows sum to 1 where matched, to 0 elsewhere

    @property
    def matched_areas(self) -> FloatArray:
        """The rest area of each target triangle (Ft,), zero where it has no partner."""
        weights = np.asarray(self.average.sum(axis=1)).ravel() > 0
        return triangle_areas(self.target, self.target_faces) * weights


def ground_ratio(match: Match, up: FloatArray) -> float:
    """Return the height of the target over its ground divided by the source's, both at rest.

    Heights are of the matched area means along the unit vector `up`; the ground is the lowest
    vertex. For meshes that lie flat, the ratio of the diagonals.
    """
    target_mean, source_mean = _area_means(match, sparse.csr_matrix(match.matched_areas))
    target_height, source_height = (
        (mean @ points @ up).item() - ground_level(points, faces, up)
        for mean, points, faces in (
            (target_mean, match.target, match.target_faces),
            (source_mean, match.source, match.source_faces),
        )
    )
    target_size, source_size = diagonal(match.target), diagonal(match.source)
    if target_height > 1e-3 * target_size and source_height > 1e-3 * source_size:
        ratio: float = target_height / source_height
        return ratio
    return target_size / source_size if source_size > 0 else 1.0


def ground_level(points: FloatArray, faces: IntArray, up: FloatArray) -> float:
    """Return the lowest coordinate along `up` of the vertices in use."""
    return float((points @ up)[faces.ravel()].min())


class Placement:
    """Translations of the connected pieces of the target, from each pose of the source.

    The root is the piece with the largest matched area. Its matched area mean (target rest areas
    as weights on both sides, so the tessellation does not matter) moves as that of the source,
    times `ratio`. Every other piece is seated on the root: it keeps its offset from the closest
    root vertex, carried along by the deformation gradient there; where the source has a piece of
    its own for it, also the part of that piece's motion that the gradient does not explain. With
    `pieces="separate"` each piece that has partners follows its own area mean instead.
    """

    def __init__(
        self, match: Match, deformation: sparse.csr_matrix, ratio: float, pieces: Pieces
    ) -> None:
        """`deformation` is the source's operator (3Fs, Vs + Fs) of deformation gradients."""
        if pieces not in ("seated", "separate"):
            raise ValueError(f"pieces should be 'seated' or 'separate', got {pieces!r}")
        self.ratio = ratio
        self.labels = components(match.target_faces, len(match.target))
        self.count = int(self.labels.max()) + 1
        piece_of = self.labels[match.target_faces[:, 0]]
        areas = match.matched_areas
        totals = np.bincount(piece_of, areas, minlength=self.count)
        self.root = int(totals.argmax())
        follows = (totals > 0) & (pieces == "separate")
        follows[self.root] = True
        self._followers = np.flatnonzero(follows)
        by_piece = sparse.coo_matrix(
            (areas, (piece_of, np.arange(len(areas)))), (self.count, len(areas))
        ).tocsr()
        self._target_mean, self._source_mean = _area_means(match, by_piece[self._followers])
        self._target_rest = self._target_mean @ match.target
        self._source_rest = self._source_mean @ match.source
        self._seated = np.flatnonzero(~follows)
        if len(self._seated):
            self._seats = _Seats(match, deformation, ratio, self.labels, self.root, self._seated)

    def anchors(self) -> IntArray:
        """One vertex of each piece (pieces,): held at the origin while solving."""
        return np.unique(self.labels, return_index=True)[1].astype(np.int32)

    def __call__(
        self,
        points: FloatArray,
        pose: FloatArray,
        stack: FloatArray,
        held: NDArray[np.bool_] | None = None,
    ) -> FloatArray:
        """Return placed positions (Vt, 3) of a solution free in the translation of each piece.

        `pose` (Vs, 3) and its `stack` (Vs + Fs, 3) are the source's; pieces of the mask `held`
        (pieces,) stay as they come.
        """
        wanted = self._target_rest + self.ratio * (self._source_mean @ pose - self._source_rest)
        shift = np.zeros((self.count, 3))
        shift[self._followers] = wanted - self._target_mean @ points
        if held is not None:
            shift[held] = 0.0
        if len(self._seated):
            shift[self._seated] = shift[self.root] + self._seats(points, stack)
            if held is not None:
                shift[held] = 0.0
        return points + shift[self.labels]


class _Seats:
    """Where the pieces that ride on the root sit: their translation relative to the root."""

    def __init__(
        self,
        match: Match,
        deformation: sparse.csr_matrix,
        ratio: float,
        labels: IntArray,
        root: int,
        pieces: NDArray[np.int64],
    ) -> None:
        around = _vertex_weights(match)
        usable = np.asarray(around.sum(axis=1)).ravel() > 0
        body = np.flatnonzero((labels == root) & usable)
        vertices, anchors = _closest_vertices(match.target, body, labels, pieces)
        body_means = _area_means(match, around[anchors])
        own_means = _area_means(match, around[vertices])
        source_labels = components(match.source_faces, len(match.source))
        own = usable[vertices] & ~_shared_pieces(own_means[1], body_means[1], source_labels)
        self_rows = sparse.coo_matrix(
            (1.0 * ~own, (np.arange(len(vertices)), vertices)), (len(vertices), len(labels))
        )
        own_target = sparse.diags(1.0 * own) @ own_means[0] + self_rows
        # What the source's own pieces do beyond following the gradient at their seats.
        apart = ratio * (sparse.diags(1.0 * own) @ (own_means[1] - body_means[1]))
        self._seat = (body_means[0] - own_target).tocsr()
        offsets = -self._seat @ match.target - apart @ match.source
        padding = sparse.csr_matrix((len(vertices), len(match.source_faces)))
        carried = _carrying_rows(_normalized(around[anchors]) @ match.average, offsets)
        self._wanted = (sparse.hstack([apart, padding]) + carried @ deformation).tocsr()

    def __call__(self, points: FloatArray, stack: FloatArray) -> FloatArray:
        moved: FloatArray = self._wanted @ stack + self._seat @ points
        return moved


def _carrying_rows(weights: sparse.csr_matrix, offsets: FloatArray) -> sparse.csr_matrix:
    """Return rows (C, 3F) that take stacked gradients to S_c @ offsets[c].

    S_c is their weighted sum.
    """
    entries = weights.tocoo()
    axis = np.arange(3)
    return sparse.coo_matrix(
        (
            (entries.data[:, None] * offsets[entries.row]).ravel(),
            (np.repeat(entries.row, 3), (3 * entries.col[:, None] + axis).ravel()),
        ),
        shape=(len(offsets), 3 * weights.shape[1]),
    ).tocsr()


def _closest_vertices(
    target: FloatArray,
    body: NDArray[np.int64],
    labels: IntArray,
    pieces: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return for each piece its vertex closest to a vertex of `body`, and that vertex."""
    riders = np.flatnonzero(np.isin(labels, pieces))
    distances, nearest = cKDTree(target[body]).query(target[riders])
    order = np.lexsort((distances, labels[riders]))
    first = order[np.unique(labels[riders][order], return_index=True)[1]]
    return riders[first], body[nearest[first]]


def _vertex_weights(match: Match) -> sparse.csr_matrix:
    """Return matched areas of the triangles around each target vertex (Vt, Ft)."""
    corners = match.target_faces.ravel()
    triangles = np.repeat(np.arange(len(match.target_faces)), 3)
    shape = (len(match.target), len(match.target_faces))
    weights = match.matched_areas[triangles]
    rows = sparse.coo_matrix((weights, (corners, triangles)), shape).tocsr()
    rows.eliminate_zeros()
    return rows


def _shared_pieces(
    first: sparse.csr_matrix, second: sparse.csr_matrix, labels: IntArray
) -> NDArray[np.bool_]:
    """Return the mask (C,) of rows of two operators (C, Vs) that reach into one source piece."""
    pieces = sparse.coo_matrix((np.ones(len(labels)), (np.arange(len(labels)), labels))).tocsr()
    common = (first @ pieces).multiply(second @ pieces)
    return np.asarray(common.sum(axis=1)).ravel() > 0


def _area_means(
    match: Match, weights: sparse.csr_matrix
) -> tuple[sparse.csr_matrix, sparse.csr_matrix]:
    """Return weighted centroid means over target vertices (C, Vt) and their partners (C, Vs).

    `weights` (C, Ft) need not be normalised; an empty row gives empty rows.
    """
    rows = _normalized(weights)
    target = rows @ _centroid_operator(match.target_faces, len(match.target))
    source = rows @ match.average @ _centroid_operator(match.source_faces, len(match.source))
    return target.tocsr(), source.tocsr()


def _centroid_operator(faces: IntArray, count: int) -> sparse.csr_matrix:
    """Return the operator (F, count) from vertex positions to triangle centroids."""
    rows = np.repeat(np.arange(len(faces)), 3)
    weights = np.full(3 * len(faces), 1.0 / 3.0)
    return sparse.coo_matrix((weights, (rows, faces.ravel())), (len(faces), count)).tocsr()


def _normalized(weights: sparse.csr_matrix) -> sparse.csr_matrix:
    """Return the rows scaled to sum 1; empty ones stay empty."""
    totals = np.asarray(weights.sum(axis=1)).ravel()
    scale = np.divide(1.0, totals, out=np.zeros_like(totals), where=totals > 0)
    return sparse.diags(scale) @ weights
