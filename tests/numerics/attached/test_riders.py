"""Small parts that ride on a larger one: found by a clip, and carried along where it moves."""

from __future__ import annotations

import numpy as np

from dtrepair import Body, SceneRepairer
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attached.riders import riders
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray, components
from tests.meshes import icosphere, joined

HEAD, FACES = icosphere(3)
TOOTH = icosphere(2)[0] * (0.1, 0.1, 0.05)
SMALL = icosphere(2)[1]


def part_of(points: FloatArray, faces: np.ndarray) -> np.ndarray:
    return np.unique(components(faces, len(points))[faces[:, 0]], return_inverse=True)[1]


def tied(*poses: FloatArray, size: float = 1.0, free: bool = True, host: bool = True) -> int:
    """How many vertices of a tooth are tied to the head, at poses of the tooth."""
    whole = [joined((HEAD, FACES), (size * pose, SMALL)) for pose in poses]
    points, faces = whole[0]
    of_face = part_of(points, faces).astype(np.int32)
    ties = riders(
        [pose for pose, _ in whole],
        faces,
        of_face,
        np.array([False, free]),
        np.array([host, False]),
    )
    held = np.einsum("nk,nkd->nd", ties.weights, points[faces[ties.triangles]])
    assert (np.linalg.norm(held, axis=1) < 1.001).all()
    assert (ties.vertices >= len(HEAD)).all()
    return len(ties.vertices)


AT = np.array([0.0, 0.0, 1.06])


def test_what_lies_close_to_something_large_rides_on_it() -> None:
    assert tied(TOOTH + AT) == len(TOOTH)
    assert tied(TOOTH + AT, free=False) == 0
    assert tied(TOOTH + AT, host=False) == 0


def test_what_lies_far_off_does_not_ride() -> None:
    assert tied(TOOTH + 1.3 * AT) == 0


def test_what_lies_within_something_large_rides_on_it_however_far_its_skin_is() -> None:
    assert tied(TOOTH + 0.3 * AT) == len(TOOTH)
    assert tied(TOOTH + 0.3 * AT, TOOTH + 0.2 * AT) == 0
    long = TOOTH * (1.0, 1.0, 16.0)  # it comes out on both sides
    assert 0.0 < np.ptp(long[:, 2]) / 2.0 - 0.75 < 0.1 and tied(long + 0.3 * AT) == 0


def test_what_is_as_large_does_not_ride() -> None:
    assert tied(4.0 * TOOTH + 1.3 * AT) == 0


def test_what_leaves_in_some_pose_does_not_ride() -> None:
    assert tied(TOOTH + AT, TOOTH + AT, TOOTH + 1.2 * AT) == 0


def test_what_half_leaves_is_held_by_what_stays() -> None:
    up = TOOTH[:, 2] > 0.02
    pose = TOOTH + AT + 0.2 * up[:, None]
    assert tied(TOOTH + AT, pose) == np.count_nonzero(~up)


def test_a_rider_goes_along_with_what_it_rides_on() -> None:
    """A ball sits on the top of a head with a knob, and the head is pressed up from below."""
    knob = 0.3 * HEAD + (0.0, 1.1, 0.0)
    bodies = [(HEAD, FACES), (knob, FACES), (TOOTH + AT, SMALL)]
    points, faces = joined(*bodies)
    shown = [Reference(points, Detector(points, faces)(points))]
    wall = 3.0 * HEAD + (0.0, 0.0, -4.2), FACES
    scene = [Body(*mesh) for mesh in bodies] + [Body(*wall, mobility=0.0)]
    every = joined(*bodies, wall)
    references = [Reference(every[0], own.pairs) for own in shown]
    lifted = wall[0] + (0.0, 0.0, 0.3)
    clip = [Reference(every[0] + (0.0, 0.0, z), own.pairs) for z in (0.0, 0.5) for own in shown]
    poses = [own for own, _ in bodies] + [lifted]
    results = SceneRepairer(scene, references=references, layer_poses=clip)(poses)
    assert results[0].before.pairs > 0 and results[0].after.pairs == 0
    risen = results[0].points - HEAD
    on_top = risen[HEAD[:, 2] > 0.95].mean(axis=0)
    assert on_top[2] > 0.02
    # One pose tells nothing: the head presses the ball on.
    alone = SceneRepairer(scene, references=references)(poses)
    off = [
        np.linalg.norm((found[2].points - (TOOTH + AT)).mean(axis=0) - on_top)
        for found in (results, alone)
    ]
    assert off[0] < 0.2 * on_top[2] < off[1]
