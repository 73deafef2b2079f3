"""Whether rests tell how meshes lie to each other: of caches at one origin they do not."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline import check_stage, repair_stage
from dtrepair.pipeline.modelled.references import layer_poses, modelled_parts
from dtrepair.pipeline.modelled.together import Together, together
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.rest import choose_rests
from dtrepair.pipeline.stages.sources import Source, open_source
from tests.jointed_arm import FORE, UPPER, arm
from tests.meshes import Mesh, icosphere, joined, tube
from usd_io import AuthoredMesh, write_animation

Points = NDArray[np.float64]
ALONG = np.array([1.0, 0.0, 0.0])
HEAD, EYE = icosphere(2), icosphere(1, 0.2)
FRAMES = 6


class Scene(NamedTuple):
    """Points at rest, triangles, the mesh of each, and the first vertex of each mesh."""

    rest: Points
    faces: NDArray[np.int32]
    mesh_of: NDArray[np.int64]
    starts: NDArray[np.int64]

    def together(self, *poses: Points) -> Together:
        """What is together, where all triangles of two meshes meet that are nearly the same."""
        first, second = np.triu_indices(len(self.faces), 1)
        middles = self.rest[self.faces].mean(axis=1)
        meet = np.linalg.norm(middles[first] - middles[second], axis=1) < 0.05
        meet &= self.mesh_of[first] != self.mesh_of[second]
        pairs = np.stack([first[meet], second[meet]], axis=1)
        return together(self.rest, poses, self.faces, pairs.astype(np.int32), self.starts)

    def parted(self, *poses: Points) -> list[tuple[int, int]]:
        """The meshes that are parted."""
        found = self.together(*poses).parted
        assert np.array_equal(found, found.T)
        return [(a, b) for a, b in np.argwhere(found).tolist() if a < b]


def scene(*meshes: Mesh) -> Scene:
    points, faces = joined(*meshes)
    mesh_of = np.repeat(np.arange(len(meshes)), [len(own) for _, own in meshes])
    return Scene(points, faces, mesh_of, np.cumsum([0, *(len(own) for own, _ in meshes)]))


def moved(known: Scene, *shifts: float) -> Points:
    """Each mesh moved along x."""
    result: Points = known.rest + np.repeat(shifts, np.diff(known.starts))[:, None] * ALONG
    return result


def test_what_meets_at_rest_only_is_parted() -> None:
    both = scene(HEAD, HEAD)
    assert both.parted(moved(both, 0.0, 5.0)) == [(0, 1)]
    assert both.parted(moved(both, 3.0, 3.01)) == []
    # One pose in which they meet as at rest is enough, the first or the last.
    near, far = moved(both, 0.0, 0.01), moved(both, 0.0, 5.0)
    assert both.parted(far, near) == both.parted(near, far) == both.parted(far, far, near) == []
    # Without a pose nothing is known.
    assert both.parted() == []


def test_what_slides_out_of_its_sheath_is_not_parted() -> None:
    rod, sleeve = tube(40, 12, 0.2, 2.0), tube(40, 12, 0.21, 2.0)
    both = scene(rod, sleeve)
    (axis,) = np.flatnonzero(np.ptp(rod[0], axis=0) > 1.0)
    out, gone = (both.rest.copy() for _ in range(2))
    out[: len(rod[0]), axis] += 0.9
    gone[: len(rod[0]), axis] += 1.7
    # By most of its length it is in there in half of the poses at least.
    assert both.parted(out, out, gone) == both.parted(gone, out) == []
    assert both.parted(out, gone, gone) == both.parted(gone) == [(0, 1)]


def test_what_turns_in_its_place_is_not_parted() -> None:
    both = scene(HEAD, (1.01 * HEAD[0], HEAD[1]))
    pose = both.rest.copy()
    pose[: len(HEAD[0])] *= (-1.0, -1.0, 1.0)
    assert both.parted(pose) == []


def test_half_of_what_meets_has_to_be_near() -> None:
    """A mesh that meets another in a few triangles only is parted from it, box or no box."""
    both = scene(HEAD, HEAD)
    turned = both.rest * (-1.0, -1.0, 1.0)
    pose = np.where(np.arange(len(both.rest))[:, None] < len(HEAD[0]), both.rest, turned)
    assert both.parted(pose) == []  # a ball: it touches all the same
    assert both.parted(pose + np.repeat([0.0, 1.5], len(HEAD[0]))[:, None] * ALONG) == [(0, 1)]


def test_sizes_are_those_of_the_smaller_mesh_in_the_pose() -> None:
    both = scene(HEAD, (HEAD[0] + 0.02, HEAD[1]))
    assert both.parted(100.0 * both.rest) == []
    assert both.parted(100.0 * moved(both, 0.0, 5.0)) == [(0, 1)]
    # A tenth of the large one would be all of the small one.
    large, small = (10.0 * HEAD[0], HEAD[1]), (0.2 * HEAD[0] + 9.8 * ALONG, HEAD[1])
    sphere = scene(large, small)
    pairs = np.stack([np.zeros(50, np.int64), len(HEAD[1]) + np.arange(50)], axis=1)
    out = sphere.rest + np.repeat([0.0, 1.5], len(HEAD[0]))[:, None] * ALONG
    found = together(sphere.rest, [out], sphere.faces, pairs.astype(np.int32), sphere.starts)
    assert found.parted[0, 1]


def test_what_is_scaled_to_nothing_shows_nothing() -> None:
    both = scene(HEAD, HEAD)
    hidden = moved(both, 0.0, 5.0)
    hidden[len(HEAD[0]) :] = hidden[-1]
    assert both.parted(hidden) == []
    assert both.parted(hidden, moved(both, 0.0, 5.0), hidden) == [(0, 1)]
    near = moved(both, 0.0, 0.01)
    assert both.parted(hidden, near) == both.parted(near, hidden) == []


def test_groups_are_of_what_meets_in_frames_as_at_rest() -> None:
    four = scene(HEAD, (HEAD[0] + 0.01, HEAD[1]), HEAD, (EYE[0] + 9.0, EYE[1]))
    found = four.together(moved(four, 0.0, 0.0, 5.0, 0.0))
    assert [(a, b) for a, b in np.argwhere(found.parted).tolist() if a < b] == [(0, 2), (1, 2)]
    # The last one meets nothing and is parted from nothing.
    assert found.number.tolist() == [1, 1, 2, 0]
    assert four.together(four.rest).number.tolist() == [0, 0, 0, 0]


def caches(path: Path, apart: float, *, beside: float) -> Path:
    """An upper arm and its forearm that bend, and a ball: a cache each, with its default points.

    The ball's points at the default time are `beside` the arm, in all frames it is `apart`.
    """
    poses = [arm(bend) for bend in np.linspace(0.1, 0.6, FRAMES)]
    split = len(UPPER[0])
    ball = icosphere(2, 0.3)
    meshes = [
        AuthoredMesh("/Hero/Upper", UPPER[1], [pose[:split] for pose in poses], arm(0.0)[:split]),
        AuthoredMesh("/Hero/Fore", FORE[1], [pose[split:] for pose in poses], arm(0.0)[split:]),
        AuthoredMesh(
            "/Ball",
            ball[1],
            [ball[0] + (apart + 0.1 * frame) * ALONG for frame in range(FRAMES)],
            ball[0] + beside * ALONG,
        ),
    ]
    write_animation(path, meshes, times=1.0 + np.arange(FRAMES))
    return path


def opened(path: Path) -> Source:
    return open_source(str(path), Selection())


def test_default_points_at_one_origin_tie_nothing_together(tmp_path: Path) -> None:
    source = opened(caches(tmp_path / "a.usda", 4.0, beside=0.0))
    found = modelled_parts(source).attachments
    assert found is not None
    names = [mesh.path for mesh in source.meshes]
    arm_only = [names.index("/Hero/Upper"), names.index("/Hero/Fore")]
    assert [sorted(pair) for pair in found.pairs_of_parts] == [sorted(arm_only)]
    # Which part lies over which is told by the frames then, not by the rests.
    rests = choose_rests(source, None, device="cpu")
    assert "bind pose" not in {pose.name for pose in layer_poses(source, rests)}


def test_a_ball_that_stays_where_its_default_points_meet_is_modelled(tmp_path: Path) -> None:
    source = opened(caches(tmp_path / "a.usda", 0.0, beside=0.0))
    found = modelled_parts(source).attachments
    assert found is not None and len(found.pairs_of_parts) > 1


def test_caches_at_one_origin_come_out_as_those_that_lie_apart(tmp_path: Path) -> None:
    done = []
    for beside in (0.0, 4.0):
        stage, out = tmp_path / f"{beside}.usda", tmp_path / f"{beside}_out.usda"
        report = repair_stage(caches(stage, 4.0, beside=beside), out)
        assert [frame.status for frame in report.frames] == ["clean"] * FRAMES
        counts = [frame.before for frame in check_stage(str(stage)).frames]
        done.append((counts, [frame.displacement_max for frame in report.frames]))
    assert done[0] == done[1]
