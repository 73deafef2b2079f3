"""Reads an animated mesh from a USD stage, repairs all its frames, and writes a layer over it.

    python examples/repair_animation.py [FOLDER]

What `dtrepair repair` does, with the parts laid open: `usd_io` reads and writes, `dtrepair` sees
arrays only. Without FOLDER the stages go into a temporary one.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from shapes import arm

import dtrepair
import usd_io


def make_stage(path: Path) -> None:
    """Write an arm that bends until it passes through itself, and opens again."""
    rest, faces = arm(bend=0.0)
    bends = 3.5 * np.sin(np.linspace(0.6, np.pi - 0.6, 12))
    poses = [arm(bend)[0] for bend in bends]
    mesh = usd_io.AuthoredMesh("/Character/Arm", faces, points=poses, rest=rest)
    usd_io.write_animation(path, mesh, times=np.arange(1.0, len(poses) + 1.0))


def main(folder: Path) -> None:
    """Write shot.usda and shot_repaired.usdc."""
    make_stage(folder / "shot.usda")
    opened = usd_io.open_stage(folder / "shot.usda")
    mesh = usd_io.read_meshes(opened).meshes[0]

    repairer = dtrepair.Repairer(mesh.rest, mesh.faces)
    results = repairer.animation(usd_io.read_points(mesh, mesh.times), times=mesh.times)

    settings = {"method": "full"}
    with usd_io.OverrideWriter(opened, folder / "shot_repaired.usdc", settings=settings) as writer:
        for time, result in zip(mesh.times, results, strict=True):
            writer.write(mesh, time, result.points)
            print(f"frame {time:g}: {result.before.triangles} -> {result.after.triangles}")
        writer.commit()
    print(f"written: {writer.path}")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        Path(sys.argv[1]).mkdir(parents=True, exist_ok=True)
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))
