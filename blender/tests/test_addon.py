"""The add-on in Blender without a window: the worker is a real one."""

from __future__ import annotations

import os
from typing import Any

import bpy
import numpy as np
import pytest

from blender.dtrepair_addon.scene.copies import copied
from blender.dtrepair_addon.scene.jobs import Job
from blender.dtrepair_addon.scene.marks import FACES, GROUP
from blender.dtrepair_addon.scene.sampling import SceneError, evaluated, points_of, sample
from blender.dtrepair_addon.scene.shape_keys import add_keys, fewest, fitted, points_of_key
from blender.dtrepair_addon.ui import overlay
from blender.dtrepair_addon.ui.preferences import interpreter
from blender.tests.character import FRAMES, state


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
    assert selected(hero) == held == selected(hero, by_group=True)
    assert len(overlay.shown(min(frames))) and not len(overlay.shown(1))
    view = viewport()
    view.view_perspective = "CAMERA"
    bpy.context.scene.frame_set(1)
    bpy.ops.dtrepair.go(index=len(contacts) - 1)
    last = contacts[-1]
    assert bpy.context.scene.frame_current == last.frame != 1
    assert bpy.context.scene.dtrepair.active == len(contacts) - 1
    assert view.view_perspective == "PERSP" and view.view_distance > last.size > 0.0
    assert (view.view_location - last.centre).length < 1e-6
    corners = overlay.shown(last.frame)
    assert (np.abs(corners - np.array(view.view_location)) <= 0.5 * last.size + 1e-6).all()
    bpy.ops.dtrepair.clear()
    assert FACES not in hero.data.attributes and GROUP not in hero.vertex_groups


def test_a_repaired_character_is_clean_and_the_original_untouched(hero: Any) -> None:
    before = sample([hero], range(1, FRAMES + 1))[0]
    own = points_of(hero.data).tobytes()
    assert bpy.ops.dtrepair.repair() == {"FINISHED"}
    copy = bpy.context.view_layer.objects.active
    assert copy.name == "Hero repaired" and copy.data is not hero.data
    keys = copy.data.shape_keys
    assert keys.use_relative and 1 <= len(keys.key_blocks) - 1 < FRAMES
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
    copy = copied(hero)
    both = zip(frames, mesh.points, wanted, strict=True)
    offsets = np.stack([fitted(copy, frame, old, new) for frame, old, new in both])
    names = add_keys(copy, fewest(frames, offsets))
    assert names == ["dtrepair 3-5 1", "dtrepair 3-5 2", "dtrepair 3-5 3"]
    after = sample([copy], frames)[0].points
    assert np.abs(after - wanted).max() < 1e-6
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


def test_what_the_artist_did_in_the_meantime_is_told(hero: Any) -> None:
    job = Job("check", interpreter(), [hero], [1], {})
    bpy.ops.ed.undo_push(message="before")
    bpy.context.scene.objects["Hero rig"].location.x = 1.0
    bpy.ops.ed.undo_push(message="moved")
    bpy.ops.ed.undo()
    assert job.objects == [bpy.data.objects["Hero"]]
    bpy.data.objects["Hero"].data.vertices.add(1)
    with pytest.raises(SceneError, match="Hero was edited in the meantime"):
        job.objects  # noqa: B018
    bpy.data.objects.remove(bpy.data.objects["Hero"])
    with pytest.raises(SceneError, match="Hero was deleted in the meantime"):
        job.objects  # noqa: B018
    job.cancel()


def test_the_rest_pose_is_that_of_the_armature_without_earlier_repairs(hero: Any) -> None:
    bpy.context.scene.frame_set(4)
    assert (evaluated(hero)[0] != points_of(hero.data)).any()
    hero.shape_key_add(name="Basis")
    own, earlier = (hero.shape_key_add(name=name) for name in ("Nose", "dtrepair 4"))
    own.data[7].co.x += 1.0
    earlier.data[8].co.x += 1.0
    own.value = earlier.value = 1.0
    wanted = points_of(hero.data)
    wanted[7, 0] += 1.0
    assert np.allclose(sample([hero], [4])[0].rest, wanted, atol=1e-6)
    assert not earlier.mute and bpy.data.armatures[0].pose_position == "POSE"


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


def selected(body: Any, by_group: bool = False) -> set[int]:
    """The vertices that an artist selects in edit mode, by the face attribute or the group."""
    body.data.attributes.active = body.data.attributes[FACES]
    body.vertex_groups.active = body.vertex_groups[GROUP]
    bpy.context.view_layer.objects.active = body
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="DESELECT")
    bpy.ops.object.vertex_group_select() if by_group else bpy.ops.mesh.select_by_attribute()
    bpy.ops.object.mode_set(mode="OBJECT")
    return {vertex.index for vertex in body.data.vertices if vertex.select}


def viewport() -> Any:
    """The 3D viewport of the screen."""
    (area,) = (each for each in bpy.context.screen.areas if each.type == "VIEW_3D")
    return area.spaces.active.region_3d
