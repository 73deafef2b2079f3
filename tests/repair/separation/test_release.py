"""What lies wholly inside something else: told, led out if it may move, left if it belongs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair import Body, Repairer, RepairOptions, SceneRepairer, Status
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attachments import Reference
from dtrepair.repair.separation.release import released
from dtrepair.repair.surface.containment import Enclosures
from tests.exact_reference import exact_pairs
from tests.meshes import icosphere, joined

BALL, BALL_FACES = icosphere(2)
SMALL, SMALL_FACES = icosphere(1, 0.25)
AWAY, DEEP = np.array([3.0, 0.0, 0.0]), np.array([0.2, 0.1, 0.3])


def scene(
    mode: str = "both", ignore: Sequence[tuple[int, int]] = (), **small: Any
) -> SceneRepairer:
    bodies = [
        Body(BALL, BALL_FACES, name="head"),
        Body(SMALL + AWAY, SMALL_FACES, name="pea", **small),
    ]
    return SceneRepairer(bodies, options=RepairOptions(mode=mode), ignore=ignore)


def free(first: NDArray[np.float64], second: NDArray[np.float64]) -> bool:
    """Whether neither body meets the other nor lies in it."""
    points, faces = joined((first, BALL_FACES), (second, SMALL_FACES))
    pairs = exact_pairs(points, faces)
    rest = joined((BALL, BALL_FACES), (SMALL + AWAY, SMALL_FACES))[0]
    return len(pairs) == 0 and len(Enclosures(rest, faces)(points, pairs).parts) == 0


@pytest.mark.parametrize("rigid", [False, True])
def test_what_may_move_is_led_out(rigid: bool) -> None:
    results = scene(rigid=rigid)([BALL, SMALL + DEEP])
    assert [result.status for result in results] == [Status.CLEAN, Status.CLEAN]
    assert free(*(result.points for result in results))
    # The shortest way is 1 + 0.25 less the distance from the middle.
    moved = np.linalg.norm(results[1].points - SMALL - DEEP, axis=1)
    assert moved.max() < 1.2 * (1.25 - np.linalg.norm(DEEP))


def test_what_is_held_is_told_by_name() -> None:
    results = scene(pin=np.ones(len(SMALL)))([BALL, SMALL + DEEP])
    for result, points in zip(results, (BALL, SMALL + DEEP), strict=True):
        assert result.status is Status.UNCHANGED and np.array_equal(result.points, points)
        assert result.message == "pea lies wholly inside head"
        assert result.before.pairs == result.after.pairs == 0


def test_an_eye_stays_in_its_head() -> None:
    eye = SMALL + DEEP
    bodies = [Body(BALL, BALL_FACES), Body(eye, SMALL_FACES)]
    results = SceneRepairer(bodies)([BALL + 5.0, eye + 5.0])
    assert all(result.status is Status.CLEAN for result in results)
    assert np.array_equal(results[1].points, eye + 5.0)


@pytest.mark.parametrize("how", [{"mode": "self"}, {"ignore": ((0, 1),)}])
def test_contacts_that_do_not_count_stay(how: dict[str, Any]) -> None:
    results = scene(**how)([BALL, SMALL + DEEP])
    assert all(result.status is Status.CLEAN for result in results)
    assert np.array_equal(results[1].points, SMALL + DEEP)


def test_parts_of_one_mesh() -> None:
    rest, faces = joined((BALL, BALL_FACES), (SMALL + AWAY, SMALL_FACES))
    pose = joined((BALL, BALL_FACES), (SMALL + DEEP, SMALL_FACES))[0]
    result = Repairer(rest, faces)(pose)
    assert result.status is Status.CLEAN
    assert free(result.points[: len(BALL)], result.points[len(BALL) :])
    pin = np.zeros(len(rest))
    pin[len(BALL) :] = 1.0
    held = Repairer(rest, faces, pin=pin)(pose)
    assert held.status is Status.UNCHANGED
    assert held.message == "a part of the mesh lies wholly inside another part of it"


def test_a_clip_leaves_on_one_side_and_steadily() -> None:
    # Passes through the ball: outside, crossing, wholly inside, crossing, outside.
    travel = np.linspace(-2.0, 2.0, 28)
    poses = [[BALL, SMALL + np.array([x, 0.2, 0.3])] for x in travel]
    bodies = [Body(BALL, BALL_FACES, mobility=0.0), Body(SMALL + AWAY, SMALL_FACES, rigid=True)]
    frames = list(SceneRepairer(bodies).animator.stream(list(enumerate(poses)), jobs=1))
    moved = []
    for frame, pose in zip(frames, poses, strict=True):
        assert all(result.status is Status.CLEAN for result in frame.results)
        assert free(frame.results[0].points, frame.results[1].points)
        moved.append(frame.results[1].points - pose[1])
    motion = np.array(moved)
    largest = np.linalg.norm(motion, axis=2).max(axis=1)
    assert max(largest[0], largest[-1]) < 0.01 * largest.max()
    second = np.linalg.norm(np.diff(motion, 2, axis=0), axis=2).max()
    assert second < 0.35 * largest.max()


def test_both_held_end_unchanged_with_both_names() -> None:
    bodies = [
        Body(BALL, BALL_FACES, name="stone", mobility=0.0),
        Body(SMALL + AWAY, SMALL_FACES, name="sword", mobility=0.0),
    ]
    results = SceneRepairer(bodies)([BALL, SMALL + np.array([0.9, 0.1, 0.0])])
    for result in results:
        assert result.status is Status.UNCHANGED and result.displacement_max == 0.0
        assert "stone and sword still intersect" in result.message
        assert "all of them where nothing may move" in result.message


@pytest.mark.parametrize("rides", [False, True])
def test_what_rides_in_a_head_comes_out_with_it(rides: bool) -> None:
    """A head with a knob and a pea in it, and another ball that is about the pea as well."""
    rests = [BALL, 0.3 * BALL + [1.1, 0.0, 0.0], SMALL, BALL + AWAY]
    faces = [BALL_FACES, BALL_FACES, SMALL_FACES, BALL_FACES]
    points, every = joined(*zip(rests, faces, strict=True))
    shown = Reference(points, Detector(points, every)(points))
    # One pose tells nothing of what rides on what.
    poses = [shown._replace(points=points + 0.5 * AWAY)] if rides else []
    bodies = [Body(*mesh) for mesh in zip(rests, faces, strict=True)]
    of = SceneRepairer(bodies, references=[shown], layer_poses=poses).scene
    pose = points.copy()
    pose[of.vertices_of(3)] -= 0.9 * AWAY
    inner, outer = (int(of.enclosures.part[of.vertices_of(body).start]) for body in (2, 3))
    found = released(of, pose, np.array([[inner, outer]]))
    assert np.array_equal(found, pose) == rides


@pytest.mark.parametrize("inside", [1, 2, 3])
def test_a_link_of_a_chain_comes_out_with_all_of_it_or_by_the_solver(inside: int) -> None:
    """Of three balls that hold on to each other in a row, the first ones lie in a larger one."""
    links = [SMALL + AWAY + [0.0, 0.0, 0.4 * k] for k in range(3)]
    rests, faces = [2.0 * BALL, *links], [BALL_FACES, *[SMALL_FACES] * 3]
    points, every = joined(*zip(rests, faces, strict=True))
    shown = Reference(points, Detector(points, every)(points))
    bodies = [Body(*mesh) for mesh in zip(rests, faces, strict=True)]
    of = SceneRepairer(bodies, references=[shown]).scene
    part = [int(of.enclosures.part[of.vertices_of(body).start]) for body in range(4)]
    assert len(of.attached_parts.pairs) == 2
    # The first ones deep in the large ball, the others where they were.
    pose = points.copy()
    for body in range(1, inside + 1):
        pose[of.vertices_of(body)] -= AWAY
    enclosed = np.array([[part[body], part[0]] for body in range(1, inside + 1)])
    found = released(of, pose, enclosed)
    assert np.array_equal(found, pose) == (inside < 3)
