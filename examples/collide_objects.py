"""Pushes a soft arm out of a ball that does not move.

    python examples/collide_objects.py

A `SceneRepairer` takes several bodies in one space. `mobility=0` makes a collider of one; `pin`
holds single vertices, here the shoulder.
"""

import numpy as np
from shapes import arm, ball

import dtrepair


def main() -> None:
    """Repair the arm, and show that ball and shoulder keep every bit."""
    arm_points, arm_faces = arm(bend=0.0)
    ball_points, ball_faces = ball(radius=0.3)
    ball_points = ball_points + np.array([1.5, 0.33, 0.0])
    shoulder = arm_points[:, 0] < 0.2

    scene = dtrepair.SceneRepairer(
        [
            dtrepair.Body(arm_points, arm_faces, pin=shoulder.astype(float)),
            dtrepair.Body(ball_points, ball_faces, mobility=0.0),
        ]
    )
    moved_arm, still_ball = scene([arm_points, ball_points])
    print(f"pairs between arm and ball: {moved_arm.before.inter_pairs} before")
    print(f"pairs between arm and ball: {moved_arm.after.inter_pairs} after")
    assert np.array_equal(still_ball.points, ball_points)
    assert np.array_equal(moved_arm.points[shoulder], arm_points[shoulder])
    print("ball and shoulder: unchanged, bit for bit")


if __name__ == "__main__":
    main()
