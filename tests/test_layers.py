"""The walls of the house: who may import whom, and what an import loads."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from tests.layering import (
    arrows_up,
    circles,
    import_graph,
    imported,
    rows_missing_or_idle,
    rows_upside_down,
    sources,
)

ROOT = Path(__file__).resolve().parents[1]
FILES = sources(ROOT, ("dtrepair", "usd_io"))
GRAPH = import_graph(FILES)

_TOLD = "files diagnosis device wording"
_HEARD = "observer selection errors"
_SOLVERS = "parallel elastic surface result options"
_ALL = f"scene full {_SOLVERS}"
# Each package from top to bottom: a room, and which rooms below it it may import.
WALLS = {
    "dtrepair": {
        "__main__": "cli",
        "cli": f"pipeline __init__ report keyposes transfer repair intersect display demo {_TOLD}",
        "pipeline": f"__init__ report keyposes transfer repair intersect numerics display {_TOLD}",
        "__init__": "transfer repair intersect diagnosis",
        "report": "keyposes files diagnosis wording",
        "keyposes": "numerics",
        "transfer": "numerics files",
        "repair": "intersect numerics diagnosis device",
        "intersect": "numerics diagnosis device",
        "display": "files",
        "demo": "",
        "files": "",
        "numerics": "",
        "diagnosis": "strain wording",
        "strain": "wording",
        "device": "",
        "wording": "",
    },
    "dtrepair.cli": {
        "__init__": "app",
        "commands": "app exit_codes options terminal",
        "app": "exit_codes options terminal",
        "exit_codes": "",
        "options": "terminal",
        "terminal": "",
    },
    "dtrepair.pipeline": {
        "__init__": f"page check check_settings join transfer keyposes repair stages {_HEARD}",
        "page": f"repair modelled stages {_HEARD}",
        "keyposes": f"repair modelled stages clock {_HEARD}",
        "join": "stages selection errors",
        "check": f"check_settings repair modelled stages clock {_HEARD}",
        "check_settings": "selection errors",
        "transfer": f"repair modelled stages clock {_HEARD}",
        "repair": f"modelled stages clock {_HEARD}",
        "modelled": f"stages {_HEARD}",
        "stages": _HEARD,
        "clock": "",
        "observer": "errors",
        "selection": "errors",
        "errors": "",
    },
    "dtrepair.pipeline.stages": {
        "__init__": "",
        "enclosed_parts": "bodies frames sources",
        "bodies": "shot rest object_settings matching frames sources",
        "plan": "rest sources",
        "shot": "rest sources",
        "rest": "frames sources",
        "object_settings": "matching sources",
        "matching": "sources",
        "sinks": "outputs sources",
        "outputs": "sources",
        "world_mesh": "frames sources",
        "frames": "sources",
        "devices": "",
        "sources": "",
    },
    "dtrepair.report": {
        "page": "parts",
        "joining": "record findings parts",
        "record": "sections schema findings parts",
        "sections": "",
        "parts": "",
        "fields": "command_fields",
        "command_fields": "",
        "schema": "findings conformance",
        "findings": "",
        "conformance": "",
    },
    "dtrepair.repair": {
        "__init__": "repairer result options",
        "repairer": f"solution_cache clip independent independent_options relief separation {_ALL}",
        "solution_cache": f"clip independent separation scene full paper {_SOLVERS}",
        "clip": f"frame independent single_poses independent_options separation relief {_ALL}",
        "independent": f"independent_options single_poses separation relief strain {_ALL}",
        "single_poses": f"independent_options torn_poses separation relief frame {_ALL}",
        "independent_options": "torn_poses separation relief frame strain full paper options",
        "torn_poses": f"separation scene {_SOLVERS}",
        "relief": f"frame scene strain full {_SOLVERS}",
        "frame": f"strain {_ALL}",
        "separation": f"scene full {_SOLVERS}",
        "scene": f"strain full paper {_SOLVERS}",
        "strain": "",
        "full": f"stage_log {_SOLVERS}",
        "stage_log": f"{_SOLVERS}",
        "paper": _SOLVERS,
        "parallel": "surface options",
        "elastic": "surface options",
        "surface": "options",
        "result": "",
        "options": "",
    },
    "dtrepair.intersect": {
        "queries": "detector query_kernels proximity_kernels",
        "scene_counts": "detector ignored __init__",
        "proximity": "detector ignored proximity_kernels",
        "detector": "exact ignored topology kernels predicates tree",
        "exact": "topology exact_kernels",
        "ignored": "__init__",
        "topology": "tree",
        "tree": "",
        "query_kernels": "",
        "proximity_kernels": "",
        "exact_kernels": "predicates",
        "fixed_kernels": "kernels predicates",
        "kernels": "predicates",
        "predicates": "",
        "__init__": "",
    },
    "dtrepair.transfer": {
        "__init__": "report pins deformation following matching",
        "following": "",
        "report": "deformation matching gradients arrays",
        "pins": "deformation gradients arrays",
        "deformation": "placement poisson matching gradients arrays",
        "rests": "matching arrays",
        "placement": "gradients arrays",
        "poisson": "gradients",
        "matching": "gradients arrays",
        "gradients": "arrays",
        "arrays": "",
    },
    "dtrepair.numerics": {
        "__init__": "",
        "attached": "attachments worn closest_point enclosure geometry",
        "attachments": "closest_point geometry",
        "worn": "closest_point enclosure operators recent geometry",
        "closest_point": "geometry",
        "enclosure": "geometry",
        "geodesics": "geometry",
        "metrics": "geometry",
        "operators": "geometry work",
        "recent": "geometry",
        "scale": "geometry",
        "temporal": "geometry",
        "low_rank": "",
        "geometry": "",
        "threads": "",
        "work": "",
    },
    "usd_io": {
        "__init__": "write read times errors",
        "write": "read layers times polygons normals values paths crate_check diagnostics errors",
        "read": "layers times frame_grid polygons values paths expressions diagnostics errors",
        "layers": "arcs crate_check lease diagnostics errors",
        "arcs": "",
        "lease": "",
        "times": "errors",
        "frame_grid": "",
        "polygons": "errors",
        "normals": "errors",
        "values": "",
        "paths": "errors",
        "expressions": "errors",
        "crate_check": "errors",
        "diagnostics": "errors",
        "errors": "",
    },
}
# What is still to be opened. A line that is no longer needed fails, so the lists only shrink.
KNOWN_ARROWS: set[str] = set()

# Packages that only these may name.
OWNERS = {
    "cholespy": ("dtrepair.numerics.operators",),
    "click": ("dtrepair.cli",),
    "matplotlib": ("dtrepair.display.render",),
    "pxr": ("usd_io", "dtrepair.cli"),
    "rich": ("dtrepair.cli",),
    "trimesh": ("dtrepair.files.mesh_files",),
    "usd_io": ("usd_io", "dtrepair.pipeline", "dtrepair.cli.commands"),
    "dtrepair": ("dtrepair",),
}
KNOWN_STRANGERS: set[str] = set()


def within(name: str, parents: tuple[str, ...]) -> bool:
    return any(name == parent or name.startswith(parent + ".") for parent in parents)


def strangers(files: dict[str, Path]) -> set[str]:
    """Modules that name a package which they do not own, as "module names package"."""
    return {
        f"{name} names {package}"
        for name, path in files.items()
        for package in {used.partition(".")[0] for used in imported(path)} & set(OWNERS)
        if not within(name, OWNERS[package])
    }


def loaded_by(statements: str) -> set[str]:
    """Top-level modules in sys.modules after the statements, in a fresh interpreter."""
    code = f"{statements}\nimport sys\nprint(*{{name.partition('.')[0] for name in sys.modules}})"
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert run.stderr == ""
    return set(run.stdout.split())


def test_a_room_imports_only_what_lies_below_it() -> None:
    assert arrows_up(GRAPH, WALLS) == KNOWN_ARROWS


def test_no_modules_import_one_another_in_a_circle() -> None:
    assert not circles(GRAPH)


def test_every_room_has_a_row_and_rows_name_only_rows_below() -> None:
    assert not rows_missing_or_idle(FILES, WALLS)
    assert not rows_upside_down(WALLS)


def test_only_its_owner_names_a_package() -> None:
    assert strangers(FILES) == KNOWN_STRANGERS


def test_no_test_imports_a_benchmark() -> None:
    files = sources(ROOT, ("tests",)).values()
    assert not [path for path in files if any(within(n, ("benchmarks",)) for n in imported(path))]


def test_folders_are_small() -> None:
    sizes = Counter(path.parent for path in FILES.values() if path.name != "__init__.py")
    assert max(sizes.values()) <= 13


@pytest.fixture
def house(tmp_path: Path) -> dict[str, Path]:
    """A made-up tree that breaks every rule once."""
    texts = {
        "house/__init__.py": "",
        "house/roof.py": "import house.room.bed\nimport click",
        "house/cellar.py": "def f():\n    from house.roof import tile",
        "house/room/__init__.py": "",
        "house/room/bed.py": "from typing import TYPE_CHECKING\n"
        "if TYPE_CHECKING:\n    from house.room.lamp import Lamp",
        "house/room/lamp.py": "from house.room import bed",
    }
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return sources(tmp_path, ("house",))


def test_the_rules_notice_each_fault_of_a_made_up_tree(house: dict[str, Path]) -> None:
    graph = import_graph(house)
    good = {"house": {"roof": "room", "room": "", "cellar": ""}}
    assert graph["house.roof"] == {"house.room.bed"}
    assert arrows_up(graph, good) == {"house: cellar -> roof"}
    assert circles(graph) == [{"house.room.bed", "house.room.lamp"}]
    assert strangers(house) == {"house.roof names click"}
    assert not rows_missing_or_idle(house, good) and not rows_upside_down(good)
    idle = rows_missing_or_idle(house, {"house": {"roof": "", "room": "", "attic": ""}})
    assert idle == {"house.cellar", "house.attic"}
    assert rows_upside_down({"house": {"cellar": "roof", "roof": "cellar"}}) == {
        "house: roof -> cellar"
    }


def test_a_relative_import_is_refused(tmp_path: Path) -> None:
    (tmp_path / "near.py").write_text("from .far import thing")
    with pytest.raises(AssertionError, match="absolute names"):
        imported(tmp_path / "near.py")


SHELL = ("dtrepair.cli", "dtrepair.__main__", "usd_io")
LIBRARY = [name for name in FILES if not within(name, SHELL)]


def test_importing_dtrepair_is_light() -> None:
    loaded = loaded_by("import dtrepair; dir(dtrepair)")
    assert "dtrepair" in loaded
    assert not loaded & {"torch", "warp", "scipy", "numpy", "pxr", "trimesh", "usd_io"}


def test_importing_usd_io_is_light() -> None:
    assert not loaded_by("import usd_io; dir(usd_io)") & {"pxr", "torch", "dtrepair", "warp"}


def test_the_command_line_starts_light() -> None:
    loaded = loaded_by("import dtrepair.cli")
    assert not loaded & {"torch", "warp", "scipy", "pxr", "trimesh", "matplotlib"}


def test_the_core_never_loads_usd() -> None:
    core = [name for name in LIBRARY if not within(name, ("dtrepair.pipeline",))]
    loaded = loaded_by("\n".join(f"import {name}" for name in core))
    assert "torch" in loaded or "warp" in loaded
    assert not loaded & {"pxr", "usd_io"}


def test_usd_io_never_loads_the_core() -> None:
    names = [name for name in FILES if within(name, ("usd_io",))]
    loaded = loaded_by("\n".join(f"import {name}" for name in names))
    assert "pxr" in loaded
    assert not loaded & {"torch", "dtrepair", "warp", "scipy", "trimesh"}
