"""What sank into what it sits on is led out first, to where it was modelled."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dtrepair import Body, RepairOptions, SceneRepairer
from dtrepair.diagnosis import StrainKind
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.separation.sunken import SunkenOptions, raised_frames, sitters
from tests.meshes import Mesh, icosphere, joined

THICK = 0.06


def plate() -> Mesh:
    """A thin closed disk across z, the vest."""
    points, faces = icosphere(4)
    return points * [1.0, 1.0, 0.5 * THICK], faces


def pouch() -> Mesh:
    """A lump that sits on its middle, a fifth of it within."""
    points, faces = icosphere(2)
    return points * [0.1, 0.1, 0.05] + [0.0, 0.0, 0.5 * THICK + 0.03], faces


def bodies(**second: Any) -> list[Body]:
    return [Body(*plate()), Body(*pouch(), **second)]


def references(*meshes: Mesh) -> list[Reference]:
    points, faces = joined(*meshes)
    return [Reference(points, Detector(points, faces)(points))]


def scene_of(*meshes: Mesh, options: RepairOptions | None = None, **last: Any) -> Scene:
    """The meshes as bodies of a scene, attached where they meet."""
    *others, (points, faces) = meshes
    every = [*(Body(*mesh) for mesh in others), Body(points, faces, **last)]
    return make_scene(every, options or RepairOptions(), references=references(*meshes))


def lowered(*depths: float) -> FloatArray:
    """Poses (T, V, 3) in which the pouch is lower by some depths."""
    points = joined(plate(), pouch())[0]
    poses = np.repeat(points[None], len(depths), axis=0)
    poses[:, len(plate()[0]) :, 2] -= np.array(depths)[:, None]
    return poses


def pairs_of(scene: Scene, poses: FloatArray) -> list[Any]:
    return [scene.pairs(pose, scene.weld(pose)) for pose in poses]


def test_a_pouch_sits_on_a_vest_and_not_the_reverse() -> None:
    scene = scene_of(plate(), pouch())
    (sitter,) = sitters(scene)
    assert (scene.body_of_vertex[sitter.vertices] == 1).all()
    assert len(sitter.vertices) == len(pouch()[0])
    assert sitter.height == pytest.approx(0.03, abs=0.01)


def directed() -> FloatArray:
    return np.tile([1.0, 0.0, 0.0], (len(pouch()[0]), 1))


HELD: list[dict[str, Any]] = [
    {"mobility": 0.0},
    {"mobility": 0.5},
    {"rigid": True},
    {"diffusion": 999.0},
    {"direction": directed()},
]


@pytest.mark.parametrize("last", HELD)
def test_what_is_fixed_stiff_or_directed_is_left_to_that(last: dict[str, Any]) -> None:
    assert not sitters(scene_of(plate(), pouch(), **last))


def test_with_a_largest_displacement_nothing_is_raised() -> None:
    scene = scene_of(plate(), pouch(), options=RepairOptions(maximum_displacement=0.01))
    poses = lowered(0.09)
    assert raised_frames(scene, poses, pairs_of(scene, poses), np.zeros(1)) is poses


def test_what_is_attached_to_two_or_is_not_small_does_not_sit() -> None:
    points, faces = pouch()
    second = points * 0.8 + [0.12, 0.0, 0.02], faces
    assert len(sitters(scene_of(plate(), pouch()))) == 1
    assert not sitters(scene_of(plate(), second, pouch()))
    large = points * [4.5, 4.5, 1.0], faces
    assert not sitters(scene_of(plate(), large))


def test_a_ball_in_its_socket_or_an_arm_does_not_sit() -> None:
    points, faces = icosphere(3)
    inside, arm = 0.3 * points + [0.9, 0.0, 0.0], points * [0.1, 0.1, 0.6] + [0.0, 0.0, 1.5]
    for small in (inside, arm):
        assert not sitters(scene_of((points, faces), (small, faces)))


def test_what_sank_is_raised_to_where_it_was_modelled() -> None:
    scene, poses = scene_of(plate(), pouch()), lowered(0.09)
    raised = raised_frames(scene, poses, pairs_of(scene, poses), np.zeros(1))
    assert np.abs(raised[0] - lowered(0.0)[0]).max() < 1e-3
    count = len(plate()[0])
    assert np.array_equal(raised[0, :count], poses[0, :count])


def test_a_character_that_shrinks_has_not_sunk() -> None:
    scene, poses = scene_of(plate(), pouch()), 0.5 * lowered(0.0, 0.09)
    met = [scene.pairs(2.0 * pose, scene.rest_weld) for pose in lowered(0.05, 0.09) * 0.5]
    assert all(map(len, met))
    still = raised_frames(scene, poses[:1], met[:1], np.zeros(1))
    assert np.array_equal(still, poses[:1])
    raised = raised_frames(scene, poses[1:], met[1:], np.zeros(1))
    assert np.abs(raised[0] - poses[0]).max() < 1e-3


def test_where_the_host_is_folded_nobody_knows_the_way() -> None:
    scene, poses = scene_of(plate(), pouch()), lowered(0.09)
    met = pairs_of(scene, poses)
    poses[:, : len(plate()[0]), 2] = 0.0  # the disk is flat now ...
    poses[:, : len(plate()[0]), :2] = 0.0  # ... and no more than a point
    assert np.array_equal(raised_frames(scene, poses, met, np.zeros(1)), poses)


def test_what_meets_nothing_or_has_not_sunk_stays() -> None:
    scene = scene_of(plate(), pouch())
    for depth in (0.0, 0.009):  # a twentieth of its size
        poses = lowered(depth)
        assert np.array_equal(
            raised_frames(scene, poses, pairs_of(scene, poses), np.zeros(1)), poses
        )
    far = lowered(0.3)  # behind it already: nothing tells which way
    assert np.array_equal(raised_frames(scene, far, pairs_of(scene, far), np.zeros(1)), far)


def test_in_clips_it_rises_smoothly() -> None:
    scene = scene_of(plate(), pouch())
    depth = 0.09 * np.exp(-(((np.arange(16.0) - 7.5) / 3.0) ** 2))
    poses = lowered(*depth)
    raised = raised_frames(scene, poses, pairs_of(scene, poses), np.arange(16.0))
    lifted = (raised - poses)[:, -1, 2]
    assert lifted.max() > 0.07
    assert np.abs(np.diff(lifted, 2)).max() < 0.02


def test_what_goes_back_to_where_it_was_modelled_has_not_come_off() -> None:
    meter = scene_of(plate(), pouch()).strain_meter
    modelled, sunk = lowered(0.0, 0.12)
    assert not meter(sunk, modelled)
    assert {own.kind for own in meter(modelled, sunk)} & {StrainKind.DRIFT, StrainKind.SLIDE}


def test_a_part_that_is_hidden_in_a_point_stays() -> None:
    (sitter,) = sitters(scene_of(plate(), pouch()))
    hidden = lowered(0.0)[0]
    hidden[len(plate()[0]) :] = 0.0
    assert not sitter.way_out(hidden, SunkenOptions()).any()


def test_what_rises_goes_no_farther_than_its_own_size() -> None:
    scene, poses = scene_of(plate(), pouch()), lowered(0.35)
    (sitter,) = sitters(scene)
    assert np.linalg.norm(sitter.way_out(poses[0], SunkenOptions())) == pytest.approx(sitter.size)


def test_a_little_sunk_is_a_little_raised() -> None:
    scene = scene_of(plate(), pouch())
    (sitter,) = sitters(scene)
    depths = np.linspace(0.0, 0.03, 31)
    way = [sitter.way_out(pose, SunkenOptions())[2] for pose in lowered(*depths)]
    assert way[0] == way[9] == 0.0 and way[-1] == pytest.approx(0.03, abs=1e-3)
    assert np.diff(way).max() < 0.005


def test_a_ball_half_in_a_bowl_does_not_sit_on_it() -> None:
    points, faces = icosphere(3)
    ring = np.hypot(points[:, 0], points[:, 1])
    # A dent in a ball, as wide as the small one.
    dented = points * [1.0, 1.0, 1.0]
    dented[:, 2] -= np.where(points[:, 2] > 0.0, 0.9 * np.exp(-((ring / 0.25) ** 2)), 0.0)
    ball = 0.24 * points + [0.0, 0.0, 0.3]
    assert not sitters(scene_of((dented, faces), (ball, faces)))


def test_frames_of_a_clip_begin_with_what_sank_led_out() -> None:
    count, depth = len(plate()[0]), 0.09 * np.sin(np.linspace(0.0, np.pi, 8))
    repairer = SceneRepairer(bodies(), references=references(plate(), pouch()))
    poses = [
        (float(time), [pose[:count], pose[count:]]) for time, pose in enumerate(lowered(*depth))
    ]
    for frame in repairer.animator.stream(poses, jobs=1):
        vest, own = frame.results
        assert own.after.pairs == 0
        middle = vest.points[np.linalg.norm(plate()[0][:, :2], axis=1) < 0.2, 2].mean()
        assert own.points[:, 2].mean() > middle + 0.02


def test_a_sunken_pouch_ends_in_front_of_its_vest() -> None:
    repairer = SceneRepairer(bodies(), references=references(plate(), pouch()))
    pose = lowered(0.09)[0]
    count = len(plate()[0])
    vest, own = repairer([pose[:count], pose[count:]])
    assert own.before.pairs > 0 and own.after.pairs == 0
    middle = vest.points[np.linalg.norm(plate()[0][:, :2], axis=1) < 0.2, 2].mean()
    assert own.points[:, 2].mean() > middle + 0.02
