"""A scene: bodies as one mesh, and which of their pairs count."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from dtrepair import Body, RepairOptions
from dtrepair.intersect.ignored import counted_between
from dtrepair.numerics.attachments import Reference
from dtrepair.repair.repairer import SceneRepairer
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.scene import Scene
from tests.meshes import icosphere, joined, with_seam

BALL, FACES = icosphere(1)
NEAR, AWAY = np.array([0.7, 0.0, 0.0]), np.array([5.0, 0.0, 0.0])
# A body that intersects itself, and another that intersects the first one.
TWICE, TWICE_FACES = joined((BALL, FACES), (BALL + NEAR, FACES))
POSE = np.concatenate([TWICE, BALL - NEAR])
BODIES = [Body(TWICE, TWICE_FACES), Body(BALL + AWAY, FACES)]


def scene(
    mode: str = "both", ignore: Sequence[tuple[int, int]] = (), bodies: Sequence[Body] = BODIES
) -> Scene:
    return make_scene(bodies, RepairOptions(mode=mode), ignore)


def met(of: Scene) -> set[tuple[int, int]]:
    """Which bodies meet in the pose, by the pairs that count."""
    owner = np.sort(of.body_of[of.pairs(POSE, of.weld(POSE))], axis=1)
    return {(first, second) for first, second in owner.tolist()}


def test_bodies_are_numbered_through() -> None:
    both = scene()
    assert np.array_equal(both.rest, np.concatenate([TWICE, BALL + AWAY]))
    assert np.array_equal(both.faces[both.triangles_of(1)], FACES + len(TWICE))
    assert both.vertices_of(1) == slice(len(TWICE), len(TWICE) + len(BALL))
    assert (both.body_of_vertex[both.faces] == both.body_of[:, None]).all()
    edges = both.edges_of_bodies[1]
    assert edges.min() == 0 and edges.max() == len(BALL) - 1


@pytest.mark.parametrize(("method", "expected"), [("paper", "cuda:3"), ("full", "cpu")])
def test_poses_are_counted_where_the_published_method_runs(
    method: str, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    devices = []

    def detector(rest: object, faces: object, *, device: str) -> None:
        devices.append(device)

    monkeypatch.setattr("dtrepair.repair.repairer.resolve_device", lambda name: name)
    monkeypatch.setattr("dtrepair.repair.repairer.DeviceQueue", lambda name: None)
    monkeypatch.setattr("dtrepair.repair.scene.scene.Detector", detector)
    repairer = SceneRepairer(BODIES, options=RepairOptions(method=method), device="cuda:3")
    assert repairer.scene.detector is None and devices == [expected]


def test_a_scene_does_not_change() -> None:
    with pytest.raises(FrozenInstanceError):
        setattr(scene(), "rest", BALL)  # noqa: B010


@pytest.mark.parametrize(
    ("mode", "ignore", "expected"),
    [
        ("both", [], {(0, 0), (0, 1)}),
        ("self", [], {(0, 0)}),
        ("inter", [], {(0, 1)}),
        ("both", [(1, 0)], {(0, 0)}),
        ("both", [(0, 0)], {(0, 1)}),
        ("inter", [(0, 1)], set()),
    ],
)
def test_mode_and_ignored_pairs_decide_which_pairs_count(
    mode: str, ignore: list[tuple[int, int]], expected: set[tuple[int, int]]
) -> None:
    assert met(scene(mode, ignore)) == expected


def test_counting_is_symmetric_in_the_two_bodies() -> None:
    bodies = np.array([[0, 1], [1, 0], [2, 2], [0, 2]])
    for mode in ("self", "inter", "both"):
        one = counted_between(bodies, mode=mode, ignored=[(0, 1)])
        other = counted_between(bodies[:, ::-1], mode=mode, ignored=[(0, 1)])
        assert one.tolist() == other.tolist()
    assert counted_between(bodies, mode="both", ignored=[(0, 1)]).tolist() == [0, 0, 1, 1]


def test_vertices_of_one_body_are_welded_those_of_two_are_not() -> None:
    points, faces = with_seam(BALL, FACES, 3)
    assert len(points) > len(BALL)
    same = scene(bodies=[Body(points, faces), Body(points, faces)])
    weld = same.weld(same.rest)
    assert len(np.unique(weld)) == 2 * len(BALL)
    assert (same.body_of_vertex[weld] == same.body_of_vertex).all()


@pytest.mark.parametrize(
    ("mode", "ignore", "count"),
    [("both", [], 1), ("inter", [], 1), ("self", [], 0), ("both", [(0, 1)], 0)],
)
def test_what_is_caught_inside_counts_as_its_bodies_do(
    mode: str, ignore: list[tuple[int, int]], count: int
) -> None:
    bodies = [Body(BALL, FACES), Body(0.2 * BALL + AWAY, FACES)]
    both = scene(mode, ignore, bodies)
    pose = np.concatenate([BALL, 0.2 * BALL])
    enclosed = both.enclosed_parts(pose, both.pairs(pose, both.weld(pose)))
    assert len(enclosed) == count
    assert count == 0 or both.body_of_part[enclosed].tolist() == [[1, 0]]


def test_the_rest_knows_its_own_contacts() -> None:
    assert scene("both").rest_intersections > 0 == scene("inter").rest_intersections


@pytest.mark.parametrize("asked", [False, True])
def test_what_is_asked_for_is_modelled_whatever_the_options_say(asked: bool) -> None:
    """The two parts of the first body overlap in the reference."""
    every = np.concatenate([TWICE, BALL + AWAY])
    pairs = scene().rest_pairs
    for rest_contacts in ("auto", "repair", "leave"):
        options = RepairOptions(rest_contacts=rest_contacts)
        references = [Reference(every, pairs, asked=asked)]
        found = make_scene(BODIES, options, references=references)
        modelled = asked or rest_contacts == "auto"
        assert (found.attachments is not None) == modelled
        assert (len(found.rest_pairs) == 0) == modelled
    paper = make_scene(BODIES, RepairOptions(method="paper"), references=references)
    assert paper.attachments is None


def test_wrong_scenes_and_poses_are_refused() -> None:
    with pytest.raises(ValueError, match="at least one body, got none"):
        make_scene([], RepairOptions())
    with pytest.raises(ValueError, match=r"diffusion should be positive and finite, got -1"):
        scene(bodies=[Body(BALL, FACES, diffusion=-1.0)])
    with pytest.raises(
        ValueError, match=r"ignore should hold pairs of bodies 0 to 1, got \(0, 2\)"
    ):
        scene(ignore=[(2, 0)])
    with pytest.raises(ValueError, match=r"clearance should be at most .* 5% of the diagonal"):
        make_scene(BODIES, RepairOptions(clearance=1.0))
    with pytest.raises(ValueError, match="points should hold 2 poses, got 1"):
        scene().gather([TWICE])
    with pytest.raises(ValueError, match=f"should have {len(BALL)} rows"):
        scene().gather([TWICE, BALL[1:]])
