"""Layers of an option, a table or a primvar arrive at the bodies of the repair."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair import RepairOptions
from dtrepair.pipeline import (
    ObjectOptions,
    ObjectSettings,
    PrimTable,
    RepairSettings,
    UsageError,
    plan_repair,
    repair_stage,
)
from dtrepair.pipeline.repair.journal import hash_of_run
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.bodies import make_bodies, read_controls
from dtrepair.pipeline.stages.rest import choose_rests
from dtrepair.pipeline.stages.sources import open_source
from tests.command_line import assert_fails, run, tube_obj
from tests.meshes import icosphere

NOTHING = ObjectOptions()
BALL, FACES = icosphere(1)
COUNT = len(FACES)


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    """A body and a coat, apart from each other."""
    from usd_io import AuthoredMesh, write_animation

    meshes = [
        AuthoredMesh(path=f"/Hero/{name}", faces=FACES, rest=BALL + np.array((x, 0.0, 0.0)))
        for name, x in (("Body", 0.0), ("Coat", 5.0))
    ]
    path = tmp_path / "a.usda"
    write_animation(path, meshes, times=[1.0])
    return path


def add_layer(path: Path, prim: str, value: Any, interpolation: str = "constant") -> None:
    """Author primvars:dtrepair:layer with pxr, as a pipeline would."""
    from pxr import Sdf, Usd, UsdGeom

    opened = Usd.Stage.Open(str(path))
    kind = Sdf.ValueTypeNames.IntArray if isinstance(value, list) else Sdf.ValueTypeNames.Int
    primvars = UsdGeom.PrimvarsAPI(opened.GetPrimAtPath(prim))
    assert primvars.CreatePrimvar("dtrepair:layer", kind, interpolation).Set(value)
    opened.Save()


def layers(
    path: Path, objects: ObjectOptions = NOTHING, *tables: PrimTable
) -> list[NDArray[np.int32] | None]:
    """The layers (F,) of the bodies that the repair gets."""
    source = open_source(str(path), Selection())
    controls = read_controls(source, objects, tables)
    rests = choose_rests(source, None, device="cpu")
    bodies = make_bodies(source, rests, controls).bodies
    return [None if body.layer is None else np.asarray(body.layer) for body in bodies]


def told(path: Path, *arguments: Any) -> list[list[int] | None]:
    """Of each body the layers that occur."""
    found = layers(path, *arguments)
    return [None if each is None else np.unique(each).tolist() for each in found]


def test_nobody_says_anything(stage: Path) -> None:
    assert told(stage) == [None, None]


def test_an_option_gives_each_triangle_a_layer(stage: Path) -> None:
    _, coat = layers(stage, ObjectOptions(layer=("/Hero/Coat=2",)))
    assert coat is not None and coat.dtype == np.int32 and coat.tolist() == [2] * COUNT
    # Of several that match the last one holds.
    assert told(stage, ObjectOptions(layer=("/Hero=-1", "/Hero/Coat=3"))) == [[-1], [3]]


def test_a_primvar_of_a_prim_or_of_one_above(stage: Path) -> None:
    add_layer(stage, "/Hero", 1)
    assert told(stage) == [[1], [1]]
    add_layer(stage, "/Hero/Coat", 4)
    assert told(stage, ObjectOptions(layer=("/Hero=9",))) == [[1], [4]]


def test_a_primvar_of_faces(stage: Path) -> None:
    numbers = (np.arange(COUNT) % 3).tolist()
    add_layer(stage, "/Hero/Coat", numbers, "uniform")
    body, coat = layers(stage, ObjectOptions(layer=("/Hero/Coat=9",)))
    assert body is None and coat is not None and coat.tolist() == numbers


def test_a_table_wins(stage: Path) -> None:
    add_layer(stage, "/Hero/Coat", [1] * COUNT, "uniform")
    table = PrimTable("/Hero/Coat", ObjectSettings(layer=7))
    assert told(stage, NOTHING, table) == [None, [7]]


def test_a_report_says_it_again(stage: Path, tmp_path: Path) -> None:
    numbers = (np.arange(COUNT) % 2).tolist()
    add_layer(stage, "/Hero/Body", numbers, "uniform")
    settings = RepairSettings(objects=ObjectOptions(layer=("/Hero/Coat=2",)))
    recorded = repair_stage(stage, tmp_path / "b.usda", settings).document()["settings"]
    assert recorded["layer"] == ["/Hero/Coat=2"]
    assert recorded["objects"] == {
        "/Hero/Body": {"layer": "dtrepair:layer"},
        "/Hero/Coat": {"layer": 2},
    }
    again = RepairSettings.from_report(recorded)
    assert again.objects == settings.objects
    body, coat = layers(stage, again.objects, *again.tables)
    assert body is not None and body.tolist() == numbers
    assert coat is not None and coat.tolist() == [2] * COUNT


def test_a_run_with_other_layers_does_not_go_on_with_an_old_one(stage: Path) -> None:
    """The numbers of faces are no part of the settings, which name their primvar only."""
    source = open_source(str(stage), Selection())
    rests = choose_rests(source, None, device="cpu")
    hashes = []
    for number in (1, 1, 2):
        add_layer(stage, "/Hero/Coat", [number] * COUNT, "uniform")
        source = open_source(str(stage), Selection())
        bodies = make_bodies(source, rests, read_controls(source, NOTHING)).bodies
        hashes.append(hash_of_run({}, "cpu", bodies, source.times))
    assert hashes[0] == hashes[1] != hashes[2]


def test_the_command_line_and_the_config_file(stage: Path, tmp_path: Path) -> None:
    out = ["repair", stage, "-o", tmp_path / "b.usda", "--dry-run"]
    assert "layer 2" in run(*out, "--layer", "/Hero/Coat=2").out
    config = tmp_path / "c.toml"
    for text in ('layer = ["/Hero/Coat=2"]', '[[prim]]\npath = "/Hero/Coat"\nlayer = 2'):
        config.write_text(text)
        assert "layer 2" in run(*out, "--config", config).out
    assert_fails(run(*out, "--layer", "/Hero/Coat"), 2, "expected a prim and a whole number")
    assert_fails(run(*out, "--layer", "/Hero/Hat=1"), 2, "--layer", "none of the selected")
    mesh = tube_obj(tmp_path / "m.obj")
    words = (2, "only for USD stages")
    assert_fails(run("repair", mesh, "-o", tmp_path / "n.obj", "--layer", "/A=1"), *words)


def test_who_asks_a_collider_to_move_as_a_whole_is_warned(stage: Path, tmp_path: Path) -> None:
    out = ["repair", stage, "-o", tmp_path / "b.usda", "--dry-run", "--collider", "/Hero/Coat"]
    expected = "rigid has no effect on colliders, which never move: /Hero/Coat\n"
    assert f"warning: --rigid /Hero: {expected}" in run(*out, "--rigid", "/Hero").err
    assert expected not in run(*out, "--rigid", "/Hero/Body").err
    table = tmp_path / "c.toml"
    table.write_text('[[prim]]\npath = "/Hero/Coat"\nrigid = true')
    assert f"[[prim]] /Hero/Coat: {expected}" in run(*out, "--config", table).err


def test_wrong_primvars_and_methods_are_refused(stage: Path, tmp_path: Path) -> None:
    add_layer(stage, "/Hero/Coat", [1, 2, 3], "uniform")
    assert_fails(
        run("repair", stage, "-o", tmp_path / "b.usda"), 3, "one number for each of", "/Hero/Coat"
    )
    table = PrimTable("/Hero/Body", ObjectSettings(layer="cloth"))
    with pytest.raises(UsageError, match="layer cloth: has no primvar of that name"):
        layers(stage, NOTHING, table)
    paper = RepairOptions(method="paper")
    with pytest.raises(UsageError, match="--layer: has no effect"):
        plan_repair(
            stage, tmp_path / "b.usda", options=paper, objects=ObjectOptions(layer=("/A=1",))
        )
