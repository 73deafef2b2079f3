"""Joints that slide: where they meet moves along with them, and nothing else becomes modelled."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, Vt
from scipy.spatial.transform import Rotation

from dtrepair.pipeline import check_stage, repair_stage
from dtrepair.pipeline.modelled.references import modelled_references
from dtrepair.pipeline.modelled.slides import rigid_motion
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.rest import Rest
from dtrepair.pipeline.stages.sources import open_source
from tests.meshes import Mesh, icosphere, subdivided, swept
from usd_io import AuthoredMesh, write_animation

Floats = NDArray[np.float64]
Pose = Callable[[float], Floats]


CENTRES = np.linspace(0.0, 4.0, 41)[:, None] * [0.0, 0.0, 1.0]
# A thin rod along z, from 0 to 4, closed.
ROD, ROD_FACES = swept(CENTRES, np.full(41, 0.1), 12, closed=False)


def box() -> Mesh:
    """What the rod dips into: a fine box, whose upper face is at z = .5."""
    coarse = trimesh.creation.box(extents=(1.0, 1.0, 2.0))
    points, faces = np.asarray(coarse.vertices), coarse.faces.astype(np.int32)
    for _ in range(4):
        points, faces = subdivided(points, faces)
    return points + np.array([0.03, 0.02, -0.5]), faces


def piston(path: Path, pose: Pose, frames: int = 9) -> Path:
    """A stage of a rod that moves by `pose` (its points at a share of the clip) over a box."""
    other, other_faces = box()
    faces = np.concatenate([ROD_FACES, other_faces + len(ROD)])
    turn = Rotation.from_rotvec((0.0, 0.5, 0.3))
    joined = [np.concatenate([pose(t), other]) for t in np.linspace(0.0, 1.0, frames)]
    # The whole piston swings as well: only how its parts lie to each other tells.
    poses = [(turn**t).apply(p) for t, p in zip(np.linspace(0.0, 2.0, frames), joined, strict=True)]
    drawn = AuthoredMesh(path="/Root/Piston", faces=faces, points=poses, rest=joined[0])
    write_animation(path, drawn, times=1.0 + np.arange(frames))
    return path


def slid(t: float) -> Floats:
    """The rod dips in further, and spins."""
    points = ROD - (0.0, 0.0, 1.1 * t)
    return np.asarray(Rotation.from_rotvec((0.0, 0.0, 2.0 * t)).apply(points))


def test_a_rod_may_slide_in_what_holds_it(tmp_path: Path) -> None:
    path = piston(tmp_path / "a.usda", slid)
    report = check_stage(path)
    assert all(frame.before is not None and frame.before.modelled_pairs for frame in report.frames)
    done = repair_stage(path, tmp_path / "b.usda")
    assert all(frame.status == "clean" and not frame.displacement_max for frame in done.frames)


def beside(t: float) -> Floats:
    """The rod goes a straight way that is not its axis: neither side meets where it did."""
    return np.asarray(ROD - np.array([-0.4, 0.0, 1.1]) * t)


def tilted(t: float) -> Floats:
    """The rod tilts as it dips in."""
    turn = Rotation.from_rotvec((0.0, 0.5 * t, 0.0))
    return np.asarray(turn.apply(ROD) - (0.0, 0.0, 1.1 * t))


def bent(t: float) -> Floats:
    """The rod bends as it dips in."""
    points = ROD.copy()
    points[:, 0] += 0.05 * t * points[:, 2] ** 2
    return points - (0.0, 0.0, 1.1 * t)


@pytest.mark.parametrize("pose", [beside, tilted, bent])
def test_what_does_not_slide_along_its_axis_stays_a_fault(tmp_path: Path, pose: Pose) -> None:
    last = check_stage(piston(tmp_path / "a.usda", pose)).frames[-1]
    assert last.before is not None and last.before.pairs > 0


def test_the_whole_clip_tells_whichever_frames_are_repaired(tmp_path: Path) -> None:
    path = piston(tmp_path / "a.usda", slid)
    every = {frame.time: frame.before for frame in check_stage(path).frames}
    (one,) = check_stage(path, selection=Selection(frames="6")).frames
    assert one.before == every[6.0]


def test_few_frames_tell_nothing(tmp_path: Path) -> None:
    path = piston(tmp_path / "a.usda", slid, frames=4)
    source = open_source(str(path), Selection())
    found = modelled_references(source, [Rest(mesh.rest, "") for mesh in source.meshes])
    assert not any(reference.slid for reference in found)


def test_where_the_rod_is_hidden_nothing_is_told_and_nothing_lost(tmp_path: Path) -> None:
    def hidden(t: float) -> Floats:
        points = slid(t)
        size = 1e-6 if t == 0.25 else 1.0
        return np.asarray(points.mean(axis=0) + size * (points - points.mean(axis=0)))

    frames = check_stage(piston(tmp_path / "a.usda", hidden)).frames
    for frame in (*frames[:2], *frames[3:]):
        assert frame.before is not None
        assert frame.before.pairs == 0 and frame.before.modelled_pairs > 0


def test_a_frame_in_which_another_mesh_is_a_point_is_left_out(tmp_path: Path) -> None:
    path = piston(tmp_path / "a.usda", slid)
    stage = Usd.Stage.Open(str(path))
    ball, faces = icosphere(4)
    mesh = UsdGeom.Mesh.Define(stage, "/Root/Ball")
    mesh.CreateFaceVertexCountsAttr([3] * len(faces))
    mesh.CreateFaceVertexIndicesAttr(faces.ravel().tolist())
    far = ball + 20.0
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(far.astype(np.float32)))
    for time in range(1, 10):
        points = np.full_like(far, 20.0) if time == 5 else far
        mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)), float(time))
    stage.Save()
    states = [frame.status for frame in check_stage(path).frames]
    assert len(states) == 9 and states.count("clean") >= 8


def test_what_is_called_attached_slides_as_well(tmp_path: Path) -> None:
    path = piston(tmp_path / "a.usda", slid)
    asked = ("/Root/Piston,/Root/Piston",)
    frames = check_stage(path, rest_contacts="repair", attach=asked).frames
    assert all(own.before is not None and own.before.pairs == 0 for own in frames)
    assert all(own.before is not None and own.before.modelled_pairs for own in frames)


def test_a_motion_is_found_where_there_is_one() -> None:
    points = ROD
    turn = Rotation.from_rotvec((0.3, -2.0, 0.7))
    moved = np.asarray(turn.apply(points)) + np.array([1.0, 2.0, 3.0])
    motion = rigid_motion(points, moved, 1e-6)
    assert motion is not None
    np.testing.assert_allclose(motion.rotation.apply(points) + motion.shift, moved, atol=1e-9)
    np.testing.assert_allclose(motion.back(moved), points, atol=1e-9)
    assert rigid_motion(points, moved * (1.0, -1.0, 1.0), 1e-3) is None
    assert rigid_motion(points, 1.01 * moved, 1e-3) is None
    for few in (1, 2):
        assert rigid_motion(points[:few], moved[:few], 1.0) is None
    line = np.arange(3.0)[:, None] * [1.0, 2.0, 3.0]
    assert rigid_motion(line, line + 1.0, 1.0) is None
