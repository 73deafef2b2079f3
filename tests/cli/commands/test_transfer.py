"""`dtrepair transfer` of mesh files: markers, correspondences, pictures and errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.numerics.geometry import diagonal
from dtrepair.report.record import read_report
from dtrepair.report.schema import validate
from dtrepair.transfer import Transfer, match_triangles, register
from tests.command_line import (
    CLOSED,
    Outcome,
    assert_fails,
    read_samples,
    run,
    tube_polygons,
    tube_pose,
    tube_stage,
    write_obj,
)
from tests.meshes import Mesh, split_quads
from tests.quadruped import Quadruped, markers

Animals = tuple[Path, Mesh, Mesh, NDArray[np.int32]]

SOURCE = Quadruped(cells=8.0)
TARGET = Quadruped(cells=9.0, body=0.85, width=0.38, leg=1.1, thickness=0.12, neck=0.8)


@pytest.fixture(scope="module")
def animals(tmp_path_factory: pytest.TempPathFactory) -> Animals:
    """Source and target rests with markers as files, and three poses of the source."""
    folder = tmp_path_factory.mktemp("animals")
    source, target = SOURCE.mesh(), TARGET.mesh()
    write_obj(folder / "source.obj", *source)
    write_obj(folder / "target.obj", *target)
    rows = markers(SOURCE, source[0], TARGET, target[0])
    (folder / "m.cons").write_text(f"{len(rows)}\n" + "".join(f"{a}, {b}\n" for a, b in rows))
    for number, pose in enumerate(SOURCE.walk(source[0], 3), start=1):
        write_obj(folder / f"pose{number}.obj", pose, source[1])
    return folder, source, target, rows


def poses(folder: Path) -> list[Path]:
    return sorted(folder.glob("pose?.obj"))


@pytest.fixture(scope="module")
def transferred(animals: Animals) -> tuple[Path, Outcome]:
    """One run with everything that is written beside the animation."""
    folder = animals[0]
    done = run(
        *("transfer", folder / "source.obj", folder / "target.obj", "--poses", *poses(folder)),
        *("--markers", folder / "m.cons", "-o", folder / "out.usdc"),
        *("--report", folder / "r.json", "--save-correspondence", folder / "c.npz"),
        *("--registration", folder / "p.png"),
    )
    return folder, done


def test_mesh_files_give_a_new_stage(animals: Animals, transferred: tuple[Path, Outcome]) -> None:
    _, source, target, rows = animals
    folder, done = transferred
    assert done.code in (0, 1) and done.err == ""
    samples = read_samples(folder / "out.usdc", "/target/Mesh")
    assert list(samples) == [1.0, 2.0, 3.0]
    pairs = match_triangles(register(*source, *target, rows), source[1], *target)
    expected = Transfer(*source, *target, pairs)(SOURCE.walk(source[0], 3))
    found = np.stack(list(samples.values()))
    # The same call on the same numbers, rounded once.
    assert np.abs(found - expected).max() < 1e-6 * diagonal(target[0])
    assert np.abs(found[0] - found[1]).max() > 0.1


def test_the_report_tells_coverage_residual_and_markers(transferred: tuple[Path, Outcome]) -> None:
    folder, done = transferred
    report = read_report(folder / "r.json")
    section = report["transfer"]
    assert section["correspondence"] == "markers" and section["target"] == "target.obj"
    assert section["unmatched"] < 0.005 * report["prims"][0]["triangles"]
    assert 0 < section["residual_median"] < section["residual_p95"] < 0.6
    assert section["markers"]["suspects"] == [] and section["markers"]["count"] > 20
    assert section["unit_ratio"] == pytest.approx(1.0, abs=0.05)
    assert f"{section['pairs']} pairs of triangles (markers)" in done.out
    assert f"residual: median {section['residual_median']:.3f}" in done.out
    assert "written: " in done.out
    section["residual_median"] = -1.0
    with pytest.raises(ValueError, match=r"transfer\.residual_median"):
        validate(report)


def test_the_picture_shows_three_views(transferred: tuple[Path, Outcome]) -> None:
    from PIL import Image

    with Image.open(transferred[0] / "p.png") as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    assert pixels.shape[1] == 3 * 640
    red = (pixels[..., 0] > 120) & (pixels[..., 1] < 60)
    assert red[:, 1280:].sum() > 1000 and red[:, :640].sum() == 0


def test_a_saved_correspondence_gives_the_same_animation(
    animals: Animals, transferred: tuple[Path, Outcome], tmp_path: Path
) -> None:
    folder = transferred[0]
    arguments = ("transfer", folder / "source.obj", folder / "target.obj")
    again = tmp_path / "again.usdc"
    chosen = ("--correspondence", folder / "c.npz", "--frames", "2:3", "-o", again)
    assert run(*arguments, "--poses", *poses(folder), *chosen).code in (0, 1)
    before, after = (read_samples(p, "/target/Mesh") for p in (folder / "out.usdc", again))
    assert list(after) == [2.0, 3.0]
    assert all((before[time] == after[time]).all() for time in after)
    swapped = ("transfer", folder / "target.obj", folder / "source.obj")
    done = run(*swapped, "--poses", folder / "target.obj", *chosen[:2], "-o", again)
    assert_fails(done, 3, "c.npz", "match the meshes again")


def test_markers_as_npz(animals: Animals, tmp_path: Path) -> None:
    folder, _, _, rows = animals
    np.savez(tmp_path / "m.npz", markers=rows)
    arguments = ("transfer", folder / "source.obj", folder / "target.obj")
    output = ("--poses", folder / "pose1.obj", "-o", tmp_path / "o.usdc", "--markers")
    assert run(*arguments, "--dry-run", *output, tmp_path / "m.npz").code == 0
    np.savez(tmp_path / "n.npz", pairs=rows)
    assert_fails(run(*arguments, *output, tmp_path / "n.npz"), 3, "'markers'", "got pairs")
    assert_fails(run(*arguments, *output, tmp_path / "no.npz"), 3, "no such file")
    (tmp_path / "bad.npz").write_text("nothing")
    assert_fails(run(*arguments, *output, tmp_path / "bad.npz"), 3, "is not an npz")
    np.savez_compressed(tmp_path / "bad.npz", markers=np.zeros(2**26))
    assert_fails(run(*arguments, *output, tmp_path / "bad.npz"), 3, "unpacks to")


def test_swapped_markers_are_named(animals: Animals, tmp_path: Path) -> None:
    folder, _, _, rows = animals
    rows = rows.copy()
    rows[[3, 40], 1] = rows[[40, 3], 1]
    np.savez(tmp_path / "m.npz", markers=rows)
    done = run(
        *("transfer", folder / "source.obj", folder / "target.obj", "--poses", poses(folder)[0]),
        *("--markers", tmp_path / "m.npz", "-o", tmp_path / "o.usdc"),
        *("--report", tmp_path / "r.json"),
    )
    assert done.code in (0, 1)
    assert "swapped with marker 40?" in done.err and "swapped with marker 3?" in done.err
    report = read_report(tmp_path / "r.json")
    assert report["transfer"]["markers"]["swapped"] == [[3, 40]]
    assert any("swapped with marker 40?" in text for text in report["warnings"])


def test_bad_markers_are_refused(animals: Animals, tmp_path: Path) -> None:
    folder = animals[0]
    arguments = ["transfer", folder / "source.obj", folder / "target.obj"]
    arguments += ["--poses", poses(folder)[0], "-o", tmp_path / "o.usdc"]
    bad = tmp_path / "m.cons"
    bad.write_text("3\n0, 1\n2, 3\n0, 5\n")
    assert_fails(run(*arguments, "--markers", bad), 3, "m.cons", "one marker", "vertex 0")
    bad.write_text("0 1\n2 99999\n4 5")
    assert_fails(run(*arguments, "--markers", bad), 3, "index 99999 in marker 1")
    bad.write_text("0 1\n2 3")
    assert_fails(run(*arguments, "--markers", bad), 3, "at least 3 markers")
    assert_fails(run(*arguments, "--markers", tmp_path / "no"), 3, "cannot be read")
    assert_fails(run(*arguments), 2, "--markers", "same triangles")
    both = ("--markers", bad, "--correspondence", bad)
    assert_fails(run(*arguments, *both), 2, "give one of them")
    assert not (tmp_path / "o.usdc").exists()


def test_ground_keeps_the_feet_down(
    animals: Animals, transferred: tuple[Path, Outcome], tmp_path: Path
) -> None:
    folder, _, target, _ = animals
    arguments = ("transfer", folder / "source.obj", folder / "target.obj", "--poses")
    more = ("--correspondence", folder / "c.npz", "-o", tmp_path / "o.usdc", "--ground")
    assert run(*arguments, *poses(folder), *more).code in (0, 1)
    lowest = [p[:, 1].min() for p in read_samples(tmp_path / "o.usdc", "/target/Mesh").values()]
    # The walk keeps the source's lowest vertex where it is at rest.
    assert np.abs(np.array(lowest) - target[0][:, 1].min()).max() < 1e-5 * diagonal(target[0])


def test_a_bad_pose_fails_alone(animals: Animals, tmp_path: Path) -> None:
    folder, source, _, _ = animals
    bad = tmp_path / "bad.obj"
    write_obj(bad, source[0][:-1], np.clip(source[1], 0, len(source[0]) - 2))
    other = write_obj(tmp_path / "other.obj", source[0], source[1][::-1])
    files = (poses(folder)[0], bad, other, poses(folder)[1])
    arguments = ("transfer", folder / "source.obj", folder / "source.obj", "--poses", *files)
    done = run(*arguments, "-o", tmp_path / "o.usda")
    assert done.code == 4
    assert "frame 2: failed" in done.err and "bad.obj: expected" in done.err
    assert "frame 3: failed" in done.err and "the faces are not those" in done.err
    assert list(read_samples(tmp_path / "o.usda", "/source/Mesh")) == [1.0, 4.0]
    none = run(*arguments[:4], bad, "-o", tmp_path / "none.usda")
    assert none.code == 3 and "no frame could be used" in none.err
    assert not (tmp_path / "none.usda").exists()
    missing = run(*arguments, tmp_path / "missing.obj", "-o", tmp_path / "none.usda")
    assert_fails(missing, 3, "missing.obj", "--poses")


def test_the_horse_moves_the_camel(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "transfer"
    done = run(
        *("transfer", folder / "horse/horse_ref.obj", folder / "camel/camel_ref.obj"),
        *("--poses", folder / "horse/horse-03.obj", folder / "horse/horse-07.obj", "--repair"),
        *("--markers", folder / "horse_camel.cons", "-o", tmp_path / "o.usdc", "-q"),
    )
    assert (done.code, done.out, done.err) == (0, "", "")
    assert run("check", tmp_path / "o.usdc", "-q").code == 0


def test_polygons_and_texture_of_a_mesh_file_reach_the_new_stage(tmp_path: Path) -> None:
    from pxr import Usd, UsdGeom

    source = tube_stage(tmp_path / "a.usda", (1.0, CLOSED), rest=0.0)
    output = tmp_path / "c.usdc"
    quads = tube_polygons()
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in tube_pose(0.0).tolist()]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1"]
    lines += ["f " + " ".join(f"{v + 1}/{k % 3 + 1}" for k, v in enumerate(q)) for q in quads]
    (tmp_path / "9 lives.obj").write_text("\n".join(lines))
    assert run("transfer", source, tmp_path / "9 lives.obj", "-o", output).code == 1
    stage = Usd.Stage.Open(str(output))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/_9_lives/Mesh"))
    assert set(mesh.GetFaceVertexCountsAttr().Get()) == {4}
    corners = np.asarray(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 4)
    assert (corners == quads).all() and len(split_quads(corners)) == 384
    assert len(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").Get()) == 3
