"""The full method: clean, unfolded, close to the input, the same every time."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.metrics import distortion, volume
from dtrepair.numerics.operators import Factor
from dtrepair.repair.elastic.arap import ArapSystem
from dtrepair.repair.full.biharmonic_fill import FillOptions
from dtrepair.repair.full.method import FullMethod, FullOptions
from dtrepair.repair.full.phases import PhaseOptions
from dtrepair.repair.surface.defects import find_defects
from dtrepair.repair.surface.surface import Surface
from tests.exact_reference import exact_pairs
from tests.meshes import (
    Mesh,
    armed_body,
    crossing_tubes,
    elbow,
    knot,
    overlapping_spheres,
    torus,
)
from tests.quadruped import Quadruped

POSES: dict[str, tuple[Mesh, Mesh]] = {
    "tubes": (crossing_tubes(8, 20), crossing_tubes(8, 20)),
    "spheres": (overlapping_spheres(), overlapping_spheres()),
    "knot": (knot(), knot(tube_radius=0.3)),
    "arm": (armed_body(4.2), armed_body(0.0)),
    "deep crease": (elbow(2.4), elbow(0.0)),
    "shallow crease": (elbow(1.6), elbow(0.0)),
}


def surface_and_pose(kind: str) -> tuple[Surface, FloatArray]:
    (points, faces), (rest, _) = POSES[kind]
    surface = Surface(rest, faces)
    return surface, points / surface.size


@pytest.mark.parametrize("kind", POSES)
def test_nothing_intersects_and_nothing_new_folds(kind: str) -> None:
    surface, pose = surface_and_pose(kind)
    before = find_defects(surface, pose)
    assert len(before.crossings) > 20
    kept = pose.copy()
    solved = FullMethod(surface)(pose)
    assert np.array_equal(pose, kept)
    assert len(exact_pairs(surface.written(solved.points), surface.faces)) == 0
    after = find_defects(surface, solved.points)
    assert len(after.crossings) == 0
    assert len(after.folds) <= len(before.folds)
    # The last stage tells of the pose that is handed back.
    last = solved.stages[-1]
    assert (last.crossings, last.folds) == (0, len(after.folds))
    assert last.distortion == pytest.approx(
        distortion(pose, solved.points, surface.edges), rel=1e-9
    )
    # It stays the pose it was: no vertex travels farther than the overlap asks for.
    assert last.distortion < 0.25
    assert np.linalg.norm(solved.points - pose, axis=1).max() < 0.25


@pytest.mark.parametrize("kind", ["knot", "arm", "deep crease"])
def test_closed_surfaces_keep_their_volume(kind: str) -> None:
    surface, pose = surface_and_pose(kind)
    solved = FullMethod(surface)(pose)
    assert volume(solved.points, surface.faces) == pytest.approx(
        volume(pose, surface.faces), rel=0.15
    )


@pytest.mark.parametrize(
    "phases",
    [
        PhaseOptions(),
        PhaseOptions(insist_steps=()),
        PhaseOptions(last_fill=FillOptions(rounds=0)),
    ],
)
def test_tangles_that_the_phases_leave_are_solved_by_insisting(phases: PhaseOptions) -> None:
    # Pushing them by short steps does it, and so do patches that grow.
    # Legs swung by 92 degrees, hind legs against front legs: through each other and the belly.
    animal = Quadruped(cells=9)
    rest, faces = animal.mesh()
    surface = Surface(rest, faces)
    pose = animal.posed(rest, (1.6, 1.6, -1.6, -1.6), -1.0) / surface.size
    given_up = FullMethod(surface, skip=("insist",))(pose)
    assert len(find_defects(surface, given_up.points).crossings) > 0
    solved = FullMethod(surface, options=FullOptions(phases=phases))(pose)
    assert len(exact_pairs(surface.written(solved.points), surface.faces)) == 0
    assert solved.stages[-1].name == "relax"


def test_two_runs_are_bit_identical() -> None:
    surface, pose = surface_and_pose("arm")
    method = FullMethod(surface)
    first = method(pose).points
    FullMethod(surface)(surface_and_pose("arm")[0].rest)
    assert np.array_equal(method(pose).points, first)
    assert np.array_equal(FullMethod(surface_and_pose("arm")[0])(pose).points, first)


@pytest.mark.parametrize("mesh", [torus(), knot(tube_radius=0.3), elbow(0.5)])
def test_a_clean_pose_comes_back_bit_identical(mesh: Mesh) -> None:
    surface = Surface(*mesh)
    solved = FullMethod(surface)(surface.rest)
    assert np.array_equal(solved.points, surface.rest)
    assert solved.iterations == 0


def test_tightening_brings_the_result_closer() -> None:
    surface, pose = surface_and_pose("knot")
    loose, tight = (FullMethod(surface, rounds=rounds)(pose).points for rounds in (0, 4))
    assert distortion(pose, tight, surface.edges) < 0.9 * distortion(pose, loose, surface.edges)


def test_one_factor_for_the_push_and_one_for_the_edges() -> None:
    surface, pose = surface_and_pose("knot")
    before = Factor.count
    for amount in (0.0, 0.001, 0.002):
        FullMethod(surface)(pose * (1 + amount))
    assert Factor.count == before + 2


class OtherSolver:
    """A solver that is not the project's own: LU by scipy, which rounds otherwise."""

    made = 0

    def __init__(self, matrix: sparse.spmatrix) -> None:
        type(self).made += 1
        self.size, self._lu = matrix.shape[0], splu(sparse.csc_matrix(matrix))

    def __call__(self, right_hand_side: NDArray[np.floating]) -> FloatArray:
        return np.asarray(self._lu.solve(np.ascontiguousarray(right_hand_side, dtype=float)))

    def solve(self, frames: NDArray[np.floating]) -> FloatArray:
        return np.stack([self(frame) for frame in frames])


@pytest.mark.parametrize("kind", ["knot", "deep crease"])
def test_stages_solve_with_what_their_surface_was_given(kind: str) -> None:
    (points, faces), (rest, _) = POSES[kind]
    before, made = Factor.count, OtherSolver.made
    surface = Surface(rest, faces, factor=OtherSolver)
    pose = points / surface.size
    found = FullMethod(surface)(pose).points
    # Of a small region alone, too.
    region = np.arange(surface.count) < 20
    ArapSystem(surface, surface.rest, region=region).solve(surface.rest)
    assert Factor.count == before and OtherSolver.made >= made + 2
    assert len(find_defects(surface, found).crossings) == 0
    usual = FullMethod(Surface(rest, faces))(pose).points
    assert 0.0 < np.abs(found - usual).max() < 0.1


def test_what_is_far_from_a_contact_keeps_every_bit() -> None:
    # The crease is in the middle of a long tube; both ends have nothing to do with it.
    (points, faces), (rest, _) = elbow(1.6, along=80), elbow(0.0, along=80)
    surface = Surface(rest, faces)
    pose = points / surface.size
    solved = FullMethod(surface)(pose)
    assert len(find_defects(surface, pose).crossings) > 0
    assert len(find_defects(surface, solved.points).crossings) == 0
    ends = np.r_[0 : 12 * 8, 12 * 73 : len(points)]
    assert np.array_equal(solved.points[ends], pose[ends])


def test_fixed_vertices_keep_every_bit() -> None:
    (points, faces), (rest, _) = POSES["arm"]
    fixed = np.arange(len(points)) < 12 * 12
    surface = Surface(rest, faces, mobility=np.where(fixed, 0.0, 1.0))
    pose = points / surface.size
    before = find_defects(surface, pose)
    solved = FullMethod(surface)(pose)
    assert np.array_equal(solved.points[fixed], pose[fixed])
    assert len(find_defects(surface, solved.points).crossings) < len(before.crossings)


def test_no_vertex_moves_farther_than_the_farthest() -> None:
    surface, pose = surface_and_pose("arm")
    free = np.linalg.norm(FullMethod(surface)(pose).points - pose, axis=1).max()
    limit = 0.3 * free
    solved = FullMethod(surface, farthest=limit)(pose)
    moved = np.linalg.norm(solved.points - pose, axis=1)
    assert 0 < moved.max() <= limit
    still = FullMethod(surface, farthest=0.0)(pose)
    assert np.array_equal(still.points, pose)


def test_a_crumpled_first_phase_is_followed_by_another() -> None:
    animal = Quadruped(
        cells=15.1,
        body=1.085,
        width=0.24,
        leg=0.627,
        thickness=0.094,
        neck=0.795,
        hips=(0.457, 0.168),
    )
    rest, faces = animal.mesh()
    surface = Surface(rest, faces)
    pose = animal.posed(rest, (1.47, 1.35, -1.37, 0.06), -0.28) / surface.size
    solved = FullMethod(surface)(pose)
    first, second = (stage for stage in solved.stages if stage.name == "fill")
    assert (first.crossings, second.crossings) == (0, 0)
    assert second.distortion < PhaseOptions.tightenable < first.distortion
    assert distortion(pose, solved.points, surface.edges) < second.distortion
