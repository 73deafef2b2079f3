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

from usd_io.errors import OutputError, one_line
from usd_io.paths import check_output_path
from usd_io.write.temporary import make_temporary_folder

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
        """Save the temporary layer. Raises OutputError."""
        assert self.layer is not None
        if not os.path.isdir(self._folder):  # pxr would make it again, and who removed it not know
            raise self._failed(OSError("its temporary folder was removed"))
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
        """Return the OutputError of an exception."""
        return OutputError(
            f"{self.path}: writing failed ({_reason(error)}); an older file is unchanged; check "
            "the free space and permissions"
        )


def _reason(error: BaseException) -> str:
    """Return why the output cannot be written, in a few words."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return one_line(error, limit=160)
