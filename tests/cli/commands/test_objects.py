"""Settings of single objects: tables of --config, primvars, --rigid, --ignore."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.numerics.geometry import unique_edges
from dtrepair.report.record import read_report
from tests.command_line import assert_fails, run, tube_obj
from tests.meshes import icosphere, tube

Moved = tuple[float, float, NDArray[np.float64], dict[str, Any]]
Repair = Callable[..., Moved]

BALL, BALL_FACES = icosphere(2, radius=0.5)
ROD, ROD_FACES = tube(8, 12, radius=0.12, length=1.2)


@pytest.fixture
def rod_in_ball(tmp_path: Path) -> Path:
    """A rod that a transform moves into a ball."""
    from usd_io import AuthoredMesh, write_animation

    into = np.tile(np.eye(4), (3, 1, 1))
    into[:, 3, :3] = [(0.1, 0.05, height) for height in (2.0, 1.0, 0.95)]
    meshes = [
        AuthoredMesh(path="/Scene/Ball/Mesh", faces=BALL_FACES, rest=BALL),
        AuthoredMesh(path="/Scene/Rod/Mesh", faces=ROD_FACES, rest=ROD, transforms=into),
    ]
    path = tmp_path / "scene.usda"
    write_animation(path, meshes, times=(1.0, 2.0, 3.0))
    return path


@pytest.fixture
def repaired(rod_in_ball: Path, tmp_path: Path) -> Repair:
    """Runs `repair`; the largest move of ball and rod, the rod's points at time 3, the report."""

    def repair(*options: object) -> Moved:
        from pxr import Usd

        out, report = tmp_path / "out.usda", tmp_path / "report.json"
        done = run("repair", rod_in_ball, "-o", out, "--report", report, *options)
        assert done.code == 0, done
        moves: list[float] = []
        for prim, rest in (("/Scene/Ball/Mesh", BALL), ("/Scene/Rod/Mesh", ROD)):
            stage = Usd.Stage.Open(str(out))
            attribute = stage.GetPrimAtPath(prim).GetAttribute("points")
            points = np.array(attribute.Get(3), dtype=np.float64)
            moves.append(float(np.linalg.norm(points - np.float32(rest), axis=1).max()))
        return moves[0], moves[1], points, read_report(report)

    return repair


def config(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "settings.toml"
    path.write_text(text)
    return path


def add_primvar(
    path: Path, prim: str, name: str, kind: str, value: Any, *, primvar: bool = True
) -> None:
    from pxr import Sdf, Usd, UsdGeom

    stage = Usd.Stage.Open(str(path))
    kind = getattr(Sdf.ValueTypeNames, kind)
    if primvar:
        api = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(prim))
        api.CreatePrimvar(name, kind, "constant").Set(value)
        del api
    else:
        stage.GetPrimAtPath(prim).CreateAttribute(name, kind, True).Set(value)
    stage.Save()


def stretch(points: NDArray[np.float64]) -> float:
    edges = unique_edges(ROD_FACES)
    lengths = [np.linalg.norm(p[edges[:, 0]] - p[edges[:, 1]], axis=1) for p in (points, ROD)]
    return float(np.abs(lengths[0] / lengths[1] - 1.0).max())


def test_without_settings_both_move_and_bend(repaired: Repair) -> None:
    ball, rod, points, report = repaired()
    assert ball > 0 < rod and stretch(points) > 3e-5
    assert report["settings"]["objects"] == {}


@pytest.mark.parametrize("how", ["option", "table", "primvar", "attribute"])
def test_a_rigid_object_keeps_its_shape(
    repaired: Repair, rod_in_ball: Path, tmp_path: Path, how: str
) -> None:
    options: tuple[object, ...] = ()
    if how == "option":
        options = ("--rigid", "/Scene/Rod")
    elif how == "table":
        options = ("--config", config(tmp_path, '[[prim]]\npath = "/Scene/Rod"\nrigid = true\n'))
    elif how == "primvar":  # inherited from the prim above
        add_primvar(rod_in_ball, "/Scene/Rod", "dtrepair:rigid", "Bool", True)
    else:
        prim = "/Scene/Rod/Mesh"
        add_primvar(rod_in_ball, prim, "dtrepair:rigid", "Bool", True, primvar=False)
    _, rod, points, report = repaired(*options)
    assert rod > 0 and stretch(points) < 1e-5
    assert report["settings"]["objects"] == {"/Scene/Rod/Mesh": {"rigid": True}}


def test_tables_win_over_primvars_and_primvars_over_options(
    repaired: Repair, rod_in_ball: Path, tmp_path: Path
) -> None:
    add_primvar(rod_in_ball, "/Scene/Ball", "dtrepair:mobility", "Float", 0.0)
    ball, rod, *_ = repaired("--diffusion", "50")
    assert ball == 0.0 < rod
    table = '[[prim]]\npath = "//Ball//"\nmobility = 1\ndiffusion = 999\n'
    table += '[repair]\ndiffusion = 20\n[[repair.prim]]\npath = "/Scene/Rod//"\nmobility = 0.0\n'
    ball, rod, _, report = repaired("--config", config(tmp_path, table))
    assert ball > 0.0 == rod
    assert report["settings"]["diffusion"] == 20
    assert report["settings"]["objects"] == {
        "/Scene/Ball/Mesh": {"mobility": 1.0, "diffusion": 999.0},
        "/Scene/Rod/Mesh": {"mobility": 0.0},
    }


def test_a_collider_never_moves_whatever_a_table_says(repaired: Repair, tmp_path: Path) -> None:
    table = config(tmp_path, '[[prim]]\npath = "/Scene/Ball"\nmobility = 1.0\n')
    ball, rod, *_ = repaired("--config", table, "--collider", "/Scene/Ball/Mesh")
    assert ball == 0.0 < rod


def test_pins_of_a_single_object(repaired: Repair, rod_in_ball: Path, tmp_path: Path) -> None:
    from pxr import Sdf, Usd, UsdGeom

    stage = Usd.Stage.Open(str(rod_in_ball))
    half = (np.arange(len(ROD)) < len(ROD) // 2).astype(float).tolist()
    mesh = stage.GetPrimAtPath("/Scene/Rod/Mesh")
    for name in ("held", "dtrepair:pin"):
        UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(name, Sdf.ValueTypeNames.FloatArray, "vertex").Set(
            half
        )
    stage.Save()
    del mesh, stage
    *_, points, _ = repaired()  # the primvar
    assert np.array_equal(points[: len(ROD) // 2], np.float32(ROD[: len(ROD) // 2]))
    table = config(tmp_path, '[[prim]]\npath = "/Scene/Rod"\npin = "held"\n')
    *_, points, _ = repaired("--config", table)
    assert np.array_equal(points[: len(ROD) // 2], np.float32(ROD[: len(ROD) // 2]))
    wrong = config(tmp_path, '[[prim]]\npath = "/Scene/Ball"\npin = "held"\n')
    done = run("repair", rod_in_ball, "-o", tmp_path / "o.usda", "--config", wrong)
    where = (
        f"{wrong}: [[prim]] /Scene/Ball: pin held: /Scene/Ball/Mesh has no primvar or GeomSubset"
    )
    assert_fails(done, 2, where, "add it to the stage")
    wrong = config(tmp_path, '[[prim]]\npath = "/Scene/Ball"\ndirection = "up"\n')
    done = run("repair", rod_in_ball, "-o", tmp_path / "o.usda", "--config", wrong)
    assert_fails(done, 2, f"{wrong}: [[prim]] /Scene/Ball: direction up", "no vector primvar")
    done = run("repair", rod_in_ball, "-o", tmp_path / "o.usda", "--pin", "grip")
    assert_fails(done, 2, "--pin grip: none of /Scene/", "has a primvar or GeomSubset of that name")


def test_ignored_pairs(repaired: Repair, rod_in_ball: Path, tmp_path: Path) -> None:
    ball, rod, _, report = repaired("--ignore", "/Scene/Ball,//{isa:Mesh, isa:Mesh} - //Ball//")
    assert ball == rod == 0.0
    assert report["summary"]["pairs_before"] == 0
    assert run("check", rod_in_ball).code == 1
    assert run("check", rod_in_ball, "--ignore", "/Scene/Rod,/Scene/Ball").code == 0
    assert run("check", rod_in_ball, "--ignore", "/Scene/Rod,/Scene/Rod").code == 1
    table = config(tmp_path, 'ignore = "/Scene/Rod,/Scene/Ball"\n')
    assert run("check", rod_in_ball, "--config", table).code == 0


@pytest.mark.parametrize("text", ["/Scene/Rod", "/Scene/Rod,", "/a,/b,/c", "/Scene/Rod,/Nobody"])
def test_bad_ignored_pairs(rod_in_ball: Path, text: str) -> None:
    assert_fails(run("check", rod_in_ball, "--ignore", text), 2, "--ignore")


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ('path = "/Scene/Rod"\nmobilty = 1', ("'mobilty'", "mobility")),
        ('path = "/Scene/Sword"\nmobility = 1', ("/Scene/Sword", "matches none", "/Scene/Ball")),
        ('path = "/Scene/Rod"\nmobility = 7', ("mobility", "0 to 1", "7")),
        ('path = "/Scene/Rod"\ndiffusion = 0', ("diffusion", "positive")),
        ('path = "/Scene/Rod"\ndiffusion = "much"', ("diffusion", "number", "much")),
        ('path = "/Scene/Rod"\nrigid = 3', ("rigid", "true or false")),
        ('path = "/Scene/Rod"\npin = 3', ("pin", "name")),
        ("mobility = 1", ("[[prim]]", "path")),
    ],
)
def test_bad_tables_are_usage_errors(
    rod_in_ball: Path, tmp_path: Path, table: str, words: tuple[str, ...]
) -> None:
    path = config(tmp_path, f"[[prim]]\n{table}\n")
    done = run("repair", rod_in_ball, "-o", tmp_path / "o.usda", "--config", path)
    assert_fails(done, 2, "settings.toml", *words)


@pytest.mark.parametrize(
    ("name", "kind", "value", "words"),
    [
        ("mobility", "Float", 2.0, ("0 to 1", "2.0")),
        ("diffusion", "Float", -1.0, ("positive",)),
        ("diffusion", "String", "much", ("number",)),
        ("diffusion", "FloatArray", [1.0, 2.0], ("one value", "2")),
        ("rigid", "Float", 0.5, ("true or false",)),
    ],
)
def test_bad_primvars_make_the_input_unusable(
    rod_in_ball: Path, tmp_path: Path, name: str, kind: str, value: Any, words: tuple[str, ...]
) -> None:
    add_primvar(rod_in_ball, "/Scene/Rod", f"dtrepair:{name}", kind, value)
    done = run("repair", rod_in_ball, "-o", tmp_path / "o.usda")
    assert_fails(done, 3, "/Scene/Rod/Mesh", f"dtrepair:{name}", *words)


def test_unknown_primvars_are_warned(rod_in_ball: Path, tmp_path: Path) -> None:
    add_primvar(rod_in_ball, "/Scene/Rod", "dtrepair:difusion", "Float", 2.0)
    done = run("repair", rod_in_ball, "-o", tmp_path / "o.usda", "--dry-run")
    assert done.code == 0 and "dtrepair:difusion: unknown" in done.err


def test_settings_are_for_stages_and_rigid_for_the_full_method(
    rod_in_ball: Path, tmp_path: Path
) -> None:
    mesh = tube_obj(tmp_path / "a.obj")
    out = tmp_path / "b.obj"
    assert_fails(run("repair", mesh, "-o", out, "--rigid", "/a"), 2, "--rigid", "USD stages")
    assert_fails(run("repair", mesh, "-o", out, "--ignore", "/a,/b"), 2, "--ignore", "USD stages")
    paper = ("--method", "paper", "--rigid", "/Scene/Rod")
    done = run("repair", rod_in_ball, "-o", tmp_path / "o.usda", *paper)
    assert_fails(done, 2, "--rigid", "--method paper")


def test_the_plan_tells_the_roles(rod_in_ball: Path, tmp_path: Path) -> None:
    table = config(tmp_path, '[[prim]]\npath = "/Scene/Rod"\nrigid = true\nmobility = 0.5\n')
    out = ("-o", tmp_path / "o.usda", "--collider", "/Scene/Ball/Mesh")
    done = run("repair", rod_in_ball, *out, "--config", table, "--dry-run")
    assert "rigid, mobility 0.5" in done.out and "collider" in done.out


def test_the_report_tells_who_met_whom_and_who_moved(rod_in_ball: Path, tmp_path: Path) -> None:
    out, path, page = tmp_path / "o.usda", tmp_path / "r.json", tmp_path / "r.html"
    options = ("--rigid", "/Scene/Rod", "--collider", "/Scene/Ball/Mesh", "--report", path)
    done = run("repair", rod_in_ball, "-o", out, *options)
    assert done.code == 0
    report = read_report(path)
    first, last = report["frames"][0], report["frames"][2]
    assert first["contacts"] == []
    (contact,) = last["contacts"]
    names = {"first": "/Scene/Ball/Mesh", "second": "/Scene/Rod/Mesh"}
    assert contact == {**names, "before": last["before"]["pairs"], "after": 0}
    (total,) = report["summary"]["contacts"]
    assert total == {**names, "before": report["summary"]["pairs_before"], "after": 0}
    ball, rod = last["prims"]
    assert ball["motion"] is None
    motion = rod["motion"]
    assert motion["edge_distortion"] < 1e-6 > motion["edge_change"]
    # All of a rigid motion is rigid.
    assert 0 < motion["rigid_rms"] <= motion["displacement_max"] == last["displacement_max"]
    for text in ("/Scene/Rod/Mesh", "as a whole", str(total["before"])):
        assert text in done.out
    assert run("report", path, "-o", page, "--pictures", 0).code == 0
    assert "<h2>Objects</h2>" in page.read_text() and "Not counted" not in page.read_text()
    counted = run("check", rod_in_ball, "--json", "-").json["summary"]["contacts"]
    assert counted[0]["before"] == counted[0]["after"] == total["before"]


def test_the_page_tells_what_is_ignored(rod_in_ball: Path, tmp_path: Path) -> None:
    path, page = tmp_path / "r.json", tmp_path / "r.html"
    ignored = ("--ignore", "/Scene/Rod,/Scene/Ball")
    run("repair", rod_in_ball, "-o", tmp_path / "o.usda", *ignored, "--report", path)
    assert read_report(path)["settings"]["ignore"] == ["/Scene/Rod,/Scene/Ball"]
    assert run("report", path, "-o", page, "--pictures", 1).code == 0
    assert "Not counted: contacts of /Scene/Rod,/Scene/Ball" in page.read_text()


def test_objects_that_cannot_be_separated_are_named(rod_in_ball: Path, tmp_path: Path) -> None:
    tables = [f'[[prim]]\npath = "/Scene/{name}"\nmobility = 0\n' for name in ("Ball", "Rod")]
    table = config(tmp_path, "".join(tables))
    done = run("repair", rod_in_ball, "-o", tmp_path / "o.usda", "--config", table)
    assert done.code == 1 and "unchanged" in done.out
    assert "/Scene/Ball/Mesh and /Scene/Rod/Mesh still intersect" in done.out
    assert "where nothing may move" in done.out


def test_a_collider_may_intersect_itself(rod_in_ball: Path, tmp_path: Path) -> None:
    from pxr import Usd

    stage = Usd.Stage.Open(str(rod_in_ball))
    attribute = stage.GetPrimAtPath("/Scene/Ball/Mesh").GetAttribute("points")
    # One vertex through the other side.
    points = np.array(attribute.Get())
    points[0] = -1.3 * points[0]
    attribute.Set(points)
    stage.Save()
    del attribute, stage
    assert run("check", rod_in_ball, "--frames", 1).code == 1
    out = ("-o", tmp_path / "o.usda", "--collider", "/Scene/Ball/Mesh")
    done = run("repair", rod_in_ball, *out)
    assert done.code == 0, done
    assert "as a collider never moves" in done.err


def test_colliders_and_prims_given_several_times_all_count(
    rod_in_ball: Path, tmp_path: Path
) -> None:
    """The last one used to win, and the others moved."""
    ball, rod = "/Scene/Ball//", "/Scene/Rod//"
    run_once = ("repair", rod_in_ball, "-o", tmp_path / "out.usda")
    assert_fails(run(*run_once, "--collider", ball, "--collider", rod), 2, "nothing may move")
    config = tmp_path / "c.toml"
    config.write_text(f'collider = ["{ball}", "{rod}"]\n')
    assert_fails(run(*run_once, "--config", config), 2, "nothing may move")
    # A mistyped one is told, though the other one matches.
    assert_fails(run(*run_once, "--rigid", ball, "--rigid", "/Scene/Rodd"), 2, "/Scene/Rodd")
    for name in ("--collider", "--prim"):
        mistyped = run(*run_once, name, ball, name, "/Scene/Rodd")
        assert_fails(mistyped, 2, "'/Scene/Rodd'", "no match")
    report = run("check", rod_in_ball, "--prim", ball, "--prim", rod, "--json", "-").json
    assert [prim["path"] for prim in report["prims"]] == ["/Scene/Ball/Mesh", "/Scene/Rod/Mesh"]
    assert report["settings"]["prim"] == f"({ball}) + ({rod})"
    none = run("check", rod_in_ball, "--exclude", ball, "--exclude", rod)
    assert_fails(none, 3, "besides those excluded by")
