"""A repair as a mesh cache: the worker is a real one, and Blender reads the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from blender.dtrepair_addon.host.exchange import read_points
from blender.dtrepair_addon.scene import mesh_cache
from blender.dtrepair_addon.scene.jobs import Job
from blender.dtrepair_addon.scene.sampling import SceneError, points_of, sample
from blender.tests.character import FRAMES, state

EVERY = range(FRAMES + 3)


@pytest.fixture
def cached(hero: Any, tmp_path: Path) -> Any:
    """The hero, whose repairs become mesh caches in a folder that is not there yet."""
    bpy.context.scene.dtrepair.result = "CACHE"
    bpy.context.scene.dtrepair.caches = str(tmp_path / "new" / "caches")
    bpy.context.scene.frame_set(3)
    return hero


def test_a_cache_has_the_repaired_points_and_the_original_is_untouched(
    cached: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = sample([cached], EVERY)[0]
    own = points_of(cached.data).tobytes()
    wanted: list[Any] = []
    inherited = Job.apply

    def kept(job: Job) -> Any:
        wanted.extend(read_points(job.worker.folder / job.told["result"], job.meshes))
        return inherited(job)

    monkeypatch.setattr(Job, "apply", kept)
    assert bpy.ops.dtrepair.repair() == {"FINISHED"}
    copy = bpy.context.view_layer.objects.active
    assert copy.name == "Hero repaired" and copy.data.shape_keys is None and cached.hide_render
    assert [file.name for file in (tmp_path / "new" / "caches").iterdir()] == ["dtrepair_001.usdc"]
    after = sample([copy], EVERY)[0]
    assert after.points[1 : FRAMES + 1].tobytes() == wanted[0].tobytes()
    assert after.rest.tobytes() == before.rest.tobytes()
    beside = [0, *EVERY[FRAMES + 1 :]]
    assert after.points[beside].tobytes() == before.points[beside].tobytes()
    assert points_of(cached.data).tobytes() == own
    assert sample([cached], EVERY)[0].points.tobytes() == before.points.tobytes()
    cached.select_set(False)
    assert bpy.ops.dtrepair.check() == {"FINISHED"}
    assert not len(bpy.context.scene.dtrepair.contacts)


def test_a_cache_is_undone_in_one_step(cached: Any) -> None:
    bpy.context.scene.dtrepair.span = "CURRENT"
    before = state(cached)
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.dtrepair.repair("EXEC_DEFAULT", True) == {"FINISHED"}
    assert bpy.data.objects.get("Hero repaired") and len(bpy.data.cache_files) == 1
    bpy.ops.ed.undo()
    assert state(bpy.data.objects["Hero"]) == before and not len(bpy.data.cache_files)


def test_a_cache_holds_added_vertices_below_a_subdivision_and_moves_with_the_scene(
    cached: Any, tmp_path: Path
) -> None:
    scene = bpy.context.scene
    scene.dtrepair.span, scene.dtrepair.caches = "CURRENT", "//caches"
    with pytest.raises(RuntimeError, match="save the scene"):
        bpy.ops.dtrepair.repair()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "hero.blend"))
    cached.modifiers.new("Mirror", "MIRROR").use_axis = (False, True, False)
    cached.modifiers.new("Subdivision", "SUBSURF").levels = 1
    before = sample([cached], [3])[0].points[0]
    assert len(before) > len(cached.data.vertices)
    assert bpy.ops.dtrepair.repair() == {"FINISHED"}
    copy = bpy.data.objects["Hero repaired"]
    assert [m.type for m in copy.modifiers] == [
        "ARMATURE",
        "MIRROR",
        "MESH_SEQUENCE_CACHE",
        "SUBSURF",
    ]
    assert bpy.data.cache_files[0].filepath == "//caches/dtrepair_001.usdc"
    after = sample([copy], [3])[0].points[0]
    assert after.shape == before.shape and np.abs(after - before).max() > 1e-3


def test_what_would_deform_a_cache_again_is_refused_before_the_work(cached: Any) -> None:
    cached.modifiers.new("Subdivision", "SUBSURF")
    cached.modifiers.new("Late", "LATTICE")
    before = state(cached)
    with pytest.raises(RuntimeError, match="Late comes after a subdivision"):
        bpy.ops.dtrepair.repair()
    bpy.context.scene.dtrepair.caches = __file__
    with pytest.raises(RuntimeError, match="choose another folder"):
        bpy.ops.dtrepair.repair()
    assert state(cached) == before


@pytest.mark.parametrize("failing", ["opened", "apply"])
def test_a_cache_that_fails_leaves_no_file(
    cached: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failing: str
) -> None:
    folder = tmp_path / "failing"
    scene = bpy.context.scene
    scene.dtrepair.span, scene.dtrepair.caches = "CURRENT", str(folder)
    scene.frame_set(3)
    before, files = state(cached), len(bpy.data.cache_files)

    def fail(*arguments: Any) -> None:
        raise SceneError("Blender did not read it")

    monkeypatch.setattr(mesh_cache, failing, fail)
    with pytest.raises(RuntimeError, match="did not read it"):
        bpy.ops.dtrepair.repair()
    assert not list(folder.iterdir()) and len(bpy.data.cache_files) == files
    assert state(cached) == before and bpy.data.objects.get("Hero repaired") is None
