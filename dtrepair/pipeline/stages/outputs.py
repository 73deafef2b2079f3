"""Outputs of a run: refused before anything is computed, and whole or not there at all."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager

from dtrepair.pipeline.errors import OutputError, UsageError

FilePath = str | os.PathLike[str]


@contextmanager
def writing(path: FilePath) -> Iterator[None]:
    """Turn an OSError while writing `path` into an OutputError."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(f"{path}: cannot be written: {reason}; choose another place") from None


def check_writable(path: FilePath) -> None:
    """Refuse an output before any computing: no such directory, no file, no permission."""
    from dtrepair.files.atomic import atomic_output

    try:
        # A trial without the last step: it leaves nothing behind.
        with writing(path), atomic_output(path):
            raise _TrialDone
    except _TrialDone:
        pass


class _TrialDone(Exception):
    """Ends the trial of `check_writable`."""


def is_readable(path: FilePath) -> bool:
    """Return whether a path is a file that opens as a layer or mesh file."""
    from dtrepair.files.polygon_mesh import MeshFileError
    from dtrepair.pipeline.stages.sources import is_stage

    if not os.path.isfile(path):
        return False
    if is_stage(os.fspath(path)):
        from usd_io import UsdIoError, open_stage

        try:
            open_stage(path)
        except UsdIoError:
            return False
        return True
    from dtrepair.files.mesh_files import read_mesh

    try:
        read_mesh(path)
    except MeshFileError:
        return False
    return True


def has_record(path: FilePath) -> bool:
    """Return whether a layer says how it was made, as outputs do; mesh files cannot say it."""
    from usd_io.write.records import record_of

    return bool(record_of(path)[0])


def other_result(path: FilePath, over: str | None, settings: Mapping[str, str | None]) -> str:
    """Return what a layer is, in words, if another run made it than one that is asked for; else "".

    over: the stage that the run lies over; settings: some of its choices. Files are compared by
    their names where one of them is not there, as on another machine.
    """
    from usd_io.write.records import record_of

    record, below = record_of(path)
    if over is not None and below and not _same(below, over):
        return f"a layer over {below}"
    kept = record.get("settings", {})
    for name, value in settings.items():
        own = kept.get(name) if isinstance(kept, Mapping) else None
        if name.endswith("_path") and own and not (value and _same(own, value)):
            return f"made of {own}"
        if not name.endswith("_path") and own != value:
            return f"of {name} {own}" if own else f"of no {name}"
    return ""


def _same(one: str, other: str) -> bool:
    """Return whether two paths name one file; of a file in a package, the package."""
    paths = [path.partition("[")[0] if path.endswith("]") else path for path in (one, other)]
    if all(os.path.exists(path) for path in paths):
        return os.path.samefile(*paths)
    return os.path.basename(paths[0]) == os.path.basename(paths[1])


def refuse_overwriting(
    output: FilePath,
    *inputs: str | None,
    others: Iterable[str | None] = (),
) -> None:
    """Refuse an output that is one of the inputs, or of the `others`, outputs as well."""
    for what, names in (("an input", inputs), ("another output", others)):
        if any(name and os.path.realpath(name) == os.path.realpath(output) for name in names):
            raise UsageError(f"{output}: is {what} of this run; choose another output")


def remove_unfinished(output: FilePath) -> None:
    """Remove what this process has written of an output so far: it will exit without an end."""
    from usd_io.write.temporary import remove_own_folders

    remove_own_folders(output)
