"""The group: help, version, lazy loading, one-line errors and exit codes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from dtrepair import __version__
from dtrepair.cli import app
from dtrepair.cli.app import COMMANDS
from tests.command_line import CLOSED, OPEN, assert_fails, run, tube_obj, tube_stage
from usd_io import StageError


def test_version_and_help() -> None:
    assert run("--version").out == f"dtrepair {__version__}\n"
    listed = run("--help")
    assert run() == listed
    assert listed.code == 0 and listed.err == ""
    for name, summary in COMMANDS.items():
        assert name in listed.out and summary[:30] in listed.out
    assert "Exit codes" in listed.out


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_with_an_example(name: str) -> None:
    shown = run(name, "--help")
    assert shown.code == 0
    assert "Example:" in shown.out and f"dtrepair {name}" in shown.out
    options = [w for w in shown.out.split() if w.startswith("--")]
    assert all("_" not in option for option in options)


def test_help_loads_nothing_but_the_command_line() -> None:
    code = (
        "import sys\n"
        "before = set(sys.modules)\n"
        "import dtrepair.cli\n"
        "try: dtrepair.cli.main(['--help'])\n"
        "except SystemExit: pass\n"
        "loaded = {name.partition('.')[0] for name in set(sys.modules) - before}\n"
        "sys.stderr.write(' '.join(sorted(loaded - sys.stdlib_module_names)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0 and "Usage" in done.stdout
    assert done.stderr.split() == ["click", "dtrepair"]


def test_python_m_dtrepair(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "dtrepair", "check", str(tmp_path / "none.obj")],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 3
    assert done.stderr.count("\n") == 1 and "No such file" in done.stderr


def test_usage_errors_are_one_line() -> None:
    assert_fails(run("chek"), 2, "chek", "--help")
    assert_fails(run("chek", "a.obj"), 2, "no such command: chek (did you mean check?)")
    assert_fails(run("-q", "Repiar"), 2, "(did you mean repair?)")
    assert_fails(run("check", "a.obj", "-picture", "a.png"), 2, "(did you mean --picture?)")
    assert_fails(run("check", "a.obj", "-picture=a.png"), 2, "(did you mean --picture?)")
    assert_fails(run("repair", "a.obj", "-only-frames"), 2, "(did you mean --only-frames?)")
    assert "mean" not in run("check", "--", "-picture").err
    assert "mean" not in run("check", "a.obj", "-pear", "--picture", "a.png").err
    assert "mean" not in run("xyzzy").err
    assert_fails(run("check"), 2, "STAGE|MESH", "dtrepair check --help")
    assert_fails(run("check", "a.obj", "--nonsense"), 2, "--nonsense")
    assert_fails(run("repair", "a.obj", "--clearence", "1"), 2, "--clearance")
    assert_fails(run("check", "a.obj", "--mode", "all"), 2, "--mode")
    assert_fails(run("check", "a.obj", "--jobs", "0"), 2, "--jobs")


def test_interrupt_and_closed_pipe(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(**options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(app.group, "main", interrupt)
    assert_fails(run("check"), 130, "interrupted", "no output was written")


def test_internal_errors_are_one_line_and_debug_shows_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tube_obj(tmp_path / "a.obj")

    def broken(*arguments: object, **options: object) -> None:
        raise RuntimeError("wires crossed")

    monkeypatch.setattr("dtrepair.pipeline.check.open_source", broken)
    assert_fails(run("check", path), 70, "internal error: RuntimeError: wires crossed", "-vv")
    with pytest.raises(RuntimeError, match="wires crossed"):
        run("check", path, "-vv")
    monkeypatch.setenv("DTREPAIR_DEBUG", "1")
    with pytest.raises(RuntimeError, match="wires crossed"):
        run("check", path)


def test_an_error_on_purpose_shows_where_it_came_from(tmp_path: Path) -> None:
    missing = tmp_path / "a.usd"
    assert_fails(run("check", missing), 3, "a.usd")
    with pytest.raises(StageError, match=r"a\.usd"):
        run("check", missing, "-vv")
    assert_fails(run("check", missing, "--device", "gpu", "-vv"), 2, "--device")


def test_config_sets_defaults_that_the_command_line_overrides(tmp_path: Path) -> None:
    path = tube_obj(tmp_path / "a.obj")
    config = tmp_path / "c.toml"
    config.write_text('mode = "self"\n[check]\njobs = 1\n[repair]\nmethod = "paper"\n')
    assert run("check", path, "--config", config, "--json", "-").json["settings"]["mode"] == "self"
    found = run("check", path, "--config", config, "--mode", "inter", "--json", "-")
    assert found.json["settings"]["mode"] == "inter" and found.code == 0


def test_bad_configs_are_refused(tmp_path: Path) -> None:
    path = tube_obj(tmp_path / "a.obj")
    config = tmp_path / "c.toml"
    assert_fails(run("check", path, "--config", config), 2, "c.toml", "cannot be read")
    config.write_text("mode = ")
    assert_fails(run("check", path, "--config", config), 2, "is not TOML")
    config.write_text("moode = 3")
    assert_fails(run("check", path, "--config", config), 2, "has no option 'moode'")
    config.write_text('mode = "all"')
    assert_fails(run("check", path, "--config", config), 2, "--mode")
    config.write_text("[check]\nalone = true")
    assert_fails(run("check", path, "--config", config), 2, "check has no option 'alone'")
    config.write_text("[repar]\nalone = true")
    assert_fails(run("check", path, "--config", config), 2, "[repar] is no command", "[repair]")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('alone = "yes"', ["alone should be true or false, got 'yes'"]),
        ("jobs = true", ["jobs should be a whole number, got True"]),
        ("jobs = 1.5", ["jobs should be a whole number, got 1.5"]),
        ('diffusion = "high"', ["diffusion should be a number, got 'high'"]),
        ("mode = true", ["mode should be text, got True"]),
        ("ignore = [3, true]", ["ignore should be text, got True"]),
    ],
)
def test_values_of_wrong_types_are_refused(tmp_path: Path, text: str, words: list[str]) -> None:
    config = tmp_path / "c.toml"
    config.write_text(text)
    output = ("-o", tmp_path / "b.obj")
    path = tube_obj(tmp_path / "a.obj")
    assert_fails(run("repair", path, *output, "--config", config), 2, "c.toml", *words)


def test_one_config_serves_every_command(tmp_path: Path) -> None:
    config = tmp_path / "c.toml"
    config.write_text(
        'rest = 1\ndiffusion = 50\nextra-keys = 3\nalone = true\n[[prim]]\npath = "/Root"\n'
        "mobility = 1\n[transfer]\nground = true\n"
    )
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED))
    own = ("--config", config)
    assert run("check", path, *own).code == 1
    repaired = run("repair", path, "-o", tmp_path / "b.usdc", "--report", "-", *own)
    assert repaired.json["settings"]["diffusion"] == 50 and repaired.code == 0
    assert repaired.json["settings"]["rest"] == ["frame 1"]
    assert run("keyposes", path, "-o", tmp_path / "c.usdc", *own).code == 0
    clean = tube_stage(tmp_path / "clean.usda", (OPEN, OPEN))
    moved = run("transfer", clean, clean, "-o", tmp_path / "d.usdc", "--report", "-", *own)
    assert moved.json["settings"]["ground"] is True
