"""Counts the intersecting triangles of one mesh, and of many poses with one detector.

    python examples/find_intersections.py

`find_intersections` serves a single mesh. A `Detector` is built once from a rest pose and then
counts many poses of it, a whole clip in one call.
"""

import numpy as np
from shapes import arm

import dtrepair


def main() -> None:
    """Print the counts of a bent arm, and of the arm while it bends."""
    points, faces = arm(bend=3.6)
    pairs = dtrepair.find_intersections(points, faces)  # (K, 2), each pair once
    print(f"one mesh: {len(pairs)} pairs of {len(np.unique(pairs))} triangles intersect")

    rest, _ = arm(bend=0.0)
    clip = np.stack([arm(bend)[0] for bend in np.linspace(2.6, 3.8, 7)])  # (T, V, 3)
    detector = dtrepair.Detector(rest, faces)
    found = detector(clip)  # (K, 3): frame, first triangle, second triangle
    per_frame = np.bincount(found[:, 0], minlength=len(clip))
    print("pairs in each frame:", *per_frame)


if __name__ == "__main__":
    main()
