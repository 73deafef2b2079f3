"""Writes a dressed character: a body that moves, and a shirt and trousers that come too late.

    python examples/dressed_character.py dressed.usda

The clothes are copies of parts of the body, a little wider, and posed as the body was a moment ago:
arms and thighs come through. The arms also pass through the hips. In the rest pose all is clean.
"""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import usd_io
from dtrepair.demo.character import make_character
from dtrepair.files.polygon_mesh import vertex_normals

Floats = NDArray[np.float64]
Quads = NDArray[np.int32]

# Degrees about X, Y, Z in the last frame: arms down, one knee up.
TURNS = {
    "chest": (6, 0, 0),
    "head": (4, 12, 0),
    "left_arm": (30, 0, -52),
    "right_arm": (-20, 0, 46),
    "left_forearm": (0, -105, 0),
    "right_forearm": (0, 26, 0),
    "left_thigh": (14, 0, 4),
    "right_thigh": (-52, 0, 0),
    "right_shin": (64, 0, 0),
}


def cut(quads: Quads, inside: NDArray[np.bool_]) -> tuple[NDArray[np.int64], Quads]:
    """The vertices of the quads that lie `inside` with all corners, and these quads renumbered."""
    kept = quads[inside[quads].all(axis=1)]
    vertices = np.unique(kept).astype(np.int64)
    return vertices, np.searchsorted(vertices, kept).astype(np.int32)


def wider(pose: Floats, quads: Quads, width: float) -> Floats:
    """A pose with its surface moved outwards."""
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return np.asarray(pose + width * vertex_normals(pose, triangles))


def main(path: Path, frames: int = 10) -> None:
    """Write the stage: /Hero/Body, /Hero/Shirt and /Hero/Trousers."""
    body = make_character(2 * frames, turns=TURNS)
    x, y, _ = np.abs(body.rest).T
    arm = x > 0.21
    shirt = np.where(arm, (x < 0.56) & (y > 1.2), (y > 0.93) & (y < 1.45))
    trousers = ~arm & (y > 0.12) & (y < 1.0)

    poses = list(body.points[:frames])
    late = [0.6 * poses[max(k - 1, 0)] + 0.4 * poses[k] for k in range(frames)]
    meshes = [usd_io.AuthoredMesh("/Hero/Body", body.quads, points=poses, rest=body.rest)]
    for name, inside, width in (("Shirt", shirt, 0.028), ("Trousers", trousers, 0.014)):
        vertices, quads = cut(body.quads, inside)
        rest, *cloth = [wider(pose, body.quads, width)[vertices] for pose in (body.rest, *late)]
        meshes.append(usd_io.AuthoredMesh(f"/Hero/{name}", quads, points=cloth, rest=rest))
    usd_io.write_animation(path, meshes, times=np.arange(1.0, frames + 1.0))
    print(f"written: {path}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "dressed.usda"))
