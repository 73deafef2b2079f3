"""A pile of movable objects: what its repair costs as the number of objects grows.

Shapes of five kinds, some rigid, on a grid with some disorder, each overlapping its neighbours: the
contacts grow with the objects, the pairs of objects with their square.

    python benchmarks/pile.py [--objects 2 4 8 16 32 64] [--rigid]
"""

from __future__ import annotations

import argparse
import resource
import time

import numpy as np

from dtrepair import Body, SceneRepairer, Status
from dtrepair.numerics.geometry import FloatArray, IntArray
from tests.meshes import icosphere, torus

Mesh = tuple[FloatArray, IntArray]


def shapes() -> list[Mesh]:
    """A ball, an egg, a rod, a ring and a cushion, about 1 across."""
    ball, faces = icosphere(3, 0.5)
    ring, ring_faces = torus(32, 16, 0.38, 0.14)
    cushion = np.sign(ball) * np.abs(ball / 0.5) ** 0.5 * 0.4
    stretched = [ball, ball * [1.2, 0.8, 0.8], ball * [1.4, 0.5, 0.5], cushion]
    return [*((points, faces) for points in stretched), (ring, ring_faces)]


def pile(count: int, *, seed: int = 0) -> list[Mesh]:
    """Closed meshes on the cells of a cube, turned at random."""
    generator = np.random.default_rng(seed)
    side = int(np.ceil(count ** (1 / 3)))
    cells = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    meshes = []
    kinds = shapes()
    for index, cell in enumerate(cells[:count]):
        points, faces = kinds[index % len(kinds)]
        turn = np.linalg.qr(generator.normal(size=(3, 3)))[0]
        turn[:, 0] *= np.sign(np.linalg.det(turn))
        place = 0.85 * cell + 0.04 * generator.normal(size=3)
        meshes.append((points @ turn.T + place, faces))
    return meshes


def main() -> None:
    """Print one row for each number of objects."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--objects", type=int, nargs="+", default=[2, 4, 8, 16, 32, 64])
    parser.add_argument("--rigid", action="store_true", help="every second object is rigid")
    given = parser.parse_args()
    warm = pile(2)
    SceneRepairer([Body(*mesh) for mesh in warm])([points for points, _ in warm])
    print("objects  triangles  pairs  left  build s  repair s  ms/contact  most memory MB")
    for count in given.objects:
        meshes = pile(count)
        bodies = [Body(*mesh, rigid=given.rigid and k % 2 == 1) for k, mesh in enumerate(meshes)]
        start = time.process_time()
        scene = SceneRepairer(bodies)
        before = len(scene.scene.detector(np.concatenate([points for points, _ in meshes])))
        built = time.process_time()
        results = scene([points for points, _ in meshes])
        end = time.process_time()
        left = sum(result.status is not Status.CLEAN for result in results)
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        triangles = sum(len(faces) for _, faces in meshes)
        print(
            f"{count:7d}  {triangles:9d}  {before:5d}  {left:4d}  {built - start:7.2f}  "
            f"{end - built:8.2f}  {1e3 * (end - built) / max(before, 1):10.2f}  {memory:14.0f}"
        )


if __name__ == "__main__":
    main()
