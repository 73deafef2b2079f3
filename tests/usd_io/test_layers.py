"""Layers that are cut while they are parsed, and what layers refer to."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from pxr import Ar, Sdf

from tests.command_line import assert_fails, run
from tests.usd_io.test_crate_check import MANY, patched, sections
from tests.usd_stages import cube_file
from usd_io import StageError, join_layers, open_stage, read_meshes
from usd_io.layers import find_layers, read_text

CUT = 30  # bytes that are left


@pytest.fixture
def cutting(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Text files that somebody cuts short as soon as a layer is parsed."""
    files: list[Path] = []
    parse = Sdf.Layer.ImportFromString

    def cut_and_parse(layer: Sdf.Layer, text: str) -> bool:
        for file in files:
            os.truncate(file, CUT)
        done: bool = parse(layer, text)
        return done

    monkeypatch.setattr(Sdf.Layer, "ImportFromString", cut_and_parse)
    return files


def referring(path: Path, to: Path, kind: str) -> Path:
    """A layer that has another as a sublayer, or whose prim refers to it; neither is composed."""
    layer = Sdf.Layer.CreateNew(str(path))
    prim = Sdf.CreatePrimInLayer(layer, "/Root")
    layer.defaultPrim, asset = "Root", f"./{to.name}"
    if kind == "sublayer":
        layer.subLayerPaths.append(asset)
    elif kind == "reference":
        prim.referenceList.Append(Sdf.Reference(asset))
    else:
        prim.payloadList.Append(Sdf.Payload(asset))
    layer.Save()
    return path


@pytest.mark.parametrize("name", ["shot.usda", "shot.usd"])
@pytest.mark.parametrize("kind", ["", "sublayer", "reference"])
def test_text_that_is_cut_while_it_is_parsed_is_whole_and_an_error_afterwards(
    tmp_path: Path, cutting: list[Path], name: str, kind: str
) -> None:
    file = cube_file(tmp_path / "written.usda", times=range(5)).rename(tmp_path / name)
    path = referring(tmp_path / "top.usdc", file, kind) if kind else file
    cutting.append(file)
    opened = open_stage(path)
    mesh = read_meshes(opened).meshes[0]
    assert len(mesh.times) == 5 and file.stat().st_size == CUT
    with pytest.raises(StageError, match=rf"{name}: was changed while it was read, from \d+ to 30"):
        opened.check_unchanged()


def test_the_command_line_tells_of_text_that_is_cut(tmp_path: Path, cutting: list[Path]) -> None:
    cutting.append(cube_file(tmp_path / "shot.usda", times=range(5)))
    assert_fails(run("check", cutting[0]), 3, "shot.usda: was changed while it was read")


def test_layers_that_are_open_stay_as_they_are(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "shot.usda")
    mine = Sdf.Layer.FindOrOpen(str(path))
    mine.defaultPrim = "Mine"
    assert open_stage(path).stage.GetRootLayer() == mine and mine.defaultPrim == "Mine"


def test_what_is_no_whole_text_is_left_to_the_reader_of_usd(tmp_path: Path) -> None:
    crate = cube_file(tmp_path / "crate.usdc").rename(tmp_path / "crate.usd")
    broken = tmp_path / "broken.usda"
    broken.write_text('#usda 1.0\ndef "x" {\n')
    gone = tmp_path / "gone.usda"
    assert [read_text(str(path)) for path in (crate, broken, gone)] == [None] * 3


@pytest.mark.parametrize("kind", ["", "sublayer", "reference"])
def test_text_that_is_no_utf_8_is_told_with_its_line(tmp_path: Path, kind: str) -> None:
    latin = tmp_path / "latin.usda"
    latin.write_bytes(b'#usda 1.0\ndef "x" (doc = "\xe4") {\n}\n')
    path = referring(tmp_path / "top.usdc", latin, kind) if kind else latin
    assert_fails(run("check", path), 3, r"latin.usda: line 2 is not UTF-8 (byte 0xe4)", "save it")
    with pytest.raises(StageError, match="line 2 is not UTF-8"):
        join_layers([latin], tmp_path / "joined.usda")


@pytest.mark.parametrize("top", ["top.usdc", "top.usda"])
@pytest.mark.parametrize("kind", ["sublayer", "reference", "payload"])
def test_binary_layers_that_announce_gigabytes_are_refused_wherever_they_are(
    tmp_path: Path, kind: str, top: str
) -> None:
    whole = cube_file(tmp_path / "whole.usdc")
    bad = patched(whole, sections(whole.read_bytes())["SPECS"][1], MANY)
    between = referring(tmp_path / "between.usdc", bad, kind)
    path = referring(tmp_path / top, between, "reference")
    with pytest.raises(StageError, match=r"announcing\.usdc: .*specs are announced"):
        open_stage(path)


def test_payloads_that_are_not_loaded_are_not_looked_into(tmp_path: Path) -> None:
    cube = cube_file(tmp_path / "cube.usdc")
    path = referring(tmp_path / "top.usda", cube, "payload")
    assert [Path(file).name for file in find_layers(str(path)).sizes] == ["top.usda", "cube.usdc"]
    assert [Path(file).name for file in find_layers(str(path), payloads=False).sizes] == [
        "top.usda"
    ]


VARIANTS = """#usda 1.0
def "x" (
    variants = {{ string look = "{chosen}" }}
    prepend variantSets = "look"
)
{{
    variantSet "look" = {{
        "one" (references = @./one.usda@) {{
        }}
        "two" {{
            def "y" (payload = @./two.usda@)
            {{
            }}
        }}
    }}
}}
"""


@pytest.mark.parametrize("chosen", ["one", "two"])
def test_only_variants_that_are_selected_are_looked_into(tmp_path: Path, chosen: str) -> None:
    for name in ("one", "two"):
        (tmp_path / f"{name}.usda").write_text('#usda 1.0\n(defaultPrim = "x")\ndef "x" {\n}\n')
    path = tmp_path / "top.usda"
    path.write_text(VARIANTS.format(chosen=chosen))
    found = [Path(file).name for file in find_layers(str(path)).sizes]
    assert found == ["top.usda", f"{chosen}.usda"]


def test_a_variant_that_a_weaker_layer_selects_is_looked_into(tmp_path: Path) -> None:
    (tmp_path / "two.usda").write_text('#usda 1.0\n(defaultPrim = "x")\ndef "x" {\n}\n')
    strong, weak = tmp_path / "strong.usda", tmp_path / "weak.usda"
    text = VARIANTS.format(chosen="two").replace('variants = { string look = "two" }', "")
    strong.write_text(text.replace("\n", "\n(subLayers = [@./weak.usda@])\n", 1))
    weak.write_text('#usda 1.0\nover "x" (variants = { string look = "two" }) {\n}\n')
    found = [Path(file).name for file in find_layers(str(strong)).sizes]
    assert found == ["strong.usda", "weak.usda", "two.usda"]


def test_assets_of_a_search_path_are_parsed_from_memory_too(
    tmp_path: Path, cutting: list[Path]
) -> None:
    (tmp_path / "library").mkdir()
    file = cube_file(tmp_path / "library" / "found.usda", times=range(5))
    top = Sdf.Layer.CreateNew(str(tmp_path / "top.usdc"))
    top.subLayerPaths.append("found.usda")
    top.Save()
    Ar.DefaultResolver.SetDefaultSearchPath([str(tmp_path / "library")])
    try:
        cutting.append(file)
        opened = open_stage(tmp_path / "top.usdc")
        assert len(read_meshes(opened).meshes[0].times) == 5 and file.stat().st_size == CUT
        with pytest.raises(StageError, match=r"found\.usda: was changed while it was read"):
            opened.check_unchanged()
    finally:
        Ar.DefaultResolver.SetDefaultSearchPath([])


def test_references_are_looked_into_without_payloads(tmp_path: Path) -> None:
    cube = cube_file(tmp_path / "cube.usdc")
    path = referring(tmp_path / "top.usda", cube, "reference")
    found = find_layers(str(path), payloads=False).sizes
    assert [Path(file).name for file in found] == ["top.usda", "cube.usdc"]


def test_layers_that_refer_to_each_other_are_read_once(tmp_path: Path) -> None:
    one, other = tmp_path / "one.usda", tmp_path / "other.usda"
    for path, to in ((one, other), (other, one)):
        path.write_text(f'#usda 1.0\ndef "x" (references = @./{to.name}@</x>)\n{{\n}}\n')
    assert len(find_layers(str(one)).held) == 2
