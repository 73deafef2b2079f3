"""Sets face what moves near them, whichever way they were modelled."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dtrepair.pipeline import repair_stage
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.object_settings import read_settings
from dtrepair.pipeline.stages.shot.sets import find_sets
from dtrepair.pipeline.stages.sources import open_source
from tests.command_line import read_samples
from tests.pipeline.stages.test_sets import ALONG, BALL, FACES, HALVES, SQUARE, TIMES, UP, stage_of


@pytest.mark.parametrize("half", [10.0, 300.0])
def test_which_way_a_set_faces_changes_no_bit(tmp_path: Path, half: float) -> None:
    found, facing = [], []
    for name, halves in (("a", HALVES), ("over", HALVES[:, [0, 2, 1]])):
        path = stage_of(tmp_path / f"{name}.usda", half=half, halves=halves)
        out = tmp_path / f"{name}_out.usda"
        assert all(frame.status == "clean" for frame in repair_stage(str(path), str(out)).frames)
        found.append(read_samples(out, "/Ball/Mesh"))
        facing.append(faces_away(path))
    assert all(np.array_equal(found[0][time], found[1][time]) for time in TIMES)
    assert not np.array_equal(found[0][1.0], read_samples(path, "/Ball/Mesh")[1.0])
    assert facing[0]["/Set/Floor"] == [False] * 2 and facing[1]["/Set/Floor"] == [True] * 2


def faces_away(path: Path) -> dict[str, list[bool]]:
    """Return which triangles of each set of a stage face away from what moves."""
    source = open_source(str(path), Selection())
    find_sets(source, read_settings(source).each)
    known = {own.path: own.faces_away for own in source.meshes}
    return {name: own.tolist() for name, own in known.items() if own is not None}


def balls_on_tiles(path: Path, *heights: float) -> Path:
    """Balls over a floor of tiles with gaps that look up and down by turns, in a row."""
    from usd_io import AuthoredMesh, write_animation

    corner = np.array(list(np.ndindex(8, 8, 1))) - 3.5 * (ALONG + UP[[0, 2, 1]])
    tiles = (0.45 * SQUARE + corner[:, None]).reshape(-1, 3)
    faces = np.concatenate([HALVES[:, :: 1 - 2 * (k % 2)] + 4 * k for k in range(len(corner))])
    meshes = [AuthoredMesh(path="/Set/Floor", faces=faces, rest=tiles.astype(np.float32))]
    for index, height in enumerate(heights):
        poses = [(BALL + x * ALONG + height * UP).astype(np.float32) for x in (0.0, 0.2, 0.4)]
        meshes.append(
            AuthoredMesh(path=f"/Ball{index}/Mesh", faces=FACES, rest=poses[0], points=poses)
        )
    write_animation(path, meshes, times=TIMES)
    return path


@pytest.mark.parametrize(
    ("heights", "above"),
    [((1.0,), True), ((-1.0,), False), ((9.0,), True), ((1.0, -4.0), True), ((4.0, -1.0), False)],
)
def test_each_part_of_a_set_faces_what_is_near(
    tmp_path: Path, heights: tuple[float, ...], above: bool
) -> None:
    down = np.repeat(np.arange(64) % 2 == 1, 2)
    for order in (heights, heights[::-1]):
        found = faces_away(balls_on_tiles(tmp_path / f"{order}.usda", *order))["/Set/Floor"]
        assert found == (down == above).tolist()


def test_what_is_seen_from_both_sides_stays_as_it_is(tmp_path: Path) -> None:
    path = balls_on_tiles(tmp_path / "a.usda", 1.0, -1.0)
    assert not any(faces_away(path)["/Set/Floor"])
