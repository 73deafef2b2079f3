"""Props that may be rigid: neither worn nor attached; and where they may not stay so."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from dtrepair.diagnosis import Status
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray, diagonal, lengths
from dtrepair.numerics.worn.measure import WornOptions
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.repairer import SceneRepairer
from dtrepair.repair.result import RepairResult
from dtrepair.repair.scene.bodies import Body
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.separation.free_props import with_free_props
from dtrepair.repair.surface.rigid_bodies import RigidBodies
from tests.meshes import Mesh, elbow, icosphere, joined, torus

UP = np.array([0.0, 0.0, 1.0])
ASIDE = np.array([1.0, 0.0, 0.0])


def prop(mesh: Mesh, name: str = "prop") -> Body:
    return Body(*mesh, prop=True, name=name)


def props_of(*bodies: Body, method: str = "full", attached: bool = False) -> list[str]:
    options = RepairOptions(method="paper") if method == "paper" else RepairOptions()
    points, faces = joined(*((np.asarray(b.rest), np.asarray(b.faces)) for b in bodies))
    shown = Reference(points, Detector(points, faces)(points))
    references = [shown] if attached else []
    scene = make_scene(bodies, options, references=references)
    return [own.name for own in with_free_props(scene, options=WornOptions()).bodies if own.prop]


def unbent(before: FloatArray, after: FloatArray) -> float:
    """How far a mesh is from a rigid motion, diagonals."""
    whole = RigidBodies([(0, len(before))], np.ones(len(before))).fitted(before, after)
    return float(lengths(whole - after).max()) / diagonal(before)


def test_what_lies_apart_is_a_prop_and_only_what_is_called_so() -> None:
    ball = icosphere(2, 0.2)
    apart = ball[0] + ASIDE, ball[1]
    assert props_of(Body(*elbow(0.1)), prop(apart)) == ["prop"]
    assert props_of(Body(*elbow(0.1)), prop(apart), method="paper") == []
    assert props_of(Body(*elbow(0.1)), Body(*apart)) == []


def test_what_has_no_triangles_is_none() -> None:
    points = icosphere(1, 0.1)[0]
    bare = points + elbow(0.0)[0].mean(axis=0), np.zeros((0, 3), dtype=np.int32)
    apart = icosphere(2, 0.2)[0] + ASIDE, icosphere(2)[1]
    assert props_of(Body(*elbow(0.0)), prop(bare, "bare"), prop(apart)) == ["prop"]


def test_what_goes_round_something_is_none() -> None:
    arm = elbow(0.0)
    points, faces = torus(40, 12, 0.3, 0.06)
    around = points + arm[0].mean(axis=0)
    assert props_of(Body(*arm), prop((around, faces))) == []
    assert props_of(Body(*arm), prop((around + 3.0 * ASIDE, faces))) == ["prop"]
    # A hat is open, and lies over what it is on.
    ball, triangles = icosphere(3, 1.0)
    hat = triangles[(1.1 * ball[triangles][:, :, 2] > 0.3).all(axis=1)]
    head = Body(ball, triangles)
    assert props_of(head, prop((1.1 * ball, hat))) == []
    assert props_of(head, prop((1.1 * ball + 5.0 * UP, hat))) == ["prop"]


def test_what_is_attached_to_another_body_is_none() -> None:
    ball = icosphere(2, 0.15)
    held = ball[0] + elbow(0.1)[0].max(axis=0) * [1.0, 0.0, 0.5], ball[1]
    assert props_of(Body(*elbow(0.1)), prop(held), attached=True) == []
    assert props_of(Body(*elbow(0.1)), prop(held), attached=False) == ["prop"]


def solved(
    heights: Sequence[float], *, gap: float, tall: float, together: bool
) -> list[tuple[FloatArray, RepairResult]]:
    """Poses of a ball at some heights between two blocks that do not move, and their repairs."""
    (ball, faces), (block, others) = icosphere(2, 0.5), icosphere(2, 1.0)
    block = block * [1.0, 1.0, tall]
    sides = [block + sign * (1.0 + gap / 2) * ASIDE for sign in (1.0, -1.0)]
    bodies = [Body(side, others, mobility=0.0) for side in sides]
    repairer = SceneRepairer([prop((ball + 3.0 * UP, faces)), *bodies])
    poses = [[ball + height * UP, *sides] for height in heights]
    if together:
        found = [own.results for own in repairer.animator.stream(enumerate(poses), jobs=1)]
    else:
        found = repairer.batch(poses)
    return [(pose[0], own[0]) for pose, own in zip(poses, found, strict=True)]


@pytest.mark.parametrize("together", [True, False])
def test_it_keeps_its_shape_where_that_cleans(*, together: bool) -> None:
    found = solved([0.4, 0.3, 0.3, 0.4], gap=0.9, tall=1.0, together=together)
    assert all(own.status is Status.CLEAN for _, own in found)
    assert max(unbent(pose, own.points) for pose, own in found) < 1e-6
    assert max(lengths(own.points - pose).max() for pose, own in found) > 0.01


@pytest.mark.parametrize("together", [True, False])
def test_it_bends_where_it_could_not_come_clean(*, together: bool) -> None:
    """Between the blocks there is no room, and out of them it is far."""
    found = solved([0.1, 0.05, 0.0, 0.05], gap=0.95, tall=2.0, together=together)
    assert all(own.status is Status.CLEAN for _, own in found)
    assert max(unbent(pose, own.points) for pose, own in found) > 1e-3
    assert max(lengths(own.points - pose).max() for pose, own in found) < 0.2
