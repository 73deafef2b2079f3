"""Close-ups: all of a contact is seen, in every pose, from where it can be seen."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.display.closeups import CloseupOptions, Posed, contact_view, draw_closeups
from dtrepair.display.colours import Colours
from dtrepair.display.render import render
from tests.meshes import icosphere

Scene = tuple[list[Posed], NDArray[np.int32], NDArray[np.int64]]
OPTIONS = CloseupOptions(size=80)


@pytest.fixture
def poses() -> Scene:
    """A sphere with red at its back, which moves by half its radius."""
    points, faces = icosphere(2)
    place = np.flatnonzero(points[faces].mean(axis=1)[:, 2] < -0.85)
    red = np.zeros(len(faces), dtype=bool)
    red[place] = True
    moved = points + np.array([0.5, 0, 0])
    return [Posed(points, red), Posed(moved, np.zeros_like(red))], faces.astype(np.int32), place


def test_it_looks_from_where_the_contact_is_seen(
    poses: Scene,
) -> None:
    both, faces, place = poses
    view = contact_view(both, faces, place, options=OPTIONS)
    assert view.rotation[2] @ [0, 0, -1] > 0.5  # from behind


def test_the_contact_of_both_poses_is_within_the_picture(
    poses: Scene,
) -> None:
    both, faces, place = poses
    view = contact_view(both, faces, place, options=OPTIONS)
    for pose in both:
        seen = pose.points[np.unique(faces[place])] @ view.rotation.T - view.centre
        assert np.abs(seen[:, :2]).max() < view.half_size


def test_a_picture_has_both_poses_and_the_whole(
    poses: Scene,
) -> None:
    both, faces, place = poses
    view = contact_view(both, faces, place, options=OPTIONS)
    image = draw_closeups(both, faces, view, options=OPTIONS)
    assert image.shape == (80, 160, 3)
    red = (image[..., 0] > 2 * image[..., 1].astype(int)) & (image[..., 0] > 60)
    assert red[:, :80].any() and not red[:, 80:].any()
    border = image[:24, :24]
    assert (border[[0, -1]] == 200).all() and (border == 40).all(axis=2).any()


def test_each_object_has_its_own_colour() -> None:
    numbers = np.arange(30)
    assert len(np.unique(Colours().of(numbers), axis=0)) == 30
    points, faces = icosphere(1)
    whole = np.concatenate([points, points + np.array([3.0, 0, 0])])
    both = np.concatenate([faces, faces + len(points)]).astype(np.int32)
    view = contact_view([Posed(whole, np.zeros(len(both), bool))], both, np.arange(len(both)))
    image = render(whole, both, view=view, objects=np.arange(len(both)) // len(faces), size=60)
    inside = image[(image < 240).any(axis=2)].astype(int)
    tints = inside[:, 0] - inside[:, 2]
    assert (tints > 8).any() and (tints < -8).any()  # the first is warm, the second cold
