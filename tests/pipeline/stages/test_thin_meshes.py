"""A clearance that is wide for thin meshes is questioned before anything is computed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dtrepair import RepairOptions
from dtrepair.pipeline import ObjectOptions, PrimTable, UsageError, plan_keyposes, plan_repair
from dtrepair.pipeline.selection import ObjectSettings
from tests.meshes import icosphere, tube
from tests.observers import Recorder

FINGER, BALL = "/Root/Finger", "/Root/Ball"


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    """A finger 0.2 thick beside a ball 2 thick, in a space that is stretched tenfold."""
    from pxr import Usd, UsdGeom

    from usd_io import AuthoredMesh, write_animation

    finger, ball = tube(radius=0.1), icosphere(2)
    meshes = [
        AuthoredMesh(path=FINGER, faces=finger[1], points=[finger[0]] * 2, rest=finger[0]),
        AuthoredMesh(path=BALL, faces=ball[1], points=[ball[0] + 5.0] * 2, rest=ball[0] + 5.0),
    ]
    path = tmp_path / "a.usda"
    write_animation(path, meshes, times=np.array([1.0, 2.0]))
    opened = Usd.Stage.Open(str(path))
    UsdGeom.Xformable(opened.GetPrimAtPath("/Root")).AddScaleOp().Set((10.0,) * 3)
    opened.Save()
    return path


def told(stage: Path, clearance: float, *, plan: Any = plan_repair, **choices: Any) -> list[str]:
    """The warnings of a plan that question the clearance."""
    observer = Recorder()
    options = RepairOptions(clearance=clearance)
    output = stage.with_name("out.usdc")
    plan(stage, output, options=options, observer=observer, **choices)
    return [text for text in observer.warnings if "thickness" in text]


@pytest.mark.parametrize("plan", [plan_repair, plan_keyposes])
def test_a_wide_clearance_is_questioned_with_the_thickness(stage: Path, plan: Any) -> None:
    (text,) = told(stage, 0.3, plan=plan)
    assert text.startswith(
        f"--clearance 0.3 is more than a tenth of the thickness of {FINGER}, 1.9"
    )
    assert text.endswith(("is 0.19 enough?", "is 0.2 enough?"))
    (text,) = told(stage, 2.5, plan=plan)
    assert f"of {FINGER} (and 1 other mesh), 1.9" in text


@pytest.mark.parametrize("plan", [plan_repair, plan_keyposes])
def test_one_that_is_refused_is_not_questioned_first(stage: Path, plan: Any) -> None:
    observer, options = Recorder(), RepairOptions(clearance=50.0)
    with pytest.raises(UsageError, match="--clearance 50: expected at most"):
        plan(stage, stage.with_name("out.usdc"), options=options, observer=observer)
    assert not any("thickness" in text for text in observer.warnings)


def test_a_narrow_clearance_is_not(stage: Path) -> None:
    assert told(stage, 0.15) == [] and told(stage, 0.0) == []


def test_what_keeps_its_shape_may_be_thin(stage: Path) -> None:
    assert told(stage, 0.3, objects=ObjectOptions(collider=FINGER)) == []
    assert told(stage, 0.3, objects=ObjectOptions(rigid=FINGER)) == []
    still = PrimTable(FINGER, ObjectSettings(mobility=0.0))
    assert told(stage, 0.3, tables=(still,)) == []
