"""The metadata of a layer that `OverrideWriter` wrote: those of the stage, and the record."""

from __future__ import annotations

from pathlib import Path

import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.usd_rewriting import rewrite, times_in
from tests.usd_stages import CUBE, cube_file
from usd_io import OverrideWriter, open_stage, read_meshes


@pytest.mark.parametrize("rate", [24.0, 25.0, 48.0, 60.0])
@pytest.mark.parametrize("keys", ["both", "timeCodesPerSecond", "framesPerSecond"])
def test_stage_metadata_is_copied(tmp_path: Path, rate: float, keys: str) -> None:
    path = cube_file(tmp_path / "in.usda", times=[1.0, 2.0])
    layer = Sdf.Layer.FindOrOpen(str(path))
    for key in ("timeCodesPerSecond", "framesPerSecond") if keys == "both" else (keys,):
        setattr(layer, key, rate)
    layer.startTimeCode, layer.endTimeCode = -3.0, 7.0
    layer.pseudoRoot.SetInfo("upAxis", "Z")
    layer.pseudoRoot.SetInfo("metersPerUnit", 0.01)
    layer.expressionVariables = {"SHOT": "sq10"}
    layer.customLayerData = {"camera": "persp"}
    layer.comment = "exported by hand"
    layer.Save()
    rewrite(path, tmp_path / "out.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    assert stage.GetTimeCodesPerSecond() == rate
    assert stage.GetRootLayer().HasTimeCodesPerSecond(), "left to a fallback"
    if keys != "timeCodesPerSecond":
        assert stage.GetFramesPerSecond() == rate
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (-3.0, 7.0)
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 0.01
    assert stage.GetDefaultPrim().GetPath() == "/Root"
    root = stage.GetRootLayer()
    assert root.expressionVariables == {"SHOT": "sq10"}
    assert set(root.customLayerData) == {"dtrepair"} and not root.comment
    # Everything else on the stage stays at its time, too.
    assert times_in(tmp_path / "out.usdc") == [1.0, 2.0]


def test_record_of_how_the_layer_was_made(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usda", times=[1.0, 2.0, 3.0])
    opened = open_stage(path)
    mesh = read_meshes(opened).meshes[0]
    settings = {"method": "full", "clearance": 0.0, "pin": None, "nested": {"steps": [1, 2]}}
    with OverrideWriter(
        opened, tmp_path / "out.usda", settings=settings, version="1.2.3"
    ) as writer:
        writer.write(mesh, 2.0, CUBE)
        writer.commit(record={"counts": {"before": 690, "after": 0}})
    record = Sdf.Layer.FindOrOpen(str(tmp_path / "out.usda")).customLayerData["dtrepair"]
    assert record["version"] == "1.2.3" and record["input"] == "./in.usda"
    assert record["settings"]["method"] == "full" and "pin" not in record["settings"]
    assert list(record["settings"]["nested"]["steps"]) == [1, 2]
    assert list(record["frames"]) == [2.0]
    assert list(record["written"]["/Root/Cube"]) == [2.0]
    assert record["counts"] == {"before": 690, "after": 0}
