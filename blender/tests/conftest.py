"""The character of the tests, in a scene with the add-on."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import pytest

from blender.dtrepair_addon import register, unregister
from blender.tests.character import FRAMES, character


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
