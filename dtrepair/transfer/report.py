"""What a transfer should be judged by: coverage, residuals, units; what to look at, and why."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.numerics.geometry import (
    FloatArray,
    as_mesh,
    diagonal,
    shared_edges,
    triangle_areas,
    triangle_normals,
)
from dtrepair.transfer.arrays import Array, to_numpy
from dtrepair.transfer.deformation import Transfer
from dtrepair.transfer.gradients import stacked, surface_gradient
from dtrepair.transfer.matching.alignment import similarity
from dtrepair.transfer.matching.correspondence import checked_pairs


@dataclass(frozen=True, kw_only=True)
class ConcernOptions:
    """From where on a figure is of concern.

    Args:
        unmatched: Fraction of the target's triangles without a partner.
        least_units: Size of the poses next to the source's rest: below it they are in other units.
        largest_units: The same above: no motion makes a body half as large again.
        flipped: Fraction of the target's triangles turned inside out in a frame: few are slivers.
        turn: Angle between the rests, degrees: bodies in different rest poses are turned by less.
        rest_error: Of the transferred rest, diagonals of the target: rounding, if all is well.
    """

    unmatched: float = 0.005
    least_units: float = 0.67
    largest_units: float = 1.5
    flipped: float = 0.01
    turn: float = 45.0
    rest_error: float = 1e-6


class Concern(StrEnum):
    """What is wrong with a transfer, or its inputs."""

    UNMATCHED = "unmatched"
    UNITS = "units"
    TURN = "turn"
    INSIDE_OUT = "inside out"
    ILL_CONDITIONED = "ill-conditioned"


# What to do about each.
REMEDIES = {
    Concern.UNMATCHED: "add markers there",
    Concern.UNITS: "are they in other units? scale one of them",
    Concern.TURN: "give the rotation between them",
    Concern.INSIDE_OUT: "check the markers and the winding of both meshes",
    Concern.ILL_CONDITIONED: "the system is ill-conditioned; use weights='area'",
}


@dataclass(frozen=True)
class Coverage:
    """How much of the target has partners on the source."""

    pairs: int
    target_triangles: int
    unmatched: int
    unmatched_area: float  # part of the target's area
    largest_hole: int  # triangles of the largest connected unmatched patch
    source_used: float  # part of the source's triangles that occur in a pair
    concerns: tuple[Concern, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each concern."""
        return self.sentences()

    def sentences(self, remedies: Mapping[Concern, str] = REMEDIES) -> tuple[str, ...]:
        """One sentence for each concern, which ends with what to do about it."""
        return tuple(
            f"{self.unmatched} of {self.target_triangles} target triangles have no partner "
            f"(largest patch: {self.largest_hole}); they follow their neighbours: "
            f"{remedies[concern]}"
            for concern in self.concerns
        )

    @property
    def unmatched_part(self) -> float:
        """The fraction of the target's triangles without a partner."""
        return self.unmatched / max(self.target_triangles, 1)


@dataclass(frozen=True)
class TransferReport:
    """Figures of a transferred animation, over the frames looked at."""

    coverage: Coverage
    residual_median: float  # of || G x - S P || over triangles and frames; no unit
    residual_p95: float
    residual_max: float
    flipped: float  # part of a frame's triangles turned against S n, in the worst frame
    unit_ratio: float  # median over frames of the median det(S)^(1/3)
    turn: float  # degrees between the two rests, from their pairs
    rest_error: float  # transfer of the rest against the target's, relative to the diagonal
    concerns: tuple[Concern, ...] = ()  # besides those of the coverage

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each concern."""
        return self.sentences()

    def sentences(self, remedies: Mapping[Concern, str] = REMEDIES) -> tuple[str, ...]:
        """One sentence for each concern, which ends with what to do about it."""
        found = {
            Concern.UNITS: f"the poses are {self.unit_ratio:.3g} times the size of the source's "
            "rest",
            Concern.TURN: f"the rests face ways {self.turn:.0f} degrees apart",
            Concern.INSIDE_OUT: f"{100 * self.flipped:.1f} % of the triangles are turned inside "
            "out in the worst frame",
            Concern.ILL_CONDITIONED: f"the source's rest comes out {self.rest_error:.1g} diagonals "
            "from the target's",
        }
        own = tuple(f"{found[concern]}: {remedies[concern]}" for concern in self.concerns)
        return self.coverage.sentences(remedies) + own


def measure_coverage(
    pairs: Array,
    source_faces: Array,
    target: Array,
    target_faces: Array,
    *,
    options: ConcernOptions = ConcernOptions(),
) -> Coverage:
    """Return how pairs (K, 2) with source faces (Fs, 3) cover a target (Vt, 3), (Ft, 3)."""
    points, faces = as_mesh(to_numpy(target), to_numpy(target_faces))
    source_count = len(to_numpy(source_faces))
    rows = checked_pairs(pairs, source_count, len(faces))
    unmatched = np.ones(len(faces), dtype=bool)
    unmatched[rows[:, 1]] = False
    areas = triangle_areas(points, faces)
    count, hole = int(unmatched.sum()), _largest_patch(faces, unmatched)
    return Coverage(
        pairs=len(rows),
        target_triangles=len(faces),
        unmatched=count,
        unmatched_area=float(areas[unmatched].sum() / max(areas.sum(), np.finfo(float).tiny)),
        largest_hole=hole,
        source_used=len(np.unique(rows[:, 0])) / max(source_count, 1),
        concerns=(Concern.UNMATCHED,) if count > options.unmatched * len(faces) else (),
    )


def examine(
    transfer: Transfer,
    poses: Array,
    result: Array,
    *,
    samples: int = 48,
    options: ConcernOptions = ConcernOptions(),
) -> TransferReport:
    """Return the figures of `result` (T, Vt, 3), the transfer of `poses` (T, Vs, 3).

    At most `samples` frames, evenly spread, are looked at. Raises ValueError when the two do not
    belong together.
    """
    frames, outcomes = to_numpy(poses), to_numpy(result)
    if frames.ndim != 3 or outcomes.shape != (len(frames), len(transfer.target), 3):
        raise ValueError(
            f"result should have shape ({len(frames)}, {len(transfer.target)}, 3) as the transfer "
            f"of poses (T, {len(transfer.source)}, 3), got {outcomes.shape} for {frames.shape}"
        )
    if not len(frames) or samples < 1:
        raise ValueError(
            f"examine needs a frame and a sample, got {len(frames)} frames, {samples} samples"
        )
    chosen = np.unique(np.linspace(0, len(frames) - 1, min(samples, len(frames))).astype(int))
    frames, outcomes = frames[chosen], outcomes[chosen].astype(np.float64)
    coverage = measure_coverage(
        transfer.pairs,
        transfer.source_faces,
        transfer.target,
        transfer.target_faces,
        options=options,
    )
    residual = residuals(transfer, frames, outcomes)
    flipped = float(flipped_parts(transfer, frames, outcomes).max(initial=0.0))
    units = float(np.median([unit_ratio(transfer, frame) for frame in frames]))
    turn = _turn_between_rests(transfer)
    middle, high = np.percentile(residual, [50, 95])
    rest_error = _rest_error(transfer)
    return TransferReport(
        coverage,
        float(middle),
        float(high),
        float(residual.max(initial=0.0)),
        flipped,
        units,
        turn,
        rest_error,
        _concerns(units, turn, flipped, rest_error, options),
    )


def residuals(transfer: Transfer, poses: Array, result: Array) -> FloatArray:
    """Return || G x - S P ||, Frobenius, of each triangle and frame (T, Ft); no pass or fail."""
    operator = surface_gradient(transfer.target, transfer.target_faces, transfer.degenerate)
    normals = triangle_normals(transfer.target, transfer.target_faces)
    values = np.zeros((len(poses), len(transfer.target_faces)))
    for index, (pose, points) in enumerate(zip(poses, result, strict=True)):
        wanted = _wanted(transfer, pose)
        along = np.einsum("tij,tj->ti", wanted, normals)
        tangential = wanted - along[:, :, None] * normals[:, None, :]
        achieved = np.swapaxes((operator @ points).reshape(-1, 3, 3), 1, 2)
        values[index] = np.linalg.norm(achieved - tangential, axis=(1, 2))
    values[:, transfer.degenerate] = 0.0
    return values


def flipped_parts(transfer: Transfer, poses: Array, result: Array) -> FloatArray:
    """Return the fraction of target triangles whose normal points against S n, per frame (T,)."""
    rest = triangle_normals(transfer.target, transfer.target_faces)
    parts = np.zeros(len(poses))
    for index, (pose, points) in enumerate(zip(poses, result, strict=True)):
        expected = np.einsum("tij,tj->ti", _wanted(transfer, pose), rest)
        normals = triangle_normals(points, transfer.target_faces)
        parts[index] = (np.einsum("tj,tj->t", normals, expected) < 0).mean()
    return parts


def unit_ratio(transfer: Transfer, pose: Array) -> float:
    """Return the median det(S)^(1/3) of the target: 1 when pose and rest share their units."""
    return float(np.median(np.cbrt(np.linalg.det(_wanted(transfer, pose)))))


def _wanted(transfer: Transfer, pose: Array) -> FloatArray:
    return transfer.gradients(stacked(transfer.turned(pose), transfer.source_faces))


def _rest_error(transfer: Transfer) -> float:
    stack = stacked(transfer.source, transfer.source_faces)
    moved = transfer.placement(transfer.solve(stack), transfer.source, stack)
    size = max(diagonal(transfer.target), np.finfo(float).tiny)
    return float(np.abs(moved - transfer.target).max() / size)


def _turn_between_rests(transfer: Transfer) -> float:
    source = transfer.source[transfer.source_faces[transfer.pairs[:, 0]]].mean(axis=1)
    target = transfer.target[transfer.target_faces[transfer.pairs[:, 1]]].mean(axis=1)
    try:
        return similarity(source, target).angle
    except ValueError:  # too few triangles, or all on a line: no rotation to speak of
        return 0.0


def _largest_patch(faces: NDArray[np.int32], mask: NDArray[np.bool_]) -> int:
    if not mask.any():
        return 0
    links = shared_edges(faces)
    links = links[mask[links].all(axis=1)]
    graph = sparse.coo_matrix((np.ones(len(links)), links.T), (len(faces), len(faces)))
    labels = csgraph.connected_components(graph, directed=False)[1]
    return int(np.bincount(labels[mask]).max())


def _concerns(
    units: float, turn: float, flipped: float, rest_error: float, options: ConcernOptions
) -> tuple[Concern, ...]:
    wrong = {
        Concern.UNITS: not options.least_units <= units <= options.largest_units,
        Concern.TURN: turn > options.turn,
        Concern.INSIDE_OUT: flipped > options.flipped,
        Concern.ILL_CONDITIONED: not rest_error < options.rest_error,
    }
    return tuple(concern for concern, holds in wrong.items() if holds)
