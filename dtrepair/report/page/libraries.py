"""The JavaScript libraries that a page carries: taken as files out of packages, never run here."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from zipfile import ZipFile

# SHA-256 of the files of uPlot 1.6.31, as its author publishes them: youplot only hands them on.
UPLOT = {
    "uplot.iife.min.js": "2d27e8ad3d228164525ce213f9dc716f39b4e3aee0cc773fb3491c96cf4921a2",
    "uplot.min.css": "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04",
}


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
    script, style = (_published(folder / name, digest) for name, digest in UPLOT.items())
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


def _published(path: Path, digest: str) -> str:
    """Return the text of a file of uPlot, if it is the one that was tested, bit for bit."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise LibraryError(f"charts need uPlot of youplot 1.0.0: {error}") from None
    if sha256(content).hexdigest() != digest:
        cure = "pip install --force-reinstall youplot==1.0.0"
        raise LibraryError(f"{path}: expected uPlot 1.6.31, got another file: {cure}")
    return content.decode("utf-8")


def _checked(script: str, name: str) -> str:
    """Return a script if it has what it is taken for, and cannot end its element."""
    if name not in script or "</script" in script.lower() or "<!--" in script:
        raise LibraryError(f"{name}: not the script that was expected")
    return script
