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
from blender.dtrepair_addon.scene.sampling import points_of, sample
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
    assert copy.data.shape_keys.use_relative
    assert points_of(hero.data).tobytes() == own and hero.data.shape_keys is None
    after = sample([hero], range(1, FRAMES + 1))[0]
    assert after.points.tobytes() == before.points.tobytes()
    hero.select_set(False)
    assert bpy.ops.dtrepair.check() == {"FINISHED"}
    assert not len(bpy.context.scene.dtrepair.contacts)


def test_cancel_leaves_the_scene_as_it_was(hero: Any) -> None:
    bpy.context.scene.frame_set(3)
    before = state(hero)
    job = Job("repair", interpreter(), [hero], range(1, FRAMES + 1), {})
    folder = job.worker.folder
    assert job.worker.running and folder.exists()
    job.cancel()
    assert not job.worker.running and not folder.exists()
    assert state(hero) == before


def test_a_missing_interpreter_is_told(hero: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DTREPAIR_PYTHON", os.devnull + "/none")
    before = state(hero)
    with pytest.raises(RuntimeError, match="DTREPAIR_PYTHON"):
        bpy.ops.dtrepair.check()
    assert state(hero) == before
