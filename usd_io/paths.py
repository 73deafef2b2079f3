"""Paths of layer files: which file they name, whether one can be written, how one sees another."""

from __future__ import annotations

import os

from usd_io.errors import OutputError, UsageError

OUTPUT_EXTENSIONS = (".usd", ".usda", ".usdc")


def check_output_path(path: str | os.PathLike[str]) -> str:
    """Return the absolute path of an output layer.

    Raises:
        UsageError: the extension is not that of a USD layer.
        OutputError: the directory does not exist, or the path is no file.
    """
    absolute = os.path.abspath(os.fspath(path))
    extension = os.path.splitext(absolute)[1].lower()
    if extension == ".usdz":
        raise UsageError(
            f"{path}: a usdz package cannot be written; write a .usdc layer over the input and "
            "package both"
        )
    if extension not in OUTPUT_EXTENSIONS:
        raise UsageError(f"{path}: expected an output ending in {', '.join(OUTPUT_EXTENSIONS)}")
    directory = os.path.dirname(absolute)
    if not os.path.isdir(directory):
        raise OutputError(f"{path}: no directory {directory}; create it first")
    if os.path.isdir(absolute):
        raise OutputError(f"{path}: is a directory; name a file in it")
    if os.path.exists(absolute) and not os.path.isfile(absolute):
        raise OutputError(f"{path}: is a device, a FIFO or a socket; name a file")
    return absolute


def relative_asset_path(asset: str, directory: str) -> str:
    """Return the asset path of a layer file seen from a directory: ./a.usd, ../a.usd.

    Falls back to the absolute path where links make the relative one point elsewhere, or on
    another drive.
    """
    outer, bracket, inner = asset.partition("[")
    outer = os.path.abspath(outer)
    try:
        relative = os.path.relpath(outer, directory)
    except ValueError:
        return asset
    seen_from_link = os.path.normpath(os.path.join(os.path.realpath(directory), relative))
    if os.path.realpath(seen_from_link) != os.path.realpath(outer):
        return outer.replace(os.sep, "/") + bracket + inner
    relative = relative.replace(os.sep, "/")
    if not relative.startswith("../"):
        relative = f"./{relative}"
    return relative + bracket + inner


def same_file(first: str, second: str) -> bool:
    """Return whether two paths name one file, through links of either kind."""
    if os.path.realpath(first) == os.path.realpath(second):
        return True
    try:
        return os.path.samefile(first, second)
    except OSError:
        return False
