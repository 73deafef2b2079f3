"""The add-on in Blender without a window: the worker is a real one."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import bpy
import numpy as np
import pytest

from blender.dtrepair_addon import register, unregister
from blender.dtrepair_addon.scene.jobs import Job
from blender.dtrepair_addon.scene.marks import FACES, GROUP
from blender.dtrepair_addon.scene.roles import Roles, with_roles
from blender.dtrepair_addon.scene.sampling import points_of, sample
from blender.dtrepair_addon.scene.shape_keys import apply, points_of_key
from blender.dtrepair_addon.ui import overlay
from blender.dtrepair_addon.ui.preferences import interpreter
from blender.tests.character import character

# A clip of the middle, where the hand is in the hip, and what leads there.
FRAMES = 6


@pytest.fixture
def hero() -> Iterator[Any]:
    body = character(FRAMES)
    register()
    body.select_set(True)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, FRAMES
    scene.dtrepair.span = "SCENE"
    yield body
    unregister()


def state(body: Any) -> Any:
    """All of a scene that a cancelled job could have changed."""
    scene = bpy.context.scene
    return (
        [(o.name, o.hide_get(), o.hide_render, len(o.modifiers)) for o in scene.objects],
        points_of(body.data).tobytes(),
        body.data.shape_keys,
        [group.name for group in body.vertex_groups],
        [attribute.name for attribute in body.data.attributes],
        scene.frame_current,
        [rig.pose_position for rig in bpy.data.armatures],
        len(bpy.data.meshes),
    )


def test_check_marks_what_intersects_and_lists_the_frames(hero: Any) -> None:
    assert bpy.ops.dtrepair.check() == {"FINISHED"}
    contacts = bpy.context.scene.dtrepair.contacts
    frames = {contact.frame for contact in contacts}
    assert frames and 1 not in frames
    assert all(contact.pairs > 0 and contact.first == "Hero" for contact in contacts)
    mask = np.zeros(len(hero.data.polygons), dtype=bool)
    hero.data.attributes[FACES].data.foreach_get("value", mask)
    assert mask.any() and not mask.all()
    group = hero.vertex_groups[GROUP].index
    held = {v.index for v in hero.data.vertices if any(g.group == group for g in v.groups)}
    assert held == {v for p in np.flatnonzero(mask) for v in hero.data.polygons[p].vertices}
    assert len(overlay.shown(min(frames))) and not len(overlay.shown(1))
    bpy.context.scene.frame_set(1)
    bpy.ops.dtrepair.go(index=0)
    assert bpy.context.scene.frame_current == contacts[0].frame
    bpy.ops.dtrepair.clear()
    assert FACES not in hero.data.attributes and GROUP not in hero.vertex_groups


def test_a_repaired_character_is_clean_and_the_original_untouched(hero: Any) -> None:
    before = sample([hero], range(1, FRAMES + 1))[0]
    own = points_of(hero.data).tobytes()
    assert bpy.ops.dtrepair.repair() == {"FINISHED"}
    copy = bpy.context.view_layer.objects.active
    assert copy.name == "Hero repaired" and copy.data is not hero.data
    keys = copy.data.shape_keys
    assert keys.use_relative and 2 <= len(keys.key_blocks) < FRAMES
    assert (points_of_key(keys.key_blocks[1]) != points_of_key(keys.reference_key)).any()
    bpy.context.scene.frame_set(0)
    assert all(key.value == 0.0 for key in keys.key_blocks[1:])
    assert points_of(hero.data).tobytes() == own and hero.data.shape_keys is None
    after = sample([hero], range(1, FRAMES + 1))[0]
    assert after.points.tobytes() == before.points.tobytes()
    hero.select_set(False)
    assert bpy.ops.dtrepair.check() == {"FINISHED"}
    assert not len(bpy.context.scene.dtrepair.contacts)


def test_with_a_key_for_each_frame_repaired_points_come_back(hero: Any) -> None:
    frames = range(1, FRAMES + 1)
    mesh = sample([hero], frames)[0]
    wanted = mesh.points.copy()
    wanted[2:5, :9] += np.float32(0.05) * np.arange(1, 4, dtype=np.float32)[:, None, None]
    applied = apply(hero, frames, mesh, wanted)
    assert applied.keys == ("dtrepair 3-5 1", "dtrepair 3-5 2", "dtrepair 3-5 3")
    after = sample([applied.object], frames)[0].points
    assert np.abs(after - wanted).max() < 1e-6 and applied.off.max() < 1e-6
    assert after[[0, 1, 5]].tobytes() == mesh.points[[0, 1, 5]].tobytes()
    assert after[:, 9:].tobytes() == mesh.points[:, 9:].tobytes()


def test_cancel_leaves_the_scene_as_it_was(hero: Any) -> None:
    bpy.context.scene.frame_set(3)
    before = state(hero)
    job = Job("repair", interpreter(), [hero], range(1, FRAMES + 1), {})
    folder = job.worker.folder
    assert job.worker.running and folder.exists()
    job.cancel()
    assert not job.worker.running and not folder.exists()
    assert state(hero) == before


def test_a_repair_is_undone_in_one_step(hero: Any) -> None:
    bpy.context.scene.frame_set(3)
    bpy.context.scene.dtrepair.span = "CURRENT"
    before = state(hero)
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.dtrepair.repair("EXEC_DEFAULT", True) == {"FINISHED"}
    assert bpy.data.objects.get("Hero repaired") and hero.hide_render
    bpy.ops.ed.undo()
    assert state(bpy.data.objects["Hero"]) == before


def test_what_no_shape_key_can_hold_is_refused_before_the_work(hero: Any) -> None:
    hero.modifiers.new("Mirror", "MIRROR")
    before = state(hero)
    with pytest.raises(RuntimeError, match="modifiers add"):
        bpy.ops.dtrepair.repair()
    assert state(hero) == before
    assert bpy.ops.dtrepair.check() == {"FINISHED"}  # which only looks


def test_the_cage_below_a_subdivision_is_repaired_and_the_modifier_stays(hero: Any) -> None:
    hero.modifiers.new("Subdivision", "SUBSURF").levels = 1
    bpy.context.scene.frame_set(3)
    bpy.context.scene.dtrepair.span = "CURRENT"
    assert bpy.ops.dtrepair.repair() == {"FINISHED"}
    copy = bpy.data.objects["Hero repaired"]
    assert hero.modifiers["Subdivision"].show_viewport
    assert copy.modifiers["Subdivision"].show_viewport


def test_a_missing_interpreter_is_told(hero: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DTREPAIR_PYTHON", os.devnull + "/none")
    before = state(hero)
    with pytest.raises(RuntimeError, match="DTREPAIR_PYTHON"):
        bpy.ops.dtrepair.check()
    assert state(hero) == before


def test_a_collider_takes_part_unselected_and_does_not_move(hero: Any) -> None:
    ball = beside(hero, "Ball")
    scene = bpy.context.scene
    scene.dtrepair.span = "CURRENT"
    scene.dtrepair.colliders = collection(ball)
    assert bpy.ops.dtrepair.check() == {"FINISHED"}
    assert [(c.first, c.second) for c in scene.dtrepair.contacts] == [("Hero", "Ball")]
    assert bpy.ops.dtrepair.repair() == {"FINISHED"}
    assert bpy.data.objects.get("Hero repaired") and not bpy.data.objects.get("Ball repaired")
    hero.select_set(False)
    assert bpy.ops.dtrepair.check() == {"FINISHED"}
    assert not len(scene.dtrepair.contacts)


def test_contacts_within_the_ignored_collection_do_not_count(hero: Any) -> None:
    ball = beside(hero, "Ball")
    ball.select_set(True)
    scene = bpy.context.scene
    scene.dtrepair.span = "CURRENT"
    assert bpy.ops.dtrepair.check() == {"FINISHED"} and len(scene.dtrepair.contacts) == 1
    scene.dtrepair.ignored = collection(hero, ball)
    assert bpy.ops.dtrepair.check() == {"FINISHED"} and not len(scene.dtrepair.contacts)


def test_pinned_vertices_stay(hero: Any) -> None:
    scene = bpy.context.scene
    scene.frame_set(3)
    scene.dtrepair.span, scene.dtrepair.pin = "CURRENT", "spine"
    before = sample([hero], [3])[0].points[0]
    assert bpy.ops.dtrepair.repair() == {"FINISHED"}
    copy = bpy.context.view_layer.objects.active
    after = sample([copy], [3])[0].points[0]
    group = hero.vertex_groups["spine"].index
    pinned = np.array([any(g.group == group for g in v.groups) for v in hero.data.vertices])
    assert after[pinned].tobytes() == before[pinned].tobytes()
    assert (after[~pinned] != before[~pinned]).any()


def test_led_vertices_have_their_direction_and_an_unknown_group_is_told(hero: Any) -> None:
    roles = Roles(direction="arm", towards=(1.0, 0.0, 0.0))
    (mesh,) = with_roles([hero], sample([hero], [1]), roles)
    assert mesh.direction is not None and mesh.pin is None
    arm = sum(any(g.group == 1 for g in v.groups) for v in hero.data.vertices)
    assert (mesh.direction == (1.0, 0.0, 0.0)).all(axis=1).sum() == arm
    assert not mesh.direction[~mesh.direction.any(axis=1)].any()
    bpy.context.scene.dtrepair.pin = "Spine"
    with pytest.raises(RuntimeError, match="vertex group Spine"):
        bpy.ops.dtrepair.repair()


def beside(hero: Any, name: str) -> Any:
    """A ball that is a little in the torso, on the side without the arm."""
    bpy.ops.mesh.primitive_ico_sphere_add(radius=0.15, subdivisions=3, location=(-0.4, 0.02, 1.01))
    ball = bpy.context.object
    ball.name = name
    ball.select_set(False)
    hero.select_set(True)
    return ball


def collection(*objects: Any) -> Any:
    found = bpy.data.collections.new("Some")
    for each in objects:
        found.objects.link(each)
    return found
