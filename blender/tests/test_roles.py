"""Collections and vertex groups say what objects do."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from blender.dtrepair_addon.scene.roles import Roles, with_roles
from blender.dtrepair_addon.scene.sampling import sample


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
