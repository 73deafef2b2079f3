"""Counting intersections: of one mesh, or of several meshes in one space."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dtrepair.diagnosis import CountRecord
from dtrepair.intersect import MODES
from dtrepair.intersect.detector import Detector
from dtrepair.intersect.ignored import collapsed, counted_between
from dtrepair.numerics.attachments import Attachments
from dtrepair.numerics.geometry import weld_maps


@dataclass(frozen=True)
class SceneCount:
    """Counts of all meshes together and of each one, and the intersecting triangles.

    total: `inter_pairs` are the pairs between two meshes; they are part of `pairs`.
    each: for one mesh `triangles` are its triangles that intersect anything, `pairs` all pairs it
    takes part in, `inter_pairs` those with another mesh.
    intersecting: a mask (F,) for each mesh.
    The five numbers of a record are told apart: pairs that were modelled are in none of the first
    three, and a triangle is modelled if it is in modelled pairs only.
    met: number of pairs between meshes (i, j), i <= j, that meet; (i, i) is one with itself.
    every_pair: all pairs (K, 2) of triangles of the meshes in a row, whatever the mode.
    modelled: the pairs (M, 2) among them that were modelled.
    pairs: the pairs (P, 2) among them that count.
    """

    total: CountRecord
    each: tuple[CountRecord, ...]
    intersecting: tuple[NDArray[np.bool_], ...]
    met: dict[tuple[int, int], int] = field(default_factory=dict)
    every_pair: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, 2), np.int32))
    modelled: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, 2), np.int32))
    pairs: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, 2), np.int32))


class SceneCounter:
    """Counts the intersections of the frames of some meshes; built once, used for every frame.

    Args:
        rests: for each mesh points (V, 3) of some frame, all in one space; the hierarchy is built
            on them.
        faces: triangles (F, 3) of each mesh.
        mode: "self" counts pairs within a mesh, "inter" those between two, "both" all.
        ignored: pairs of meshes (i, j), i <= j, whose contacts do not count.
        device: "cpu" or "cuda:N".
        attachments: contacts that were modelled, by the triangles of all meshes in a row; they are
            counted apart.
    """

    def __init__(
        self,
        rests: Sequence[ArrayLike],
        faces: Sequence[NDArray[np.int32]],
        *,
        mode: str = "both",
        ignored: Sequence[tuple[int, int]] = (),
        device: str = "cpu",
        attachments: Attachments | None = None,
    ) -> None:
        if mode not in MODES:
            raise ValueError(f"mode: expected one of {', '.join(MODES)}, got {mode!r}")
        self.mode = mode
        self.ignored = tuple(ignored)
        self.attachments = attachments
        self._vertices = np.cumsum([0, *(len(np.asarray(rest)) for rest in rests)])
        self._triangles = np.cumsum([0, *(len(triangles) for triangles in faces)])
        shifted = [
            triangles + start for triangles, start in zip(faces, self._vertices, strict=False)
        ]
        self._owner = np.repeat(np.arange(len(faces)), np.diff(self._triangles))
        self._detector = Detector(
            np.concatenate([np.asarray(rest, dtype=np.float64) for rest in rests]),
            np.concatenate(shifted).astype(np.int32),
            device=device,
        )

    def __call__(self, points: Sequence[ArrayLike], *, hidden: Collection[int] = ()) -> SceneCount:
        """Count the intersections of one frame: points (V, 3) of each mesh, rounded to float32.

        Nothing of `hidden` meshes is counted. Vertices of one mesh at one float32 position count
        as one. Raises CollapsedPoseError where so many triangles lie at one place that their pairs
        cannot be kept.
        """
        together = np.concatenate([np.asarray(pose) for pose in points]).astype(np.float32)
        weld = weld_maps(points)
        self._check_places(weld)
        every = self._detector(together, weld=weld)
        if hidden:
            every = every[~np.isin(self._owner[every], list(hidden)).any(axis=1)]
        pairs, owner = every, self._owner[every]
        keep = counted_between(owner, mode=self.mode, ignored=self.ignored)
        pairs = pairs[keep]
        modelled = np.zeros((0, 2), dtype=np.int32)
        if self.attachments is not None:
            meant = self.attachments.modelled(pairs)
            pairs, modelled = pairs[~meant], pairs[meant]
        owner = self._owner[pairs]
        between = owner[:, 0] != owner[:, 1]
        hit = np.zeros(len(self._owner), dtype=bool)
        hit[pairs.reshape(-1)] = True
        intersecting = tuple(
            hit[a:b] for a, b in zip(self._triangles[:-1], self._triangles[1:], strict=True)
        )
        only_modelled = np.zeros(len(self._owner), dtype=bool)
        only_modelled[modelled.reshape(-1)] = True
        only_modelled &= ~hit
        owner_modelled = self._owner[modelled]
        each = []
        for index, mask in enumerate(intersecting):
            of_mesh = (owner == index).any(axis=1)
            own = slice(self._triangles[index], self._triangles[index + 1])
            each.append(
                CountRecord(
                    triangles=int(mask.sum()),
                    pairs=int(of_mesh.sum()),
                    inter_pairs=int((between & of_mesh).sum()),
                    modelled_triangles=int(only_modelled[own].sum()),
                    modelled_pairs=int((owner_modelled == index).any(axis=1).sum()),
                )
            )
        together, numbers = np.unique(np.sort(owner, axis=1), axis=0, return_counts=True)
        met = {(i, j): n for (i, j), n in zip(together.tolist(), numbers.tolist(), strict=True)}
        total = CountRecord(
            triangles=int(hit.sum()),
            pairs=len(pairs),
            inter_pairs=int(between.sum()),
            modelled_triangles=int(only_modelled.sum()),
            modelled_pairs=len(modelled),
        )
        return SceneCount(total, tuple(each), intersecting, met, every, modelled, pairs)

    def _check_places(self, weld: NDArray[np.int32]) -> None:
        """Raise CollapsedPoseError where triangles that became one vertex have too many pairs.

        The detector counts none of these pairs: their triangles share a vertex.
        """
        first, second, third = weld[self._detector.faces].T
        numbers = np.bincount(first[(first == second) & (second == third)]).astype(np.int64)
        triangles = len(self._owner)
        if (numbers * (numbers - 1) // 2).sum() > self._detector.limits.of(triangles)[1]:
            raise collapsed(triangles)
