"""Frames relaxed in step: less distortion, still clean, and smooth in time."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attached.overlaps import find_attachments
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.metrics import volume
from dtrepair.repair.clip.restore_shape import (
    RelaxFramesOptions,
    collapsed_vertices,
    relax_frames,
)
from dtrepair.repair.clip.window_state import WindowState
from dtrepair.repair.parallel.worker_pool import WorkerPool
from dtrepair.repair.surface.surface import BodyRange, BoolArray, Surface
from tests.meshes import joined, tube

FRAMES = 6


def attached_tubes() -> Surface:
    """Two tubes end to end that overlap, as parts of one mesh."""
    first = tube(12, 20, 0.2, 2.0)
    second = 1.1 * first[0] * (1.0, 1.0, 1.0 / 1.1) + (0.04, 0.01, 1.7)
    points, faces = joined(first, (second, first[1]))
    pairs = Detector(points, faces)(points)
    found = find_attachments(faces, len(points), [Reference(points, pairs)])
    return Surface(points, faces, attachments=found)


def clean(surface: Surface, pose: FloatArray) -> FloatArray:
    return pose


def state_of(surface: Surface, added: FloatArray) -> WindowState:
    """A clean window whose poses are the rest and what was added to it."""
    original = np.repeat(surface.rest[None], FRAMES, axis=0)
    state = WindowState(
        surface, original, np.arange(FRAMES, dtype=float), WorkerPool(), alone=clean
    )
    state.work.extra[:] = added
    state.evaluate()
    assert not state.dirty
    return state


def bump(surface: Surface) -> FloatArray:
    """A sideways displacement (T, V, 3) of the far end that grows over time."""
    height = surface.rest[:, 2]
    bent = np.clip((height - np.median(height)) * 2.0, 0.0, 1.0)
    size = 0.05 + 0.01 * np.arange(FRAMES)
    return np.asarray(size[:, None, None] * bent[:, None] ** 2 * np.array([1.0, 0.0, 0.0]))


def test_attached_parts_come_back_to_their_shape() -> None:
    surface = attached_tubes()
    state = state_of(surface, bump(surface))
    # As if all frames had had contacts: they need what moved them.
    state.found = [np.zeros((1, 2), dtype=np.int32)] * FRAMES
    before = np.linalg.norm(state.poses - state.original, axis=2).mean()
    relax_frames(state, options=RelaxFramesOptions(agreement=(0.1,) * 12))
    moved = state.poses - state.original
    assert np.linalg.norm(moved, axis=2).mean() < 0.5 * before
    assert not state.dirty
    # A fifth of the step between two frames of the input; at the ends, which are level, a quarter.
    second = np.abs(np.diff(moved, 2, axis=0)).max(axis=(1, 2))
    assert second[1:-1].max() < 0.002 and second.max() < 0.0025


def test_a_first_frame_without_contacts_eases_in() -> None:
    surface = attached_tubes()
    moved = []
    for needed in (True, False):
        state = state_of(surface, bump(surface))
        state.found = [np.zeros((1, 2), dtype=np.int32)] * FRAMES
        if not needed:
            state.found[0] = state.found[0][:0]
        relax_frames(state, options=RelaxFramesOptions(agreement=(1.0,) * 12))
        moved.append(np.linalg.norm(state.poses[0] - state.original[0], axis=1).max())
    assert moved[1] < 0.6 * moved[0]


def test_a_single_skin_comes_back_and_keeps_its_volume() -> None:
    surface = Surface(*tube(12, 20, 0.2, 2.0))
    state = state_of(surface, bump(surface))
    before = np.linalg.norm(state.poses - state.original, axis=2).mean()
    relax_frames(state)
    assert np.linalg.norm(state.poses - state.original, axis=2).mean() < 0.95 * before
    given = volume(surface.rest, surface.faces)
    for pose in state.poses:
        assert volume(pose, surface.faces) == pytest.approx(given, rel=0.03)


def two_free_tubes() -> Surface:
    """Two tubes beside each other, each a body of its own."""
    points, faces = joined(tube(12, 20, 0.2, 2.0), tube(12, 20, 0.2, 2.0))
    points[len(points) // 2 :, 0] += 1.0
    half = len(points) // 2
    bodies = [BodyRange(0, half, 99.0), BodyRange(half, 2 * half, 99.0)]
    return Surface(points, faces, bodies=bodies)


def test_bodies_that_move_freely_are_left_alone() -> None:
    surface = two_free_tubes()
    state = state_of(surface, bump(surface))
    before = state.poses.copy()
    relax_frames(state)
    assert np.array_equal(state.poses, before)


def test_bodies_whose_frames_were_solved_alone_come_back() -> None:
    surface = two_free_tubes()
    state = state_of(surface, bump(surface))
    before = np.linalg.norm(state.poses - state.original, axis=2).mean()
    relax_frames(state, alone=True)
    assert np.linalg.norm(state.poses - state.original, axis=2).mean() < 0.95 * before
    assert not state.dirty


def test_frames_that_agree_accelerate_less() -> None:
    """A single frame stands out: how far depends on how strongly its neighbours pull."""
    rough = []
    for weight in (0.0, 3.0):
        surface = Surface(*tube(12, 20, 0.2, 2.0))
        added = bump(surface)
        added[2] *= 1.5
        state = state_of(surface, added)
        relax_frames(state, options=RelaxFramesOptions(agreement=(weight,) * 2))
        rough.append(np.abs(np.diff(state.poses - state.original, 2, axis=0)).max())
    assert rough[1] < 0.6 * rough[0]


def squeezed(surface: Surface) -> FloatArray:
    """The tip of a tube pressed flat towards its middle."""
    tip = np.clip(surface.rest[:, 2] / surface.rest[:, 2].max() * 4.0 - 3.0, 0.0, 1.0)
    added = np.zeros((FRAMES, surface.count, 3))
    added[:, :, :2] = -0.9 * tip[:, None] * surface.rest[:, :2]
    return added


def count_of(surface: Surface, pose: FloatArray) -> tuple[BoolArray, int]:
    return collapsed_vertices(surface, surface.rest, pose, 0.25)


def test_a_collapsed_tip_opens_again() -> None:
    surface = Surface(*tube(12, 40, 0.2, 2.0))
    state = state_of(surface, squeezed(surface))
    assert count_of(surface, state.poses[0])[1] > 10
    relax_frames(state)
    assert all(count_of(surface, pose)[1] == 0 for pose in state.poses)


def test_what_needs_no_displacement_gets_little_of_the_others() -> None:
    surface = Surface(*tube(12, 20, 0.2, 2.0))
    added = bump(surface)
    added[:3] = 0.0
    added[3:] *= np.array([0.5, 0.75, 1.0])[:, None, None]
    state = state_of(surface, added)
    size = np.linalg.norm(added, axis=2).max(axis=1)
    # A trend that goes on before its start asks the first frame for half as much again.
    relax_frames(state, options=RelaxFramesOptions(agreement=(30.0,) * 60, still=0.0))
    moved = np.linalg.norm(state.poses[0] - state.original[0], axis=1).max()
    assert 0.0 < moved <= 1.01 * (size[3:] * np.exp(-0.5 * (np.arange(3, 6) / 2.0) ** 2)).max()
