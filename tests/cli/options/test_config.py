"""Config files that are none: exit code 2 and one line, in an instant."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.command_line import assert_fails, run, tube_obj


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a = " + "[" * 5_000, "nested too deeply"),
        ("a = " + "[\n" * 100_000, "nested too deeply"),
        ("a = " + "[" * 100_000, "expected up to 1048576 bytes, and 10000 a line"),
        (".".join(["a"] * 100_000) + " = 1", "10000 a line"),
        ("#\n" * 2**20, "expected up to 1048576 bytes"),
        ("jobs = " + "9" * 5_000, "is not TOML"),
        ("jobs = \x00", "is not TOML"),
    ],
)
def test_a_config_that_is_none(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "config.toml"
    path.write_text(text)
    mesh = tube_obj(tmp_path / "mesh.obj")
    done = run("check", mesh, "--config", path)
    assert_fails(done, 2, str(path), words)
    assert "--help" not in done.err
