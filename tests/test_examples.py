"""Every example runs as its first lines say, and shows what it claims."""

from __future__ import annotations

import ast
import os
import re
import runpy
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.command_line import run

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "examples"

# Script: what it has to print.
SHOWN = {
    "collide_objects.py": r"[1-9]\d* before\n.* 0 after\n.*unchanged",
    "find_intersections.py": r"[1-9]\d* pairs of .*\n.*: 0 0 .*[1-9]",
    "repair_animation.py": r"frame 5: [1-9]\d* -> 0\n(frame .* -> 0\n)+written: .*usdc",
    "repair_mesh.py": r"full: [1-9]\d* -> 0 .*clean.*\npaper: [1-9]\d* -> ",
    "transfer_pose.py": r"bend 1.5: 0 -> 0 .*\nbend 3.1: [1-9]\d* -> 0 ",
}


def test_every_script_is_run() -> None:
    assert {path.name for path in FOLDER.glob("*.py")} == {
        *SHOWN,
        "dressed_character.py",
        "shapes.py",
    }


@pytest.fixture
def run_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., str]:
    """Runs a script in this process, which has loaded what it imports; returns what it prints."""

    def run_script(name: str, *arguments: object) -> str:
        monkeypatch.chdir(tmp_path)
        monkeypatch.syspath_prepend(str(FOLDER))
        monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
        runpy.run_path(str(FOLDER / name), run_name="__main__")
        shown = capsys.readouterr()
        assert shown.err == ""
        return shown.out

    return run_script


@pytest.mark.parametrize("name", SHOWN)
def test_script(name: str, tmp_path: Path, run_here: Callable[..., str]) -> None:
    described = ast.get_docstring(ast.parse((FOLDER / name).read_text(encoding="utf-8"))) or ""
    assert f"\n    python examples/{name}" in described
    shown = run_here(name)
    assert re.search(SHOWN[name], shown), shown
    assert not list(tmp_path.iterdir())


def test_a_script_runs_from_any_folder_in_a_process_of_its_own(tmp_path: Path) -> None:
    name = "find_intersections.py"
    done = subprocess.run(
        [sys.executable, "-W", "error", str(FOLDER / name)],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0 and done.stderr == "", done.stderr
    assert re.search(SHOWN[name], done.stdout), done.stdout


def test_animation_example_writes_into_a_folder(
    tmp_path: Path, run_here: Callable[..., str]
) -> None:
    folder = tmp_path / "new"
    run_here("repair_animation.py", folder)
    assert run("check", folder / "shot.usda").code == 1
    assert run("check", folder / "shot_repaired.usdc").code == 0


def test_dressed_character_is_clean_at_rest_and_comes_through_its_clothes(
    tmp_path: Path, run_here: Callable[..., str]
) -> None:
    path = tmp_path / "dressed.usda"
    run_here("dressed_character.py", path)
    report = run("check", path, "--frames", "1,5", "--json", "-").json
    first, fifth = (frame["before"] for frame in report["frames"])
    assert first["pairs"] == 0 and fifth["inter_pairs"] > 100
    assert not fifth["modelled_pairs"]
    assert len(report["prims"]) == 3


def test_shapes_are_closed_and_wound_outward(monkeypatch: pytest.MonkeyPatch) -> None:
    import numpy as np

    from dtrepair.numerics.geometry import vector_areas

    monkeypatch.syspath_prepend(str(FOLDER))
    from shapes import arm, ball

    for points, faces in (arm(1.0), ball(0.3)):
        edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        directed = {tuple(edge) for edge in edges.tolist()}
        assert len(directed) == len(edges)
        assert all((b, a) in directed for a, b in directed)
        centroids = points[faces].mean(axis=1)
        assert np.einsum("fk,fk->", centroids, vector_areas(points, faces)) > 0
