"""A skin cut into two bodies: it is solved as one, and its seam stays closed."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair import Body, RepairOptions, SceneRepairer
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray, weld_map
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import detected, gathered
from dtrepair.repair.scene.props import with_rigid
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from tests.meshes import Mesh, armed_body, joined

# A body with an arm that curls into it.
REST, FACES = armed_body(0.0)
FIRST = REST[FACES].mean(axis=1)[:, 2] < 0.6


def cut(points: FloatArray) -> list[Mesh]:
    """The mesh as two, cut across the body where the arm comes back to it."""
    halves = []
    for own in (FACES[FIRST], FACES[~FIRST]):
        used, faces = np.unique(own, return_inverse=True)
        halves.append((points[used], faces.reshape(-1, 3).astype(np.int32)))
    return halves


def seam() -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The vertices of both halves that lie on each other in the rest."""
    one, other = (points for points, _ in cut(REST))
    first, second = np.nonzero((one[:, None] == other[None]).all(axis=2))
    return first, second


def references() -> list[Reference]:
    points = np.concatenate([points for points, _ in cut(REST)])
    halves = cut(REST)
    faces = np.concatenate([halves[0][1], halves[1][1] + len(halves[0][0])])
    weld = make_scene([Body(*half) for half in halves], RepairOptions()).rest_weld
    return [Reference(points, Detector(points, faces)(points, weld=weld))]


def bodies(**second: object) -> list[Body]:
    one, other = cut(REST)
    return [Body(*one), Body(*other, **second)]  # type: ignore[arg-type]


def test_the_seam_stays_closed() -> None:
    poses = [points for points, _ in cut(armed_body(4.0)[0])]
    repairer = SceneRepairer(bodies(), references=references())
    one, other = repairer(poses)
    assert one.before.pairs > 0 and one.after.pairs == other.after.pairs == 0
    first, second = seam()
    assert len(first) > 4
    moved = np.linalg.norm(one.points[first] - poses[0][first], axis=1)
    assert np.array_equal(one.points[first], other.points[second])
    assert moved.max() > 1e-4


@pytest.mark.parametrize("mobility", [0.0, 1.0])
def test_both_are_one_skin_and_a_collider_holds_it(mobility: float) -> None:
    scene = make_scene(bodies(mobility=mobility), RepairOptions(), references=references())
    pose = gathered(scene, [points for points, _ in cut(REST)])
    mesh = WeldedMeshes(scene)([pose.sewn])
    first, second = seam()
    both = mesh.place[first], mesh.place[second + scene.vertices_of(1).start]
    assert np.array_equal(*both)
    assert (mesh.surface.fixed[both[0]] == (mobility == 0.0)).all()
    assert mesh.surface.clusters == 1
    assert (mesh.surface.body_of == scene.body_of).all()


@pytest.mark.parametrize(
    "options", [RepairOptions(rest_contacts="repair"), RepairOptions(mode="inter")]
)
def test_what_is_not_taken_as_modelled_is_not_sewn(options: RepairOptions) -> None:
    scene = make_scene(bodies(), options, references=references())
    assert len(scene.seams.vertices) == 0


def test_rigid_bodies_are_not_sewn() -> None:
    scene = make_scene(bodies(rigid=True), RepairOptions(), references=references())
    assert len(scene.seams.vertices) == 0
    soft = make_scene(bodies(), RepairOptions(), references=references())
    assert len(soft.seams.vertices) == len(seam()[0])
    assert len(with_rigid(soft, (1,)).seams.vertices) == 0


def test_triangles_keep_their_body_where_all_corners_are_on_the_seam() -> None:
    """A cut with an ear: one triangle of the second half has no vertex of its own."""
    first = FIRST
    ends = np.isin(FACES, np.intersect1d(FACES[FIRST], FACES[~FIRST])).sum(axis=1)
    ear = np.flatnonzero(~first & (ends == 2))[0]
    first = first.copy()
    beside = np.flatnonzero(~first & (np.isin(FACES, FACES[ear]).sum(axis=1) == 2))
    first[beside] = True
    halves = []
    for own in (FACES[first], FACES[~first]):
        used, place = np.unique(own, return_inverse=True)
        halves.append((REST[used], place.reshape(-1, 3).astype(np.int32)))
    points, faces = joined(*halves)
    shown = [Reference(points, Detector(points, faces)(points))]
    scene = make_scene([Body(*half) for half in halves], RepairOptions(), references=shown)
    surface = WeldedMeshes(scene)([gathered(scene, [own for own, _ in halves]).sewn]).surface
    assert np.array_equal(surface.body_of, scene.body_of)
    assert (surface.body_of_vertex[surface.faces].max(axis=1) != surface.body_of).any()


@pytest.mark.parametrize("collider", [0, 1])
def test_a_split_is_closed_where_a_collider_is(collider: int) -> None:
    one, other = cut(armed_body(4.0)[0])
    off = other[0] + 4e-7
    own = [Body(*half, mobility=float(k != collider)) for k, half in enumerate(cut(REST))]
    scene = make_scene(own, RepairOptions(), references=references())
    pose = detected(scene, gathered(scene, [one[0], off]))
    vertices = scene.vertices_of(collider)
    assert len(pose.pairs) > 0
    assert np.array_equal(pose.centred[vertices], pose.original[vertices])
    first, second = seam()
    both = pose.centred[first], pose.centred[second + scene.vertices_of(1).start]
    assert np.array_equal(*both)


def split(points: FloatArray, off: float = 3e-7) -> Mesh:
    """The halves as one mesh, whose second one is off by a rounding error."""
    one, other = cut(points)
    return joined(one, (other[0] + off, other[1]))


def test_a_split_that_rounding_opened_is_closed_where_something_moves() -> None:
    """A split in the body next to which the arm comes through, and one that is far from it."""
    rest, faces = split(REST)
    pose = split(armed_body(4.0)[0], off=4e-7)[0]
    first, second = seam()
    second = second + len(cut(REST)[0][0])
    straight = split(REST, off=4e-7)[0] + np.array([10.0, 0.0, 0.0])
    every, both = joined((rest, faces), (straight, faces))
    result = SceneRepairer([Body(every, both)])([np.concatenate([pose, straight])])[0]
    assert result.before.pairs > 0 and result.after.pairs == 0
    assert len(Detector(every, both)(result.points, weld=weld_map(result.points))) == 0
    near = result.points[: len(rest)]
    assert np.array_equal(near[first], near[second])
    assert np.array_equal(result.points[len(rest) :], straight)


def test_a_pose_without_contacts_keeps_the_bits_of_its_splits() -> None:
    rest, faces = split(REST)
    repairer = SceneRepairer([Body(rest, faces)])
    assert np.array_equal(repairer([rest])[0].points, rest)


def test_clean_frames_ease_in_with_their_splits_closed() -> None:
    rest, faces = split(REST)
    curls = [2.4, 2.7, 3.0, 3.3, 3.6, 3.9]
    poses = [split(armed_body(curl)[0], off=4e-7)[0] for curl in curls]
    repairer = SceneRepairer([Body(rest, faces)])
    stream = repairer.animator.stream([(float(k), [own]) for k, own in enumerate(poses)], jobs=1)
    found = [frame.results[0] for frame in stream]
    clean = [result.before.pairs == 0 for result in found]
    assert clean[0] and not clean[-1]
    for result in found:
        assert len(Detector(rest, faces)(result.points, weld=weld_map(result.points))) == 0
    moved = [result.displacement_max for result in found]
    # Those that are clean as they are come after the others, and none stays out of step.
    last = clean.index(False)
    assert all(0.0 < a < b for a, b in pairwise(moved[: last + 1]))


@pytest.mark.parametrize("crosses", [False, True])
def test_a_clean_pose_stays_open_where_closing_it_would_cross(
    crosses: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    rest, faces = split(REST)
    scene = make_scene([Body(rest, faces)], RepairOptions())
    opened = gathered(scene, [split(REST, off=4e-7)[0]])
    counts = iter([0, int(crosses)])
    monkeypatch.setattr(type(scene), "pairs", lambda *_: np.zeros((next(counts), 2), dtype=int))
    pose = detected(scene, opened)
    assert len(pose.pairs) == 0
    assert np.array_equal(pose.centred, opened.centred) == crosses
