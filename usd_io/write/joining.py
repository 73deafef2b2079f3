"""Layers of frame ranges, written by several machines over one input, into one layer."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Sdf

from usd_io.crate_check import check_crates
from usd_io.diagnostics import DAMAGE, no_diagnostics, reading
from usd_io.errors import StageError, UsageError, one_line, time_text
from usd_io.layers import read_text
from usd_io.paths import check_output_path, relative_asset_path, same_file
from usd_io.write.atomic_layer import AtomicLayer
from usd_io.write.metadata import get_record, set_record, usd_dictionary
from usd_io.write.normals_sources import NORMALS, RATES
from usd_io.write.rates import author_rates
from usd_io.write.records import check_alike, check_record, part_of, record_of, same_values

LAYER_KEYS = ("subLayers", "subLayerOffsets", "customLayerData")
SHARED_KEYS = ("version", "input", "input_digest", "settings")
RECORD_KEYS = (*SHARED_KEYS, "frames", "written", "written_default")


@dataclass(frozen=True)
class _Chunk:
    """One input of a join: its layer, what it lies over, and what it changed."""

    path: str
    layer: Sdf.Layer
    sources: tuple[str, ...]
    record: dict[str, Any]
    written: dict[str, frozenset[float]]

    def changed(self, prim: Sdf.Path, time: float) -> bool:
        """Return whether the chunk changed a mesh at a time: any, where it has no record."""
        if not self.record:
            return True
        if math.isnan(time):
            return str(prim) in self.record.get("written_default", ())
        return time in self.written.get(str(prim), ())


def join_layers(
    paths: Sequence[str | os.PathLike[str]],
    output: str | os.PathLike[str],
    *,
    differing: Collection[str] = (),
) -> None:
    """Merge outputs of `OverrideWriter` for parts of one animation into one layer.

    A time code that a chunk changed is taken from it; one that no chunk changed is the kept copy
    of the input. Times are exact; samples are copied bit by bit and streamed. Velocities and
    accelerations are computed again across the seams.

    Args:
        paths: the chunk layers; equal whatever their order.
        output: .usd, .usdc or .usda; may be neither a chunk nor the input.
        differing: settings in which the layers may differ, such as the frames that were chosen;
            chunks K/N of one split differ in nothing else.

    Raises:
        StageError: a chunk cannot be read; the chunks lie over different inputs, or were written
            with other settings or by another version; two chunks disagree about a sample; a chunk
            K/N of the N is missing.
        UsageError: no chunks, or the output is one of them or their input.
        OutputError: the output cannot be written.
    """
    if not paths:
        raise UsageError("no layers to join; name at least one")
    target = check_output_path(output)
    chunks = _checked(paths, target, differing)
    with AtomicLayer(target) as file, reading("the layers to join"):
        assert file.layer is not None
        first = chunks[0]
        _copy_info(first.layer.pseudoRoot, file.layer.pseudoRoot, but=LAYER_KEYS)
        _join_range(file.layer, chunks)
        directory = os.path.dirname(target)
        file.layer.subLayerPaths = [relative_asset_path(item, directory) for item in first.sources]
        for prim in sorted({path for chunk in chunks for path in _prim_paths(chunk.layer)}):
            _join_prim(file, chunks, prim)
            _join_rates(file, chunks, prim)
        set_record(file.layer, _joined_record(chunks, list(file.layer.subLayerPaths)))
        file.commit()


def is_joined(
    paths: Sequence[str | os.PathLike[str]],
    output: str | os.PathLike[str],
    *,
    differing: Collection[str] = (),
) -> bool:
    """Return whether an output says it was joined of such layers; else as `join_layers` does."""
    target = os.fspath(output)
    chunks = _checked(paths, target, differing)
    record, below = record_of(target) if os.path.isfile(target) else ({}, "")
    if not record:
        return True
    own = {**_joined_record(chunks, chunks[0].sources), "input": record.get("input")}
    over = [same_file(below, source) for source in chunks[0].sources[:1] if below]
    return all(over) and same_values(record, usd_dictionary(own))


def _checked(
    paths: Sequence[str | os.PathLike[str]], target: str, differing: Collection[str]
) -> list[_Chunk]:
    """Return the layers in their order; raise where they do not belong together."""
    chunks = sorted((_open_chunk(os.fspath(path)) for path in paths), key=_order)
    _check_chunks(chunks, target)
    for chunk in chunks:
        check_alike(chunks[0].path, chunks[0].record, chunk.path, chunk.record, differing)
    _check_complete(chunks)
    return chunks


def _open_chunk(path: str) -> _Chunk:
    """Open one input of a join. Raises StageError where it is no output of this package."""
    with suppress(OSError):  # pxr tells what cannot be read
        check_crates(path)
    try:
        with no_diagnostics():
            layer = read_text(path) or _reloaded(path)
    except DAMAGE as error:
        raise StageError(f"{path}: cannot be opened ({one_line(error)}); write it again") from None
    if layer is None:
        raise StageError(f"{path}: no such layer; check the path")
    with reading(path):
        sources = tuple(layer.ComputeAbsolutePath(item) for item in layer.subLayerPaths)
        record = get_record(layer)
    if not record:
        raise StageError(f"{path}: was not written by a repair; name its outputs, not its input")
    check_record(path, record)
    if "form" in record:
        raise StageError(f"{path}: holds {record['form']}, no points; name layers of points")
    written = {prim: frozenset(times) for prim, times in record.get("written", {}).items()}
    return _Chunk(path, layer, sources, record, written)


def _reloaded(path: str) -> Sdf.Layer | None:
    """Open a layer as its file is now: somebody may hold what it was before."""
    if layer := Sdf.Layer.FindOrOpen(path):
        layer.Reload()
    return layer


def _order(chunk: _Chunk) -> tuple[float, str]:
    """Return the sorting key of a chunk: its first frame, then its path."""
    return min(chunk.record.get("frames", ()), default=math.inf), chunk.path


def _check_chunks(chunks: Sequence[_Chunk], target: str) -> None:
    """Raise StageError for layers that do not belong together.

    Raise UsageError if one of their files is the target.
    """
    first = chunks[0]
    for chunk in chunks:
        for file in (chunk.layer.realPath, *chunk.sources):
            if same_file(file, target):
                raise UsageError(f"{target}: is one of the inputs of the join; choose another")
        if len(chunk.sources) != len(first.sources) or not all(
            same_file(one, other) for one, other in zip(chunk.sources, first.sources, strict=True)
        ):
            raise StageError(
                f"{chunk.path} and {first.path} lie over different inputs; join the outputs of "
                "one input"
            )
        if chunk.layer.timeCodesPerSecond != first.layer.timeCodesPerSecond:
            raise StageError(
                f"{chunk.path} and {first.path} differ in time codes per second; write them again"
            )


def _check_complete(chunks: Sequence[_Chunk]) -> None:
    """Raise StageError if layers are parts K/N, and one of the N is not there."""
    parts = [part_of(chunk.record.get("settings", {}).get("chunk")) for chunk in chunks]
    numbers: dict[int, set[int]] = {}
    for index, count in (part for part in parts if part is not None):
        numbers.setdefault(count, set()).add(index)
    for of, present in numbers.items():
        missing = [f"{k}/{of}" for k in range(1, of + 1) if k not in present]
        if missing:
            raise StageError(
                f"chunk {', '.join(missing[:8])}{' ...' * (len(missing) > 8)} is missing: name the "
                "layers of all chunks of one split"
            )


def _join_range(layer: Sdf.Layer, chunks: Sequence[_Chunk]) -> None:
    """Make the range of a layer that of all chunks, where each has the range of its own frames."""
    parts = [chunk.layer for chunk in chunks]
    if all(part.HasStartTimeCode() and part.HasEndTimeCode() for part in parts):
        layer.startTimeCode = min(part.startTimeCode for part in parts)
        layer.endTimeCode = max(part.endTimeCode for part in parts)


def _prim_paths(layer: Sdf.Layer) -> list[Sdf.Path]:
    """Return the paths of all prims of a layer."""
    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    return [path for path in paths if path.IsPrimPath()]


def _copy_info(source: Sdf.Spec, target: Sdf.Spec, *, but: Sequence[str]) -> None:
    """Copy the fields of a spec but some."""
    for key in sorted(source.ListInfoKeys()):
        if key not in but:
            target.SetInfo(key, source.GetInfo(key))


def _join_prim(file: AtomicLayer, chunks: Sequence[_Chunk], path: Sdf.Path) -> None:
    """Create the `over` and merge its attributes."""
    assert file.layer is not None
    target = Sdf.CreatePrimInLayer(file.layer, path)
    attributes: dict[str, Sdf.AttributeSpec] = {}
    for chunk in chunks:
        prim = chunk.layer.GetPrimAtPath(path)
        if prim:
            _copy_info(prim, target, but=("specifier",))
            for attribute in prim.attributes:
                attributes.setdefault(attribute.name, attribute)
    for name, attribute in attributes.items():
        made = Sdf.AttributeSpec(target, name, attribute.typeName)
        _copy_info(attribute, made, but=("typeName", "variability", "default", "timeSamples"))
        _join_attribute(file, chunks, made.path)


def _join_attribute(file: AtomicLayer, chunks: Sequence[_Chunk], path: Sdf.Path) -> None:
    """Merge one attribute of the chunks: its value and its samples."""
    assert file.layer is not None
    holders = [chunk for chunk in chunks if chunk.layer.GetAttributeAtPath(path)]
    blocked = any(
        isinstance(chunk.layer.GetAttributeAtPath(path).default, Sdf.ValueBlock)
        and not chunk.layer.ListTimeSamplesForPath(path)
        for chunk in holders
    )
    if path.name in NORMALS and blocked:
        file.set_sample(path, math.nan, Sdf.ValueBlock())
        return
    times = sorted({t for chunk in holders for t in chunk.layer.ListTimeSamplesForPath(path)})
    if any(chunk.layer.GetAttributeAtPath(path).HasInfo("default") for chunk in holders):
        times.append(math.nan)
    for time in times:
        file.set_sample(path, time, _joined_value(holders, path, time))
        file.end_frame()


def _joined_value(chunks: Sequence[_Chunk], path: Sdf.Path, time: float) -> object:
    """Return the sample that the chunks agree on.

    Those that changed it decide, or without any those that kept it.
    """
    samples = [(chunk, _value(chunk, path, time)) for chunk in chunks]
    samples = [(chunk, value) for chunk, value in samples if value is not None]
    changed = [item for item in samples if item[0].changed(path.GetPrimPath(), time)]
    deciding = changed or samples
    first, value = deciding[0]
    for chunk, other in deciding[1:]:
        # Rates differ at the seams of the chunks and are computed again.
        if path.name not in RATES and not _same(value, other):
            raise StageError(
                f"{first.path} and {chunk.path} disagree about {path} at {time_text(time)}; "
                + ("give each chunk frames of its own" if changed else "the inputs have changed")
            )
    return value


def _value(chunk: _Chunk, path: Sdf.Path, time: float) -> Any:
    """Return a sample, or the default value for NaN; None if there is none."""
    with reading(f"{chunk.path}: {path}"):
        if math.isnan(time):
            attribute = chunk.layer.GetAttributeAtPath(path)
            return attribute.default if attribute.HasInfo("default") else None
        return chunk.layer.QueryTimeSample(path, time)


def _same(first: Any, second: Any) -> bool:
    """Return whether two values are equal bit for bit."""
    blocks = [isinstance(value, Sdf.ValueBlock) for value in (first, second)]
    if any(blocks):
        return all(blocks)
    # Bytes, because NaN samples are copied too and differ from themselves.
    return np.asarray(first).tobytes() == np.asarray(second).tobytes()


def _join_rates(file: AtomicLayer, chunks: Sequence[_Chunk], prim: Sdf.Path) -> None:
    """Author velocities and accelerations again, from the joined points."""
    assert file.layer is not None
    layer = file.layer
    times = {
        time: any(chunk.changed(prim, time) for chunk in chunks)
        for time in layer.ListTimeSamplesForPath(prim.AppendProperty("points"))
    }
    names = [name for name in RATES if layer.GetAttributeAtPath(prim.AppendProperty(name))]

    def copied(name: str, time: float) -> Any:
        return layer.QueryTimeSample(prim.AppendProperty(name), time)

    author_rates(file, prim, names, times, layer.timeCodesPerSecond, original=copied)


def _joined_record(chunks: Sequence[_Chunk], sources: Sequence[str]) -> dict[str, Any]:
    """Return the record of the joined layer."""
    first = chunks[0].record
    written: dict[str, set[float]] = {}
    for chunk in chunks:
        for prim, times in chunk.written.items():
            written.setdefault(prim, set()).update(times)
    rest = [{k: v for k, v in chunk.record.items() if k not in RECORD_KEYS} for chunk in chunks]
    digests = {chunk.record.get("input_digest") for chunk in chunks}
    digest = {"input_digest": digests.pop()} if len(digests) == 1 and None not in digests else {}
    defaults = {prim for chunk in chunks for prim in chunk.record.get("written_default", ())}
    return {
        "version": first.get("version"),
        "input": sources[0] if sources else None,
        **digest,
        "settings": {k: v for k, v in first.get("settings", {}).items() if k != "chunk"},
        "frames": np.array(sorted(set().union(*written.values())), dtype=np.float64),
        "written": {prim: sorted(times) for prim, times in written.items()},
        "written_default": sorted(defaults),
        "chunks": {f"chunk{number}": record for number, record in enumerate(rest) if record},
    }
