"""Bodies that penetrate each other are led apart; layers, dents and held bodies are not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair import Body, RepairOptions, SceneRepairer, Status
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray, extent, unique_edges
from dtrepair.numerics.metrics import edge_log_ratio, jitter
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from dtrepair.repair.separation.penetration import BodyShape, Penetration, find_inside
from dtrepair.repair.separation.separation import SeparationOptions, separated_frames
from tests.exact_reference import exact_pairs
from tests.meshes import Mesh, icosphere, joined, torus

BALL, BALL_FACES = icosphere(2)
# A closed rod, thin and long enough to stick out at both sides of the ball.
ROD, ROD_FACES = icosphere(3)
ROD = ROD * np.array([0.12, 0.12, 1.5])
RIGHT_THROUGH = ROD + np.array([0.35, 0.1, 0.05])


def pair(rod: FloatArray, **of: list[Any]) -> list[Body]:
    meshes = [(BALL, BALL_FACES), (ROD + np.array([0.0, 0.0, 9.0]), ROD_FACES)]
    given = [{name: values[k] for name, values in of.items()} for k in (0, 1)]
    return [Body(*mesh, **own) for mesh, own in zip(meshes, given, strict=True)]


def separated(scene: Scene, *poses: list[FloatArray], **options: Any) -> FloatArray:
    """The poses (T, V, 3) that the repair of contacts would start from."""
    stacked = np.stack([np.concatenate(pose) for pose in poses])
    welds = [scene.weld(pose) for pose in stacked]
    pairs = [scene.pairs(pose, weld) for pose, weld in zip(stacked, welds, strict=True)]
    mesh = WeldedMeshes(scene)(welds)
    frames = np.arange(len(poses), dtype=np.float64)
    return separated_frames(scene, mesh, stacked, pairs, frames, **options)


def edge_change(before: FloatArray, after: FloatArray, faces: NDArray[np.int32]) -> float:
    return edge_log_ratio(before, np.asarray(after, np.float64), unique_edges(faces))


@pytest.mark.parametrize("mobility", [(1.0, 1.0), (0.0, 1.0), (1.0, 0.0)])
@pytest.mark.parametrize("diffusion", [99.0, 999.0])
def test_a_rod_right_through_a_ball_is_moved_not_stretched(
    mobility: tuple[float, float], diffusion: float
) -> None:
    bodies = pair(RIGHT_THROUGH, mobility=list(mobility), diffusion=[diffusion] * 2)
    results = SceneRepairer(bodies)([BALL, RIGHT_THROUGH])
    after = [(results[0].points, BALL_FACES), (results[1].points, ROD_FACES)]
    assert len(exact_pairs(*joined(*after))) == 0
    moved = []
    for result, points, faces, free in zip(
        results, (BALL, RIGHT_THROUGH), (BALL_FACES, ROD_FACES), mobility, strict=True
    ):
        assert result.status is Status.CLEAN
        assert edge_change(points, result.points, faces) < 0.02
        assert free or np.array_equal(result.points, points)
        moved.append(np.linalg.norm(result.points - points, axis=1).max())
    # The axis is 0.364 from the middle: the shortest way is 1 - 0.364, and the rod's radius.
    assert 0.6 < sum(moved) < 0.95
    if mobility == (1.0, 1.0):
        assert moved[0] < moved[1]  # the smaller one moves farther


KNOB = 0.2 * BALL + np.array([0.0, 0.0, 1.5])


def with_knob(attached: bool, *, mobility: float = 0.0, scale: float = 1.0) -> Scene:
    """A ball, and a rod with a knob at its end, which would come off as a coat off who wears it."""
    away = np.array([0.0, 0.0, 9.0])
    rest = [scale * own for own in (BALL, ROD + away, KNOB + away)]
    meshes = list(zip(rest, (BALL_FACES, ROD_FACES, BALL_FACES), strict=True))
    points, faces = joined(*meshes)
    shown = Reference(points, Detector(points, faces)(points))
    bodies = [Body(*meshes[0], mobility=mobility), *(Body(*mesh) for mesh in meshes[1:])]
    return make_scene(bodies, RepairOptions(), references=[shown] if attached else [])


def put_through(*shifts: float, scale: float = 1.0) -> list[list[FloatArray]]:
    """Poses of these with the rod in the ball, off its middle by some lengths."""
    ways = [np.array([shift, 0.1, 0.05]) for shift in shifts]
    return [[scale * own for own in (BALL, ROD + way, KNOB + way)] for way in ways]


def moved(scene: Scene, poses: list[list[FloatArray]], **how: Any) -> list[tuple[float, float]]:
    """How far ball and rod are led in each pose, diagonals."""
    both = zip(separated(scene, *poses, **how), poses, strict=True)
    far = [np.linalg.norm(found - np.concatenate(pose), axis=1) for found, pose in both]
    size = [scene.scale.diagonal(np.concatenate(pose)) for pose in poses]
    rod = slice(len(BALL), len(BALL) + len(ROD))
    return [
        (own[: len(BALL)].max() / d, own[rod].max() / d) for own, d in zip(far, size, strict=True)
    ]


@pytest.mark.parametrize("tangled", [frozenset(), frozenset({(0, 1)})])
@pytest.mark.parametrize("scale", [1.0, 100.0])
def test_what_is_attached_to_another_is_not_led_off_it(
    scale: float, tangled: frozenset[tuple[int, int]]
) -> None:
    poses = put_through(0.35, scale=scale)
    ((_, free),) = moved(with_knob(False, scale=scale), poses, tangled=tangled)
    ((_, held),) = moved(with_knob(True, scale=scale), poses, tangled=tangled)
    assert free > 0.15 and held <= SeparationOptions.attached


def test_what_is_attached_goes_a_little_in_all_frames_or_not_at_all() -> None:
    poses, scene = put_through(0.5, 0.35), with_knob(True)
    far = [rod for _, rod in moved(with_knob(False), poses)]
    assert min(far) > 0.1
    for factor in (0.99, 1.01):
        most = factor * max(far)
        found = [rod for _, rod in moved(scene, poses, options=SeparationOptions(attached=most))]
        assert max(found) <= most and (found == pytest.approx(far)) == (factor > 1.0)


def test_what_hangs_on_nothing_goes_all_the_way() -> None:
    ((ball, rod),) = moved(with_knob(True, mobility=1.0), put_through(0.35))
    assert ball > 0.15 and rod == 0.0


def test_the_shift_of_a_clip_is_steady_and_leaves_far_frames_alone() -> None:
    depth = np.concatenate([np.full(12, 3.0), np.linspace(3.0, 0.05, 16), np.full(6, 0.05)])
    poses = [[BALL, ROD + np.array([0.35, 0.1, height])] for height in depth]
    scene = SceneRepairer(pair(ROD, mobility=[0.0, 1.0]))
    frames = list(scene.animator.stream(list(enumerate(poses)), jobs=1))
    assert sum(frame.results[1].before.pairs > 0 for frame in frames) > 12
    assert all(result.status is Status.CLEAN for frame in frames for result in frame.results)
    before = np.stack([rod for _, rod in poses])
    after = np.stack([frame.results[1].points for frame in frames])
    changes = [edge_change(a, b, ROD_FACES) for a, b in zip(before, after, strict=True)]
    assert max(changes) < 0.02
    assert jitter(before, after) < 0.01
    assert np.array_equal(after[0], before[0])


def test_what_touches_only_a_little_is_left_to_the_contacts() -> None:
    scene = make_scene(pair(ROD), RepairOptions())
    dented = [BALL, ROD * [8.0, 8.0, 1.0] + np.array([0.0, 0.0, 2.3])]
    assert len(scene.pairs(np.concatenate(dented), scene.weld(np.concatenate(dented))))
    assert np.array_equal(separated(scene, dented)[0], np.concatenate(dented))


def test_a_ring_stays_on_its_finger() -> None:
    """It is pierced all around, and the way out is as long as the finger."""
    ring, ring_faces = torus(32, 8, 1.05, 0.04)
    finger = BALL * np.array([1.05, 1.05, 6.0])
    apart = Body(ring + np.array([9.0, 0.0, 0.0]), ring_faces)
    scene = make_scene([Body(finger, BALL_FACES), apart], RepairOptions())
    pose = [finger, ring]
    assert np.array_equal(separated(scene, pose)[0], np.concatenate(pose))


def test_a_stiff_ring_that_is_too_narrow_is_not_drawn_off() -> None:
    """Deep in its finger all around; off over the tip is far longer than that is deep."""
    ring, ring_faces = torus(32, 8, 1.0, 0.06)
    finger = BALL * np.array([1.05, 1.05, 3.0])
    apart = Body(ring + np.array([9.0, 0.0, 0.0]), ring_faces, diffusion=999.0)
    scene = make_scene([Body(finger, BALL_FACES), apart], RepairOptions())
    pose = [finger, ring]
    deep = find_inside(np.concatenate(pose), BodyShape(scene, 1), BodyShape(scene, 0)).depth
    assert deep > BodyShape(scene, 1).thickness
    assert np.array_equal(separated(scene, pose)[0], np.concatenate(pose))


def sheet(scale: float) -> Mesh:
    """Two layers over the upper part of the ball."""
    outer, inner = BALL * scale, BALL * (scale - 0.02)
    upper = BALL_FACES[(BALL[BALL_FACES][:, :, 2] > 0.3).all(axis=1)]
    return joined((outer, upper), (inner, upper[:, ::-1]))


@pytest.mark.parametrize("stiff", [False, True])
def test_a_layer_that_pushing_left_in_contact_is_not_led_off(stiff: bool) -> None:
    """It is lifted; what is stiff cannot be, and is led apart as before."""
    points, faces = sheet(1.05)
    jacket = Body(points, faces, diffusion=999.0 if stiff else 99.0)
    scene = make_scene([Body(BALL, BALL_FACES), jacket], RepairOptions())
    sunk = [BALL, points - np.array([0.0, 0.0, 0.1])]
    left = separated(scene, sunk, tangled=frozenset({(0, 1)}))[0]
    assert np.array_equal(left, np.concatenate(sunk)) != stiff


@pytest.mark.parametrize("diffusion", [99.0, 999.0])
def test_a_layer_stays_on_what_it_covers(diffusion: float) -> None:
    points, faces = sheet(1.05)
    scene = make_scene(
        [Body(BALL, BALL_FACES), Body(points, faces, diffusion=diffusion)], RepairOptions()
    )
    sunk = [BALL, points - np.array([0.0, 0.0, 0.3])]
    assert len(scene.pairs(np.concatenate(sunk), scene.weld(np.concatenate(sunk))))
    assert np.array_equal(separated(scene, sunk)[0], np.concatenate(sunk))


@pytest.mark.parametrize("held", ["pin", "direction", "limit", "paper", "ignored"])
def test_what_is_held_or_led_by_the_user_is_not_separated(held: str) -> None:
    of, options, ignore = {}, RepairOptions(), []
    if held == "pin":
        half = [np.r_[1.0, np.zeros(len(points) - 1)] for points in (BALL, ROD)]
        of["pin"] = half
    elif held == "direction":
        of["direction"] = [None, np.tile([0.0, 0.0, 1.0], (len(ROD), 1))]
    elif held == "limit":
        options = RepairOptions(maximum_displacement=0.1)
    elif held == "paper":
        options = RepairOptions(method="paper")
    else:
        ignore = [(0, 1)]
    scene = make_scene(pair(ROD, **of), options, ignore)
    pose = [BALL, RIGHT_THROUGH]
    assert np.array_equal(separated(scene, pose)[0], np.concatenate(pose))


def test_one_way_for_all_frames_of_a_contact() -> None:
    scene = make_scene(pair(ROD, mobility=[0.0, 1.0]), RepairOptions())
    poses = [[BALL, ROD + np.array([x, 0.05, 0.0])] for x in (-0.2, -0.1, 0.0, 0.1, 0.2)]
    shifts = separated(scene, *poses)[:, -1] - np.stack([pose[1][-1] for pose in poses])
    ways = shifts / np.linalg.norm(shifts, axis=1, keepdims=True)
    assert np.allclose(ways, ways[0], atol=1e-9)


def test_the_way_out_is_the_shortest_one() -> None:
    scene = make_scene(pair(ROD), RepairOptions())
    points = np.concatenate([BALL, RIGHT_THROUGH])
    rod, ball = BodyShape(scene, 1), BodyShape(scene, 0)
    inside = find_inside(points, rod, ball)
    assert inside.depth == pytest.approx(1.0 - 0.25, abs=0.1)
    assert 0.4 < inside.fraction < 0.8
    assert abs(rod.thickness - 0.12) < 0.05 < extent(BALL)
    penetration = Penetration(rod, ball, [points], [(inside, find_inside(points, ball, rod))])
    way = penetration.directions()[0]
    assert way @ [0.9615, 0.2747, 0.0] > 0.95  # away from the middle
    assert 0.6 < penetration.length(0, way) < 0.9
