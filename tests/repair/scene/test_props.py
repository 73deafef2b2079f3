"""What one joint carries is found where bending it strains it, and a scene with it rigid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dtrepair import Body, RepairOptions, SceneRepairer, Status
from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.clip.clip_options import ClipOptions
from dtrepair.repair.clip.clip_repairer import ClipRepairer
from dtrepair.repair.clip.frames import Frame
from dtrepair.repair.clip.window_repairer import WindowRepairer
from dtrepair.repair.independent_options import IndependentOptions
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import gathered
from dtrepair.repair.scene.props import MachineOptions, bent_bodies, props_among, with_rigid
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from dtrepair.repair.strain.bounds import Excess, StrainOptions
from dtrepair.repair.surface.rigid_bodies import RigidBodies
from tests.meshes import icosphere, swept, tube
from tests.repair.relief.test_relief import winged

TIGHT = ClipOptions(
    independent=IndependentOptions(strain=StrainOptions(factor=1.0001, edges=0, edges_share=0.0))
)

BALL, FACES = icosphere(2)
ROD = tube(12, 16, 0.1, 2.0)
BODIES = [Body(BALL, FACES, name="ball"), Body(ROD[0] + 3.0, ROD[1], name="rod", mobility=0.5)]


def turned(points: FloatArray, angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    moved: FloatArray = points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [0.2, -angle, 0.3]
    return moved.astype(np.float32).astype(np.float64)


def swung(scene: Scene, bend: float = 0.0) -> list[FloatArray]:
    """Frames in which the rod turns, and in the last one is bent."""
    frames = []
    for angle in (0.1, 0.5, 0.9):
        rod = turned(ROD[0] + 3.0, angle)
        rod[:, 0] += bend * (angle == 0.9) * rod[:, 2] ** 2
        frames.append(gathered(scene, [BALL * (1.0 + angle), rod]).centred)
    return frames


def judged(part: int, kind: StrainKind = StrainKind.VOLUME) -> Judged:
    """A pose that is strained at a part."""
    excess = Excess(kind, part, 1.0, 0.2, 0, np.zeros(1, dtype=np.int32))
    return Judged(np.zeros((0, 3)), (excess,), lowered=True)


SCENE = make_scene(BODIES, RepairOptions())


@pytest.mark.parametrize("kind", list(StrainKind))
def test_bodies_that_are_strained_in_their_shape_are_bent(kind: StrainKind) -> None:
    where = kind in (StrainKind.DRIFT, StrainKind.SLIDE, StrainKind.WORN)
    assert bent_bodies(SCENE, judged(1, kind)) == (set() if where else {1})
    assert bent_bodies(SCENE, Judged(np.zeros((0, 3)))) == set()


def test_props_are_bodies_that_move_as_wholes() -> None:
    # The ball grows in the input, a bent rod bends in it, and what is rigid needs no telling.
    assert props_among(SCENE, [0, 1], swung(SCENE)) == (1,)
    assert props_among(SCENE, [0], swung(SCENE)) == ()
    assert props_among(SCENE, [0, 1], swung(SCENE, bend=0.01)) == ()
    assert props_among(with_rigid(SCENE, [1]), [0, 1], swung(SCENE)) == ()


def test_a_scene_with_something_rigid_keeps_what_is_known_of_it() -> None:
    meter, detector = SCENE.strain_meter, SCENE.detector
    assert len(SCENE.rigid.slices) == 0
    other = with_rigid(SCENE, [1])
    assert [body.rigid for body in other.bodies] == [False, True]
    assert other.rigid.slices == (SCENE.vertices_of(1),)
    # What is rigid may come off: that is judged anew.
    assert other.strain_meter is not meter and other.detector is detector
    assert np.array_equal(other.mobility, SCENE.mobility)
    assert len(SCENE.rigid.slices) == 0 and not SCENE.bodies[1].rigid
    ways = list(WeldedMeshes(SCENE).otherwise([{0, 1}, {1}, set()], swung(SCENE)))
    assert [way.scene.rigid.slices for way in ways] == [other.rigid.slices]
    meshes = WeldedMeshes(SCENE)
    # Where something else is strained as well, or nothing that moves as a whole.
    for bent in ({0, 1}, {0}, set()):
        assert list(meshes.otherwise([bent], swung(SCENE))) == []
    # Windows that follow find the factors that the first one made.
    first, second = (list(meshes.otherwise([{1}], swung(SCENE))) for _ in range(2))
    assert len(first) == 1 and first[0] is second[0]


def test_what_is_pinned_anywhere_is_held_as_a_whole() -> None:
    pin = np.zeros(len(ROD[0]))
    pin[0] = 1.0
    scene = make_scene([BODIES[0], Body(*ROD, pin=pin)], RepairOptions())
    own = scene.vertices_of(1)
    assert scene.mobility[own].max() == 1.0
    assert (with_rigid(scene, [1]).mobility[own] == 0.0).all()


def test_a_prop_in_the_way_of_something_fixed_goes_as_a_whole() -> None:
    centre = np.linspace(-1.0, 1.0, 24)[:, None] * [1.0, 0.0, 0.0]
    rod = swept(centre, np.full(24, 0.08), 12, closed=False)
    bodies = [Body(BALL, FACES, name="ball", mobility=0.0), Body(*rod, name="rod")]
    scene = SceneRepairer(bodies, clip=TIGHT)
    poses = [[BALL, rod[0] + [0.0, 0.0, height]] for height in (1.02, 0.98, 0.94, 0.9)]
    clip = [frame.results for frame in scene.animator.stream(enumerate(poses))]
    for found in (scene.batch(poses), clip):
        for (_, moved), (_, pose) in zip(found, poses, strict=True):
            assert moved.status is Status.CLEAN and moved.before.pairs > 0
            whole = RigidBodies([(0, len(pose))], np.ones(len(pose))).fitted(pose, moved.points)
            assert np.abs(whole - moved.points).max() < 1e-4
    # Without such bounds it bends.
    (_, bent) = SceneRepairer(bodies)(poses[-1])
    whole = RigidBodies([(0, len(pose))], np.ones(len(pose))).fitted(pose, bent.points)
    assert np.abs(whole - bent.points).max() > 1e-3


@pytest.mark.parametrize(
    ("angles", "expected"),
    # Only in the last frame does the wing meet the trunk; in all.
    [((0.8, 0.85, 0.9, 0.95, 1.07), [5, 1]), ((1.06, 1.07), [2, 2])],
)
def test_strained_frames_of_attached_parts_go_another_way_alone(
    angles: tuple[float, ...], expected: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    # It bends there, and may slide.
    strain = StrainOptions(factor=1.001, edges=0, edges_share=0.0, slide=0.01)
    # Else it is a machine, which is kept rigid from the start.
    clip = replace(
        TIGHT, independent=IndependentOptions(strain=strain), machine=MachineOptions(share=2.0)
    )
    scene, poses = None, []
    for angle in angles:
        scene, frame, _ = winged(angle)
        poses.append(np.split(frame.centred, [scene.vertex_starts[1]]))
    assert scene is not None
    scene, known, asked = replace(scene, strain=strain), WindowRepairer._judged, []

    def judged(self: WindowRepairer, way: WeldedMeshes, frames: list[Frame]) -> list[Judged]:
        asked.append(len(frames))
        return known(self, way, frames)

    monkeypatch.setattr(WindowRepairer, "_judged", judged)
    clips = ClipRepairer(scene, WeldedMeshes(scene), options=clip)
    results = [frame.results for frame in clips.stream(enumerate(poses), jobs=1)]
    assert asked == expected
    assert all(own.status is Status.CLEAN for found in results for own in found)
    assert results[-1][1].before.pairs > 0
    wing = RigidBodies([(0, len(poses[-1][1]))], np.ones(len(poses[-1][1])))
    whole = wing.fitted(poses[-1][1], results[-1][1].points)
    assert np.abs(whole - results[-1][1].points).max() < 1e-4


def test_ways_of_a_pose_are_compared_by_what_is_left_of_all_bodies() -> None:
    centre = np.linspace(-1.0, 1.0, 24)[:, None] * [1.0, 0.0, 0.0]
    rod = swept(centre, np.full(24, 0.08), 12, closed=False)
    first = Body(BALL + np.array([0.0, 2.3, 0.0]), FACES, name="concerned by nothing")
    bodies = [first, Body(BALL, FACES, name="ball", mobility=0.0), Body(*rod, name="rod")]
    found = SceneRepairer(bodies, clip=TIGHT)([first.rest, BALL, rod[0] + [0.0, 0.0, 0.9]])
    assert found[2].before.pairs > 0 and {own.status for own in found} == {Status.CLEAN}
