"""Which triangles belong together: the same topology, markers, or a correspondence file."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.files.archives import DAMAGE, check_archive
from dtrepair.pipeline.errors import USAGE, InputError, UsageError
from dtrepair.pipeline.stages.outputs import writing
from dtrepair.pipeline.transfer.inputs import input_errors
from dtrepair.pipeline.transfer.matches import choose_matches
from dtrepair.pipeline.transfer.options import TransferOptions
from dtrepair.pipeline.transfer.pair import JoinedMeshes, Mesh, Pair
from dtrepair.pipeline.transfer.picture import draw_registration
from dtrepair.report.sections import MarkersRecord
from dtrepair.wording import listed


@dataclass(frozen=True)
class Correspondence:
    """Pairs (K, 2) of (source triangle, target triangle) and where they come from.

    registered: source rest (V, 3) deformed onto the target, None where nothing was registered.
    origin: markers, file or topology; markers: what a report says of them.
    """

    pairs: NDArray[np.int32]
    origin: str
    registered: NDArray[np.float64] | None = None
    markers: MarkersRecord | None = None
    warnings: tuple[str, ...] = ()


def match(pair: Pair, options: TransferOptions) -> Correspondence:
    """Pair the triangles of source and target rest; save and draw them as asked."""
    from dtrepair.transfer import write_correspondence

    meshes, up = pair.meshes, pair.axes.up
    if not (pair.from_meshes.several or pair.to_meshes.several) or options.correspondence:
        if options.match:
            raise UsageError("--match: both sides are one mesh; take --markers")
        found = find_correspondence(*meshes, markers=options.markers, file=options.correspondence)
    else:
        found = _of_several(pair.from_meshes, pair.to_meshes, options)
    if options.save_correspondence is not None:
        with writing(options.save_correspondence):
            faces = [mesh[1] for mesh in meshes]
            write_correspondence(options.save_correspondence, found.pairs, *faces)
    if options.registration is not None:
        try:
            with writing(options.registration):
                draw_registration(
                    options.registration, *meshes, found.pairs, found.registered, up=up
                )
        except ImportError as error:
            undrawn = f"{options.registration}: not drawn: {error}"
            return replace(found, warnings=(undrawn, *found.warnings))
    return found


def _of_several(
    source: JoinedMeshes, target: JoinedMeshes, options: TransferOptions
) -> Correspondence:
    """Pair the meshes that match; what is left of the target follows the nearest of its parts."""
    from dtrepair.transfer import following_pairs

    matches = choose_matches(source, target, options)
    pairs, warnings = [], list[str]()
    markers: MarkersRecord | None = None
    for chosen in matches:
        sides = source.part(chosen.source), target.part(chosen.target)
        found = find_correspondence(*sides, markers=chosen.markers, file=None)
        starts = source.triangles(chosen.source).start, target.triangles(chosen.target).start
        pairs.append(found.pairs + np.array(starts, dtype=np.int32))
        markers = markers or found.markers
        warnings += found.warnings
    known = {chosen.target for chosen in matches}
    led = [place for place in range(len(target.paths)) if place not in known]
    followers = np.zeros(len(target.faces), dtype=bool)
    for place in led:
        followers[target.triangles(place)] = True
    if led:
        names = listed([target.paths[place] for place in led])
        warnings.append(f"no mesh of the source corresponds to {names}: follows the nearest part")
    every = following_pairs(np.concatenate(pairs), target.points, target.faces, followers)
    origin = "topology" if markers is None else "markers"
    return Correspondence(every, origin, markers=markers, warnings=tuple(warnings))


def find_correspondence(
    source: Mesh, target: Mesh, *, markers: str | None, file: str | None
) -> Correspondence:
    """Pair the triangles of two rests, each (V, 3) and (F, 3)."""
    from dtrepair.transfer import identity_pairs, read_correspondence

    if file is not None:
        with input_errors():
            return Correspondence(read_correspondence(file, source[1], target[1]), "file")
    if markers is not None:
        return _from_markers(source, target, markers)
    with input_errors(code=USAGE, prefix="--markers, --correspondence: "):
        return Correspondence(identity_pairs(source[1], target[1]), "topology")


def _from_markers(source: Mesh, target: Mesh, path: str) -> Correspondence:
    from dtrepair.transfer import check_markers, match_triangles, register

    rows = read_marker_file(path, len(source[0]), len(target[0]))
    with input_errors(prefix=f"{path}: "):
        check = check_markers(*source, *target, rows)
        registered = register(*source, *target, rows)
        pairs = match_triangles(registered, source[1], *target)
    record = MarkersRecord(
        count=len(rows),
        distance_median=float(np.median(check.distances)),
        distance_max=float(check.distances.max()),
        suspects=check.suspects,
        swapped=check.swapped,
    )
    warnings = tuple(f"{path}: {text}" for text in check.warnings)
    return Correspondence(pairs, "markers", registered, record, warnings)


def read_marker_file(path: str, source_count: int, target_count: int) -> NDArray[np.int32]:
    """Read markers (K, 2) from `.cons`, two columns of text, or an npz with the entry `markers`."""
    from dtrepair.transfer import read_markers
    from dtrepair.transfer.matching.markers import checked_markers

    with input_errors():
        if not path.lower().endswith(".npz"):
            return read_markers(path, source_count=source_count, target_count=target_count)
    rows = read_arrays(path, "markers")["markers"]
    with input_errors(prefix=f"{path}: "):
        return checked_markers(rows, source_count, target_count)


def read_arrays(path: str, needed: str) -> dict[str, NDArray[Any]]:
    """Read an npz that holds at least the entry `needed`."""
    if not os.path.isfile(path):
        raise InputError(f"{path}: cannot be read: no such file")
    try:
        data = Path(path).read_bytes()
        check_archive(data)
        with np.load(BytesIO(data), allow_pickle=False) as archive:
            content = {name: archive[name] for name in archive.files}
    except (*DAMAGE, AttributeError) as error:
        raise InputError(
            f"{path}: is not an npz archive ({error}); write it with numpy.savez"
        ) from None
    if needed not in content:
        names = ", ".join(sorted(content)) or "nothing"
        raise InputError(f"{path}: expected the entry {needed!r}, got {names}")
    return content
