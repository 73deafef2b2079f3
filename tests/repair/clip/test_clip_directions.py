"""Preferred directions in clips: frames of a window are led as single poses are."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dtrepair import Status
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.clip.clip_options import ClipOptions
from dtrepair.repair.independent_options import IndependentOptions
from dtrepair.repair.relief.other_ways import OtherWayOptions
from dtrepair.repair.repairer import SceneRepairer
from dtrepair.repair.scene.bodies import Body
from dtrepair.repair.solution_cache import Arrays
from dtrepair.repair.strain.bounds import StrainOptions
from tests.meshes import armed_body

REST, FACES = armed_body(0.0)
ARM = np.arange(len(REST)) > 12 * 30
X, _, Z = np.eye(3)


class Kept(dict[str, Arrays]):
    """A memory of solved windows."""

    recall = dict.get
    keep = dict.__setitem__


def arm_motions(
    way: FloatArray,
    curls: tuple[float, ...],
    strain: StrainOptions = StrainOptions(),
    *,
    clean: bool = True,
    **numbers_of_clips: Any,
) -> tuple[FloatArray, Kept]:
    """Mean motion (T, 3) of an arm that is led a way in a clip; whether all of it is `clean`."""
    independent = IndependentOptions(strain=strain)
    numbers = replace(ClipOptions(independent=independent), **numbers_of_clips)
    poses = [armed_body(curl)[0] for curl in curls]
    body, kept = Body(REST, FACES, direction=np.where(ARM[:, None], way, 0.0)), Kept()
    clip = SceneRepairer([body], clip=numbers).make_animator(kept)
    frames = ((float(time), [pose]) for time, pose in enumerate(poses))
    results = [frame.results[0] for frame in clip.stream(frames, jobs=1)]
    assert all(result.status is Status.CLEAN for result in results) == clean
    moved = [(r.points - pose)[ARM].mean(axis=0) for r, pose in zip(results, poses, strict=True)]
    return np.array(moved), kept


@pytest.mark.parametrize("way", [-Z, Z], ids=str)
def test_frames_that_pushing_left_dirty_are_led_their_way(way: FloatArray) -> None:
    # Relaxed and lent without regard to directions they went as far across as along.
    for motion in arm_motions(way, (4.2, 4.4))[0]:
        along = float(motion @ way)
        assert along > 0.1
        assert np.linalg.norm(motion - along * way) < 0.5 * along


def test_a_window_that_its_directions_strain_is_solved_without() -> None:
    # Through all of the body, the arm is drawn out; the other way is a sixth as long.
    led, kept = arm_motions(-X, (3.9, 4.1))
    assert (led @ -X > 0.8).all() and len(kept) == 1
    free, kept = arm_motions(-X, (3.9, 4.1), StrainOptions(factor=1.5))
    assert (free @ X > 0.1).all()
    # Both ways are remembered, each under its own key.
    assert len(kept) == 2
    # A way on which anything moves much farther is not taken.
    none = {"ways": OtherWayOptions(farther=0.0, near=0.0)}
    kept_on, _ = arm_motions(-X, (3.9, 4.1), StrainOptions(factor=1.5), clean=False, **none)
    assert not (kept_on @ X > 0.1).any()
