"""The JavaScript libraries that a page carries: taken as files out of packages, never run here."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from zipfile import ZipFile


class LibraryError(Exception):
    """A library is not where its package had it."""


@dataclass(frozen=True)
class Library:
    """A classic script, and styles that belong to it."""

    script: str
    style: str = ""


@cache
def chart_library() -> Library:
    """Return uPlot (MIT, Leon Sorokin), the charts. Raises LibraryError."""
    folder = _folder("youplot") / "vendor"
    try:
        script = (folder / "uplot.iife.min.js").read_text(encoding="utf-8")
        style = (folder / "uplot.min.css").read_text(encoding="utf-8")
    except OSError as error:
        raise LibraryError(f"charts need uPlot of youplot 1.0.0: {error}") from None
    notice = "/* uPlot: MIT licence, Copyright (c) Leon Sorokin */\n"
    return Library(_checked(notice + script, "uPlot"), style)


@cache
def space_library() -> Library:
    """Return three.js (MIT, Three.js Authors) with TrackballControls. Raises LibraryError.

    trimesh keeps it within the template of its own viewer, in front of a loader.
    """
    path = _folder("trimesh") / "resources" / "templates" / "viewer.zip"
    try:
        with ZipFile(path) as archive:
            page = archive.read("viewer.html.template").decode("utf-8")
        start = page.index("<script>") + len("<script>")
        end = page.index("(function(){class GLTFLoader", start)
    except (OSError, KeyError, ValueError) as error:
        raise LibraryError(
            f"the viewer needs three.js of trimesh 4.8.3 or newer: {error}"
        ) from None
    return Library(_checked(page[start:end], "TrackballControls"))


def _folder(package: str) -> Path:
    """Return the folder of a package without importing it."""
    found = find_spec(package)
    if found is None or not found.submodule_search_locations:
        raise LibraryError(f"{package} is not installed: pip install {package}")
    return Path(found.submodule_search_locations[0])


def _checked(script: str, name: str) -> str:
    """Return a script if it has what it is taken for, and cannot end its element."""
    if name not in script or "</script" in script.lower() or "<!--" in script:
        raise LibraryError(f"{name}: not the script that was expected")
    return script
