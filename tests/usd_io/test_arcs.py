"""Value clips: their layers are looked at as those that a stage refers to."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf

from tests.usd_io.test_crate_check import MANY, patched, sections
from tests.usd_stages import cube_file, moved_cube
from usd_io import StageError, input_digest, open_stage, read_frame, read_meshes
from usd_io.arcs import find_arcs

STAGE = """#usda 1.0
(defaultPrim = "Root"
 startTimeCode = 1
 endTimeCode = 3)
def Xform "Root" (
    clips = {{ dictionary default = {{
        string primPath = "/Root"
        {clips}
    }} }}
)
{{
    def Mesh "Cube"
    {{
        int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
        int[] faceVertexIndices = [{corners}]
        uniform token subdivisionScheme = "none"
    }}
}}
"""
CORNERS = "0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5"
LISTED = """asset[] assetPaths = [{assets}]
        asset manifestAssetPath = @./manifest.usda@
        double2[] active = [(1, 0), (2, 1), (3, 2)]
        double2[] times = [(1, 1), (2, 2), (3, 3)]"""
NUMBERED = """string templateAssetPath = "./clip.###.{kind}"
        double templateStartTime = 1
        double templateEndTime = 3
        double templateStride = 1
        asset manifestAssetPath = @./manifest.usda@"""


def clip_stage(folder: Path, kind: str, *, listed: bool) -> tuple[Path, list[Path]]:
    """A stage whose cube has a value clip for each of three frames; and the files of these."""
    files = [folder / f"clip.{frame:03d}.{kind}" for frame in (1, 2, 3)]
    for frame, file in enumerate(files, start=1):
        cube_file(file, times=[float(frame)])
    manifest = 'def "Root" {\n over "Cube" {\n point3f[] points\n }\n}\n'
    (folder / "manifest.usda").write_text("#usda 1.0\n" + manifest)
    assets = ", ".join(f"@./{file.name}@" for file in files)
    clips = LISTED.format(assets=assets) if listed else NUMBERED.format(kind=kind)
    path = folder / "shot.usda"
    path.write_text(STAGE.format(clips=clips, corners=CORNERS))
    return path, files


@pytest.mark.parametrize("listed", [True, False])
@pytest.mark.parametrize("kind", ["usda", "usdc"])
def test_layers_of_clips_are_found(tmp_path: Path, kind: str, listed: bool) -> None:
    path, files = clip_stage(tmp_path, kind, listed=listed)
    (tmp_path / f"clip.01.{kind}").write_text("too few digits")
    arcs, _ = find_arcs(Sdf.Layer.FindOrOpen(str(path)))
    named = [arc.asset for arc in arcs if arc.clip]
    assert sorted(named) == sorted(map(str, [*files, tmp_path / "manifest.usda"]))


def test_numbered_files_outside_of_the_range_are_none_of_the_clips(tmp_path: Path) -> None:
    path, files = clip_stage(tmp_path, "usdc", listed=False)
    for number in ("000", "004", "900"):
        (tmp_path / f"clip.{number}.usdc").write_bytes(b"being written")
    arcs, _ = find_arcs(Sdf.Layer.FindOrOpen(str(path)))
    named = [arc.asset for arc in arcs if arc.clip]
    assert sorted(named) == sorted(map(str, [*files, tmp_path / "manifest.usda"]))


def test_a_template_of_three_numbers_names_nothing(tmp_path: Path) -> None:
    path, files = clip_stage(tmp_path, "usdc", listed=False)
    path.write_text(path.read_text().replace("clip.###.", "clip.#.#.#."))
    (tmp_path / "clip.1.2.3.usdc").write_bytes(files[0].read_bytes())
    arcs, _ = find_arcs(Sdf.Layer.FindOrOpen(str(path)))
    named = [arc.asset for arc in arcs if arc.clip]
    assert named == [str(tmp_path / "manifest.usda")]


@pytest.mark.parametrize(
    "wrong",
    [
        'string a = "x"',
        "dictionary a = { asset templateAssetPath = @./clip.###.usdc@ }",
        "dictionary a = { int assetPaths = 3 }",
        'dictionary a = { string manifestAssetPath = "m" }',
    ],
)
def test_clips_of_wrong_types_name_nothing(wrong: str) -> None:
    layer = Sdf.Layer.CreateAnonymous(".usda")
    prim = f'def "Root" (\n clips = {{\n {wrong}\n }}\n) {{}}\n'
    assert layer.ImportFromString("#usda 1.0\n" + prim)
    assert find_arcs(layer)[0] == []


@pytest.mark.parametrize("listed", [True, False])
def test_a_clip_that_announces_gigabytes_is_refused(tmp_path: Path, listed: bool) -> None:
    path, files = clip_stage(tmp_path, "usdc", listed=listed)
    bad = patched(files[1], sections(files[1].read_bytes())["SPECS"][1], MANY)
    os.replace(bad, files[1])
    with pytest.raises(StageError, match=r"clip\.002\.usdc: .*specs are announced"):
        open_stage(path)


@pytest.mark.parametrize("kind", ["usda", "usdc"])
def test_a_clip_that_is_cut_while_the_stage_is_read_is_told(tmp_path: Path, kind: str) -> None:
    path, files = clip_stage(tmp_path, kind, listed=True)
    opened = open_stage(path)
    mesh = read_meshes(opened).meshes[0]
    first = read_frame(mesh, 1.0)
    assert first is not None and np.array_equal(first, moved_cube(1.0))
    os.truncate(files[2], 30)
    if kind == "usda":  # parsed from memory before
        last = read_frame(mesh, 3.0)
        assert last is not None and np.array_equal(last, moved_cube(3.0))
    with pytest.raises(StageError, match=rf"clip\.003\.{kind}: was changed while it was read"):
        opened.check_unchanged()


def test_clips_belong_to_the_digest_before_they_are_needed(tmp_path: Path) -> None:
    path, files = clip_stage(tmp_path, "usdc", listed=True)
    before = input_digest(open_stage(path))
    cube_file(files[2], times=[3.0, 4.0])
    assert input_digest(open_stage(path)) != before
