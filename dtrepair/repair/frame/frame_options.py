"""Numbers of the work on the frames of a window, what they are given, and springs at contacts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.repair.elastic.contact_step import ContactStepOptions
from dtrepair.repair.elastic.edge_lengths import EdgeLengthOptions
from dtrepair.repair.frame.adaptive_fairing import FairingOptions
from dtrepair.repair.frame.lending import LendingOptions
from dtrepair.repair.frame.regional_push import RegionalPushOptions
from dtrepair.repair.full.cure import CureOptions
from dtrepair.repair.full.mend import MendOptions
from dtrepair.repair.full.relax import RelaxOptions
from dtrepair.repair.surface.surface import Surface

Springs = NDArray[np.int64]
Levels = NDArray[np.float32]
Alone = Callable[[Surface, FloatArray], FloatArray]


@dataclass(frozen=True, kw_only=True)
class FrameOptions:
    """Numbers of the work on the frames of a window.

    Args:
        stale: Poses that moved by less than this since their pairs were found, units of the size,
            keep them: detection is most of the work.
        fold_rings: Contacts within so many rings, next to the input's own such contacts, are folds.
        close: Contacts of triangles this close in the rest pose and in `samples` frames of the
            input, units of the size, yet clean in the input, are always close: lips, eyelids.
        samples: Frames looked at for that, evenly spread.
        spring: Weight of the springs between vertices that touch in close contacts, next to the
            squared operator's diagonal of about 40.
        fold_pushed: Level of fairing at which folds are pushed as well: it did not help alone.
        close_pushed: The same for close contacts.
        stubborn: Close contacts that were hit more often are faired as folds too.
        block: Vertices that are smoothed in time at once. It must not follow the number of workers:
            products of matrices of other shapes round otherwise.
        fade: Width of the bell as which levels of fairing fade over time, frames, however narrow
            the pushes are.
        warm: Fraction of the neighbouring frame's correction that a frame to be mended starts from.
        steady_fractions: Fractions of the way that are tried in turn where a frame is steadied.
        steadier: Fraction to which the distance to the steady place has to fall.
        folds, closes: Fairing around folds and around close contacts.
        push: The push of one frame.
        mend: The mending of one frame.
        relax: A cycle of the relaxing of one frame, roughly solved: the next one goes on from it.
        lending: What frames give each other where pushing is stuck.
        edges, cure: Edges that are crushed or drawn out, and their cure.
        borrow: A frame takes a neighbour's displacement where that is less than this part of its
            own, in the mean over the vertices; or where that leaves fewer contacts.
        alone_shares: Shares of the way from where a frame was solved alone to its place among its
            neighbours that are tried in turn.
    """

    stale: float = 2e-5
    fold_rings: int = 12
    close: float = 0.05
    samples: int = 7
    spring: float = 20.0
    fold_pushed: float = 5.5
    close_pushed: float = 7.5
    stubborn: float = 8.0
    block: int = 1024
    fade: float = 3.5
    warm: float = 0.9
    steady_fractions: tuple[float, ...] = (1.0, 0.5, 0.25)
    steadier: float = 0.95
    folds: FairingOptions = field(default_factory=lambda: FairingOptions(first=3.0, highest=8.0))
    closes: FairingOptions = field(default_factory=lambda: FairingOptions(first=4.0, highest=10.0))
    push: RegionalPushOptions = field(default_factory=RegionalPushOptions)
    mend: MendOptions = field(default_factory=MendOptions)
    relax: RelaxOptions = field(
        default_factory=lambda: RelaxOptions(
            first=1.0, longer=1.0, tries=2, solve=ContactStepOptions(rounds=1, precision=0.02)
        )
    )
    lending: LendingOptions = field(default_factory=LendingOptions)
    edges: EdgeLengthOptions = field(default_factory=EdgeLengthOptions)
    cure: CureOptions = field(default_factory=lambda: CureOptions(rounds=2))
    borrow: float = 0.8
    alone_shares: tuple[float, ...] = (0.75, 0.5, 0.25)


class Chain(NamedTuple):
    """Dirty frames next to each other, in the order they are mended, and the clean ones around."""

    frames: Sequence[int]
    lenders: Sequence[int]


def springs_between(surface: Surface, points: FloatArray, pairs: IntArray) -> Springs:
    """Return the springs between the nearest vertices of touching triangles."""
    first, second = surface.faces[pairs[:, 0]], surface.faces[pairs[:, 1]]
    distance = np.linalg.norm(points[first][:, :, None] - points[second][:, None], axis=3)
    ends = [
        (first, np.take_along_axis(second, distance.argmin(axis=2), axis=1)),
        (np.take_along_axis(first, distance.argmin(axis=1), axis=1), second),
    ]
    i = np.concatenate([a.ravel() for a, _ in ends]).astype(np.int64)
    j = np.concatenate([b.ravel() for _, b in ends]).astype(np.int64)
    keys = np.minimum(i, j) * surface.count + np.maximum(i, j)
    return np.unique(keys[i != j])


def spring_matrix(springs: Springs, count: int) -> sparse.csr_matrix:
    """Return the normalised Laplacian (count, count) of springs between vertices."""
    i, j = springs // count, springs % count
    half = sparse.coo_matrix((np.ones(len(i)), (i, j)), shape=(count, count))
    links = (half + half.T).tocsr()
    degree = np.maximum(np.asarray(links.sum(axis=1)).ravel(), 1.0)
    scale = sparse.diags(1.0 / np.sqrt(degree))
    links = (scale @ links @ scale).tocsr()
    return (sparse.diags(np.asarray(links.sum(axis=1)).ravel()) - links).tocsr()
