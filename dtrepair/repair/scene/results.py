"""From a solved pose to results: verified, rounded to float32, counted, one for each body."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dtrepair.diagnosis import Advice, Diagnosis, Status
from dtrepair.numerics.geometry import FloatArray, IntArray, as_given, differing, pair_keys
from dtrepair.numerics.metrics import displacements
from dtrepair.repair.result import Count, RepairResult, Solved
from dtrepair.repair.scene.bodies import Absent
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.diagnosis import (
    advice_for,
    contacts_left,
    deformation_of,
    enclosures_left,
    strains_of,
)
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.surface.topology import BoolArray


class Kept(NamedTuple):
    """The pose (V, 3) that is handed back, its pairs (K, 2), and parts inside others (K, 2)."""

    points: FloatArray
    pairs: IntArray
    enclosed: IntArray


def kept(scene: Scene, pose: OpenedPose, points: FloatArray, pairs: IntArray) -> Kept:
    """Return what was found for a pose, with its `pairs`, or the input where that is no better.

    A correction may have pressed a small part right into another one, where nothing crosses.
    """
    enclosed = pose.enclosed if points is pose.centred else scene.enclosed_parts(points, pairs)
    if 0 < pose.wrong_with(pairs, len(enclosed)) >= pose.wrong:
        return Kept(pose.centred, pose.pairs, pose.enclosed)
    return Kept(points, pairs, enclosed)


def results_of(
    scene: Scene,
    pose: OpenedPose,
    found: Kept,
    solved: Solved,
    seconds: dict[str, float],
    judged: Judged | None = None,
) -> list[RepairResult]:
    """Return the results of each body; vertices that did not move keep every bit of the input.

    judged: what was strained, or would have been.
    """
    moved = differing(found.points, pose.centred) | _closed_splits(scene, pose, found)
    rounded = found.points.astype(np.float32) + pose.centre
    repaired = np.where(moved[:, None], rounded, pose.original)
    return [
        _result(scene, index, pose, found, repaired, solved, seconds, judged)
        for index in range(len(scene.bodies))
    ]


def _closed_splits(scene: Scene, pose: OpenedPose, found: Kept) -> BoolArray:
    """Return the vertices (V,) of splits that are closed, where something moves or intersected."""
    closed = differing(pose.centred, pose.original - pose.centre)
    if not closed.any():
        return closed
    moved = differing(found.points, pose.centred)
    concerned = np.asarray(moved[scene.faces].any(axis=1))
    concerned[pose.first_pairs] = True
    beside = np.zeros(len(moved), dtype=bool)
    beside[pose.sewn[scene.faces[concerned]]] = True
    return np.asarray(closed & beside[pose.sewn])


def _result(
    scene: Scene,
    index: int,
    pose: OpenedPose,
    found: Kept,
    repaired: FloatArray,
    solved: Solved,
    seconds: dict[str, float],
    judged: Judged | None,
) -> RepairResult:
    own = scene.vertices_of(index)
    before, after = (_count(scene, pairs, index) for pairs in (pose.first_pairs, found.pairs))
    moved = displacements(pose.original[own], repaired[own])
    status = _status(before, after)
    left = _left(scene, index, found)
    if left.enclosures and status is Status.CLEAN:
        status = Status.IMPROVED if before.pairs else Status.UNCHANGED
    if status is not Status.UNCHANGED:
        deformation = deformation_of(scene, index, pose.original[own], repaired[own])
        deformations = (deformation,) if deformation else ()
        left = replace(left, too_close=solved.left, deformations=deformations)
    if judged is not None and (judged.excess or judged.lowered):
        left = _with_strains(scene, index, pose, found, judged, left)
        status = Status.STRAINED if left.strains else status
    given = pose.given[index]
    return RepairResult(
        points=given.points if isinstance(given, Absent) else as_given(repaired[own], given),
        before=before,
        after=after,
        iterations=solved.iterations,
        status=status,
        diagnosis=left,
        displacement_max=float(moved.max(initial=0.0)),
        displacement_mean=float(moved.mean()) if len(moved) else 0.0,
        stages=tuple(solved.stages),
        seconds=seconds,
    )


def _left(scene: Scene, index: int, found: Kept) -> Diagnosis:
    """Return what intersects or is enclosed, where it concerns a body."""
    concerned = (scene.body_of_part[found.enclosed] == index).any(axis=1)
    enclosures = enclosures_left(scene, found.enclosed[concerned])
    if len(found.pairs) and scene.options.rest_contacts == "leave":
        at_rest = int(np.isin(pair_keys(found.pairs), pair_keys(scene.rest_pairs)).sum())
        if at_rest == len(found.pairs):
            return Diagnosis(enclosures=enclosures, rest_pairs=at_rest)
    own = found.pairs[(scene.body_of[found.pairs] == index).any(axis=1)]
    if not len(own):
        return Diagnosis(enclosures=enclosures)
    return Diagnosis(
        contacts=contacts_left(scene, own), advice=advice_for(scene, own), enclosures=enclosures
    )


def _with_strains(
    scene: Scene, index: int, pose: OpenedPose, found: Kept, judged: Judged, left: Diagnosis
) -> Diagnosis:
    """Return what is left with what strains a body, or would do so if nothing were left."""
    strains = strains_of(scene, index, pose.original, judged.excess)
    if scene.options.at_any_cost:
        return left if found.points is pose.centred else replace(left, strains=strains)
    if not (left.contacts or left.enclosures):
        return left
    advice = {*left.advice, Advice.TAKE_AT_ANY_COST} if judged.lowered else {*left.advice}
    return replace(left, strains=strains, advice=tuple(a for a in Advice if a in advice))


def _count(scene: Scene, pairs: IntArray, index: int) -> Count:
    owner = scene.body_of[pairs]
    own = (owner == index).any(axis=1)
    triangles = np.unique(pairs)
    inter = int((own & (owner[:, 0] != owner[:, 1])).sum())
    return Count(int((scene.body_of[triangles] == index).sum()), int(own.sum()), inter)


def _status(before: Count, after: Count) -> Status:
    if after.pairs == 0:
        return Status.CLEAN
    return Status.IMPROVED if after.pairs < before.pairs else Status.UNCHANGED
