"""Parts that only pass each other in the bind pose, and parts that are called detached."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from dtrepair.pipeline import check_stage, repair_keyposes, repair_stage
from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.modelled.meetings import MeetingOptions, meetings
from dtrepair.pipeline.modelled.meshes import PASSING
from dtrepair.pipeline.observer import PassingFound
from dtrepair.pipeline.repair.settings import RepairSettings
from dtrepair.pipeline.selection import ObjectOptions, ObjectSettings, PrimTable
from dtrepair.repair.options import RepairOptions
from dtrepair.report.joining import join_reports
from tests.command_line import run
from tests.jointed_arm import FRAMES, arm_stage
from tests.meshes import joined, tube
from tests.pipeline.hosts import Listener
from usd_io import AuthoredMesh, write_animation

Points = NDArray[np.float64]
BODY = tube(24, 12, 0.3, 3.0)
(ALONG,) = np.flatnonzero(np.ptp(BODY[0], axis=0) > 2.0)
# A strand across the body, and a stud that sits in it.
STRAND = (np.roll(BODY[0] * 0.6, 1, axis=1) + 0.2, BODY[1])
ACROSS = np.eye(3)[(ALONG + 2) % 3]
STUD = (0.2 * BODY[0] + 0.25 * ACROSS - np.eye(3)[ALONG], BODY[1])
BOTH, TWO = "/Root/Hero,/Root/Hero", "/Root/Body,/Root/Hair"
# The strand is at its place in one of ten frames.
AWAY = np.where(np.arange(10) > 0, 2.0, 0.0)[:, None, None] * ACROSS


def hero(path: Path, away: Sequence[float], *, along: float = 0.0) -> Path:
    """A body, a strand and a stud in one mesh; the strand goes so far across in each frame.

    along: how far it goes along the body in the last one.
    """
    rest, faces = joined(BODY, STRAND, STUD)
    strand = np.zeros(len(rest), dtype=bool)
    strand[len(BODY[0]) : len(BODY[0]) + len(STRAND[0])] = True
    poses = [rest + np.where(strand, shift, 0.0)[:, None] * ACROSS for shift in away]
    poses[-1][strand, ALONG] += along
    mesh = AuthoredMesh(path="/Root/Hero", faces=faces, points=poses, rest=rest)
    write_animation(path, mesh, times=1.0 + np.arange(len(away)))
    return path


def modelled(path: Path, **choices: Any) -> list[tuple[int, int]]:
    """The numbers of the parts that are attached."""
    listed = check_stage(path, **choices).attached.listed
    return sorted((own.first.number or 0, own.second.number or 0) for own in listed)


def test_what_lies_elsewhere_in_nearly_all_frames_only_passes_by(tmp_path: Path) -> None:
    host = Listener()
    path = hero(tmp_path / "a.usda", [0.0, *[2.0] * 10, 0.0], along=1.0)
    report = check_stage(path, observer=host)
    # The stud is attached, the strand is not: its contacts are faults, at rest and elsewhere.
    assert len(report.attached) == 1
    pairs = [frame.before.pairs for frame in report.frames if frame.before is not None]
    assert pairs[0] > 0 and pairs[-1] > 0 and not any(pairs[1:-1])
    (told,) = (remark for remark in host.remarks if isinstance(remark, PassingFound))
    (passing,) = told.parts
    assert {passing.first.path, passing.second.path} == {"/Root/Hero"}
    assert passing.first.number != passing.second.number
    # The report says it as well, also one of chunks, and a list of what is modelled.
    assert report.passing == join_reports([report.document()]).passing == (passing,)
    listed = run("check", path, "--modelled").out
    assert f"not modelled, passing: {passing.first} with {passing.second}" in listed
    assert not any("if one is worn over the other" in text for text in host.warnings)
    done = repair_stage(path, tmp_path / "b.usda")
    assert done.passing == repair_keyposes(path, None).passing == (passing,)
    text = run("repair", path, "-o", tmp_path / "c.usda", "--distributed", "local").err
    assert f"not taken as modelled: {passing.first.name} with {passing.second.name}" in text
    assert all(frame.status == "clean" for frame in done.frames)


def test_what_only_passes_by_is_told_where_nothing_is_attached_at_all(tmp_path: Path) -> None:
    """And meshes that pass by are not guessed to be worn one over the other."""
    path = tmp_path / "a.usda"
    write_animation(
        path,
        [
            AuthoredMesh("/Root/Body", BODY[1], [BODY[0]] * 10, rest=BODY[0]),
            AuthoredMesh("/Root/Hair", STRAND[1], STRAND[0] + AWAY, rest=STRAND[0]),
        ],
        times=np.arange(10.0),
    )
    for choices, number in (({}, 1), ({"rest_contacts": "repair"}, 0), ({"detach": (TWO,)}, 0)):
        host = Listener()
        assert not check_stage(path, observer=host, **choices).attached
        told = [remark.parts for remark in host.remarks if isinstance(remark, PassingFound)]
        assert [(own.first.path, own.second.path) for parts in told for own in parts] == (
            [("/Root/Body", "/Root/Hair")] * number
        )
    for objects in (ObjectOptions(), ObjectOptions(detach=(TWO,))):
        host = Listener()
        repair_stage(path, tmp_path / "b.usda", objects=objects, observer=host)
        assert not any("if one is worn over the other" in text for text in host.warnings)


def test_what_is_rooted_is_attached_though_most_of_it_passes_by() -> None:
    assert met(2.0) and not met(2.0, rooted=0.2) and met(2.0, rooted=0.02)
    # Half of what meets has to be near where whole meshes are asked for.
    assert met(2.0, rooted=0.2, options=MeetingOptions(share=0.9))


@pytest.mark.parametrize("count", [9, 10, 11, 20, 21, 30])
def test_the_share_of_the_frames_is_met_exactly(count: int, tmp_path: Path) -> None:
    most = (15 * count) // 100
    for stays, attached in ((most, 1), (most + 1, 2)):
        away = [*[0.0] * stays, *[2.0] * (count - stays)]
        assert len(modelled(hero(tmp_path / f"{stays}.usda", away))) == attached


def test_what_is_back_in_more_frames_is_attached(tmp_path: Path) -> None:
    assert len(modelled(hero(tmp_path / "a.usda", [0.0, 0.0, *[2.0] * 10]))) == 2
    # And what stays, and with the user's word.
    assert len(modelled(hero(tmp_path / "b.usda", [0.02] * 12))) == 2
    passing = hero(tmp_path / "c.usda", [2.0] * 12)
    assert len(modelled(passing)) == 1 and len(modelled(passing, attach=(BOTH,))) == 2
    # A pose or two do not tell.
    assert len(modelled(hero(tmp_path / "d.usda", [2.0] * 4))) == 2


def met(shift: float, *, rooted: float = 0.0, options: MeetingOptions = PASSING) -> bool:
    """Whether a strand that has moved by so much only passes its body by.

    rooted: the share of its contacts that stay.
    """
    rest, faces = joined(BODY, STRAND)
    group = np.repeat([7, 3], [len(BODY[1]), len(STRAND[1])])
    middles = rest[faces].mean(axis=1)
    one, other = np.flatnonzero(group == 7), np.flatnonzero(group == 3)
    apart = np.linalg.norm(middles[one, None] - middles[other], axis=2)
    near = np.argwhere(apart < np.sort(apart, axis=None)[100])
    pairs = np.stack([other[near[:, 1]], one[near[:, 0]]], axis=1).astype(np.int32)
    pose = rest + np.where(np.arange(len(rest)) < len(BODY[0]), 0.0, shift)[:, None] * ACROSS
    if rooted:
        # Triangles that belong to nothing else stand for the root.
        number = int(rooted * len(pairs))
        corners = np.tile([0, len(BODY[0]), 0], (2, 1)) + np.arange(2)[:, None]
        faces = np.concatenate([faces, corners[:1], corners[:1]])
        group = np.append(group, [7, 3])
        root = np.tile([len(faces) - 1, len(faces) - 2], (number, 1))
        pairs = np.concatenate([pairs[number:], root]).astype(np.int32)
    sides, passing = meetings(rest, [pose] * 12, faces, pairs, group, options=options)
    # Groups in the order of their numbers, whatever order their triangles have.
    assert sides.tolist() == [[3, 7]]
    return bool(passing[0])


@pytest.mark.parametrize("aside", ["", "arm and body", "arm and ring"])
def test_what_meets_at_a_joint_of_a_third_part_belongs_to_it(aside: str) -> None:
    """A ring round an arm, where that comes out of a body, goes elsewhere with the arm."""
    triangle, away = 0.1 * np.eye(3), np.array([2.0, 0.0, 0.0])
    places = {"body": 0.0, "root": 0.01, "arm": 0.02, "ring": 0.03, "own": 0.03, "feet": 5.0}
    if aside == "arm and ring":  # they meet elsewhere
        places |= {"arm": 0.62, "own": 0.63}
    if aside == "arm and body":
        places["root"] = 5.01
    rest = np.concatenate([triangle + place for place in places.values()])
    faces = np.arange(len(rest), dtype=np.int32).reshape(-1, 3)
    # Body and feet are one group; so are root and arm, and both triangles of the ring.
    group = np.array([7, 5, 5, 3, 3, 7])
    held = 5 if aside == "arm and body" else 0
    pairs = np.array([[3, 0], [1, held], [4, 2]], dtype=np.int32)
    goes = np.isin(list(places), ["arm", "ring", "own"]).repeat(3)[:, None]
    pose = rest + np.where(goes, away, 0.0)
    sides, passing = meetings(rest, [pose] * 12, faces, pairs, group, options=PASSING)
    assert sides.tolist() == [[3, 5], [3, 7], [5, 7]]
    assert passing.tolist() == [False, bool(aside), False]


def test_a_joint_of_small_parts_does_not_pass_by_where_it_bends() -> None:
    """It moves on by much of its size, and by little of that of the character."""
    options = MeetingOptions(least=0.5, share=0.9)
    assert met(2.0) and not met(0.1)
    assert met(1.0) and not met(1.0, options=options)


def test_what_is_called_detached_is_not_attached(tmp_path: Path) -> None:
    path = hero(tmp_path / "a.usda", [0.02] * 12)
    assert modelled(path, detach=(BOTH,)) == modelled(path, detach=(BOTH,), attach=(BOTH,)) == []
    told, every = check_stage(path, detach=(BOTH,)), check_stage(path, rest_contacts="repair")
    assert [own.before for own in told.frames] == [own.before for own in every.frames]
    host, objects = Listener(), ObjectOptions(detach=(BOTH,))
    done = repair_stage(path, tmp_path / "b.usda", objects=objects, observer=host)
    assert not done.attached and all(own.status == "clean" for own in done.frames)
    assert not any(isinstance(remark, PassingFound) for remark in host.remarks)
    recorded = RepairSettings.from_report(done.document()["settings"])
    assert recorded.objects.detach == (BOTH,)


def test_the_published_method_knows_nothing_of_it() -> None:
    paper, objects = RepairOptions(method="paper"), ObjectOptions(detach=(BOTH,))
    with pytest.raises(UsageError, match="--detach: has no effect with --method paper"):
        RepairSettings(options=paper, objects=objects)


def test_a_prim_says_what_it_is_not_attached_to(tmp_path: Path) -> None:
    path = arm_stage(tmp_path / "a.usda", np.zeros(FRAMES))
    table = PrimTable("/Root/Arm", ObjectSettings(detach=("/Root/Arm",)))
    assert len(modelled(path)) == 1 and modelled(path, tables=(table,)) == []
    stage = Usd.Stage.Open(str(path))
    prim = stage.GetPrimAtPath("/Root/Arm")
    kind = Sdf.ValueTypeNames.TokenArray
    prim.CreateAttribute("primvars:dtrepair:detach", kind).Set(["/Root/Arm"])
    stage.Save()
    report = check_stage(path)
    assert not report.attached
    assert report.document()["settings"]["objects"] == {"/Root/Arm": {"detach": ["/Root/Arm"]}}


def test_no_third_part_tells_of_what_is_detached(tmp_path: Path) -> None:
    """Two studs that hold on to the body at one place, and in a frame come into each other."""
    meshes, path = {"Body": BODY, "Left": STUD, "Right": STUD}, tmp_path / "a.usda"
    stage = Usd.Stage.CreateNew(str(path))
    for name, (points, faces) in meshes.items():
        mesh = UsdGeom.Mesh.Define(stage, f"/Root/{name}")
        mesh.CreateFaceVertexCountsAttr([3] * len(faces))
        mesh.CreateFaceVertexIndicesAttr(faces.ravel().tolist())
        side = np.eye(3)[(ALONG + 1) % 3] * {"Body": 0.0, "Left": -0.1, "Right": 0.1}[name]
        attribute = mesh.CreatePointsAttr((points + side).astype(np.float32))
        for time, share in enumerate((1.0, *[0.5] * FRAMES)):
            attribute.Set((points + share * side).astype(np.float32), time)
    stage.Save()
    both = "/Root/Left,/Root/Right"
    counts = [check_stage(path, detach=own).frames[1].before for own in ((), (both,))]
    assert all(own is not None for own in counts)
    left, told = (own.pairs for own in counts if own is not None)
    assert left == 0 and told > 0
