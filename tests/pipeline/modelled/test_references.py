"""Which contacts of a stage were modelled: by the rest, by nearly all frames; counted apart."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel

from dtrepair.pipeline import check_stage, repair_stage
from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.modelled.references import modelled_parts
from dtrepair.pipeline.observer import Observer
from dtrepair.pipeline.selection import ObjectOptions, Selection
from dtrepair.pipeline.stages.matching import CalledPairs, Side
from dtrepair.pipeline.stages.sources import open_source
from dtrepair.repair.options import RepairOptions
from tests.jointed_arm import FRAMES, arm, arm_mesh, arm_stage
from tests.meshes import icosphere
from tests.pipeline.hosts import Listener
from tests.rigged_tube import rigged_tube


def test_an_overlap_of_the_rest_is_counted_apart(tmp_path: Path) -> None:
    path = arm_stage(tmp_path / "a.usda", np.linspace(0.0, 0.6, FRAMES))
    apart, every = (check_stage(str(path), rest_contacts=how).frames for how in ("auto", "repair"))
    assert any(frame.before and frame.before.modelled_pairs for frame in apart)
    for one, all_of_them in zip(apart, every, strict=True):
        assert one.before is not None and all_of_them.before is not None
        assert one.before.pairs + one.before.modelled_pairs == all_of_them.before.pairs
        together = one.before.triangles + one.before.modelled_triangles
        assert together == all_of_them.before.triangles
        assert all_of_them.before.modelled_pairs == 0


def test_a_strict_check_counts_every_contact_unless_told_how(tmp_path: Path) -> None:
    path = arm_stage(tmp_path / "a.usda", np.linspace(0.0, 0.6, FRAMES))
    strict = Selection(strict=True)
    counted = {
        how: [frame.before for frame in check_stage(path, rest_contacts=how).frames]
        for how in ("auto", "repair")
    }
    assert counted["auto"] != counted["repair"]
    report = check_stage(path, selection=strict)
    assert [frame.before for frame in report.frames] == counted["repair"]
    assert report.document()["settings"]["rest_contacts"] == "repair" and not report.attached
    told = check_stage(path, selection=strict, rest_contacts="auto")
    assert [frame.before for frame in told.frames] == counted["auto"]


def test_a_stage_of_nothing_but_modelled_contacts_is_clean(tmp_path: Path) -> None:
    path = arm_stage(tmp_path / "a.usda", np.zeros(3))
    report = check_stage(str(path))
    assert all(frame.status == "clean" for frame in report.frames)
    done = repair_stage(str(path), str(tmp_path / "b.usda"))
    assert all(frame.status == "clean" and not frame.displacement_max for frame in done.frames)


def test_points_at_the_default_time_tell_of_a_single_sample_too(tmp_path: Path) -> None:
    """A stage of one frame has a bind pose as well, unless the frame is that very pose."""
    posed = arm_stage(tmp_path / "a.usda", np.array([0.6]))
    assert [found.pose for found in check_stage(posed).attached.listed] == ["bind pose"]
    (frame,) = repair_stage(posed, tmp_path / "b.usda").frames
    assert frame.status == "clean" and not frame.displacement_max
    same = arm_stage(tmp_path / "c.usda", np.zeros(1))
    assert not check_stage(same).attached


def test_nearly_all_frames_tell_where_there_is_no_rest(tmp_path: Path) -> None:
    many = arm_stage(tmp_path / "a.usda", np.linspace(0.1, 0.5, FRAMES), rest=False)
    few = arm_stage(tmp_path / "b.usda", np.linspace(0.1, 0.5, 3), rest=False)
    found = modelled_parts(open_source(str(many), Selection())).attachments
    assert found is not None and found.pairs_of_parts == [(0, 1)]
    # A pose or two tell nothing: both may just be bad.
    assert modelled_parts(open_source(str(few), Selection())).attachments is None


def test_a_check_of_too_few_frames_tells_what_it_leaves_open(tmp_path: Path) -> None:
    told = (
        "different parts of /Root/Arm meet, and with no bind pose and fewer than 5 frames nothing "
        "tells whether they were modelled so: every contact is counted"
    )

    def warnings(bends: NDArray[np.float64], *, rest: bool = False, **choices: Any) -> list[str]:
        path, host = arm_stage(tmp_path / "a.usda", bends, rest=rest), Listener()
        check_stage(path, observer=host, **choices)
        return [text for text in host.warnings if text.startswith("different parts")]

    one, few = np.array([0.3]), np.linspace(0.1, 0.5, 4)
    assert [text[: len(told)] for text in warnings(one)] == [told]
    assert [text[: len(told)] for text in warnings(few)] == [told]
    # Where something tells, or the user does, there is nothing to say.
    assert not warnings(np.linspace(0.1, 0.5, 5)) and not warnings(one, rest=True)
    assert not warnings(one, attach=("/Root/Arm,/Root/Arm",))
    assert not warnings(one, ignore=("/Root/Arm,/Root/Arm",))
    assert not warnings(one, rest_contacts="repair")


def test_a_frame_that_cannot_be_used_is_left_out(tmp_path: Path) -> None:
    from usd_io import AuthoredMesh, write_animation

    poses = [arm(bend) for bend in np.linspace(0.1, 0.5, FRAMES)]
    poses[3] = np.full_like(poses[3], np.nan)
    mesh = AuthoredMesh(path="/Root/Arm", faces=arm_mesh()[1], points=poses)
    path = tmp_path / "a.usda"
    write_animation(path, mesh, times=1.0 + np.arange(FRAMES))
    report = check_stage(path)
    assert report.frames[3].status == "failed" and len(report.attached) == 1


def test_what_meets_in_some_frames_only_is_no_attachment(tmp_path: Path) -> None:
    from usd_io import AuthoredMesh, write_animation

    poses = [arm(0.3, reach=1.8 if k > 2 else 4.0) for k in range(FRAMES)]
    mesh = AuthoredMesh(path="/Root/Arm", faces=arm_mesh()[1], points=poses)
    path = tmp_path / "a.usda"
    write_animation(path, mesh, times=1.0 + np.arange(FRAMES))
    assert modelled_parts(open_source(str(path), Selection())).attachments is None


def test_what_stands_on_a_collider_is_not_attached_to_it(tmp_path: Path) -> None:
    path = tmp_path / "a.usda"
    stage = Usd.Stage.CreateNew(str(path))
    points, faces = icosphere(2)
    for name, height in (("Ball", 0.0), ("Floor", -1.9)):
        mesh = UsdGeom.Mesh.Define(stage, f"/Root/{name}")
        mesh.CreateFaceVertexCountsAttr([3] * len(faces))
        mesh.CreateFaceVertexIndicesAttr(faces.ravel().tolist())
        mesh.CreatePointsAttr(points.astype(np.float32))
        move = mesh.AddTranslateOp()
        for frame in range(6):
            move.Set((0.02 * frame if name == "Ball" else 0.0, height, 0.0), frame)
    stage.Save()
    found = modelled_parts(open_source(str(path), Selection())).attachments
    assert found is not None and found.pairs_of_parts == [(0, 1)]
    still = open_source(str(path), Selection(), collider="/Root/Floor")
    assert modelled_parts(still).attachments is None
    objects = ObjectOptions(collider="/Root/Floor")
    done = repair_stage(str(path), str(tmp_path / "b.usda"), objects=objects)
    assert not done.attached and all(frame.status == "clean" for frame in done.frames)
    assert all(frame.before and frame.before.pairs for frame in done.frames)
    # The user may say that it is.
    told = modelled_parts(still, told=CalledPairs(attached=((Side(0), Side(1)),))).attachments
    assert told is not None and told.pairs_of_parts == [(0, 1)]


def test_parts_stay_where_they_are_attached(tmp_path: Path) -> None:
    """A joint that bends: by default the parts stay together, and all told they are led apart."""
    bends = np.linspace(0.0, 0.5, FRAMES)
    path = arm_stage(tmp_path / "a.usda", bends)
    kept = repair_stage(str(path), str(tmp_path / "b.usda"))
    every = RepairOptions(rest_contacts="repair")
    apart = repair_stage(str(path), str(tmp_path / "c.usda"), options=every)
    moved = [max(frame.displacement_max for frame in run.frames) for run in (kept, apart)]
    assert moved[0] < 0.2 * moved[1]
    with pytest.raises(UsageError, match="rest-contacts"):
        check_stage(str(path), rest_contacts="leave")


@pytest.mark.parametrize("how", ["as made", "inside out", "mirrored"])
def test_a_check_takes_for_modelled_what_a_repair_does(tmp_path: Path, how: str) -> None:
    """Also where triangles face inwards or a transform turns them: zones are what lies behind."""
    from usd_io import AuthoredMesh, write_animation

    points, faces = [arm(bend) for bend in np.linspace(0.0, 0.6, 3)], arm_mesh()[1]
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0]) if how == "mirrored" else np.eye(4)
    meshes = [
        AuthoredMesh(
            path="/Root/Arm",
            faces=faces[:, ::-1] if how == "inside out" else faces,
            points=points,
            rest=arm(0.0),
            transforms=np.tile(mirror, (3, 1, 1)),
        ),
        AuthoredMesh(path="/Root/Far", faces=faces, rest=arm(0.0) + np.array((9.0, 0.0, 0.0))),
    ]
    path = tmp_path / "a.usda"
    write_animation(path, meshes, times=[1.0, 2.0, 3.0])
    counted, repaired = check_stage(path).frames, repair_stage(path, tmp_path / "b.usda").frames
    assert counted[-1].before is not None and counted[-1].before.modelled_pairs
    assert [frame.before for frame in counted] == [frame.before for frame in repaired]


def test_a_frame_between_others_tells_where_parts_meet_least(tmp_path: Path) -> None:
    bends = np.full(24, 0.5)
    bends[6] = 0.1
    many = arm_stage(tmp_path / "a.usda", bends, rest=False)
    found = modelled_parts(open_source(str(many), Selection()))
    showing = [reference for reference in found.references if len(reference.pairs)]
    assert [reference.name for reference in showing] == ["frame 7"]


def test_bind_poses_of_two_skeletons_tell_nothing_of_each_other(tmp_path: Path) -> None:
    """A rider stands in his horse where both are bound; what counts is how he sits on it."""
    names = ("First", "Second")
    path = rigged_tube(tmp_path / "a.usda", (0.0, 30.0, 0.0), every=1.0, names=names)
    stage = Usd.Stage.Open(str(path))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Root/Second"))
    mesh.GetPrim().GetAttribute("xformOp:translate").Set(
        stage.GetPrimAtPath("/Root/First").GetAttribute("xformOp:translate").Get()
        + Gf.Vec3d(0.1, 0.05, 0.0)
    )
    stage.Save()
    together = modelled_parts(open_source(str(path), Selection())).attachments
    assert together is not None and together.pairs_of_parts == [(0, 1)]
    own = [f"/Root/{name}" for name in ("Skeleton", "Animation")]
    for prim in own:
        Sdf.CopySpec(stage.GetRootLayer(), prim, stage.GetRootLayer(), f"{prim}2")
    other = stage.GetPrimAtPath(f"{own[0]}2")
    UsdSkel.BindingAPI(other).GetAnimationSourceRel().SetTargets([f"{own[1]}2"])
    translations = UsdSkel.Animation(stage.GetPrimAtPath(f"{own[1]}2")).GetTranslationsAttr()
    before = translations.Get()
    translations.Set([(9, 0, 0)] * 2)
    UsdSkel.BindingAPI(mesh).GetSkeletonRel().SetTargets([f"{own[0]}2"])
    stage.Save()
    assert modelled_parts(open_source(str(path), Selection())).attachments is None
    translations.Set(before)
    stage.Save()
    heard = Heard()
    repair_stage(path, tmp_path / "b.usda", observer=heard)
    (told,) = [text for text in heard.warnings if "were modelled so" in text]
    assert "bind poses of different skeletons" in told and "no bind pose" not in told


class Heard(Observer):
    """Keeps the warnings of a run."""

    def __init__(self) -> None:
        self.warnings: list[str] = []

    def warning(self, text: str) -> None:
        self.warnings.append(text)


def test_of_a_single_pose_is_told_that_nothing_shows_what_was_modelled(tmp_path: Path) -> None:
    """A rest that the user names does show it, whether the mesh moves or not."""
    path = arm_stage(tmp_path / "a.usda", np.array([0.3]), rest=False)
    heard = Heard()
    report = repair_stage(str(path), str(tmp_path / "b.usda"), observer=heard)
    (told,) = [text for text in heard.warnings if "nothing tells" in text]
    assert "/Root/Arm" in told and "--rest" in told and "--attach" in told
    assert not report.attached
    pose = arm_stage(tmp_path / "c.usda", np.array([0.0]))
    heard = Heard()
    report = repair_stage(str(path), str(tmp_path / "d.usda"), rest=str(pose), observer=heard)
    assert len(report.attached) == 1
    assert not [text for text in heard.warnings if "nothing tells" in text]
