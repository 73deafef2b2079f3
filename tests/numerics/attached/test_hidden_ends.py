"""Ends that another part hides: found in a pose, and carried along when what hides them moves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dtrepair import Body, SceneRepairer, Status
from dtrepair.numerics.attached.hidden_ends import hidden_ends
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import components
from tests.meshes import Mesh, icosphere, joined, tube

NONE = np.zeros((0, 2), dtype=np.int32)


def hand_in_sleeve(radius: float = 0.2, shift: float = 0.8) -> Mesh:
    """A sleeve along z, and a tube of a radius that begins inside it and ends outside."""
    hand, faces = tube(20, 20, radius=radius, length=1.0)
    return joined(
        tube(24, 20, radius=0.24, length=1.0), (hand + np.array([0.0, 0.0, shift]), faces)
    )


def tied_ends(
    mesh: Mesh, bound: tuple[int, int] = (0, 0), poses: Sequence[NDArray[np.float64]] = ()
) -> tuple[list[int], list[int]]:
    """The vertices that are tied, and the parts that hold them."""
    points, faces = mesh
    part = components(faces, len(points))
    of_face = np.unique(part, return_inverse=True)[1][faces[:, 0]].astype(np.int32)
    ties = hidden_ends(points, faces, of_face, np.array(bound)[of_face], poses=poses)
    held = np.einsum("nk,nkd->nd", ties.weights, points[faces[ties.triangles]])
    assert (np.linalg.norm(held - points[ties.vertices], axis=1) < 0.16).all()
    return ties.vertices.tolist(), np.unique(of_face[ties.triangles]).tolist()


def test_the_end_inside_a_sleeve_is_tied_to_it_and_no_other_end() -> None:
    mesh = hand_in_sleeve()
    inner = 24 * 21 + np.arange(20)  # the first ring of the hand
    assert tied_ends(mesh) == (inner.tolist(), [0])


def test_parts_of_two_bindings_or_of_none_are_not_tied() -> None:
    mesh = hand_in_sleeve()
    assert tied_ends(mesh, (0, 1)) == tied_ends(mesh, (-1, -1)) == ([], [])


def test_an_end_outside_or_far_from_what_goes_round_it_is_not_tied() -> None:
    assert tied_ends(hand_in_sleeve(shift=1.1)) == ([], [])
    assert tied_ends(hand_in_sleeve(radius=0.1)) == ([], [])


def test_an_end_in_a_wide_sleeve_is_tied_if_it_follows() -> None:
    """Both turn together, and the hand slides by less than its radius; one that slides does not."""
    mesh, turn = hand_in_sleeve(radius=0.1), np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    hand = (np.arange(len(mesh[0])) >= 24 * 21)[:, None] * np.array([1.0, 0.0, 0.0])
    inner = 24 * 21 + np.arange(20)

    def tied(*shifts: float, own: Mesh = mesh) -> list[int]:
        return tied_ends(own, poses=[(own[0] + shift * hand) @ turn for shift in shifts])[0]

    assert tied(0.0, 0.04, -0.04) == inner.tolist()
    assert tied(0.0, 0.04, 0.13) == tied(0.0, 0.5) == tied() == []
    # What is far wider, as a skirt, tells nothing of what is in it.
    assert tied(0.0, own=hand_in_sleeve(radius=0.05)) == []


def test_a_triangle_without_area_is_no_border() -> None:
    """A closed part hides nothing: what lies in it is inside it, and no end of a sleeve."""
    ball, faces = icosphere(3, radius=0.25)
    hand, hand_faces = tube(20, 20, radius=0.2, length=1.0)
    points, every = joined((ball, faces), (hand + np.array([0.0, 0.0, 0.5]), hand_faces))
    assert tied_ends((points, every)) == ([], [])
    flat = np.array([[0, 0, int(faces[0, 1])]], dtype=np.int32)
    assert tied_ends((points, np.concatenate([every, flat]))) == ([], [])


def slid(bound: NDArray[np.int32] | None) -> float:
    """How far a hand slides in its sleeve where that is pushed aside by a ball."""
    ball, ball_faces = icosphere(3, radius=0.2)
    rest, faces = hand_in_sleeve()
    reference = Reference(np.concatenate([rest, ball + 3.0]), NONE, bound=bound)
    bodies = [Body(rest, faces), Body(ball + 3.0, ball_faces, mobility=0.0)]
    pose = [rest, ball + np.array([0.3, 0.0, 0.0])]
    result = SceneRepairer(bodies, references=[reference])(pose)
    assert all(own.status == Status.CLEAN for own in result)
    moved = np.asarray(result[0].points, np.float64) - rest
    end, above = 24 * 21 + np.arange(20), 24 * 16 + np.arange(24)
    return float(np.linalg.norm(moved[end].mean(axis=0) - moved[above].mean(axis=0)))


def test_a_hand_follows_the_sleeve_that_is_pushed_aside() -> None:
    faces = len(hand_in_sleeve()[1]), len(icosphere(3)[1])
    bound = np.repeat(np.array([0, -1], dtype=np.int32), faces)
    assert slid(bound) < 0.75 * slid(None)


def test_the_clip_of_a_scene_shows_what_follows() -> None:
    rest, faces = hand_in_sleeve(radius=0.1)
    hand = (np.arange(len(rest)) >= 24 * 21)[:, None] * np.array([1.0, 0.0, 0.0])
    bind = Reference(rest, NONE, bound=np.zeros(len(faces), dtype=np.int32))
    for shifts, count in (((0.02, -0.02), 20), ((0.02, 0.3), 0), ((0.02,), 0), ((), 0)):
        poses = [Reference(rest + 1.0 + shift * hand, NONE) for shift in shifts]
        scene = SceneRepairer([Body(rest, faces)], references=[bind], layer_poses=poses).scene
        held = scene.attachments
        assert (0 if held is None else len(held.every_tie.vertices)) == count
