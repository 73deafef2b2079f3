"""Only a mesh knows where kernels run: no stage names a device, and none launches past it."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from dtrepair import Repairer
from dtrepair.device import Device, start_warp
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.elastic.arap import ArapSystem
from dtrepair.repair.full.method import FullMethod
from dtrepair.repair.surface.surface import Surface
from dtrepair.repair.surface.winding import winding_numbers
from tests.meshes import elbow

PACKAGE = Path(__file__).resolve().parents[1] / "dtrepair"
# What decides where work runs, for all others.
OWNER = PACKAGE / "device.py"


def named_devices(source: str) -> list[int]:
    """Lines of calls that are given a device by name, or launch or load kernels by Warp."""
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


def answers(surface: Surface, pose: FloatArray) -> tuple[list[NDArray[Any]], list[FloatArray]]:
    """What the kernels of a surface tell of a pose: what is counted, and what is measured."""
    pairs = surface.contacts.pairs(pose)
    above = np.asarray(pose[:, 2] > np.median(pose[:, 2]))
    counted = [pairs, surface.contacts.ring_distance(pairs), surface.components(above)]
    counted += [surface.contacts.folds(pose), surface.contacts.close_pairs(pose, 0.01)]
    counted += [winding_numbers(surface, pose, pairs)]
    system = ArapSystem(surface, surface.rest)
    return counted, [surface.vector_areas(pose), system.target(pose), system.rotations(pose)]


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_cuda_answers_as_the_cpu() -> None:
    """What is counted is equal; what is measured is rounded otherwise."""
    (rest, faces), (bent, _) = elbow(0.0, 24, 8), elbow(2.9, 24, 8)
    here, there = (Surface(rest, faces, device=name) for name in ("cpu", "cuda:0"))
    (counted, measured), found = (answers(s, bent / here.size) for s in (here, there))
    assert len(counted[0]) > 0
    assert all(np.array_equal(a, b) for a, b in zip(counted, found[0], strict=True))
    assert all(np.allclose(a, b, atol=1e-9) for a, b in zip(measured, found[1], strict=True))


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_a_pose_is_repaired_with_all_kernels_on_cuda() -> None:
    (rest, faces), (bent, _) = elbow(0.0, 24, 8), elbow(2.9, 24, 8)
    surface = Surface(rest, faces, device="cuda:0")
    found = FullMethod(surface)(bent / surface.size).points
    assert len(Surface(rest, faces).contacts.pairs(found)) == 0
