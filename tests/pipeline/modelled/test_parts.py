"""Parts have names by which they are found; lists of modelled contacts sum to the counted pairs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dtrepair import RepairOptions
from dtrepair.pipeline import PairsFound, check_stage, repair_keyposes, repair_stage
from dtrepair.pipeline.modelled.references import modelled_parts
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.sources import open_source
from dtrepair.report.parts import LISTED
from dtrepair.report.record import Report
from tests.command_line import tube_obj
from tests.jointed_arm import FRAMES, arm, arm_mesh, arm_stage
from tests.meshes import icosphere, joined
from tests.pipeline.hosts import Listener

# More balls than are listed, each sunk into a plate.
BALLS = LISTED + 4


@pytest.fixture
def bending(tmp_path: Path) -> Path:
    return arm_stage(tmp_path / "a.usda", np.linspace(0.0, 0.5, FRAMES))


def studded_stage(path: Path) -> Path:
    """A long body with balls in it, each with another radius, moved as one over three frames."""
    from tests.meshes import tube
    from usd_io import AuthoredMesh, write_animation

    body = tube(24, 200, 0.5, 60.0)
    balls = []
    for number in range(BALLS):
        points, faces = icosphere(2, 0.3 + 0.01 * number)
        balls.append((points + np.array((0.45, 0.02, 2.0 * number - 25.0)), faces))
    points, faces = joined(body, *balls)
    poses = [points + np.array((0.0, 0.1 * k, 0.0)) for k in range(3)]
    mesh = AuthoredMesh(path="/Root/Studs", faces=faces, points=poses, rest=points)
    write_animation(path, mesh, times=[1.0, 2.0, 3.0])
    return path


def assert_lists_sum(report: Report) -> None:
    """The lists of each frame and of the run have exactly the pairs that were counted."""
    document = report.document()
    for name, counted in (("modelled", "modelled_pairs"), ("faults", "pairs")):
        items = [(frame["before"], frame["after"], frame.get(name)) for frame in document["frames"]]
        summary: dict[str, Any] = document["summary"]
        whole = [{counted: summary[f"{counted}_{when}"]} for when in ("before", "after")]
        for before, after, listed in [*items, (*whole, summary.get(name))]:
            rows = [] if listed is None else [*listed["listed"], listed["others"]]
            for when, count in (("before", before), ("after", after)):
                total = sum(row["counts"][f"pairs_{when}"] for row in rows)
                assert total == count[counted]


def test_a_report_lists_what_was_modelled_by_parts(bending: Path, tmp_path: Path) -> None:
    checked = check_stage(bending)
    repaired = repair_stage(bending, tmp_path / "b.usda")
    keys = repair_keyposes(bending, tmp_path / "c.usda")
    for report in (checked, repaired, keys):
        assert_lists_sum(report)
        (attached,) = report.attached.listed
        assert attached.pose == "bind pose" and attached.pairs > 0
        assert {attached.first.name, attached.second.name} == {
            "/Root/Arm part 1",
            "/Root/Arm part 2",
        }
        listed = report.frames[0].modelled.listed
        assert [record.first for record in listed] == [attached.first]


def test_a_report_lists_which_parts_are_at_fault(bending: Path, tmp_path: Path) -> None:
    every_contact = RepairOptions(rest_contacts="repair")
    keys = repair_keyposes(bending, tmp_path / "c.usda", options=every_contact)
    assert any(frame.faults for frame in keys.frames)
    assert_lists_sum(keys)
    report = check_stage(bending, rest_contacts="repair")
    assert_lists_sum(report)
    every = [record for frame in report.frames for record in frame.faults.listed]
    met = {(record.first.name, record.second.name) for record in every}
    assert met == {("/Root/Arm part 1", "/Root/Arm part 2")}
    assert sum(record.counts.triangles_before for record in every) == sum(
        frame.before.triangles for frame in report.frames if frame.before is not None
    )


def test_a_single_part_has_no_list_of_parts(tmp_path: Path) -> None:
    """It meets itself: which part that is needs no word."""
    report = check_stage(tube_obj(tmp_path / "a.obj"))
    assert report.frames[0].before is not None and report.frames[0].before.pairs > 0
    assert not report.frames[0].faults and "faults" not in report.document()["summary"]


def test_places_are_where_the_parts_are(bending: Path) -> None:
    parts = modelled_parts(open_source(str(bending), Selection()))
    points, faces = arm(0.0), arm_mesh()[1]
    assert parts.attachments is not None
    for index, record in enumerate(parts.records):
        own = points[np.unique(faces[parts.attachments.part_of == index])]
        middle = 0.5 * (own.min(axis=0) + own.max(axis=0))
        size = np.linalg.norm(np.ptp(points, axis=0))
        assert np.abs(np.array(record.centre) - middle).max() <= 1e-3 * size
        assert record.triangles == (parts.attachments.part_of == index).sum()
    # They overlap where the upper arm ends and the forearm begins.
    (attached,) = parts.attached.listed
    low = points[len(points) // 2 :, 2].min()
    assert low - 0.05 <= attached.centre[2] <= points[: len(points) // 2, 2].max() + 0.05


def test_a_long_list_is_cut_and_its_rest_summed(tmp_path: Path) -> None:
    report = check_stage(studded_stage(tmp_path / "a.usda"))
    assert_lists_sum(report)
    frame = report.frames[0]
    assert len(frame.modelled.listed) == LISTED and frame.modelled.others.parts == BALLS - LISTED
    pairs = [record.counts.pairs_before for record in frame.modelled.listed]
    assert pairs == sorted(pairs, reverse=True)
    assert len(report.attached) == BALLS
    # The body has most triangles, and the balls follow in their order.
    names = {record.first.number for record in report.attached.listed}
    names |= {record.second.number for record in report.attached.listed}
    assert names == set(range(1, BALLS + 2))


def test_who_asks_what_is_modelled_gets_more_of_each_frame(tmp_path: Path) -> None:
    path = studded_stage(tmp_path / "a.usda")
    report = check_stage(path, find_worn=True)
    assert_lists_sum(report)
    for frame in report.frames:
        assert len(frame.modelled.listed) == BALLS and frame.modelled.others.parts == 0
    # Of what is a fault as many as ever are listed.
    faults = check_stage(path, find_worn=True, rest_contacts="repair").frames[0].faults
    assert len(faults.listed) == LISTED and faults.others.parts == BALLS - LISTED


def test_a_triangle_counts_with_each_pair_of_parts_it_is_in(tmp_path: Path) -> None:
    """Two balls sit in one place of a body: some of its triangles meet both."""
    from usd_io import AuthoredMesh, write_animation

    (ball, ball_faces), (body, body_faces) = icosphere(2, 0.4), icosphere(2, 1.0)
    places = [np.array((1.0, 0.0, 0.0)), np.array((1.0, 0.2, 0.1))]
    points, faces = joined((body, body_faces), *((ball + place, ball_faces) for place in places))
    mesh = AuthoredMesh(path="/Root/Balls", faces=faces, points=[points] * 5, rest=points)
    path = tmp_path / "a.usda"
    write_animation(path, mesh, times=np.arange(1.0, 6.0))
    host = Listener()
    check_stage(path, rest_contacts="repair", observer=host)
    contacts = next(remark.pairs for remark in host.remarks if isinstance(remark, PairsFound))
    parts = modelled_parts(open_source(str(path), Selection()))
    assert parts.attachments is not None
    between = np.sort(parts.attachments.part_of[contacts], axis=1)
    expected = {
        (parts.records[a].name, parts.records[b].name): (
            len(own := contacts[(between == (a, b)).all(axis=1)]),
            len(np.unique(own)),
        )
        for a, b in np.unique(between, axis=0).tolist()
    }
    frame = check_stage(path).frames[0]
    assert frame.before is not None and frame.before.pairs == 0 and len(expected) == 3
    assert expected == {
        (own.first.name, own.second.name): (own.counts.pairs_before, own.counts.triangles_before)
        for own in frame.modelled.listed
    }
    assert sum(triangles for _, triangles in expected.values()) > frame.before.modelled_triangles


def test_a_place_is_told_in_the_world(tmp_path: Path) -> None:
    """A single mesh is counted in its own space, but a user looks for the place in the world."""
    from pxr import Gf, Usd, UsdGeom

    path = arm_stage(tmp_path / "a.usda", np.zeros(3))
    here = check_stage(path).attached.listed[0].centre
    stage = Usd.Stage.Open(str(path))
    UsdGeom.Xformable(stage.GetPrimAtPath("/Root")).AddTranslateOp().Set(Gf.Vec3d(5.0, 0.0, 0.0))
    stage.Save()
    there = check_stage(path)
    for centre in (there.attached.listed[0].centre, there.frames[0].modelled.listed[0].centre):
        assert np.allclose(np.subtract(centre, here), (5.0, 0.0, 0.0), atol=2e-2)


def test_nothing_is_listed_where_nothing_counts_as_modelled(bending: Path) -> None:
    document = check_stage(bending, rest_contacts="repair").document()
    assert "attached" not in document and "modelled" not in document["summary"]
    assert not any("modelled" in frame for frame in document["frames"])
