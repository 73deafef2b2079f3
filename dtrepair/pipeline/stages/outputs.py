"""Outputs of a run: refused before anything is computed, and whole or not there at all."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from dtrepair.pipeline.errors import CLEAN, FRAMES, REMAINING, OutputError, UsageError

FilePath = str | os.PathLike[str]

# Choices in a record that name the inputs of a transfer, and all that may name files.
_INPUTS = ("source_path", "target_path")
_FILES = {*_INPUTS, "rest", "pin", "poses", "markers", "correspondence"}
# Choices that change no result. What single objects do, `objects`, is known with the stage only;
# what was asked of them stands in `tables`.
_WITHOUT_EFFECT = {"strict", "strict_references", "objects", "save_correspondence", "registration"}
# So much of what differs fits on a line: choices, and characters of a value.
_MOST_TOLD, _LONGEST_TOLD = 4, 60


def is_stage(path: str) -> bool:
    """Return whether a path is one of a stage; what tells it is loaded when it is asked for."""
    from dtrepair.pipeline.stages import sources

    return sources.is_stage(path)


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


def earlier_than(path: FilePath, inputs: Iterable[str]) -> str:
    """Return which of its inputs an output is older than, or "".

    Layers over one stage say what its content was; other outputs are compared by the times of the
    files. Inputs that are not there, as on another machine, are not compared.
    """
    from usd_io import UsdIoError, input_digest, open_stage
    from usd_io.write.records import record_of

    record, below = record_of(path) if is_stage(os.fspath(path)) else ({}, "")
    digest = record.get("input_digest")
    for name in inputs:
        file = name.partition("[")[0]  # a path into a package
        if not os.path.isfile(file):
            continue
        if digest and below and _same(below, name):
            try:
                if digest == input_digest(open_stage(name)):
                    continue
            except UsdIoError:
                pass  # the run tells what is wrong with it
            return name
        if os.path.getmtime(file) > os.path.getmtime(path):
            return name
    return ""


def recorded_exit_code(path: FilePath) -> int:
    """Return what the run that wrote an output ended with, by its counts; CLEAN without any.

    What it says nothing of counts as done: poses between keys, frames repaired each for itself.
    """
    from usd_io.write.records import record_of

    record = record_of(path)[0] if is_stage(os.fspath(path)) else {}
    counts, settings = record.get("counts"), record.get("settings")
    if not isinstance(counts, Mapping) or not isinstance(settings, Mapping):
        return CLEAN
    if counts.get("failed"):
        return FRAMES
    repaired = _command_of(settings) == "repair"
    left = ("strained", *(("improved", "unchanged") if repaired else ("pairs_after",)))
    return REMAINING if any(counts.get(name) for name in left) else CLEAN


def other_result(
    path: FilePath,
    over: str | None,
    settings: Mapping[str, Any],
    defaults: Mapping[str, Any],
) -> str:
    """Return what a layer is, in words, if another run made it than one that is asked for; else "".

    over: the stage that the run lies over; settings: its choices as an output records them;
    defaults: those that hold where a record, as of an older version, says nothing. Files are
    compared by their names where one of them is not there, as on another machine.
    """
    from usd_io.write.metadata import usd_dictionary
    from usd_io.write.records import record_of

    record, below = record_of(path)
    if over is not None and below and not _same(below, over):
        return f"a layer over {below}"
    kept = record.get("settings")
    if not isinstance(kept, Mapping) or not kept:
        return ""
    asked = usd_dictionary(settings)
    for name in _INPUTS:
        if name in kept and not _alike(name, kept[name], asked.get(name)):
            return f"made of {kept[name]}"
    if (maker := _command_of(kept)) != _command_of(asked):
        return f"made by {maker}"
    common = usd_dictionary(defaults)
    there, here = {**common, **kept}, {**common, **asked}
    differing = [
        f"{name} ({_told(there.get(name))} there, {_told(here.get(name))} asked for)"
        for name in sorted({*there, *here} - _WITHOUT_EFFECT)
        if not _alike(name, there.get(name), here.get(name))
    ]
    return f"made with other choices: {', '.join(differing[:_MOST_TOLD])}" if differing else ""


def _command_of(settings: Mapping[str, Any]) -> str:
    """Return which command records such settings."""
    if "source_path" in settings:
        return "transfer"
    return "keyposes" if "interpolation" in settings else "repair"


def _alike(name: str, one: object, other: object) -> bool:
    """Return whether two values of a choice mean the same."""
    one, other = _plain(one), _plain(other)
    if name in _FILES and isinstance(one, str) and isinstance(other, str):
        return _same(one, other)
    if name in _FILES and isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_same, map(str, one), map(str, other)))
    return one == other


def _plain(value: Any) -> Any:
    """Return a value of a layer with lists for its arrays."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return list(value) if hasattr(value, "__len__") and not isinstance(value, str) else value


def _told(value: object) -> str:
    """Return a value of a choice in a few words."""
    value = "none" if value is None else _plain(value)
    text = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
    text = text or "none"
    return text if len(text) <= _LONGEST_TOLD else f"{text[: _LONGEST_TOLD - 3]}..."


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
