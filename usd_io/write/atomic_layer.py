"""Atomic layer files: written beside their destination, moved onto it when whole.

`Sdf.Layer.CreateNew(path)` truncates an existing file at once, and writing into a usdc that another
process has mapped kills that process. So a layer is written in a temporary directory beside its
destination and then moved over it by `os.replace`; whoever has the old file open keeps it. Folders
that killed runs left beside the same destination are removed.
"""

from __future__ import annotations

import os
import shutil
from types import TracebackType

from pxr import Sdf, Tf

from usd_io.errors import OutputError, UsageError, one_line
from usd_io.write.temporary import make_temporary_folder

OUTPUT_EXTENSIONS = (".usd", ".usda", ".usdc")

# Unsaved samples live in memory, saved ones do not.
FRAMES_BETWEEN_SAVES = 10


class AtomicLayer:
    """A new layer that appears at its path by `commit`, or not at all.

    As a context manager it aborts when left without `commit`, for whatever reason.

    Attributes:
        layer: the layer to author into; None once committed or aborted.
        path: absolute path of the destination.
    """

    layer: Sdf.Layer | None

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Check the destination and open the temporary layer.

        Raises:
            UsageError: the extension is not that of a USD layer.
            OutputError: the directory is missing or cannot be written to.
        """
        self.path = check_output_path(path)
        directory, name = os.path.split(self.path)
        self.layer = None
        self._folder = ""
        try:
            self._folder = make_temporary_folder(self.path)
            self._file = os.path.join(self._folder, name)
            self.layer = Sdf.Layer.CreateNew(self._file)
        except (OSError, Tf.ErrorException) as error:
            self.abort()
            raise OutputError(
                f"{self.path}: cannot write into {directory} ({_reason(error)}); choose another "
                "output directory"
            ) from None
        except BaseException:
            self.abort()
            raise
        self._text = self.layer.GetFileFormat().formatId == "usda"
        self._unsaved = 0

    def set_sample(self, path: Sdf.Path, time: float, value: object) -> None:
        """Author one sample, at the default time for NaN."""
        assert self.layer is not None
        # NaN is the one value that differs from itself.
        if time != time:
            self.layer.GetAttributeAtPath(path).default = value
        else:
            self.layer.SetTimeSample(path, time, value)

    def end_frame(self) -> None:
        """Save every few frames; text layers only at the end, as each save writes them whole."""
        self._unsaved += 1
        if self._unsaved >= FRAMES_BETWEEN_SAVES and not self._text:
            self._save()

    def commit(self) -> None:
        """Save, and move the file to its destination.

        Raises:
            OutputError: the disk is full or the like; the old output is intact, no file is left.
        """
        assert self.layer is not None
        try:
            self._save()
            self.layer = None
            os.replace(self._file, self.path)
        except OSError as error:
            raise self._failed(error) from None
        finally:
            self.abort()

    def abort(self) -> None:
        """Drop the layer and every temporary file; nothing happens after `commit`."""
        self.layer = None
        if self._folder:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = ""

    def __enter__(self) -> AtomicLayer:
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Abort unless committed."""
        self.abort()

    def _save(self) -> None:
        assert self.layer is not None
        try:
            saved = self.layer.Save()
        except Tf.ErrorException as error:
            self.abort()
            raise self._failed(error) from None
        if not saved:
            self.abort()
            raise self._failed(OSError("the layer was not saved"))
        self._unsaved = 0

    def _failed(self, error: BaseException) -> OutputError:
        return OutputError(
            f"{self.path}: writing failed ({_reason(error)}); an older file is unchanged; check "
            "the free space and permissions"
        )


def check_output_path(path: str | os.PathLike[str]) -> str:
    """The absolute path of an output layer.

    Raises:
        UsageError: the extension is not that of a USD layer.
        OutputError: the directory does not exist, or the path is a directory.
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
    return absolute


def relative_asset_path(asset: str, directory: str) -> str:
    """The asset path of a layer file as seen from a directory: ./shot.usd, ../shot.usd.

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
    """Whether two paths name one file, through links of either kind."""
    if os.path.realpath(first) == os.path.realpath(second):
        return True
    try:
        return os.path.samefile(first, second)
    except OSError:
        return False


def _reason(error: BaseException) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return one_line(error, limit=160)
