"""Repairer: odd meshes that come back, and wrong ones that are refused."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair import Body, Repairer, RepairOptions, SceneRepairer, Status
from dtrepair.repair import repairer
from tests.exact_reference import check_counts
from tests.meshes import grid, icosphere, overlapping_spheres, torus


def test_open_flat_and_empty_meshes_come_back() -> None:
    for points, faces in (
        grid(4, 4),
        (np.zeros((0, 3)), np.zeros((0, 3), np.int32)),
        (np.zeros((5, 3)), np.zeros((0, 3), np.int32)),
        (np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32)),
    ):
        result = Repairer(points, faces)(points)
        assert result.status is Status.CLEAN and np.array_equal(result.points, points)


NOTHING = np.zeros((0, 3)), np.zeros((0, 3), np.int32)


@pytest.mark.parametrize("method", ["full", "paper"])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_body_without_faces_has_nothing_to_do(method: str, place: int) -> None:
    (points, faces), loose = icosphere(1, radius=0.5), np.eye(3)
    bodies = [Body(points, faces), Body(points + np.array([0.8, 0.0, 0.0]), faces)]
    poses = [np.asarray(body.rest) for body in bodies]
    bodies.insert(place, Body(loose, NOTHING[1]))
    poses.insert(place, loose)
    results = SceneRepairer(bodies, options=RepairOptions(method=method))(poses)
    assert {result.status for result in results} == {Status.CLEAN}
    assert np.array_equal(results[place].points, loose)
    assert not np.array_equal(results[1 - min(place, 1)].points, poses[1 - min(place, 1)])


def test_a_body_without_vertices_is_refused_in_a_scene() -> None:
    with pytest.raises(ValueError, match=r"a vertex at least, got none in body 1: leave it out"):
        SceneRepairer([Body(*torus()), Body(*NOTHING)])
    with pytest.raises(ValueError, match="got none in Ghost"):
        SceneRepairer([Body(*NOTHING, name="Ghost"), Body(*torus())])


@pytest.mark.parametrize("mesh", [NOTHING, (np.eye(3), NOTHING[1])])
def test_a_clip_of_nothing_comes_back(mesh: tuple[np.ndarray, np.ndarray]) -> None:
    results = Repairer(*mesh).animation(np.stack([mesh[0]] * 4))
    assert [result.status for result in results] == [Status.CLEAN] * 4
    assert all(np.array_equal(result.points, mesh[0]) for result in results)


def test_a_single_pose_is_no_clip() -> None:
    points, faces = torus()
    with pytest.raises(ValueError, match=r"frames \(T, V, 3\), got frames of shape \(3,\)"):
        Repairer(points, faces).animation(points)
    assert Repairer(points, faces).animation([]) == []


def test_unused_vertices_and_zero_area_triangles_do_no_harm() -> None:
    points, faces = overlapping_spheres()
    points = np.concatenate([points, [[9.0, 9, 9], points[3]]])
    flat = [[0, 0, 1], [5, 5, 5], [3, len(points) - 1, 4]]
    faces = np.concatenate([faces, np.array(flat, dtype=np.int32)])
    result = Repairer(points, faces)(points)
    assert result.status is Status.CLEAN and np.isfinite(result.points).all()
    check_counts(result, points, faces)
    assert np.array_equal(result.points[-2], points[-2])


def test_wrong_poses_are_refused() -> None:
    points, faces = torus()
    repairer = Repairer(points, faces)
    with pytest.raises(ValueError, match=f"should have {len(points)} rows"):
        repairer(points[1:])
    with pytest.raises(ValueError, match="shape"):
        repairer(points[:, :2])
    wrong = points.copy()
    wrong[7, 1] = np.nan
    with pytest.raises(ValueError, match=r"finite.*vertex 7"):
        repairer(wrong)
    with pytest.raises(ValueError, match="finite"):
        repairer(points * 1e39)


def test_of_wrong_frames_the_first_is_named() -> None:
    points, faces = torus()
    repairer = Repairer(points, faces)
    frames = np.stack([points] * 4)
    frames[2:, 7, 1] = np.nan
    for given in (frames, frames.tolist()):
        with pytest.raises(ValueError, match=r"frame 2 of 4, counted from 0: .*finite.*vertex 7"):
            repairer.animation(given)
    with pytest.raises(ValueError, match=r"frame 1 of 2, counted from 0: .*rows"):
        repairer.animation([points, points[1:]])


def test_wrong_meshes_and_controls_are_refused() -> None:
    points, faces = torus()
    count = len(points)
    with pytest.raises(ValueError, match="index 999"):
        Repairer(points, np.where(faces == 9, 999, faces))
    with pytest.raises(ValueError, match="finite"):
        Repairer(points * np.nan, faces)
    with pytest.raises(ValueError, match=f"pin should hold {count} numbers between 0 and 1"):
        Repairer(points, faces, pin=np.zeros(3))
    with pytest.raises(ValueError, match="pin should hold"):
        Repairer(points, faces, pin=np.full(count, 1.5))
    with pytest.raises(ValueError, match="pin should hold"):
        Repairer(points, faces, pin=np.full(count, np.nan))
    with pytest.raises(ValueError, match="direction should be"):
        Repairer(points, faces, direction=np.zeros((count, 2)))
    with pytest.raises(ValueError, match="direction should be"):
        Repairer(points, faces, direction=np.full((count, 3), np.inf))
    with pytest.raises(ValueError, match="device"):
        Repairer(points, faces, device="abacus")


def test_the_default_method_does_not_look_for_a_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def resolved(name: str) -> str:
        asked.append(name)
        return "cpu"

    monkeypatch.setattr(repairer, "resolve_device", resolved)
    bodies = [Body(*torus())]
    assert SceneRepairer(bodies, device="auto").device == "cpu"
    assert not asked
    SceneRepairer(bodies, options=RepairOptions(method="paper"), device="auto")
    SceneRepairer(bodies, device="cuda:1")  # who names one is told whether it is there
    assert asked == ["auto", "cuda:1"]
