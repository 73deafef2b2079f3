"""The walls of the house: who may import whom, and what an import loads."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

# What each part may import of the project; the command line may import everything.
MAY_IMPORT = {
    "dtrepair.numerics.geometry": (),
    "dtrepair.device": (),
    "dtrepair.numerics.operators": ("dtrepair.numerics.geometry",),
    "dtrepair.numerics.metrics": ("dtrepair.numerics.geometry",),
    "dtrepair.wording": (),
    "dtrepair.intersect": ("dtrepair.numerics.geometry", "dtrepair.device", "dtrepair.intersect"),
    "dtrepair.transfer": (
        "dtrepair.numerics.geometry",
        "dtrepair.numerics.operators",
        "dtrepair.files.atomic",
        "dtrepair.transfer",
    ),
    "dtrepair.repair": (
        "dtrepair.numerics.geometry",
        "dtrepair.numerics.operators",
        "dtrepair.device",
        "dtrepair.numerics.metrics",
        "dtrepair.wording",
        "dtrepair.intersect",
        "dtrepair.repair",
    ),
    "dtrepair": ("dtrepair",),
    "usd_io": ("usd_io",),
}
# Packages that only these files may name.
OWNERS = {
    "cholespy": ("dtrepair.numerics.operators",),
    "trimesh": ("dtrepair.files.mesh_files",),
    "matplotlib": ("dtrepair.display.render",),
    "pxr": ("usd_io", "dtrepair.cli"),
}


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def sources() -> dict[str, Path]:
    """Module names and files of both packages."""
    files = [path for package in ("dtrepair", "usd_io") for path in (ROOT / package).rglob("*.py")]
    return {module_name(path): path for path in sorted(files)}


def within(name: str, parents: tuple[str, ...]) -> bool:
    return any(name == parent or name.startswith(parent + ".") for parent in parents)


def imported(path: Path) -> set[str]:
    """All modules that a file imports, inside functions too."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name} should import by absolute names"
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return names


def loaded_by(statements: str) -> set[str]:
    """Top-level modules in sys.modules after the statements, in a fresh interpreter."""
    code = f"{statements}\nimport sys\nprint(*{{name.partition('.')[0] for name in sys.modules}})"
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert run.stderr == ""
    return set(run.stdout.split())


CORE = [name for name in sources() if within(name, ("dtrepair",)) and "cli" not in name]
LIBRARY = [name for name in CORE if name != "dtrepair.__main__"]


@pytest.mark.parametrize("name", [n for n in sources() if not within(n, ("dtrepair.cli",))])
def test_a_file_imports_only_what_lies_below_it(name: str) -> None:
    part = max((part for part in MAY_IMPORT if within(name, (part,))), key=len)
    own = {n for n in imported(sources()[name]) if within(n, ("dtrepair", "usd_io"))}
    upward = [n for n in own if not within(n, MAY_IMPORT[part])]
    if name == "dtrepair.__main__":
        upward = []
    assert not upward, f"{name} should import from {MAY_IMPORT[part]} only"


@pytest.mark.parametrize("package", OWNERS)
def test_only_its_owner_names_a_package(package: str) -> None:
    users = {name for name, path in sources().items() if within_any(package, imported(path))}
    strangers = {name for name in users if not within(name, OWNERS[package])}
    assert not strangers


def within_any(package: str, names: set[str]) -> bool:
    return any(within(name, (package,)) for name in names)


def test_the_rules_notice_a_wrong_import(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.py"
    wrong.write_text("def f():\n    from dtrepair.repair import surface\n    import pxr.Usd\n")
    names = imported(wrong)
    assert not within("dtrepair.repair.surface.surface", MAY_IMPORT["dtrepair.transfer"])
    assert names == {"dtrepair.repair.surface.surface", "pxr.Usd"} and within_any("pxr", names)


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
    loaded = loaded_by("\n".join(f"import {name}" for name in LIBRARY))
    assert "torch" in loaded or "warp" in loaded
    assert not loaded & {"pxr", "usd_io"}


def test_usd_io_never_loads_the_core() -> None:
    names = [name for name in sources() if within(name, ("usd_io",))]
    loaded = loaded_by("\n".join(f"import {name}" for name in names))
    assert "pxr" in loaded
    assert not loaded & {"torch", "dtrepair", "warp", "scipy", "trimesh"}
