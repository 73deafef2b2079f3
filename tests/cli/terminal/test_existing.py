"""--skip-existing opens what it finds."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from pxr import UsdUtils

from tests.command_line import CLOSED, OPEN, assert_fails, run, tube_obj, tube_stage


@pytest.mark.parametrize("name", ["b.usdc", "b.usda", "b.obj", "b.ply"])
def test_only_what_opens_is_done(tmp_path: Path, name: str) -> None:
    output = tmp_path / name
    if output.suffix.startswith(".usd"):
        path = tube_stage(tmp_path / "a.usdc", (CLOSED, OPEN))
    else:
        path = tube_obj(tmp_path / "a.obj")
    command = ("repair", path, "-o", output, "--skip-existing")
    done = run(*command)
    assert done.code == 0 and "skipped" not in done.out
    whole = output.read_bytes()
    done = run(*command)
    assert done.code == 0 and "exists; skipped" in done.out and done.err == ""
    for broken in (b"", whole[: len(whole) // 2]):
        output.write_bytes(broken)
        done = run(*command)
        assert done.code == 0 and "exists, but cannot be read: it is written again" in done.err
        assert output.read_bytes() == whole


@pytest.mark.parametrize("command", ["transfer", "keyposes", "join"])
def test_the_other_commands_too(tmp_path: Path, command: str) -> None:
    path, part = tube_stage(tmp_path / "a.usdc", (CLOSED, OPEN)), tmp_path / "part.usdc"
    assert run("repair", path, "-o", part).code == 0
    inputs = {"transfer": [path, path], "keyposes": [path], "join": [part]}[command]
    output = tmp_path / "b.usdc"
    output.touch()
    done = run(command, *inputs, "-o", output, "--skip-existing")
    assert "written again" in done.err and output.stat().st_size > 0
    done = run(command, *inputs, "-o", output, "--skip-existing")
    # A transfer leaves what intersects.
    assert done.code == (command == "transfer") and "exists; skipped" in done.out


@pytest.mark.parametrize("command", ["repair", "keyposes"])
def test_the_result_of_another_input_is_not_done(tmp_path: Path, command: str) -> None:
    first, other = (tube_stage(tmp_path / name, (CLOSED, OPEN)) for name in ("a.usdc", "o.usdc"))
    output = tmp_path / "b.usdc"
    assert run(command, first, "-o", output).code == 0
    whole = output.read_bytes()
    done = run(command, other, "-o", output, "--skip-existing")
    assert_fails(done, 2, f"is a layer over {first}", "remove it")
    assert output.read_bytes() == whole
    # Another path of the same file, as a link, is the same input.
    (tmp_path / "link.usdc").symlink_to(first)
    done = run(command, tmp_path / "link.usdc", "-o", output, "--skip-existing")
    assert done.code == 0 and "exists; skipped" in done.out


@pytest.mark.parametrize("command", ["repair", "keyposes"])
def test_a_layer_over_an_earlier_content_is_made_again(tmp_path: Path, command: str) -> None:
    path, output = tube_stage(tmp_path / "a.usdc", (CLOSED, OPEN)), tmp_path / "b.usdc"
    asked = (command, path, "-o", output, "--skip-existing")
    assert run(*asked).code == 0
    # A later time of a file of the same content tells nothing.
    os.utime(path, (later := output.stat().st_mtime + 5, later))
    assert "exists; skipped" in run(*asked).out
    tube_stage(path, (OPEN, CLOSED))
    os.utime(path, (0, 0))
    done = run(*asked)
    assert f"{output}: exists, of an earlier {path}: it is written again" in done.err
    done = run(*asked)
    assert "exists; skipped" in done.out and done.err == ""


def test_a_layer_of_corrections_says_what_it_is_of(tmp_path: Path) -> None:
    path, output = tube_stage(tmp_path / "a.usdc", (CLOSED, OPEN)), tmp_path / "b.usdc"
    asked = ("repair", path, "-o", output, "--delta", "--skip-existing")
    assert run(*asked).code == 0 and "exists; skipped" in run(*asked).out
    tube_stage(path, (OPEN, CLOSED))
    os.utime(path, (0, 0))
    assert "of an earlier" in run(*asked).err


def test_joined_layers_say_what_they_are_of(tmp_path: Path) -> None:
    path, output = tube_stage(tmp_path / "a.usdc", (CLOSED, OPEN)), tmp_path / "b.usdc"
    parts = [tmp_path / f"{part}.usdc" for part in (1, 2)]
    for number, part in enumerate(parts, start=1):
        assert run("repair", path, "-o", part, "--chunk", f"{number}/2").code == 0
    assert run("join", *parts, "-o", output).code == 0
    asked = ("repair", path, "-o", output, "--skip-existing")
    assert "exists; skipped" in run(*asked).out
    tube_stage(path, (OPEN, CLOSED))
    os.utime(path, (0, 0))
    assert "of an earlier" in run(*asked).err


def test_only_a_join_of_these_layers_is_done(tmp_path: Path) -> None:
    path, other = (tube_stage(tmp_path / f"{k}.usdc", (CLOSED, OPEN, OPEN, OPEN)) for k in "ao")
    output, parts = tmp_path / "b.usdc", [tmp_path / f"{part}.usdc" for part in (1, 2)]
    for number, part in enumerate(parts, start=1):
        assert run("repair", path, "-o", part, "--chunk", f"{number}/2").code == 0
    asked = ("join", *parts, "-o", output, "--skip-existing")
    assert run(*asked).code == 0 and "exists; skipped" in run(*asked).out
    # Layers that cannot be joined are refused as ever.
    assert_fails(run("join", parts[0], "-o", output, "--skip-existing"), 3, "chunk 2/2 is missing")
    missing = tmp_path / "none.usdc"
    assert_fails(run("join", missing, "-o", output, "--skip-existing"), 3, "no such layer")
    assert run("repair", other, "-o", tmp_path / "r.usdc", "--frames", "1:3").code == 0
    done = run("join", tmp_path / "r.usdc", "-o", output, "--skip-existing")
    assert_fails(done, 2, f"{output}: exists, and was joined of other layers", "remove it")
    assert run("repair", path, "-o", tmp_path / "r.usdc", "--frames", "1:3").code == 0
    done = run("join", tmp_path / "r.usdc", "-o", output, "--skip-existing")
    assert_fails(done, 2, "was joined of other layers")


@pytest.mark.parametrize(
    ("command", "poses", "more", "code"),
    [
        ("repair", (CLOSED, OPEN), ("--maximum-displacement", 1e-3), 1),
        ("repair", (OPEN, float("nan")), (), 4),
        ("transfer", (CLOSED, OPEN), (), 1),
        ("transfer", (OPEN, OPEN), (), 0),
    ],
)
def test_what_is_skipped_ends_as_its_run_did(
    tmp_path: Path, command: str, poses: Any, more: tuple[str, ...], code: int
) -> None:
    path, output = tmp_path / "a.usdc", tmp_path / "b.usdc"
    tube_stage(path, poses)
    inputs = [path, path] if command == "transfer" else [path]
    asked = (command, *inputs, "-o", output, *more)
    assert run(*asked).code == code
    done = run(*asked, "--skip-existing")
    assert done.code == code and "exists; skipped" in done.out
    assert ("it is not clean, as its run has said" in done.out) == (code != 0)


@pytest.mark.parametrize("content", [b"", b"nothing of the kind"])
def test_a_damaged_input_is_not_done(tmp_path: Path, content: bytes) -> None:
    path, output = tube_stage(tmp_path / "a.usdc", (CLOSED, OPEN)), tmp_path / "b.usdc"
    assert run("repair", path, "-o", output).code == 0
    path.write_bytes(content)
    done = run("repair", path, "-o", output, "--skip-existing")
    assert done.code == 3 and "skipped" not in done.out


def test_a_package_and_a_rest_are_inputs_too(tmp_path: Path) -> None:
    inner, package = tube_stage(tmp_path / "a.usdc", (CLOSED, OPEN)), tmp_path / "a.usdz"
    output, rest = tmp_path / "b.usdc", tube_obj(tmp_path / "rest.obj", OPEN)
    assert UsdUtils.CreateNewUsdzPackage(str(inner), str(package))
    asked = ("repair", f"{package}[a.usdc]", "-o", output, "--skip-existing", "--rest", rest)
    assert run(*asked).code == 0 and "exists; skipped" in run(*asked).out
    os.utime(rest, (later := output.stat().st_mtime + 5, later))
    assert f"of an earlier {rest}" in run(*asked).err
    os.utime(rest, (0, 0))
    tube_stage(inner, (OPEN, CLOSED))
    package.unlink()
    assert UsdUtils.CreateNewUsdzPackage(str(inner), str(package))
    assert f"of an earlier {package}[a.usdc]" in run(*asked).err


@pytest.mark.parametrize("command", ["repair", "transfer", "join"])
def test_what_is_older_than_its_input_is_made_again(tmp_path: Path, command: str) -> None:
    made, output = tube_obj(tmp_path / "a.obj", OPEN), tmp_path / "b.obj"
    if command != "repair":
        made, output = tube_stage(tmp_path / "a.usdc", (OPEN, OPEN)), tmp_path / "b.usdc"
    if command == "join":
        path, made = made, tmp_path / "part.usdc"
        assert run("repair", path, "-o", made).code == 0
    inputs = [made, made] if command == "transfer" else [made]
    asked = (command, *inputs, "-o", output, "--skip-existing")
    assert run(*asked).code == 0
    os.utime(made, (later := output.stat().st_mtime + 5, later))
    done = run(*asked)
    assert f"{output}: exists, of an earlier {made}: it is written again" in done.err
    os.utime(made, (0, 0))
    assert "exists; skipped" in run(*asked).out


def test_another_part_is_not_done(tmp_path: Path) -> None:
    path, output = tube_stage(tmp_path / "a.usdc", (OPEN, CLOSED, OPEN, OPEN)), tmp_path / "b.usdc"
    command = ("repair", path, "-o", output, "--skip-existing")
    assert run(*command, "--chunk", "1/2").code == 0
    assert "exists; skipped" in run(*command, "--chunk", "1/2").out
    assert_fails(run(*command, "--chunk", "2/2"), 2, "chunk (1/2 there, 2/2 asked for)")
    assert_fails(run(*command), 2, "chunk (1/2 there, none asked for)")
    output.unlink()
    assert run(*command).code == 0
    assert_fails(run(*command, "--chunk", "2/2"), 2, "chunk (none there, 2/2 asked for)")


@pytest.mark.parametrize(
    ("there", "here", "words"),
    [
        ("", "--frames 2", "frames (none there, 2 asked for)"),
        ("--frames 1:2", "--frames 1", "frames (1:2 there, 1 asked for)"),
        ("", "--diffusion 50", "diffusion (99.0 there, 50.0 asked for)"),
        ("--alone", "", "alone (True there, none asked for)"),
        ("--only-frames", "--delta", "delta (none there, True asked for), only_frames (True"),
        ("", "--config FILE", 'tables (none there, {"path": "/Root/Tube", "mobility": 0.5} asked'),
        ("--config FILE", "", "tables ("),
        ("--rest 1", "--rest 3", "rest (1 there, 3 asked for)"),
    ],
)
def test_a_result_of_other_choices_is_not_done(
    tmp_path: Path, there: str, here: str, words: str
) -> None:
    path, output = tube_stage(tmp_path / "a.usdc", (OPEN, CLOSED, OPEN)), tmp_path / "b.usdc"
    tables = tmp_path / "tables.toml"
    tables.write_text('[[prim]]\npath = "/Root/Tube"\nmobility = 0.5\n')
    first, then = (text.replace("FILE", str(tables)).split() for text in (there, here))
    command = ("repair", path, "-o", output, "--skip-existing")
    assert run(*command, *first).code == 0
    whole = output.read_bytes()
    assert "exists; skipped" in run(*command, *first).out
    assert_fails(run(*command, *then), 2, f"made with other choices: {words}", "remove it")
    assert output.read_bytes() == whole


def test_the_result_of_another_command_is_not_done(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usdc", (OPEN, CLOSED, OPEN))
    for maker, other in (("repair", "keyposes"), ("keyposes", "repair")):
        output = tmp_path / f"{maker}.usdc"
        assert run(maker, path, "-o", output).code == 0
        done = run(other, path, "-o", output, "--skip-existing")
        assert_fails(done, 2, f"exists, and is made by {maker}: ")
    keys = ("keyposes", path, "-o", tmp_path / "keyposes.usdc", "--skip-existing")
    assert_fails(run(*keys, "--samples", "2"), 2, "samples (4 there, 2 asked for)")
    assert "exists; skipped" in run(*keys).out


def test_choices_that_change_no_result_do_not_count(tmp_path: Path) -> None:
    path, output = tube_stage(tmp_path / "a.usdc", (OPEN, CLOSED)), tmp_path / "b.usdc"
    rest = tube_obj(tmp_path / "rest.obj", OPEN)
    assert run("repair", path, "-o", output, "--rest", rest).code == 0
    # The same rest by another name, a stage that must be whole, and another number of processors.
    (tmp_path / "link.obj").symlink_to(rest)
    more = ("--rest", tmp_path / "link.obj", "--strict", "--jobs", 1, "--skip-existing")
    assert "exists; skipped" in run("repair", path, "-o", output, *more).out


def test_a_record_that_says_less_was_made_with_what_is_common(tmp_path: Path) -> None:
    path, output = tube_stage(tmp_path / "a.usdc", (OPEN, CLOSED)), tmp_path / "b.usda"
    assert run("repair", path, "-o", output).code == 0
    lines = output.read_text().splitlines(keepends=True)
    output.write_text("".join(line for line in lines if "double effort" not in line))
    command = ("repair", path, "-o", output, "--skip-existing")
    assert "exists; skipped" in run(*command).out
    assert_fails(run(*command, "--effort", 2), 2, "effort (1.0 there, 2.0 asked for)")


@pytest.mark.parametrize("command", ["repair", "transfer", "keyposes"])
def test_a_report_that_is_not_written_is_told(tmp_path: Path, command: str) -> None:
    path, output = tube_stage(tmp_path / "a.usdc", (OPEN, OPEN)), tmp_path / "b.usdc"
    inputs = [path, path] if command == "transfer" else [path]
    assert run(command, *inputs, "-o", output).code == 0
    skipped = (command, *inputs, "-o", output, "--skip-existing", "--report")
    done = run(*skipped, tmp_path / "r.json", "--picture", tmp_path / "p.png")
    assert done.code == 0 and "exists; skipped; no report and no picture is written" in done.out
    assert not (tmp_path / "r.json").exists() and not (tmp_path / "p.png").exists()
    done = run(*skipped, "-")
    assert done.out == "" and "exists; skipped; no report is written" in done.err


def test_a_transfer_of_another_motion_is_not_done(tmp_path: Path) -> None:
    walk, jump, target = (tube_stage(tmp_path / f"{n}.usdc", (OPEN, OPEN)) for n in "wjt")
    onto, output = tube_obj(tmp_path / "t.obj", OPEN), tmp_path / "b.usdc"
    for aim in (target, onto):
        assert run("transfer", walk, aim, "-o", output).code == 0
        assert run("transfer", walk, aim, "-o", output, "--skip-existing").code == 0
        done = run("transfer", jump, aim, "-o", output, "--skip-existing")
        assert_fails(done, 2, f"is made of {walk}")
    done = run("transfer", walk, onto, "-o", output, "--skip-existing", "--repair", "--alone")
    words = "made with other choices: alone (none there, True asked for), repair (False there, True"
    assert_fails(done, 2, words)


def test_what_nobody_signed_is_told(tmp_path: Path) -> None:
    path, output = (tube_stage(tmp_path / name, (CLOSED, OPEN)) for name in ("a.usdc", "b.usdc"))
    whole = output.read_bytes()
    done = run("repair", path, "-o", output, "--skip-existing")
    assert done.code == 0 and "exists; skipped" in done.out and output.read_bytes() == whole
    assert "has no record of dtrepair, and may not be its output" in done.err


def test_what_is_no_file_is_not_done(tmp_path: Path) -> None:
    path, output = tube_stage(tmp_path / "a.usdc", (CLOSED, OPEN)), tmp_path / "b.usdc"
    os.mkfifo(output)
    done = run("repair", path, "-o", output, "--skip-existing", "-q")
    assert_fails(done, 5, "FIFO")


@pytest.mark.parametrize("command", ["repair", "transfer", "keyposes"])
def test_what_would_be_replaced_is_told_by_a_dry_run(tmp_path: Path, command: str) -> None:
    path, output = tube_stage(tmp_path / "a.usdc", (OPEN, OPEN)), tmp_path / "b.usdc"
    inputs = [path, path] if command == "transfer" else [path]
    dry = (command, *inputs, "-o", output, "--dry-run")
    assert run(*dry).out.endswith(f"2 frames (1 to 2) would be written to {output}\n")
    output.touch()
    assert run(*dry).out.endswith(f"written to {output}, which exists and would be replaced\n")
    assert output.stat().st_size == 0


@pytest.mark.parametrize("command", ["repair", "transfer", "keyposes", "join"])
def test_what_is_replaced_is_told(tmp_path: Path, command: str) -> None:
    path, part = tube_stage(tmp_path / "a.usdc", (CLOSED, OPEN)), tmp_path / "part.usdc"
    assert "exists" not in run("repair", path, "-o", part).err
    inputs = {"transfer": [path, path], "join": [part]}.get(command, [path])
    output = tmp_path / "b.usdc"
    for older in (False, True):
        done = run(command, *inputs, "-o", output)
        told = f"{output}: exists, and is replaced when this run is done" in done.err
        assert (told or "in place of an older one" in done.out) == older
    assert "exists" not in run(command, *inputs, "-o", output, "-q").err
