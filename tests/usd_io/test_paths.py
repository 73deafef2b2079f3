"""Paths of layer files: what is the same file, how one file sees another, what can be written."""

from __future__ import annotations

from pathlib import Path

from tests.usd_stages import cube_file, moved_cube
from usd_io.paths import relative_asset_path, same_file


def test_relative_paths(tmp_path: Path) -> None:
    for name in ("a/b", "c"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "a" / "in.usda").touch()
    asset = str(tmp_path / "a" / "in.usda")
    assert relative_asset_path(asset, str(tmp_path / "a")) == "./in.usda"
    assert relative_asset_path(asset, str(tmp_path / "a" / "b")) == "../in.usda"
    assert relative_asset_path(asset, str(tmp_path)) == "./a/in.usda"
    assert relative_asset_path(f"{asset}[x.usda]", str(tmp_path)) == "./a/in.usda[x.usda]"
    # Through this link `..` is another directory than it looks.
    (tmp_path / "c" / "link").symlink_to(tmp_path / "a" / "b")
    other = tmp_path / "c" / "in.usda"
    other.touch()
    assert relative_asset_path(str(other), str(tmp_path / "c" / "link")) == str(other)


def test_same_file_sees_through_links(tmp_path: Path) -> None:
    cube_file(tmp_path / "a.usda")
    (tmp_path / "soft").symlink_to("a.usda")
    (tmp_path / "hard").hardlink_to(tmp_path / "a.usda")
    cube_file(tmp_path / "b.usda", points=moved_cube(1.0))
    for name, same in (("a.usda", True), ("soft", True), ("hard", True), ("b.usda", False)):
        assert same_file(str(tmp_path / "a.usda"), str(tmp_path / name)) == same
    assert same_file(str(tmp_path / "not"), str(tmp_path / "x" / ".." / "not"))
