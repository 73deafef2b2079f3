"""Every public name is there, is the thing itself, and is documented."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import dtrepair
import dtrepair.pipeline
import usd_io


def packages() -> list[str]:
    """All modules that state their public names."""
    names = []
    for package in (dtrepair, usd_io):
        names.append(package.__name__)
        for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            if not module.name.endswith("__main__"):
                names.append(module.name)
    return [name for name in names if hasattr(importlib.import_module(name), "__all__")]


@pytest.mark.parametrize("name", packages())
def test_all_names_what_is_there(name: str) -> None:
    module = importlib.import_module(name)
    assert len(set(module.__all__)) == len(module.__all__), "a name is listed twice"
    for public in module.__all__:
        assert getattr(module, public) is not None


@pytest.mark.parametrize("module", [dtrepair, dtrepair.pipeline, usd_io])
def test_all_is_complete_and_documented(module: ModuleType) -> None:
    # Type checkers read the imports, programs read __all__: both should say the same.
    assert module.__file__ is not None
    tree = ast.parse(Path(module.__file__).read_text(encoding="utf-8"))
    typed = [
        alias.asname or alias.name
        for block in tree.body
        if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING"
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    ]
    assert typed
    assert sorted(typed) == sorted(set(module.__all__) - {"__version__"})
    assert set(module.__all__) <= set(dir(module))
    for public in module.__all__:
        value = getattr(module, public)
        # A package of the same name takes its place as soon as it is imported.
        assert not inspect.ismodule(value) or callable(value), f"{public} is a module"
        if inspect.isclass(value) or inspect.isfunction(value):
            assert value.__module__.startswith(module.__name__)
            assert inspect.getdoc(value), f"{public} should have a docstring"


@pytest.mark.parametrize("module", [dtrepair, dtrepair.pipeline, usd_io])
def test_unknown_names_raise(module: ModuleType) -> None:
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        module.nonsense  # noqa: B018


@pytest.mark.parametrize("name", ["dtrepair", "dtrepair.pipeline", "usd_io"])
def test_star_import_brings_exactly_the_public_names(name: str) -> None:
    code = (
        f"from {name} import *\n"
        f"import {name} as package\n"
        "missing = [n for n in package.__all__ if n not in globals()]\n"
        "print(missing)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_the_version_is_that_of_the_distribution() -> None:
    from importlib.metadata import version

    assert version("dtrepair") == dtrepair.__version__
