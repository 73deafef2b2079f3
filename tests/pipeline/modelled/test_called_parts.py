"""One connected part of a mesh is named as lists name it, to be attached or detached."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dtrepair.pipeline import check_stage, repair_stage
from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.modelled.names import numbered
from dtrepair.pipeline.selection import ObjectOptions, ObjectSettings, PrimTable
from tests.meshes import icosphere, joined, tube
from tests.pipeline.hosts import Listener
from usd_io import AuthoredMesh, write_animation

POST = "/Root/Post"


@pytest.fixture
def post(tmp_path: Path) -> Path:
    """A post with three balls, of which the first is the coarsest, beside a bead that meets one."""
    sizes = (1, 2, 3)
    balls = []
    for number, fineness in enumerate(sizes):
        points, faces = icosphere(fineness, 0.3)
        balls.append((points + np.array((0.45, 0.02, 2.0 * number - 2.0)), faces))
    points, faces = joined(tube(24, 100, 0.5, 8.0), *balls)
    bead = icosphere(1, 0.2)
    meshes = [
        AuthoredMesh(path=POST, faces=faces, points=[points] * 3, rest=points),
        AuthoredMesh(
            path="/Root/Bead",
            faces=bead[1],
            points=[bead[0] + np.array((0.8, 0.0, 2.0))] * 3,
            rest=bead[0] + np.array((0.8, 0.0, 2.0)),
        ),
    ]
    path = tmp_path / "a.usda"
    write_animation(path, meshes, times=[1.0, 2.0, 3.0])
    return path


def modelled(path: Path, **choices: Any) -> list[tuple[str, str]]:
    """The names of the parts that are attached, without the paths above them."""
    listed = check_stage(path, **choices).attached.listed
    names = [(own.first.name, own.second.name) for own in listed]
    return sorted((a.removeprefix("/Root/"), b.removeprefix("/Root/")) for a, b in names)


def test_parts_are_numbered_by_their_triangles() -> None:
    parts, meshes = np.array([2, 2, 0, 1, 1, 3, 3, 3]), np.array([0, 0, 0, 0, 0, 1, 1, 1])
    mesh, number, sizes = numbered(parts, meshes, 4)
    assert mesh.tolist() == [0, 0, 0, 1] and sizes.tolist() == [1, 2, 2, 3]
    # Of equal ones the first is the first.
    assert number.tolist() == [3, 1, 2, 1]


def test_one_pair_of_parts_is_detached(post: Path) -> None:
    every = [*(("Post part 1", f"Post part {n}") for n in (2, 3, 4)), ("Post part 2", "Bead")]
    assert modelled(post) == every
    for text in (f"{POST} part 1,{POST} part 3", f"{POST} part 3,{POST} part 1"):
        left = [own for own in every if own != ("Post part 1", "Post part 3")]
        assert modelled(post, detach=(text,)) == left
    assert modelled(post, detach=(f"{POST} part 2,{POST}",)) == every[1:]
    assert modelled(post, detach=(f"/Root/Bead,{POST} part 3",)) == every
    assert modelled(post, detach=(f"/Root/Bead,{POST} part 2",)) == every[:3]


def test_its_contacts_are_faults_and_repaired(post: Path, tmp_path: Path) -> None:
    text = f"{POST} part 1,{POST} part 3"
    done = repair_stage(post, tmp_path / "b.usda", objects=ObjectOptions(detach=(text,)))
    before = check_stage(post, detach=(text,)).frames[0].before
    assert before is not None and before.pairs > 0
    assert all(own.status == "clean" for own in done.frames)
    (fault,) = done.frames[0].faults.listed
    assert {fault.first.number, fault.second.number} == {1, 3}
    assert fault.counts.pairs_before == before.pairs and fault.counts.pairs_after == 0


def test_a_prim_names_a_part_of_another_or_of_itself(post: Path) -> None:
    table = PrimTable(POST, ObjectSettings(detach=(f"{POST} part 4", "/Root/Bead part 1")))
    assert modelled(post, tables=(table,)) == [
        ("Post part 1", "Post part 2"),
        ("Post part 1", "Post part 3"),
    ]


@pytest.mark.parametrize(
    "detach", [f"{POST} part 1,{POST} part 3", f"{POST},{POST}", f"{POST} part 3,{POST}"]
)
def test_what_is_within_what_is_detached_is_not_attached(post: Path, detach: str) -> None:
    host, text = Listener(), f"{POST} part 3,{POST} part 1"
    check_stage(post, attach=(text,), detach=(detach,), observer=host)
    assert f"{text}: called both attached and detached: it is detached" in host.warnings
    assert not any(own.startswith("attach: ") for own in host.warnings)


def test_numbers_are_the_same_where_nothing_is_modelled(tmp_path: Path) -> None:
    """A ball touches the post that it overlaps in a vertex, where both would be one part."""
    body, ball = tube(24, 100, 0.5, 8.0), icosphere(2, 0.3)
    meeting = ball[0] + body[0][900] - ball[0][0]
    points, faces = joined(body, (meeting, ball[1]), (ball[0] + 3.0, ball[1]))
    path = tmp_path / "a.usda"
    mesh = AuthoredMesh(path=POST, faces=faces, points=[points] * 3, rest=points)
    write_animation(path, mesh, times=[1.0, 2.0, 3.0])
    (shown,) = check_stage(path).attached.listed
    (fault,) = check_stage(path, rest_contacts="repair").frames[0].faults.listed
    for own in ("number", "triangles"):
        assert {getattr(shown.first, own), getattr(shown.second, own)} == {
            getattr(fault.first, own),
            getattr(fault.second, own),
        }


def test_parts_that_never_meet_are_named_in_a_warning(post: Path) -> None:
    for text, met in ((f"{POST} part 2,{POST} part 3", False), (f"{POST} part 4,{POST}", True)):
        host = Listener()
        check_stage(post, attach=(text,), observer=host)
        told = [own for own in host.warnings if own.startswith("attach: ")]
        assert (
            not told
            if met
            else told[0].startswith(f"attach: {POST} part 2 and {POST} part 3 meet neither")
        )


def test_what_is_attached_are_the_parts_that_are_named(tmp_path: Path) -> None:
    """Two balls in a post without a rest pose, in one of few frames: nothing else tells of them."""
    points, faces = joined(tube(24, 100, 0.5, 8.0), icosphere(3, 0.3), icosphere(2, 0.3))
    poses = []
    for depth in (0.45, 2.0, 2.0):
        moved = points.copy()
        moved[-642 - 162 : -162] += (depth, 0.02, 2.0)
        moved[-162:] += (depth, 0.02, -2.0)
        poses.append(moved)
    path = tmp_path / "a.usda"
    write_animation(path, AuthoredMesh(path=POST, faces=faces, points=poses), times=[1.0, 2.0, 3.0])
    assert modelled(path) == []
    assert modelled(path, attach=(f"{POST} part 1,{POST} part 3",)) == [
        ("Post part 1", "Post part 3")
    ]


@pytest.mark.parametrize(
    ("choices", "told"),
    [
        ({"detach": (f"{POST} part 5,{POST}",)}, "part 5: expected a number from 1 to 4; check"),
        (
            {"attach": (f"{POST},/Root/Bead part 2",)},
            "expected no number, as it is one part",
        ),
        ({"attach": (f"{POST} part 0,{POST}",)}, "part 0: expected a number from 1 on"),
        ({"ignore": (f"{POST} part 1,{POST}",)}, "--ignore: expected two prims"),
        (
            {"detach": (f"{POST} part 5,{POST}",), "rest_contacts": "repair"},
            "from 1 to 4; check",
        ),
        ({"attach": (f"{POST} part 2,{POST} part 2",)}, "names one part twice"),
        ({"detach": (f"{POST} part2,{POST}",)}, "'part2' names none; a part of a mesh is written"),
        ({"detach": (f"{POST} Parts 2,{POST}",)}, "'Parts 2' names none"),
        ({"detach": (f"{POST} part 1 + {POST} part 2,{POST}",)}, "'part 1 \\+' names none"),
        ({"ignore": (f"{POST} part 1 (320 triangles),{POST}",)}, "names none"),
        ({"detach": (f"/Root/None part 1,{POST}",)}, "matches none of the selected meshes"),
    ],
)
def test_parts_that_are_not_there_are_refused(post: Path, choices: Any, told: str) -> None:
    with pytest.raises(UsageError, match=told):
        check_stage(post, **choices)
