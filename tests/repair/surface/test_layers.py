"""Layers: what covers what at rest, and repairs that end with the right side outside."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair import Body, RepairResult, SceneRepairer, Status
from dtrepair.numerics.metrics import volume
from dtrepair.repair.full.push import PushOptions, push
from dtrepair.repair.surface.surface import BodyRange, Surface
from dtrepair.repair.surface.winding import winding_numbers
from tests.exact_reference import exact_pairs
from tests.meshes import Mesh, grid, icosphere, joined, torus, tube

Points = NDArray[np.float64]


def arm() -> Mesh:
    """A closed capsule along z, radius 0.2."""
    points, faces = icosphere(3)
    points = 0.2 * points
    points[:, 2] *= 5.0
    return points, faces


def open_sleeve(radius: float = 0.24) -> Mesh:
    return tube(24, 16, radius=radius, length=0.6)


def thick_sleeve() -> Mesh:
    """Two tubes, one inside the other, joined at their ends: a closed shell."""
    (inner, faces), (outer, _) = open_sleeve(0.22), open_sleeve(0.25)
    count, around = len(inner), 24
    ends = []
    for ring, flip in ((np.arange(around), False), (np.arange(count - around, count), True)):
        following = np.roll(ring, -1)
        quads = np.stack([ring, following, following + count, ring + count], axis=1)
        quads = quads[:, ::-1] if not flip else quads
        ends.append(np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))
    every = [faces[:, ::-1], faces + count, *ends]
    return np.concatenate([inner, outer]), np.concatenate(every).astype(np.int32)


def cape() -> Mesh:
    """An open sheet around the front half of the arm."""
    sheet, faces = grid(20, 14, 1.0)
    flat = sheet - sheet.mean(axis=0)
    axes = np.argsort(np.ptp(flat, axis=0))[1:]
    angle, height = 2.6 * flat[:, axes[0]], 0.8 * flat[:, axes[1]]
    points = np.stack([0.23 * np.cos(angle), 0.23 * np.sin(angle), height], axis=1)
    normal = np.cross(*(points[faces[0, k]] - points[faces[0, 0]] for k in (1, 2)))
    return points, faces if normal @ points[faces[0, 0]] > 0 else faces[:, ::-1].copy()


def limb(tip: float) -> Mesh:
    """The arm, and a finger of the same limb that points at it from beside, up to x = tip."""
    (points, faces), (finger, others) = arm(), icosphere(2)
    finger = finger * [0.25, 0.025, 0.025] + [tip + 0.25, 0.0, 0.0]
    return joined((points, faces), (finger, others))


COVERS = {"open": open_sleeve, "thick": thick_sleeve, "cape": cape}


def surface_of(*meshes: Mesh) -> Surface:
    points, faces = joined(*meshes)
    starts = np.cumsum([0, *(len(mesh[0]) for mesh in meshes)])
    ranges = pairwise(starts)
    return Surface(points, faces, bodies=[BodyRange(int(a), int(b), 99.0) for a, b in ranges])


def sides_of(surface: Surface, pairs: NDArray[np.signedinteger]) -> NDArray[np.float64] | None:
    return surface.covering_sides(pairs)


def beneath_and_far(surface: Surface, of_sleeve: int) -> tuple[int, int]:
    """The triangles of the arm, whose own come first, that are nearest and farthest from one."""
    middles = surface.rest[surface.faces].mean(axis=1)
    away = np.linalg.norm(middles[: len(arm()[1])] - middles[of_sleeve], axis=1)
    return int(away.argmin()), int(away.argmax())


def outside(points: Points, body: Points, faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Whether points lie outside a closed body, by solid angles (van Oosterom & Strackee 1983)."""
    corners = body[faces][None] - points[:, None, None]
    length = np.linalg.norm(corners, axis=3)
    a, b, c = (corners[:, :, k] for k in range(3))
    la, lb, lc = (length[:, :, k] for k in range(3))
    top = np.einsum("ijk,ijk->ij", a, np.cross(b, c))
    bottom = la * lb * lc + (a * b).sum(2) * lc + (b * c).sum(2) * la + (c * a).sum(2) * lb
    mask: NDArray[np.bool_] = np.abs(2.0 * np.arctan2(top, bottom).sum(axis=1)) < 2.0 * np.pi
    return mask


def test_a_sleeve_covers_its_arm_and_not_the_reverse() -> None:
    surface = surface_of(arm(), open_sleeve())
    cover = surface.cover
    count = surface.bodies[0].stop
    assert (cover[:count] == -1).all() and (cover[count:] >= 0).all()
    assert (cover[count:] < count).all()
    distance = np.linalg.norm(surface.rest[count:] - surface.rest[cover[count:]], axis=1)
    assert distance.max() * surface.size < 0.1
    of_sleeve = len(arm()[1])
    beneath, far = beneath_and_far(surface, of_sleeve)
    sides = sides_of(surface, np.array([[beneath, of_sleeve], [beneath, far]]))
    assert sides is not None and sides.tolist() == [[1.0, -1.0], [1.0, 1.0]]


def test_what_lay_elsewhere_is_beside_a_layer_not_beneath_it() -> None:
    surface = surface_of(arm(), open_sleeve())
    of_sleeve = len(arm()[1])
    _, far = beneath_and_far(surface, of_sleeve)
    sides = sides_of(surface, np.array([[far, of_sleeve]]))
    assert sides is not None and sides.tolist() == [[1.0, 1.0]]


def test_what_hung_outside_of_a_layer_is_beside_it_however_near() -> None:
    surface = surface_of(limb(0.35), open_sleeve())
    middles = surface.rest[surface.faces].mean(axis=1) * surface.size
    of_sleeve = np.flatnonzero(surface.body_of == 1)
    near = of_sleeve[np.abs(middles[of_sleeve] - [0.24, 0.0, 0.0]).sum(axis=1).argmin()]
    tip = int(np.abs(middles - [0.35, 0.0, 0.0]).sum(axis=1).argmin())
    skin = int(np.abs(middles[: len(arm()[1])] - [0.2, 0.0, 0.0]).sum(axis=1).argmin())
    sides = sides_of(surface, np.array([[tip, near], [skin, near]]))
    assert sides is not None and sides.tolist() == [[1.0, 1.0], [1.0, -1.0]]


def test_a_finger_through_a_sleeve_is_led_back_and_the_sleeve_stays() -> None:
    rest, faces = limb(0.5)
    sleeve, count = open_sleeve(), len(arm()[0])
    # The vertices of the sleeve in the finger cover the arm: they are not beneath it.
    for depth in (0.02, 0.03):
        pose = rest.copy()
        pose[count:, 0] -= 0.5 - (0.24 - depth)
        repairer = SceneRepairer([Body(rest, faces), Body(*sleeve)])
        results = repairer([pose, sleeve[0]])
        after = [(own.points, each) for own, each in zip(results, (faces, sleeve[1]), strict=True)]
        assert results[0].before.pairs > 0 and len(exact_pairs(*joined(*after))) == 0
        assert results[0].displacement_max < 0.6 * depth
        assert results[1].displacement_max < 0.1 * depth


@pytest.mark.parametrize("count", [7, 8, 12])
def test_in_a_clip_the_sleeve_gives_way_around_a_finger(count: int) -> None:
    (rest, faces), sleeve = limb(0.5), open_sleeve()
    depth = 0.05 * np.sin(np.linspace(0.0, np.pi, count))
    poses = np.repeat(rest[None], count, axis=0)
    poses[:, len(arm()[0]) :, 0] -= 0.26 + depth[:, None]
    repairer = SceneRepairer([Body(rest, faces), Body(*sleeve)])
    frames = [(float(time), [pose, sleeve[0]]) for time, pose in enumerate(poses)]
    for frame in repairer.animator.stream(frames, jobs=1):
        own, other = frame.results
        assert own.after.pairs == 0
        # The finger gives way by a sixth or a third of the depth, the sleeve by the rest.
        assert own.displacement_max < 0.45 * depth.max()
        assert other.displacement_max < depth.max()
        assert other.displacement_mean < 0.05 * depth.max()


def test_only_the_far_side_of_a_thick_sleeve_covers() -> None:
    surface = surface_of(arm(), thick_sleeve())
    cover = surface.cover[surface.bodies[1].start :]
    half = len(cover) // 2
    ring = 24  # the normals of the rims point along the arm
    assert (cover[ring : half - ring] == -1).all() and (cover[half + ring : -ring] >= 0).all()


def test_solids_side_by_side_cover_nothing() -> None:
    beside = np.array([2.05, 0.0, 0.0])
    ball, faces = icosphere(3)
    surface = surface_of((ball, faces), (ball + beside, faces))
    assert (surface.cover == -1).all()
    assert sides_of(surface, np.zeros((0, 2), dtype=np.int32)) is None
    assert (surface_of((ball, faces)).cover == -1).all()


def test_bodies_that_intersect_at_rest_cover_nothing() -> None:
    through = open_sleeve()[0] + np.array([0.09, 0.0, 0.0])
    surface = surface_of(arm(), (through, open_sleeve()[1]))
    assert (surface.cover == -1).all()


def trunk() -> Mesh:
    """A closed body that all but ends with the open sleeve."""
    points, faces = icosphere(3)
    return 0.2 * points * [1.0, 1.0, 1.6], faces


def one_mesh(*meshes: Mesh) -> SceneRepairer:
    return SceneRepairer([Body(*joined(*meshes))])


def test_parts_of_one_mesh_cover_each_other_too() -> None:
    scene = one_mesh(arm(), open_sleeve()).scene
    surface = Surface(scene.rest, scene.faces, covering=scene.covering)
    count, sleeve = len(arm()[0]), len(arm()[1])
    assert (surface.cover[:count] == -1).all()
    assert (surface.cover[count:] >= 0).all() and (surface.cover[count:] < count).all()
    beneath, far = beneath_and_far(surface, sleeve)
    pairs = np.array([[beneath, sleeve], [beneath, far], [sleeve, sleeve + 1]])
    sides = sides_of(surface, pairs)
    assert sides is not None and sides.tolist() == [[1.0, -1.0], [1.0, 1.0], [1.0, 1.0]]


def test_a_layer_over_one_thing_is_none_over_another_that_no_layer_concerns() -> None:
    (ring, of_ring), ball = torus(24, 8, 0.3, 0.03), icosphere(2, 0.1)
    meshes = [arm(), open_sleeve(), (ring, of_ring), (ball[0] + [1.0, 0.0, 0.0], ball[1])]
    scene = SceneRepairer([Body(*mesh) for mesh in meshes]).scene
    starts = [int(start) for start in scene.vertex_starts]
    bodies = [BodyRange(a, b, 99.0) for a, b in pairwise(starts)]
    surface = Surface(scene.rest, scene.faces, bodies=bodies, covering=scene.covering)
    # As if the sleeve covered the ring, which like the ball no open layer covers.
    surface.cover[starts[1] : starts[2]] = starts[2]
    first = scene.triangle_starts[1:4].tolist()
    sides = sides_of(surface, np.array([[first[0], first[1]], [first[0], first[2]]]))
    assert sides is not None and sides.tolist() == [[-1.0, 1.0], [1.0, 1.0]]


def test_what_lies_under_an_open_layer_is_not_buried_by_it() -> None:
    ball, faces = icosphere(2)
    # It goes through the sleeve, and stays clear of the trunk.
    beside = 0.1 * ball + [0.33, 0.0, 0.0], faces
    scene = one_mesh(trunk(), open_sleeve(), beside).scene
    covered = Surface(scene.rest, scene.faces, covering=scene.covering)
    unknown = Surface(scene.rest, scene.faces)
    own = slice(0, len(trunk()[0]))
    pairs = covered.contacts.pairs(covered.rest)
    assert len(pairs)
    assert (winding_numbers(unknown, unknown.rest, pairs)[own] == 1).any()
    assert (winding_numbers(covered, covered.rest, pairs)[own] == 0).all()
    # What is no layer still buries: half of the ball lies in the sleeve.
    assert winding_numbers(covered, covered.rest, pairs)[-len(ball) :].any()


def test_a_push_does_not_shrink_what_lies_under_an_open_layer() -> None:
    ball, faces = icosphere(2)
    meshes = [trunk(), open_sleeve(), (0.1 * ball + [0.7, 0.0, 0.0], faces)]
    scene, own = one_mesh(*meshes).scene, slice(0, len(trunk()[0]))
    pose = scene.rest.copy()
    pose[-len(ball) :, 0] -= 0.45
    kept = []
    for covering in (scene.covering, None):
        surface = Surface(scene.rest, scene.faces, covering=covering)
        before = pose / surface.size
        # As far as it takes: half of the ball is in the trunk.
        pushed = push(surface, before, near=20, step=0.02, options=PushOptions(part=1.0))
        assert len(pushed.pairs) == 0
        kept.append(volume(pushed.points[own], trunk()[1]) / volume(before[own], trunk()[1]))
    assert kept[0] > 0.98 and kept[1] < 0.96


def check_layers(results: list[RepairResult], meshes: list[Mesh]) -> None:
    after = [(result.points, faces) for result, (_, faces) in zip(results, meshes, strict=True)]
    assert len(exact_pairs(*joined(*after))) == 0
    assert all(result.status is Status.CLEAN for result in results)
    assert outside(results[1].points, results[0].points, meshes[0][1]).all()


@pytest.mark.parametrize("still", [None, 0, 1])
@pytest.mark.parametrize("cover", list(COVERS))
def test_the_cover_ends_outside(cover: str, still: int | None) -> None:
    meshes = [arm(), COVERS[cover]()]
    bodies = [Body(*mesh, mobility=0.0 if k == still else 1.0) for k, mesh in enumerate(meshes)]
    shift = np.array([0.09, 0.02, 0.0])
    poses = [meshes[0][0], meshes[1][0] - shift]
    results = SceneRepairer(bodies)(poses)
    assert results[0].before.inter_pairs > 50
    check_layers(results, meshes)
    if still is not None:
        assert np.array_equal(results[still].points, poses[still])


@pytest.mark.parametrize("cover", list(COVERS))
def test_the_cover_ends_outside_in_every_frame(cover: str) -> None:
    meshes = [arm(), COVERS[cover]()]
    poses = []
    for time in np.linspace(0.0, 1.0, 5):
        bent = meshes[0][0].copy()
        bent[:, 0] += 0.25 * np.sin(np.pi * time) * bent[:, 2] ** 2
        poses.append([bent, meshes[1][0] - [0.1 * np.sin(np.pi * time), 0.0, 0.2 * time]])
    scene = SceneRepairer([Body(*mesh) for mesh in meshes])
    frames = list(scene.animator.stream(list(enumerate(poses)), jobs=1))
    assert sum(frame.results[1].before.pairs > 0 for frame in frames) > 2
    for frame in frames:
        check_layers(frame.results, meshes)
