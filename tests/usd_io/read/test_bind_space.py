"""Displacements of posed points before the joints move them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdSkel, Vt

from tests.present import present
from tests.rigged_tube import MESH, POINTS, rigged_tube
from tests.usd_reading import selection_of
from usd_io import AnimatedMesh, FrameError
from usd_io.read.bind_space import bind_offsets


def rigged(path: Path, method: str = "classicLinear", joint_scale: float = 1.0) -> AnimatedMesh:
    rigged_tube(path, bulge=True, scale=2.0)
    stage = Usd.Stage.Open(str(path))
    UsdSkel.BindingAPI(stage.GetPrimAtPath(MESH)).CreateSkinningMethodAttr(method)
    animation = UsdSkel.Animation(stage.GetPrimAtPath("/Root/Animation"))
    scales = np.array([[1.0, 1.0, 1.0], [joint_scale, 1.0, 1.0]], dtype=np.float16)
    animation.GetScalesAttr().Set(Vt.Vec3hArray.FromNumpy(scales))
    stage.Save()
    return selection_of(path).meshes[0]


@pytest.mark.parametrize("method", ["classicLinear", "dualQuaternion"])
@pytest.mark.parametrize("time", [0.0, 3.0, 4.5])
def test_offsets_pose_the_mesh_as_wanted(tmp_path: Path, method: str, time: float) -> None:
    mesh = rigged(tmp_path / "in.usda", method, 0.5)
    skin = present(mesh.skin)
    old = present(skin.points(time))
    wanted = old.copy()
    wanted[::3] += np.random.default_rng(0).normal(0.0, 0.1, wanted[::3].shape)
    offsets, stretch = bind_offsets(mesh, time, wanted)
    assert not np.delete(offsets, np.s_[::3], axis=0).any() and offsets[::3].any(axis=1).all()
    posed = skin.posed(present(skin.unposed(time)) + offsets, time)
    np.testing.assert_allclose(posed, wanted, atol=2e-6)
    # The bind transform doubles all lengths; a blend of turned joints shrinks them again.
    assert (stretch[::3] <= 2.0 + 1e-3).all() and stretch[::3].max() > 1.99
    moved, lengths = (np.linalg.norm(part, axis=1) for part in (wanted - old, offsets))
    assert (moved <= stretch * lengths + 1e-6).all()


def test_flattened_points_cannot_be_moved(tmp_path: Path) -> None:
    mesh = rigged(tmp_path / "in.usda", joint_scale=0.0)
    old = present(present(mesh.skin).points(4.0))
    below = np.where(POINTS[:, 2:] < -0.5, old + np.float32(0.1), old)
    assert bind_offsets(mesh, 4.0, below)[0].any()
    with pytest.raises(FrameError, match="joints flatten what is to move"):
        bind_offsets(mesh, 4.0, old + np.float32(0.1))


def test_without_joints_offsets_are_those_of_the_points(tmp_path: Path) -> None:
    from tests.usd_stages import CUBE, cube_file

    mesh = selection_of(cube_file(tmp_path / "in.usda")).meshes[0]
    offsets, stretch = bind_offsets(mesh, np.nan, CUBE + np.float32(0.5))
    np.testing.assert_array_equal(offsets, np.full_like(CUBE, 0.5))
    assert (stretch == 1.0).all()
