"""Which Python runs the worker: one with dtrepair, which cannot be put into Blender's own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

VARIABLE = "DTREPAIR_PYTHON"
# Starting Python and finding the package, on a cold disk over a network.
PATIENCE = 60.0
# Blender's own settings of Python would lead another Python to Blender's libraries.
_NOT_PASSED_ON = ("PYTHONHOME", "PYTHONEXECUTABLE", "__PYVENV_LAUNCHER__")


class NoInterpreterError(Exception):
    """No Python with dtrepair was found; the message says where it was looked for, and the cure."""


@dataclass(frozen=True)
class Candidate:
    """A Python that may have dtrepair, and who named it."""

    path: Path
    source: str


def candidates(preference: str, environment: Mapping[str, str], home: Path) -> list[Candidate]:
    """Return where to look, in order: the preference, DTREPAIR_PYTHON, the user's environment.

    A folder stands for the virtual environment that it holds. What is named is the only one looked
    at, so that a mistyped path is told and does not lead to another version.
    """
    if preference.strip():
        return [Candidate(_python(Path(preference.strip()).expanduser()), "the preference")]
    if environment.get(VARIABLE, "").strip():
        return [Candidate(_python(Path(environment[VARIABLE].strip()).expanduser()), VARIABLE)]
    return [Candidate(_inside(user_environment(environment, home)), "the user's environment")]


def user_environment(environment: Mapping[str, str], home: Path) -> Path:
    """Return the folder of the virtual environment that is looked for where nothing is named."""
    if sys.platform == "win32":
        base = environment.get("APPDATA")
        return (Path(base) if base else home / "AppData/Roaming") / "dtrepair" / "venv"
    base = environment.get("XDG_CONFIG_HOME")
    return (Path(base) if base else home / ".config") / "dtrepair" / "venv"


def find_interpreter(
    preference: str, environment: Mapping[str, str] | None = None, home: Path | None = None
) -> Path:
    """Return the Python that runs the worker.

    Raises:
        NoInterpreterError: it is not there, or has no dtrepair.
    """
    known = os.environ if environment is None else environment
    (candidate,) = candidates(preference, known, home or Path.home())
    cure = (
        "Make one with `python3 -m venv FOLDER`, install dtrepair into it with its pip, and name "
        "FOLDER in the preferences of the add-on"
    )
    if not candidate.path.is_file():
        raise NoInterpreterError(
            f"no Python at {candidate.path}, which {candidate.source} names. {cure}"
        )
    if reason := _lacks(candidate.path, known):
        raise NoInterpreterError(f"{candidate.path} has no dtrepair: {reason}. {cure}")
    return candidate.path


def passed_on(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the environment of the worker: that of Blender, less what is for its own Python."""
    return {name: value for name, value in environment.items() if name not in _NOT_PASSED_ON}


def _python(path: Path) -> Path:
    return _inside(path) if path.is_dir() else path


def _inside(environment: Path) -> Path:
    return environment / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")


def _lacks(python: Path, environment: Mapping[str, str]) -> str:
    """Why a Python cannot run the worker; empty where it can."""
    code = "import dtrepair.pipeline"
    try:
        run = subprocess.run(
            [python, "-P", "-c", code],
            capture_output=True,
            text=True,
            env=passed_on(environment),
            timeout=PATIENCE,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    lines = run.stderr.strip().splitlines()
    return (lines[-1] if lines else f"exit code {run.returncode}") if run.returncode else ""
