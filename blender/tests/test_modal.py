"""Check and Repair as a window runs them: events are made up, the worker is a real one."""

from __future__ import annotations

import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import bpy
import pytest

from blender.dtrepair_addon import register, unregister
from blender.dtrepair_addon.scene import jobs
from blender.dtrepair_addon.scene.sampling import points_of
from blender.dtrepair_addon.ui.operators import DTREPAIR_OT_repair, _Work
from blender.tests.character import character, state

TIMER, ESC, MOVE = (SimpleNamespace(type=name) for name in ("TIMER", "ESC", "MOUSEMOVE"))


class Work(_Work):
    """An operator that Blender did not make."""

    command = "repair"

    def __init__(self) -> None:
        self.said: list[str] = []
        self.told: list[dict[str, Any]] = []

    def report(self, kinds: set[str], text: str) -> None:
        self.said.append(text)

    def _finish(self, context: Any) -> None:
        self.told.append(self._job.told)


class Window:
    """Stands for the window manager: counts timers."""

    timers = 0

    def event_timer_add(self, tick: float, window: Any) -> str:
        self.timers += 1
        return "timer"

    def event_timer_remove(self, timer: str) -> None:
        self.timers -= 1

    def modal_handler_add(self, operator: Any) -> None:
        """Nothing to do: the test sends the events."""


@pytest.fixture
def context() -> Iterator[Any]:
    body = character(6)
    register()
    bpy.context.scene.frame_set(3)
    scene = bpy.context.scene
    yield SimpleNamespace(
        scene=scene,
        screen=None,
        window=None,
        window_manager=Window(),
        selected_objects=[body],
        view_layer=bpy.context.view_layer,
        mode="OBJECT",
    )
    unregister()


class Repair(Work):
    """One that puts its result into the scene."""

    def _finish(self, context: Any) -> None:
        finish: Any = DTREPAIR_OT_repair._finish
        finish(self, context)


@pytest.mark.parametrize("by_panel", [False, True])
def test_work_is_cancelled_and_the_next_may_begin(context: Any, by_panel: bool) -> None:
    work = Work()
    own = points_of(context.selected_objects[0].data).tobytes()
    assert work.invoke(context, None) == {"RUNNING_MODAL"}
    assert context.window_manager.timers == 1 and not Work.poll(context)
    assert work.modal(context, MOVE) == work.modal(context, TIMER) == {"PASS_THROUGH"}
    worker = work._job.worker
    if by_panel:
        assert bpy.ops.dtrepair.cancel() == {"FINISHED"}
    assert work.modal(context, TIMER if by_panel else ESC) == {"CANCELLED"}
    assert not worker.running and not worker.folder.exists()
    assert context.window_manager.timers == 0 and Work.poll(context)
    assert work.said == ["cancelled; nothing was changed"] and not work.told
    assert points_of(context.selected_objects[0].data).tobytes() == own
    assert "Hero repaired" not in bpy.data.objects


def test_the_timer_leads_to_the_result(context: Any) -> None:
    work = Work()
    work.invoke(context, None)
    assert until_the_end(work, context) == {"FINISHED"}
    assert work.told[0]["frames"][0]["frame"] == 3.0
    assert context.window_manager.timers == 0 and context.scene.dtrepair.state == ""


@pytest.mark.parametrize("by_panel", [False, True])
def test_shape_keys_are_counted_by_a_worker_while_blender_stays_usable(
    context: Any, by_panel: bool
) -> None:
    body = context.selected_objects[0]
    body.select_set(True)
    before, actions = state(body), len(bpy.data.actions)
    work = counting(context)
    assert context.scene.dtrepair.state == "counting again" and not Work.poll(context)
    assert state(body) == before and body.select_get() and len(bpy.data.actions) == actions
    worker = work._job.worker
    assert worker.running and work.modal(context, MOVE) == {"PASS_THROUGH"}
    if by_panel:
        bpy.ops.dtrepair.cancel()
    assert work.modal(context, TIMER if by_panel else ESC) == {"CANCELLED"}
    assert not worker.running and not worker.folder.exists() and not context.window_manager.timers
    assert state(body) == before and len(bpy.data.actions) == actions
    work = counting(context)
    assert until_the_end(work, context) == {"FINISHED"}
    copy = bpy.data.objects["Hero repaired"]
    assert copy.data.shape_keys and body.hide_get() and "1 objects changed" in work.said


def test_keys_that_cost_a_clean_frame_are_counted_once_more(
    context: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "TOLERANCE", 0.5)
    context.scene.dtrepair.span, context.scene.dtrepair.frames = "CHOSEN", "2:4"
    work = counting(context)
    first = work._job.worker
    while work._job.worker is first:
        assert work.modal(context, TIMER) == {"PASS_THROUGH"}
        time.sleep(0.05)
    assert not first.folder.exists() and "Hero repaired" not in bpy.data.objects
    assert until_the_end(work, context) == {"FINISHED"}
    (copy,) = (each for each in bpy.data.objects if each.name == "Hero repaired")
    changed = [f for f in work._job.told["frames"] if f["before"]]
    assert len(copy.data.shape_keys.key_blocks) - 1 >= len(changed) > 1
    assert not any("not clean" in text for text in work.said)


def test_what_is_deleted_while_keys_are_counted_is_told(context: Any) -> None:
    work = counting(context)
    bpy.data.objects.remove(bpy.data.objects["Hero"])
    assert until_the_end(work, context) == {"CANCELLED"}
    assert "Hero was deleted in the meantime" in work.said[0]
    assert "Hero repaired" not in bpy.data.objects and Work.poll(context)


def counting(context: Any) -> Repair:
    """A repair whose shape keys are being counted."""
    work = Repair()
    assert work.invoke(context, None) == {"RUNNING_MODAL"}
    while not work._job.recounts:
        assert work.modal(context, TIMER) == {"PASS_THROUGH"}
        time.sleep(0.05)
    return work


def until_the_end(work: Work, context: Any) -> set[str]:
    """Send timer events; return what ended the work."""
    while (ended := work.modal(context, TIMER)) == {"PASS_THROUGH"}:
        time.sleep(0.05)
    return ended


def test_a_worker_that_dies_is_told_and_nothing_stays_behind(context: Any) -> None:
    work = Work()
    work.invoke(context, None)
    work._job.worker._end()
    assert until_the_end(work, context) == {"CANCELLED"}
    assert "ended with exit code" in work.said[0]
    assert Work.poll(context) and not work._job.worker.folder.exists()
