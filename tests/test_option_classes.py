"""Numbers of stages: frozen, named, told with their reason, and each of them used."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import pkgutil
import re
from pathlib import Path
from typing import Any

import pytest

import dtrepair

ROOT = Path(dtrepair.__file__).parent


def option_classes() -> list[type[Any]]:
    """Every dataclass of the package whose name ends in Options, once."""
    found = {}
    for module in pkgutil.walk_packages(dtrepair.__path__, "dtrepair."):
        if module.name.endswith("__main__"):
            continue
        for name, value in vars(importlib.import_module(module.name)).items():
            if name.endswith("Options") and dataclasses.is_dataclass(value):
                assert isinstance(value, type)
                found[f"{value.__module__}.{name}"] = value
    return list(found.values())


CLASSES = option_classes()


def own_fields(kind: type[Any]) -> list[dataclasses.Field[Any]]:
    return [
        field for field in dataclasses.fields(kind) if field.name in vars(kind)["__annotations__"]
    ]


@pytest.mark.parametrize("kind", CLASSES, ids=lambda kind: kind.__name__)
def test_options_are_frozen_named_and_told(kind: type[Any]) -> None:
    assert kind.__dataclass_params__.frozen
    told = re.sub(r"\s+", " ", kind.__doc__ or "")
    for field in own_fields(kind):
        assert field.kw_only, f"{field.name} can be given without its name"
        assert re.search(rf"\b{field.name}\b", told), f"{field.name} is not told of"


def test_every_option_is_used() -> None:
    read = {
        node.attr
        for path in ROOT.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute)
    }
    idle = {
        f"{kind.__name__}.{field.name}"
        for kind in CLASSES
        for field in own_fields(kind)
        if field.name not in read
    }
    assert not idle


def test_names_of_options_are_told_apart() -> None:
    names = [kind.__name__ for kind in CLASSES]
    assert len(names) > 40 and len(set(names)) == len(names)
