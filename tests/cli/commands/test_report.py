"""`dtrepair report`: a page from the report of a real run."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.command_line import CLOSED, OPEN, assert_fails, run, tube_obj, tube_stage


@pytest.fixture
def finished(tmp_path: Path) -> tuple[Path, Path]:
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED, CLOSED + 0.1))
    report = tmp_path / "r.json"
    assert run("repair", path, "-o", tmp_path / "b.usdc", "--report", report).code == 0
    return tmp_path, report


def test_page_with_pictures_before_and_after(finished: tuple[Path, Path]) -> None:
    folder, report = finished
    done = run("report", report, "-o", folder / "r.html")
    assert done.code == 0 and done.err == ""
    page = (folder / "r.html").read_text()
    assert page.count("data:image/png") == 1  # two frames intersect, and it is one contact
    assert 'frames <button class=frame data-go="1">2 to 3</button>' in page
    assert "TrackballControls=" in page and len(page) < 1_000_000
    fewer = run("report", report, "-o", folder / "r.html", "--pictures", 0)
    assert fewer.code == 0
    page = (folder / "r.html").read_text()
    assert "data:image/png" not in page and "Smaller contacts (1)" in page


def test_pictures_of_a_check_and_of_a_mesh_file(tmp_path: Path) -> None:
    path = tube_obj(tmp_path / "a.obj")
    assert run("check", path, "--json", tmp_path / "c.json").code == 1
    assert run("report", tmp_path / "c.json", "-o", tmp_path / "c.html").code == 0
    assert (tmp_path / "c.html").read_text().count("data:image/png") == 1


def test_pictures_are_drawn_wherever_the_report_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, moved = tmp_path / "made", tmp_path / "moved"
    made.mkdir()
    monkeypatch.chdir(made)
    tube_stage(made / "a.usda", (OPEN, CLOSED))
    (made / "out").mkdir()
    arguments = ("repair", "a.usda", "-o", "out/b.usda", "--report", "out/r.json")
    assert run(*arguments).code == 0
    monkeypatch.chdir(tmp_path)
    assert run("report", "made/out/r.json", "-o", "elsewhere.html").err == ""
    made.rename(moved)  # then the files beside the report are taken
    (moved / "a.usda").rename(moved / "out" / "a.usda")
    layer = moved / "out" / "b.usda"
    layer.write_text(layer.read_text().replace("@../a.usda@", "@./a.usda@"))
    assert run("report", "moved/out/r.json", "-o", "moved.html").err == ""
    for page in ("elsewhere.html", "moved.html"):
        assert (tmp_path / page).read_text().count("data:image/png") == 1


def test_missing_input_leaves_out_the_pictures(finished: tuple[Path, Path]) -> None:
    folder, report = finished
    (folder / "b.usdc").unlink()
    done = run("report", report, "-o", folder / "r.html")
    assert done.code == 0 and "without pictures" in done.err and "b.usdc" in done.err
    page = (folder / "r.html").read_text()
    assert "data:image" not in page and "Warning: without pictures" in page


def test_errors(finished: tuple[Path, Path]) -> None:
    folder, report = finished
    page = folder / "r.html"
    assert_fails(run("report", folder / "no.json", "-o", page), 3, "no.json", "cannot be read")
    assert_fails(run("report", folder / "a.usda", "-o", page), 3, "expected a JSON report")
    assert_fails(run("report", report, "-o", report), 2, "is an input")
    pdf = run("report", report, "-o", folder / "r.PDF")
    assert_fails(pdf, 2, "r.PDF: name the page .html or .htm, not .pdf")
    assert not (folder / "r.PDF").exists()
    assert_fails(run("report", report, "-o", folder / "no" / "r.html"), 5, "cannot be written")
    assert not page.exists()


def test_a_transfer_shows_its_figures_and_its_result(tmp_path: Path) -> None:
    source = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED), rest=0.0)
    target = tube_obj(tmp_path / "b.obj", 0.0)
    report = tmp_path / "r.json"
    done = run("transfer", source, target, "-o", tmp_path / "c.usdc", "--report", report)
    assert done.code == 1
    assert run("report", report, "-o", tmp_path / "r.html").code == 0
    page = (tmp_path / "r.html").read_text()
    assert page.count("data:image/png") == 1 and '"names":["transferred"]' in page
    assert "<td>384</td><td>triangle pairs</td>" in page and "<td>topology</td>" in page
    assert "markers to look at" not in page


def test_offsets_alone_have_no_picture_of_afterwards(tmp_path: Path) -> None:
    stage, report = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED)), tmp_path / "r.json"
    run("repair", stage, "-o", tmp_path / "b.usda", "--delta", "--report", report)
    assert run("report", report, "-o", tmp_path / "r.html", "--pictures", 1).code == 0
    page = (tmp_path / "r.html").read_text()
    assert page.count("data:image/png") == 1 and '"names":["before"]' in page
