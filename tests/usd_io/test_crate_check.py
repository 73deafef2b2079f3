"""Binary layers whose tables announce more than their bytes can hold."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import pytest
from pxr import Sdf

from tests.usd_stages import cube_file
from usd_io import StageError, join_layers, open_stage
from usd_io.crate_check import check_crates

# Section of a table, which of its 64-bit numbers, and what is told of it.
NUMBERS = [
    ("TOKENS", 0, "tokens are"),
    ("TOKENS", 1, "tokens of 300,000,000 bytes"),
    ("TOKENS", 2, "tokens compressed to 300,000,000 bytes"),
    ("STRINGS", 0, "strings are"),
    ("FIELDS", 0, "fields are"),
    ("FIELDSETS", 0, "fieldsets are"),
    ("PATHS", 0, "paths are"),
    ("PATHS", 1, "paths are"),
    ("SPECS", 0, "specs are"),
]
MANY = 300_000_000


def sections(data: bytes) -> dict[str, tuple[int, int]]:
    """Where each section of a crate has its entry in the table of sections, and where it begins."""
    (table,) = struct.unpack_from("<q", data, 16)
    (count,) = struct.unpack_from("<Q", data, table)
    places = range(table + 8, table + 8 + 32 * count, 32)
    entries = [(place, *struct.unpack_from("<16sq", data, place)) for place in places]
    return {name.rstrip(b"\0").decode(): (place, start) for place, name, start in entries}


def patched(path: Path, at: int, number: int) -> Path:
    """A copy of a file with another 64-bit number in it."""
    data = bytearray(path.read_bytes())
    struct.pack_into("<Q", data, at, number)
    other = path.with_name("announcing.usdc")
    other.write_bytes(data)
    return other


@pytest.fixture
def cube(tmp_path: Path) -> Path:
    return cube_file(tmp_path / "cube.usdc", times=[1.0, 2.0])


@pytest.mark.parametrize(("name", "number", "told"), NUMBERS)
def test_a_table_that_announces_gigabytes_is_refused(
    cube: Path, name: str, number: int, told: str
) -> None:
    start = sections(cube.read_bytes())[name][1]
    path = patched(cube, start + 8 * number, MANY)
    with pytest.raises(StageError, match=rf"announcing\.usdc: .*{told} .*announced in .*; export"):
        open_stage(path)
    with pytest.raises(StageError, match=told):
        join_layers([path], cube.with_name("joined.usdc"))


def test_sections_lie_within_the_file(cube: Path) -> None:
    data = cube.read_bytes()
    (table,) = struct.unpack_from("<q", data, 16)
    with pytest.raises(StageError, match="300,000,000 sections are announced"):
        open_stage(patched(cube, table, MANY))
    place = sections(data)["SPECS"][0]
    with pytest.raises(StageError, match=r"300,000,000 bytes of specs from .* are announced"):
        open_stage(patched(cube, place + 24, MANY))


def test_layers_in_a_package_are_looked_at(cube: Path) -> None:
    bad = patched(cube, sections(cube.read_bytes())["SPECS"][1], MANY)
    for file, refused in ((cube, False), (bad, True)):
        package = cube.with_suffix(f".{refused}.usdz")
        with zipfile.ZipFile(package, "w", zipfile.ZIP_STORED) as archive:
            archive.write(file, "shot.usdc")
        if refused:
            with pytest.raises(StageError, match=r"usdz\[shot\.usdc\]: .*specs are announced"):
                check_crates(str(package))
        else:
            check_crates(str(package))


def test_what_compresses_best_is_no_fault(tmp_path: Path) -> None:
    """Prims that are all alike: the numbers of their tables are hardly there."""
    layer = Sdf.Layer.CreateNew(str(tmp_path / "alike.usdc"))
    with Sdf.ChangeBlock():
        for index in range(20_000):
            Sdf.CreatePrimInLayer(layer, f"/p{index}")
    layer.Save()
    assert len(open_stage(tmp_path / "alike.usdc").stage.GetPseudoRoot().GetAllChildren()) == 20_000


def test_other_damage_is_left_to_the_reader_of_usd(cube: Path) -> None:
    data = cube.read_bytes()
    for length in (4, 12, 60, len(data) // 2, len(data) - 1):
        short = cube.with_name("short.usdc")
        short.write_bytes(data[:length])
        with pytest.raises(StageError, match="cannot be opened as USD"):
            open_stage(short)
    (cube.with_name("a.usdz")).write_bytes(b"PK\x03\x04" + data)
    check_crates(str(cube.with_name("a.usdz")))
