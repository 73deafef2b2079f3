"""What of the default method is ready for another device, and what the seams for one cost here?

    OMP_NUM_THREADS=1 python -m benchmarks.device_path --data DIR [--repeats 7]

Three tables, of repairs of three bodies of 27k triangles: the shares of processor time of its
parts, set-up left out; searches of these repairs by a kernel of one thread and by one of many, both
on the CPU, in turns (the ratio is the median of the pairs); and solves of several frames
in one call of cholespy, beside a call each, with the bits that differ.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from scipy import sparse

from benchmarks.method_parts import PARTS, Shares
from dtrepair import Repairer
from dtrepair.device import Device, start_warp
from dtrepair.files.mesh_files import read_mesh
from dtrepair.intersect.topology import components, ring_distances
from dtrepair.numerics.operators import Factor, cotangent_laplacian, lumped_mass

wp = start_warp()

BODIES = ("human_03_childs_pose", "human_07_boxing_guard", "human_08_hugging_knees")
WARM_UP = "human_01_crossed_arms_deep"
# Of a window of a clip.
FRAMES = 32


def poses(data: Path) -> tuple[Repairer, list[Any]]:
    """A repairer of the bodies, and the pose of each; the first is there to warm up."""
    meshes = [read_mesh(data / f"humans/{body}.obj") for body in (WARM_UP, *BODIES)]
    rest = read_mesh(data / "humans/human_male_rest.obj").points
    return Repairer(rest, meshes[0].faces()), [mesh.points for mesh in meshes]


def print_shares(data: Path) -> None:
    """Where the time of the repairs goes."""
    repairer, (first, *others) = poses(data)
    repairer(first)
    shares = Shares()
    with shares.watching():
        for pose in others:
            repairer(pose)
        shares.switch()
    total = sum(shares.seconds.values())
    print("| part | s | share | where it runs |\n|---|---|---|---|")
    places = {part: where for part, where, _ in PARTS} | {"the rest": "numpy, scipy"}
    for part, seconds in sorted(shares.seconds.items(), key=lambda row: -row[1]):
        print(f"| {part} | {seconds:.2f} | {seconds / total:.1%} | {places[part]} |")
    for where in ("device", "Solver"):
        own = sum(shares.seconds[part] for part, place in places.items() if where in place)
        print(f"| all of `{where}` | {own:.2f} | {own / total:.1%} | |")
    print(f"| all | {total:.2f} | | |\n", flush=True)


def _link_roots(links: Any, root: Any) -> None:
    """The kernel of one thread that roots were found by before."""
    for k in range(links.shape[0]):
        i = links[k][0]
        j = links[k][1]
        while root[i] != i:
            root[i] = root[root[i]]
            i = root[i]
        while root[j] != j:
            root[j] = root[root[j]]
            j = root[j]
        root[wp.max(i, j)] = wp.min(i, j)
    # A root comes before what hangs on it.
    for item in range(root.shape[0]):
        root[item] = root[root[item]]


LINK_ROOTS = wp.kernel(_link_roots)


def roots_in_turn(links: Any, items: Any, device: Device) -> Any:
    """`components.least_linked` by that kernel."""
    pairs = np.ascontiguousarray(links, dtype=np.int32).reshape(-1, 2)
    roots = device.array(items, wp.int32)
    device.launch(LINK_ROOTS, 1, [device.array(pairs, wp.vec2i), roots])
    return roots.numpy()


def searches(data: Path) -> dict[str, list[tuple[Any, ...]]]:
    """The arguments of the searches of the repairs: ring distances, and roots of components."""
    asked: dict[str, list[tuple[Any, ...]]] = {"rings": [], "roots": []}

    def recorded(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            asked[name].append(arguments)
            return function(*arguments)

        return call

    rings, roots = ring_distances.rings_in_turn, components.least_linked
    with (
        mock.patch.object(ring_distances, "rings_in_turn", recorded("rings", rings)),
        mock.patch.object(components, "least_linked", recorded("roots", roots)),
    ):
        repairer, of_bodies = poses(data)
        for pose in of_bodies[1:]:
            repairer(pose)
    return asked


def print_searches(data: Path, repeats: int) -> None:
    """Time of both forms of the kernels, on what the repairs asked and on parts of it."""
    asked = searches(data)
    print("| search | calls | one thread, ms | many threads, ms | ratio |\n|---|---|---|---|---|")
    forms: dict[str, tuple[Callable[..., Any], Callable[..., Any]]] = {
        "rings": (ring_distances.rings_in_turn, ring_distances.rings_at_once),
        "roots": (roots_in_turn, components.least_linked),
    }
    for name, (one, many) in forms.items():
        calls = asked[name]
        for arguments in calls:
            assert np.array_equal(one(*arguments), many(*arguments)), name
        halves = {"": calls}
        if name == "rings":
            for most in (100, 1000):
                halves[f", at most {most} pairs"] = [c for c in calls if len(c[1]) <= most]
            halves[", more pairs"] = [c for c in calls if len(c[1]) > 1000]
        for told, own in halves.items():
            row = paired(partial(replayed, one, own), partial(replayed, many, own), repeats)
            print(f"| {name}{told} | {len(own)} | {row[0]:.1f} | {row[1]:.1f} | {row[2]:.2f} |")
    print(flush=True)


def replayed(function: Callable[..., Any], calls: list[tuple[Any, ...]]) -> None:
    """Call a function again with what it was given."""
    for arguments in calls:
        function(*arguments)


def paired(
    first: Callable[[], object], second: Callable[[], object], repeats: int
) -> tuple[float, float, float]:
    """Medians of the processor milliseconds of two runs in turns, and of their ratios."""
    rows: list[tuple[float, float]] = []
    for _ in range(repeats):
        start = time.process_time()
        first()
        middle = time.process_time()
        second()
        rows.append((1e3 * (middle - start), 1e3 * (time.process_time() - middle)))
    one, other = (statistics.median(column) for column in zip(*rows, strict=True))
    return one, other, statistics.median(b / a for a, b in rows)


def print_solves(data: Path, repeats: int) -> None:
    """Whether columns of several frames in one call have the bits of a call each, and the time."""
    mesh = read_mesh(data / "humans/human_male_rest.obj")
    points, faces = mesh.points / np.ptp(mesh.points), mesh.faces()
    laplacian = cotangent_laplacian(points, faces, clamp=(1e-3, 1e3))
    factor = Factor(sparse.diags(lumped_mass(points, faces)) + 99.0 * laplacian)
    right = np.random.default_rng(0).normal(size=(FRAMES, len(points), 3))
    alone = factor.solve(right)

    def batched(size: int) -> Any:
        found = np.empty_like(right)
        for first in range(0, FRAMES, size):
            own = right[first : first + size]
            columns = factor(own.transpose(1, 0, 2).reshape(len(points), -1))
            found[first : first + size] = columns.reshape(len(points), -1, 3).transpose(1, 0, 2)
        return found

    print(
        f"| frames in a call, of {FRAMES} | ms | next to a call each | numbers that differ | by |"
    )
    print("|---|---|---|---|---|")
    for size in (1, 2, 4, 8, 16, 32):
        differ = np.abs(batched(size) - alone) / np.abs(alone).max()
        row = paired(partial(factor.solve, right), partial(batched, size), repeats)
        share = f"{np.mean(differ > 0):.0%} | {differ.max():.1e}"
        print(f"| {size} | {row[1]:.0f} | {row[2]:.2f} | {share} |", flush=True)


def main() -> None:
    """Print the three tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--repeats", type=int, default=7)
    arguments = parser.parse_args()
    print_shares(arguments.data)
    print_searches(arguments.data, arguments.repeats)
    print_solves(arguments.data, arguments.repeats)


if __name__ == "__main__":
    main()
