"""What `dtrepair repair` wrote, read by pxr alone and counted by CGAL: the report says the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from dtrepair.report.record import read_report
from tests.cgal_reference import cgal_pairs
from tests.command_line import CLOSED, OPEN, run, tube_stage

# usd.md: an output layer authors these and nothing else.
ALLOWED = {"points", "extent"}


def triangles(mesh: UsdGeom.Mesh) -> NDArray[np.int32]:
    """Fans of the polygons, written down apart from `usd_io`."""
    corners, start, found = mesh.GetFaceVertexIndicesAttr().Get(), 0, []
    for count in mesh.GetFaceVertexCountsAttr().Get():
        polygon = corners[start : start + count]
        found += [(polygon[0], polygon[k], polygon[k + 1]) for k in range(1, count - 1)]
        start += count
    return np.array(found, dtype=np.int32)


# The published loop with few iterations leaves something, so that more than zeros is compared.
@pytest.mark.parametrize("options", [[], ["--method", "paper", "--iterations", "2"]])
def test_the_written_layer_holds_what_the_report_says(tmp_path: Path, options: list[str]) -> None:
    pytest.importorskip("CGAL.CGAL_Kernel")
    source = tube_stage(tmp_path / "in.usda", (OPEN, CLOSED, CLOSED + 0.2), rest=OPEN)
    out, report = tmp_path / "out.usdc", tmp_path / "report.json"
    code = run("repair", source, "-o", out, "--report", report, *options).code
    frames = read_report(report)["frames"]

    stage = Usd.Stage.Open(str(out))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Root/Tube"))
    faces = triangles(mesh)
    assert mesh.GetPointsAttr().GetTimeSamples() == [frame["time"] for frame in frames]
    counts = []
    for frame in frames:
        points = np.array(mesh.GetPointsAttr().Get(frame["time"]))
        pairs = cgal_pairs(points, faces)
        after = frame["after"]
        assert (len(pairs), len(np.unique(pairs))) == (after["pairs"], after["triangles"])
        assert np.allclose(mesh.GetExtentAttr().Get(frame["time"]), [points.min(0), points.max(0)])
        counts.append(len(pairs))
    assert code == (1 if any(counts) else 0)
    assert any(counts) == bool(options)

    layer = Sdf.Layer.FindOrOpen(str(out))
    assert list(layer.subLayerPaths) == ["./in.usda"]
    specs: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, specs.append)
    assert {path.name for path in specs if path.IsPropertyPath()} == ALLOWED
    prims = [layer.GetPrimAtPath(path) for path in specs if path.IsPrimPath()]
    assert {prim.specifier for prim in prims} == {Sdf.SpecifierOver}
    assert {key for prim in prims for key in prim.ListInfoKeys()} == {"specifier"}
