"""Gives the bend of one arm to another arm of different topology and build, then repairs it.

    python examples/transfer_pose.py

Markers, a few pairs of corresponding vertices, deform the source onto the target; from that follow
the pairs of triangles that correspond, and from those every pose.
"""

import numpy as np
from shapes import arm, tube

import dtrepair


def main() -> None:
    """Transfer two poses, and repair the one that intersects itself."""
    source, source_faces = arm(bend=0.0, rows=60, around=12)
    rows, around = 81, 20
    line = np.stack([np.linspace(0.0, 2.4, rows), np.zeros(rows)], axis=1)
    thickness = 0.16 + 0.04 * np.cos(np.linspace(0.0, 2 * np.pi, rows))
    target, target_faces = tube(line, thickness, around)

    # Four directions around the arm at five places along it, and both ends.
    along = np.linspace(0.0, 1.0, 5)
    source_rings, target_rings = np.rint(along * 59).astype(int), np.rint(along * 80).astype(int)
    quarter = np.arange(4)
    markers = np.stack(
        [
            np.append(source_rings[:, None] * 12 + quarter * 3, [len(source) - 2, len(source) - 1]),
            np.append(target_rings[:, None] * 20 + quarter * 5, [len(target) - 2, len(target) - 1]),
        ],
        axis=1,
    )
    registered = dtrepair.register(source, source_faces, target, target_faces, markers)
    pairs = dtrepair.match_triangles(registered, source_faces, target, target_faces)
    transfer = dtrepair.Transfer(source, source_faces, target, target_faces, pairs)

    bends = (1.5, 3.1)
    poses = transfer(np.stack([arm(bend)[0] for bend in bends]))  # (T, Vt, 3)
    repairer = dtrepair.Repairer(target, target_faces)
    for bend, pose in zip(bends, poses, strict=True):
        result = repairer(pose)
        print(f"bend {bend}: {result.before.triangles} -> {result.after.triangles} triangles")


if __name__ == "__main__":
    main()
