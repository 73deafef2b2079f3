"""Makes clips heavier than a walk from single poses of one mesh: limbs right through the body.

    python benchmarks/heavy_clip.py HUMANS OUT.usdc [--clip arms|knees] [--frames N]

HUMANS is a folder with human_male_rest.obj and human_01 ... human_08_*.obj. The frames between the
poses blend deformation gradients: the logarithm of the rotation and the stretch of each triangle,
then a Poisson solve. `benchmarks/animation.py OUT.usdc REST` measures what a repair makes of it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial.transform import Rotation

from dtrepair.files.mesh_files import read_mesh
from dtrepair.numerics.operators import Factor
from dtrepair.transfer.gradients import deformation_operator, degenerate_triangles, stacked
from dtrepair.transfer.poisson import poisson_system
from usd_io import AuthoredMesh, write_animation

Floats = NDArray[np.float64]

# Key poses of each clip: the part of the clip at which it is reached, file ("" is the rest pose),
# and how far the rest pose is blended towards it. Between keys the motion eases in and out.
CLIPS: dict[str, list[tuple[float, str, float]]] = {
    "arms": [
        (0.0, "", 0.0),
        (0.06, "", 0.0),
        (0.34, "human_07_boxing_guard", 1.0),
        (0.60, "human_01_crossed_arms_deep", 1.0),
        (0.94, "", 0.0),
        (1.0, "", 0.0),
    ],
    "knees": [
        (0.0, "", 0.0),
        (0.08, "", 0.0),
        (0.40, "human_08_hugging_knees", 0.9),
        (0.62, "human_04_eagle", 0.9),
        (0.92, "", 0.0),
        (1.0, "", 0.0),
    ],
}


class Blender:
    """Blends poses of one mesh in rotations and stretches of its triangles."""

    def __init__(self, rest: Floats, faces: NDArray[np.int32]) -> None:
        """Factorise for a rest (V, 3) and triangles (F, 3)."""
        self.rest, self.faces = rest, faces
        unusable = degenerate_triangles(rest, faces)
        self.gradient = deformation_operator(rest, faces, unusable)
        weights = np.ones(len(faces))
        self.divergence, matrix = poisson_system(rest, faces, unusable, weights)
        self.factor = Factor(matrix + 1e-9 * sparse.eye(len(rest)) * matrix.diagonal().mean())
        self.order, self.parents = self._spanning_tree()

    def _spanning_tree(self) -> tuple[list[int], NDArray[np.int32]]:
        edges = np.sort(self.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        keys = edges[:, 0].astype(np.int64) * len(self.rest) + edges[:, 1]
        order = np.argsort(keys, kind="stable")
        same = keys[order][1:] == keys[order][:-1]
        first, second = order[:-1][same] // 3, order[1:][same] // 3
        count = len(self.faces)
        graph = sparse.coo_matrix((np.ones(len(first)), (first, second)), (count, count))
        # Walk from the highest triangle, the crown of the head.
        root = int(self.rest[self.faces].mean(axis=1)[:, 1].argmax())
        order, parents = csgraph.breadth_first_order(graph.tocsr(), root, directed=False)
        return order.tolist(), parents

    def parts(self, pose: Floats) -> tuple[Floats, Floats]:
        """Rotation vectors (F, 3), continuous over the mesh, and stretches (F, 3, 3) of a pose."""
        gradients = (self.gradient @ stacked(pose, self.faces)).reshape(-1, 3, 3).swapaxes(1, 2)
        left, values, right = np.linalg.svd(gradients)
        flip = np.linalg.det(left @ right) < 0
        left[flip, :, 2] *= -1.0
        values[flip, 2] *= -1.0
        stretch = right.swapaxes(1, 2) @ (values[:, :, None] * right)
        vectors = Rotation.from_matrix(left @ right).as_rotvec()
        for index in self.order[1:]:
            near, vector = vectors[self.parents[index]], vectors[index]
            angle = np.linalg.norm(vector)
            if angle > 1e-9:
                turns = np.round((near @ vector / angle - angle) / (2 * np.pi))
                vectors[index] = vector * (1.0 + 2 * np.pi * turns / angle)
        return vectors, stretch

    def pose(self, vectors: Floats, stretch: Floats, centre: Floats) -> Floats:
        """The pose (V, 3) of rotation vectors and stretches, its mean vertex at `centre`."""
        gradients = Rotation.from_rotvec(vectors).as_matrix() @ stretch
        right = self.divergence @ gradients.swapaxes(1, 2).reshape(-1, 3)
        points = self.factor(np.ascontiguousarray(right))
        placed: Floats = points - points.mean(axis=0) + centre
        return placed


def make_clip(humans: Path, name: str, frames: int) -> tuple[Floats, NDArray[np.int32], Floats]:
    """Rest (V, 3), triangles and poses (T, V, 3) of a clip of CLIPS; ValueError for other faces."""
    rest = read_mesh(humans / "human_male_rest.obj")
    blender = Blender(rest.points, rest.faces())
    still = blender.parts(rest.points)
    found: dict[str, tuple[Floats, Floats, Floats]] = {"": (*still, rest.points.mean(axis=0))}
    for _, file, _ in CLIPS[name]:
        if file not in found:
            mesh = read_mesh(humans / f"{file}.obj")
            if not np.array_equal(mesh.faces(), rest.faces()):
                raise ValueError(f"{file}.obj should have the faces of the rest pose")
            found[file] = (*blender.parts(mesh.points), mesh.points.mean(axis=0))
    keys = [
        (part, [a + amount * (b - a) for a, b in zip(found[""], found[file], strict=True)])
        for part, file, amount in CLIPS[name]
    ]
    poses = []
    for time in np.linspace(0.0, 1.0, frames):
        after = min(int(np.searchsorted([part for part, _ in keys], time)), len(keys) - 1)
        (start, one), (end, two) = keys[max(after - 1, 0)], keys[max(after, 1)]
        share = np.clip((time - start) / (end - start), 0.0, 1.0)
        eased = share * share * (3.0 - 2.0 * share)
        poses.append(
            blender.pose(*((1 - eased) * a + eased * b for a, b in zip(one, two, strict=True)))
        )
    return rest.points, rest.faces(), np.stack(poses)


def main() -> None:
    """Make a clip and write it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("humans", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--clip", choices=sorted(CLIPS), default="arms")
    parser.add_argument("--frames", type=int, default=64)
    arguments = parser.parse_args()
    rest, faces, poses = make_clip(arguments.humans, arguments.clip, arguments.frames)
    mesh = AuthoredMesh(path="/Character/Body", faces=faces, points=list(poses), rest=rest)
    write_animation(arguments.output, mesh, times=np.arange(1.0, len(poses) + 1.0))


if __name__ == "__main__":
    main()
