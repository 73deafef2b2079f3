"""Only a mesh knows where kernels run: no stage names a device, and none launches past it."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dtrepair import Repairer
from dtrepair.device import Device, start_warp
from tests.meshes import elbow

PACKAGE = Path(__file__).resolve().parents[1] / "dtrepair"
# What decides where work runs, for all others.
OWNER = PACKAGE / "device.py"


def named_devices(source: str) -> list[int]:
    """Lines of calls that are given a device by name, or launch, allocate or load by Warp."""
    lines = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call):
            continue
        named = [k.value for k in node.keywords if k.arg == "device"]
        if any(isinstance(value, ast.Constant) for value in named):
            lines.append(node.lineno)
        called = node.func
        if isinstance(called, ast.Attribute) and isinstance(
            called.value, (ast.Name, ast.Attribute)
        ):
            owner = called.value.id if isinstance(called.value, ast.Name) else called.value.attr
            if owner.strip("_") == "warp" and called.attr in ("launch", "force_load"):
                lines.append(node.lineno)
    return lines


def test_no_stage_names_a_device() -> None:
    files = [path for path in sorted(PACKAGE.rglob("*.py")) if path != OWNER]
    named = {
        str(path.relative_to(PACKAGE)): lines
        for path in files
        if (lines := named_devices(path.read_text(encoding="utf-8")))
    }
    assert not named


def test_a_named_device_is_seen() -> None:
    assert named_devices('warp.empty(3, device="cpu")\nwarp.empty(3, device=there)') == [1]
    assert named_devices("self._warp.launch(kernel, dim=3)\nself.device.launch(kernel, 3)") == [1]


def test_every_kernel_of_a_repair_runs_where_its_mesh_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Launches of the default method, single poses and a clip, all go through a `Device`."""
    warp = start_warp()
    through, all_of_them = Counter[str](), Counter[str]()
    launch, of_warp = Device.launch, warp.launch

    def watched(own: Device, kernel: Any, dim: Any, inputs: Sequence[Any]) -> None:
        through[kernel.key] += 1
        launch(own, kernel, dim, inputs)

    def counted(kernel: Any, *more: Any, **named: Any) -> Any:
        all_of_them[kernel.key] += 1
        return of_warp(kernel, *more, **named)

    monkeypatch.setattr(Device, "launch", watched)
    monkeypatch.setattr(warp, "launch", counted)
    (rest, faces), (bent, _) = elbow(0.0, 24, 8), elbow(2.9, 24, 8)
    repairer = Repairer(rest, faces)
    result = repairer(bent)
    assert result.before.triangles > 0 and result.after.triangles == 0
    assert len(list(repairer.animation(np.stack([bent, bent]), jobs=1))) == 2
    assert through == all_of_them
    expected = {"ring_distances", "hook_roots", "nearest_points", "fit_rotations", "cast_rays"}
    assert expected < set(through)
