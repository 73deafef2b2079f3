"""Repairs one pose of a mesh, and looks at what the result tells.

    python examples/repair_mesh.py

The rest pose says what the shape should be. Without one, `dtrepair.repair(points, faces)` takes
the pose itself.
"""

from shapes import arm

import dtrepair


def main() -> None:
    """Repair a bent arm by both methods, and print both results."""
    rest, faces = arm(bend=0.0)
    pose, _ = arm(bend=3.4)
    for method in ("full", "paper"):
        options = dtrepair.RepairOptions(method=method)
        result = dtrepair.Repairer(rest, faces, options=options)(pose)
        print(
            f"{method}: {result.before.triangles} -> {result.after.triangles} triangles, "
            f"{result.status.value}, largest move {result.displacement_max:.1%} of the diagonal"
        )
        # What is reported was counted on the float32 points of the result.
        left = dtrepair.find_intersections(result.points, faces)
        assert len(left) == result.after.pairs


if __name__ == "__main__":
    main()
