"""Where `OverrideWriter` may write, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdUtils

from tests.usd_rewriting import points_at, rewrite
from tests.usd_stages import (
    CUBE,
    cube_file,
    moved_cube,
)
from usd_io import (
    OutputError,
    OverrideWriter,
    StageError,
    UsageError,
    open_stage,
    read_meshes,
)


def test_output_elsewhere_refers_to_the_input_relatively(tmp_path: Path) -> None:
    (tmp_path / "shots").mkdir()
    (tmp_path / "fixed").mkdir()
    path = cube_file(tmp_path / "shots" / "in.usda", times=[1.0])
    rewrite(path, tmp_path / "fixed" / "out.usdc")
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "fixed" / "out.usdc"))
    assert layer.subLayerPaths == ["../shots/in.usda"]
    moved = tmp_path / "moved"
    moved.mkdir()
    (tmp_path / "shots").rename(moved / "shots")
    (tmp_path / "fixed").rename(moved / "fixed")
    np.testing.assert_array_equal(points_at(moved / "fixed" / "out.usdc", 1.0), moved_cube(1.0) + 1)
    assert Usd.Stage.Open(str(moved / "fixed" / "out.usdc")).GetPrimAtPath("/Root/Cube").IsDefined()


def test_usdz_in_is_fine_and_out_is_refused(tmp_path: Path) -> None:
    cube_file(tmp_path / "cube.usdc", times=[1.0])
    package = tmp_path / "in.usdz"
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "cube.usdc"), str(package))
    rewrite(package, tmp_path / "out.usdc")
    np.testing.assert_array_equal(points_at(tmp_path / "out.usdc", 1.0), moved_cube(1.0) + 1)
    with pytest.raises(UsageError, match="usdz package cannot be written"):
        rewrite(package, tmp_path / "out.usdz")


def test_output_that_is_a_layer_of_the_stage_is_refused(tmp_path: Path) -> None:
    cube_file(tmp_path / "anim.usdc", times=[1.0])
    cube_file(tmp_path / "asset.usda")
    layer = Sdf.Layer.CreateNew(str(tmp_path / "in.usda"))
    layer.subLayerPaths = ["./later.usdc", "./anim.usdc"]
    layer.Save()
    stage = Usd.Stage.Open(str(tmp_path / "in.usda"))
    stage.DefinePrim("/Root/Prop").GetPayloads().AddPayload("./asset.usda")
    layer.Save()
    (tmp_path / "link.usdc").symlink_to(tmp_path / "anim.usdc")
    (tmp_path / "hard.usdc").hardlink_to(tmp_path / "anim.usdc")
    opened = open_stage(tmp_path / "in.usda")
    names = ["in.usda", "anim.usdc", "asset.usda", "link.usdc", "hard.usdc", "later.usdc"]
    for name in names:
        before = (tmp_path / name).read_bytes() if (tmp_path / name).exists() else None
        with pytest.raises(UsageError, match="part of the input stage") as caught:
            OverrideWriter(opened, tmp_path / name, settings={})
        assert caught.value.exit_code == 2
        after = (tmp_path / name).read_bytes() if (tmp_path / name).exists() else None
        assert after == before


def test_outputs_that_cannot_be_written_fail_at_once(tmp_path: Path) -> None:
    opened = open_stage(cube_file(tmp_path / "in.usda"))
    (tmp_path / "folder.usdc").mkdir()
    for name, reason in (
        ("nowhere/out.usdc", "no directory"),
        ("folder.usdc", "is a directory"),
        ("in.usda/out.usdc", "no directory"),
    ):
        with pytest.raises(OutputError, match=reason) as caught:
            OverrideWriter(opened, tmp_path / name, settings={})
        assert caught.value.exit_code == 5
    with pytest.raises(OutputError, match="cannot write into /proc"):
        OverrideWriter(opened, "/proc/out.usdc", settings={})
    with pytest.raises(UsageError, match=r"ending in \.usd"):
        OverrideWriter(opened, tmp_path / "out.txt", settings={})
    assert not (tmp_path / "nowhere").exists()


def test_a_stage_in_memory_has_no_path_to_refer_to(tmp_path: Path) -> None:
    with pytest.raises(StageError, match="in memory only"):
        OverrideWriter(Usd.Stage.CreateInMemory(), tmp_path / "out.usdc", settings={})


def test_bad_points_are_refused(tmp_path: Path) -> None:
    opened = open_stage(cube_file(tmp_path / "in.usda", times=[1.0]))
    mesh = read_meshes(opened).meshes[0]
    with OverrideWriter(opened, tmp_path / "out.usdc", settings={}) as writer:
        with pytest.raises(ValueError, match=r"frame 1: expected points \(8, 3\), got \(7, 3\)"):
            writer.write(mesh, 1.0, CUBE[:7])
        with pytest.raises(ValueError, match="expected finite points"):
            writer.write(mesh, 1.0, CUBE * np.nan)
        with pytest.raises(ValueError, match="expected finite points"):
            writer.write(mesh, 1.0, CUBE.astype(np.float64) * 1e39)


def test_writers_and_meshes_belong_together(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usda", times=[1.0])
    opened = open_stage(path)
    mesh, stranger = (read_meshes(stage).meshes[0] for stage in (opened, open_stage(path)))
    writer = OverrideWriter(opened, tmp_path / "out.usdc", settings={})
    with pytest.raises(ValueError, match="lies on another stage"):
        writer.write(stranger, 1.0, CUBE)
    writer.commit()
    with pytest.raises(ValueError, match="committed or aborted before"):
        writer.write(mesh, 1.0, CUBE)
    with pytest.raises(ValueError, match="committed or aborted before"):
        writer.commit()
    assert (tmp_path / "out.usdc").exists()
