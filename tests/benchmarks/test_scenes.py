"""The stages that benchmarks/scenes.py measures are what they say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.scene_files import read_world, write_stage
from benchmarks.scene_stages import STAGES
from benchmarks.scenes import SHARED, count_dirty, find_pairs
from dtrepair.numerics.metrics import volume


@pytest.mark.parametrize("name", STAGES)
def test_objects_of_a_stage_meet_and_are_clean_for_themselves(name: str, tmp_path: Path) -> None:
    stage = STAGES[name]()
    path = tmp_path / "stage.usda"
    write_stage(stage, path)
    world = read_world(path)
    assert [own.split("/")[2] for own in world.paths] == [part.name for part in stage.parts]
    assert set(stage.stiff.split()) <= {part.name for part in stage.parts}
    for points, faces in zip(world.points, world.faces, strict=True):
        assert len(find_pairs(points[0], faces, np.arange(len(points[0]), dtype=np.int32))) == 0
        # Outside is out, under mirroring parents as well; the floor is open.
        assert name == "ball_on_floor" or volume(points[0], faces) > 0.0
    assert count_dirty(world, world.weld(), "", find_pairs) > 0


def test_what_the_shared_scenes_hold_is_named(shared_data: Path) -> None:
    for file, (objects, stiff) in SHARED.items():
        world = read_world(shared_data / "scenes" / file)
        assert all(any(path.startswith(own) for path in world.paths) for own in objects)
        assert set(stiff) <= set(objects)
