"""Check and Repair as a window runs them: events are made up, the worker is a real one."""

from __future__ import annotations

import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import bpy
import pytest

from blender.dtrepair_addon import register, unregister
from blender.dtrepair_addon.scene.sampling import points_of
from blender.dtrepair_addon.ui.operators import _Work
from blender.tests.character import character

TIMER, ESC, MOVE = (SimpleNamespace(type=name) for name in ("TIMER", "ESC", "MOUSEMOVE"))


class Work(_Work):
    """An operator that Blender did not make."""

    command = "repair"

    def __init__(self) -> None:
        self.said: list[str] = []
        self.told: list[dict[str, Any]] = []

    def report(self, kinds: set[str], text: str) -> None:
        self.said.append(text)

    def _finish(self, context: Any, told: dict[str, Any]) -> None:
        self.told.append(told)


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
        mode="OBJECT",
    )
    unregister()


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
    while (state := work.modal(context, TIMER)) == {"PASS_THROUGH"}:
        time.sleep(0.05)
    assert state == {"FINISHED"} and work.told[0]["frames"][0]["frame"] == 3.0
    assert context.window_manager.timers == 0 and context.scene.dtrepair.state == ""


def test_a_worker_that_dies_is_told_and_nothing_stays_behind(context: Any) -> None:
    work = Work()
    work.invoke(context, None)
    work._job.worker._end()
    while (state := work.modal(context, TIMER)) == {"PASS_THROUGH"}:
        time.sleep(0.05)
    assert state == {"CANCELLED"} and "ended with exit code" in work.said[0]
    assert Work.poll(context) and not work._job.worker.folder.exists()
