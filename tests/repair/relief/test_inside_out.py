"""Bodies that intersect themselves are repaired before the clothes over them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dtrepair import Body, RepairOptions, Status
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.clip.clip_repairer import ClipRepairer
from dtrepair.repair.clip.frames import Frame
from dtrepair.repair.relief.inside_out import InsideOutOptions, inside_out
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import detected, gathered
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.sub_scene import SubScene, inner_parts
from dtrepair.repair.scene.welded_mesh import WeldedMesh, WeldedMeshes
from tests.meshes import Mesh, elbow, grid

ALONG, AROUND = 40, 12
BENDS = (1.9, 2.1, 2.3)
GRID = grid(4, 4)


def sleeve(bend: float, radius: float) -> Mesh:
    """An open tube over the upper end of a bent limb."""
    points, faces = elbow(bend, ALONG, AROUND, radius)
    first, last = 26 * AROUND, 38 * AROUND
    kept = ((faces >= first) & (faces < last)).all(axis=1)
    return points[first:last], (faces[kept] - first).astype(np.int32)


def dressed(**choices: Any) -> Scene:
    """A limb, a sleeve on it, and a loose vertex of its prim."""
    points, faces = sleeve(0.0, 0.24)
    cloth = Body(
        np.concatenate([points, [[0.0, 0.0, 5.0]]]), faces, name="sleeve", pin=np.zeros(145)
    )
    limb = elbow(0.0, ALONG, AROUND)
    named = Body(*limb, name="limb", pin=np.linspace(0.0, 0.5, len(limb[0])))
    rest = np.concatenate([np.asarray(cloth.rest), limb[0]])
    shown = Reference(rest, np.zeros((0, 2), dtype=np.int32))
    options = RepairOptions(**choices)
    return make_scene([cloth, named], options, references=[shown], layer_poses=[shown])


def pose(bend: float, radius: float) -> list[FloatArray]:
    cloth = np.concatenate([sleeve(bend, radius)[0], [[0.0, 0.0, 5.0]]])
    return [cloth, elbow(bend, ALONG, AROUND)[0]]


def opened(scene: Scene, radius: float) -> list[Frame]:
    poses = [gathered(scene, pose(bend, radius)) for bend in BENDS]
    frames = [Frame(time=float(k), **vars(own)) for k, own in enumerate(poses)]
    return [detected(scene, frame) for frame in frames]


def inner_of(scene: Scene) -> SubScene:
    inner = inner_parts(scene)
    assert inner is not None
    return inner


def in_turn(function: Callable[[Any], Any], items: list[Any]) -> list[Any]:
    return list(map(function, items))


def test_the_limb_is_a_scene_of_its_own() -> None:
    scene = dressed(diffusion=50.0)
    inner = inner_of(scene)
    limb = scene.vertices_of(1)
    assert inner.vertices.tolist() == list(range(limb.start, limb.stop))
    assert [body.name for body in inner.scene.bodies] == ["limb"]
    np.testing.assert_array_equal(inner.scene.rest, scene.rest[limb])
    np.testing.assert_array_equal(inner.scene.faces + limb.start, scene.faces[scene.body_of == 1])
    np.testing.assert_array_equal(inner.scene.mobility, scene.mobility[limb])
    np.testing.assert_array_equal(inner.scene.bodies[0].pin, scene.bodies[1].pin)
    assert inner.scene.options is scene.options
    frame = opened(scene, 0.2)[2]
    own = inner.opened(frame)
    # Its contacts are those of the whole within it, by its own numbers.
    first = int(scene.triangle_starts[1])
    expected = frame.pairs[inner.own(frame.pairs)]
    assert len(expected) > 0
    assert {*map(tuple, own.pairs + first)} == {*map(tuple, expected)}


def test_points_of_the_limb_go_back_to_their_places() -> None:
    scene = dressed()
    inner, frame = inner_of(scene), opened(scene, 0.24)[2]
    straight = inner.scene.rest + np.array([0.0, 0.0, 3.0])
    closed = inner.closed(frame, straight)
    np.testing.assert_array_equal(closed.centred[inner.vertices], straight)
    cloth = scene.vertices_of(0)
    np.testing.assert_array_equal(closed.centred[cloth], frame.centred[cloth])
    assert len(frame.pairs) > len(closed.pairs) == 0


@pytest.mark.parametrize(
    "choices", [{"method": "paper"}, {"maximum_displacement": 0.1}], ids=["paper", "limited"]
)
def test_published_and_limited_repairs_go_as_before(choices: dict[str, Any]) -> None:
    assert inner_parts(dressed(**choices)) is None


def test_nothing_is_inner_without_clothes() -> None:
    scene = make_scene([Body(*elbow(0.0)), Body(*GRID)], RepairOptions())
    assert WeldedMeshes(scene).inner is None


@pytest.mark.parametrize(("share", "first"), [(0.01, True), (1.01, False)])
def test_the_limb_comes_first_where_much_is_its_own(share: float, first: bool) -> None:
    scene = dressed()
    frames, meshes, asked = opened(scene, 0.2), WeldedMeshes(scene), list[str]()

    def solve(own: Scene, mesh: WeldedMesh, given: list[Frame]) -> list[FloatArray]:
        asked.extend(body.name for body in own.bodies)
        assert len(mesh.surface.faces) == len(own.faces)
        return [frame.centred + 1.0 for frame in given]

    options = InsideOutOptions(share=share, mobility=0.2)
    left, after = inside_out(meshes, frames, solve, in_turn, options=options)
    if not first:
        assert asked == [] and left is meshes and after is frames
        return
    assert asked == ["limb"]
    moved = np.stack([b.centred - a.centred for a, b in zip(frames, after, strict=True)])
    limb = scene.vertices_of(1)
    np.testing.assert_allclose(moved[:, limb], 1.0, atol=1e-12)
    assert (moved[:, scene.vertices_of(0)] == 0.0).all()
    # Then it gives way less, and all else is as it was.
    assert left.scene.options == replace(scene.options, inner_mobility=0.2)
    welds = [frame.weld for frame in frames]
    own, other = meshes(welds).surface, left(welds).surface
    inside = own.body_of_vertex == 1
    np.testing.assert_allclose(other.mobility[inside], 0.2 * own.mobility[inside])
    np.testing.assert_array_equal(other.mobility[~inside], own.mobility[~inside])
    # A user who asks for still less is heeded.
    assert meshes.with_inner_mobility(1.0) is meshes


def test_limb_and_sleeve_come_clean() -> None:
    scene = dressed()
    frames = [(float(k), pose(bend, 0.19)) for k, bend in enumerate(BENDS)]
    clips = ClipRepairer(scene, WeldedMeshes(scene))
    found = [frame.results for frame in clips.stream(frames, jobs=1)]
    assert all(result.status is Status.CLEAN for results in found for result in results)
    for (_, given), results in zip(frames, found, strict=True):
        after = [np.asarray(result.points) for result in results]
        points = scene.gather(after)
        assert len(scene.enclosed_parts(points, scene.pairs(points, scene.weld(points)))) == 0
        assert np.linalg.norm(after[1] - given[1], axis=1).max() < 0.15
