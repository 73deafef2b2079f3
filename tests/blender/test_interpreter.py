from __future__ import annotations

import sys
from pathlib import Path

import pytest

from blender.dtrepair_addon.host.interpreter import (
    VARIABLE,
    NoInterpreterError,
    candidates,
    find_interpreter,
    passed_on,
    user_environment,
)


def test_the_preference_wins_over_the_variable_and_that_over_the_users_environment() -> None:
    known, home = {VARIABLE: "/second/python"}, Path("/home/artist")
    assert [c.path for c in candidates("/first/python", known, home)] == [Path("/first/python")]
    assert [c.path for c in candidates(" ", known, home)] == [Path("/second/python")]
    (last,) = candidates("", {}, home)
    assert user_environment({}, home) in last.path.parents


def test_the_users_environment_lies_where_the_system_keeps_settings() -> None:
    name = "APPDATA" if sys.platform == "win32" else "XDG_CONFIG_HOME"
    assert user_environment({name: "/set"}, Path("/home/a")) == Path("/set/dtrepair/venv")


def test_a_folder_stands_for_its_environment(tmp_path: Path) -> None:
    (found,) = candidates(str(tmp_path), {}, tmp_path)
    assert tmp_path in found.path.parents and found.path.name.startswith("python")


def test_this_python_has_dtrepair() -> None:
    assert find_interpreter(sys.executable) == Path(sys.executable)
    assert find_interpreter("", {VARIABLE: sys.executable}) == Path(sys.executable)


def test_what_is_not_there_is_told_with_who_named_it(tmp_path: Path) -> None:
    with pytest.raises(NoInterpreterError, match=r"none, which the preference names.*venv"):
        find_interpreter(str(tmp_path / "none"))
    with pytest.raises(NoInterpreterError, match=f"which {VARIABLE} names"):
        find_interpreter("", {VARIABLE: str(tmp_path / "none")})
    with pytest.raises(NoInterpreterError, match="the user's environment names"):
        find_interpreter("", {"XDG_CONFIG_HOME": str(tmp_path)}, tmp_path)


@pytest.mark.skipif(sys.platform == "win32", reason="a script stands for a Python")
def test_a_python_without_dtrepair_is_told(tmp_path: Path) -> None:
    other = tmp_path / "python"
    other.write_text("#!/bin/sh\necho ModuleNotFoundError: none >&2\nexit 1\n")
    other.chmod(0o755)
    with pytest.raises(NoInterpreterError, match=r"has no dtrepair: ModuleNotFoundError: none"):
        find_interpreter(str(other))


def test_settings_of_blenders_own_python_are_not_passed_on() -> None:
    assert passed_on({"PYTHONHOME": "/blender", "PATH": "/bin"}) == {"PATH": "/bin"}
