"""Stages of several objects, made in code, repaired as a user would: clean, close, stiff, steady?

    OMP_NUM_THREADS=1 python -m benchmarks.scenes [--only NAME ...] [--ways NAME ...] [--data DIR]

Each stage is repaired by the command line in every way that makes sense: all objects moving, each
as --collider, stiff ones with diffusion 999 or --rigid, each frame --alone. What is printed is read
back from the layer by pxr, in world space, and counted anew: frames that still intersect (a
collider with itself does not count), whether colliders kept every bit, the largest displacement of
any object (over its diagonal), the rms log-ratio of the edges of the stiff (else the most changed)
object, jitter, and processor seconds of the whole command over the frames. --data adds the two
shared scenes; --exact counts with libigl and CGAL. An exit code that does not fit what was counted
is printed.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.scene_files import World, read_world, write_stage
from benchmarks.scene_stages import STAGES
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.geometry import FloatArray, IntArray, unique_edges
from dtrepair.numerics.metrics import displacements, edge_log_ratio, jitter

# Scenes that are files: their names below --data, what they hold, and what is stiff of that.
SHARED = {
    "sword_in_stone.usda": (("/Scene/Stone", "/Scene/Sword"), ("/Scene/Sword",)),
    "sleeve_on_arm.usdc": (("/Scene/Human/Body", "/Scene/Human/Sleeve"), ()),
}
COLUMNS = "stage | way | not clean | still | moved: mean / max | edges: mean / max | jitter | s"

# Finds the pairs (K, 2) of a mesh (V, 3), (F, 3) with a weld map (V,).
Finder = Callable[[FloatArray, IntArray, IntArray], IntArray]


@dataclass(frozen=True)
class Source:
    """A stage that is measured: its file, the paths of what it holds, those that are stiff."""

    name: str
    path: Path
    world: World
    objects: tuple[str, ...]
    stiff: tuple[str, ...]


@dataclass(frozen=True)
class Way:
    """How a stage is repaired: a label, arguments, the collider, whether stiff ones are stiff."""

    label: str
    arguments: tuple[str, ...]
    still: str = ""
    stiff: bool = False


def find_pairs(points: FloatArray, faces: IntArray, weld: IntArray) -> IntArray:
    """Intersecting pairs (K, 2), by this package."""
    return Detector(points, faces)(points, weld=weld)


def find_by_cgal(points: FloatArray, faces: IntArray, weld: IntArray) -> IntArray:
    """The same by libigl with CGAL; pairs that share a vertex or a position left out."""
    from igl.copyleft.cgal import remesh_self_intersections

    single = points.astype(np.float32).astype(np.float64)
    pairs = remesh_self_intersections(single, faces.astype(np.int64), detect_only=True)[2]
    own = weld[faces[pairs]] if len(pairs) else np.zeros((0, 2, 3), dtype=np.int64)
    share = (own[:, 0, :, None] == own[:, 1, None, :]).any(axis=(1, 2))
    distinct: IntArray = pairs.reshape(-1, 2)[~share]
    return distinct


def count_dirty(world: World, weld: IntArray, still: str, find: Finder) -> int:
    """Frames with pairs; what a collider has with itself is not asked for."""
    held = [bool(still) and path.startswith(still) for path in world.paths]
    of_face = np.repeat(held, [len(faces) for faces in world.faces])
    frames = range(len(world.points[0]))
    return sum(not of_face[find(*world.joined(k), weld)].all(axis=1).all() for k in frames)


def sources(only: list[str] | None, folder: Path, data: Path | None) -> Iterator[Source]:
    """The stages that are asked for, written where they are made in code."""
    for name, make in STAGES.items():
        if only is None or name in only:
            stage, path = make(), folder / f"{name}.usda"
            path.unlink(missing_ok=True)
            write_stage(stage, path)
            objects = tuple(f"/World/{part.name}" for part in stage.parts)
            stiff = tuple(f"/World/{own}" for own in stage.stiff.split())
            yield Source(name, path, read_world(path), objects, stiff)
    for file, (objects, stiff) in SHARED.items() if data is not None else ():
        path = Path(data or "", "scenes", file)
        if only is None or path.stem in only:
            yield Source(path.stem, path, read_world(path), objects, stiff)


def ways(source: Source, config: Path) -> Iterator[Way]:
    """What is tried on a stage."""
    yield Way("both", ())
    yield Way("alone", ("--alone",))
    for path in source.objects:
        if not source.stiff or path in source.stiff:
            yield Way(f"{_short(path)} still", ("--collider", f"{path}//"), path)
    for path in source.objects if not source.stiff else ():
        yield Way(f"{_short(path)} still, alone", ("--collider", f"{path}//", "--alone"), path)
    if not source.stiff:
        return
    config.write_text(
        "".join(f'[[prim]]\npath = "{path}//"\ndiffusion = 999\n' for path in source.stiff)
    )
    rigid = ("--rigid", " + ".join(f"{path}//" for path in source.stiff))
    for label, stiffly in (("stiff", ("--config", str(config))), ("rigid", rigid)):
        yield Way(label, stiffly, "", True)
        yield Way(f"{label}, alone", (*stiffly, "--alone"), "", True)
        for path in source.objects:
            if path not in source.stiff:
                collider = (*stiffly, "--collider", f"{path}//")
                short = _short(path)
                yield Way(f"{label}, {short} still", collider, path, True)
                yield Way(f"{label}, {short} still, alone", (*collider, "--alone"), path, True)


def _short(path: str) -> str:
    return path.rpartition("/")[2]


def measure(source: Source, way: Way, out: Path, find: Finder) -> str:
    """Run the command line on a stage and look at what it wrote: a row of the table."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "dtrepair", "repair", str(source.path), "-o", str(out), "-q"]
    code = subprocess.run([*command, "--jobs", "1", *way.arguments], check=False).returncode
    now = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = now.ru_utime + now.ru_stime - spent.ru_utime - spent.ru_stime
    before, after = source.world, read_world(out)
    frames, weld = len(before.points[0]), before.weld()
    dirty = count_dirty(after, weld, way.still, find)
    kept, mean, farthest, shaken, edges = "", 0.0, 0.0, 0.0, (0.0, 0.0)
    for index, path in enumerate(before.paths):
        old, new = before.points[index], after.points[index]
        if way.still and path.startswith(way.still):
            kept = "yes" if before.bits[index] == after.bits[index] else "MOVED"
            continue
        far = [displacements(a, b) for a, b in zip(old, new, strict=True)]
        mean, farthest = max(mean, float(np.mean(far))), max(farthest, float(np.max(far)))
        shaken = max(shaken, jitter(old, new))
        if way.stiff and not path.startswith(source.stiff):
            continue
        ends = unique_edges(before.faces[index])
        each = [edge_log_ratio(a, b, ends) for a, b in zip(old, new, strict=True)]
        edges = max(edges, (float(np.mean(each)), max(each)))
    odd = "" if code == (dirty > 0) else f", EXIT {code}"
    return (
        f"| {source.name} | {way.label} | {dirty} of {frames}{odd} | {kept} "
        f"| {mean:.4f} / {farthest:.3f} | {edges[0]:.3f} / {edges[1]:.3f} "
        f"| {shaken:.1e} | {seconds / frames:.2f} |"
    )


def main() -> None:
    """Print one row for each stage and way."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", help="names of stages")
    parser.add_argument("--ways", nargs="+", help="labels of ways")
    parser.add_argument("--data", type=Path, help="folder of shared data")
    parser.add_argument("--exact", action="store_true", help="count with libigl and CGAL")
    parser.add_argument("--keep", type=Path, help="leave the stages and layers here")
    given = parser.parse_args()
    folder = given.keep or Path(tempfile.mkdtemp())
    folder.mkdir(exist_ok=True)
    print(f"| {COLUMNS} |\n{'|---' * 8}|")
    for source in sources(given.only, folder, given.data):
        for index, way in enumerate(ways(source, folder / f"{source.name}.toml")):
            if given.ways is None or way.label in given.ways:
                out = folder / f"{source.name}_{index}.usdc"
                finder = find_by_cgal if given.exact else find_pairs
                print(measure(source, way, out, finder), flush=True)


if __name__ == "__main__":
    main()
