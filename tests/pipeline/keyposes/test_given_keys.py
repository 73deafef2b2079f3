"""Given keys end near the input, with room where poses between them are looked at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from dtrepair.diagnosis import CountRecord
from dtrepair.intersect.detector import Detector
from dtrepair.intersect.proximity import close_pairs
from dtrepair.keyposes.options import KeyOptions
from dtrepair.keyposes.spans import KeyPoses
from dtrepair.numerics.geometry import diagonal
from dtrepair.pipeline.keyposes import solve, stage
from dtrepair.pipeline.keyposes.solve import KeyRepairOptions, StageKeys
from dtrepair.pipeline.keyposes.stage import repair_keyposes
from dtrepair.pipeline.repair.solve import FrameRepairer, Repaired
from dtrepair.pipeline.repair.stage import repair_stage
from dtrepair.pipeline.selection import Selection
from dtrepair.repair.options import RepairOptions
from tests.command_line import CLOSED, OPEN, read_samples, tube_pose, tube_stage
from tests.meshes import icosphere
from tests.swinging_arm import arm_mesh, arm_stage

ARM, MIDDLE = "/Root/Arm", 11.0
# The first vertex of the arm that hangs down, and where the body ends, by rings of nine.
HANGS, BODY = 30 * 9, 16 * 9
REST, FACES = arm_mesh(1.0)
ROOM = KeyRepairOptions().room * diagonal(REST)


@pytest.fixture
def pressed(tmp_path: Path) -> Path:
    """An arm that hangs in front of the body, in it, and in front of it."""
    return arm_stage(tmp_path / "arm.usda", (1.0, 0.3, 1.0))


@pytest.fixture
def swing(tmp_path: Path) -> Path:
    """An arm that swings through the body between two clean keys."""
    return arm_stage(tmp_path / "swing.usda", (1.0, -1.0))


def middle(path: Path) -> NDArray[np.float64]:
    return read_samples(path, ARM)[MIDDLE].astype(np.float64)


def keyposes(path: Path, **choices: Any) -> NDArray[np.float64]:
    """The key in the middle, repaired."""
    out = path.with_name("keys.usdc")
    report = repair_keyposes(path, out, **choices)
    assert all(frame.after is not None and frame.after.pairs == 0 for frame in report.frames)
    return middle(out)


def too_close(points: NDArray[np.float64], distance: float) -> int:
    """How many pairs of triangles of arm and body are closer than a distance."""
    triangles = Detector(points, FACES)
    pairs = close_pairs(triangles, points.astype(np.float32), distance)
    first, second = (np.asarray(FACES)[pairs[:, side]] for side in (0, 1))
    apart = (first < BODY).all(axis=1) & (second >= HANGS).all(axis=1)
    apart |= (second < BODY).all(axis=1) & (first >= HANGS).all(axis=1)
    return int(apart.sum())


def test_a_key_is_tightened_but_keeps_room(pressed: Path) -> None:
    given, key = middle(pressed), keyposes(pressed)
    loose = keyposes(pressed, options=RepairOptions(tighten=0))
    far = [np.abs(own - given).max() for own in (key, loose)]
    assert 0.0 < far[0] < 0.9 * far[1]
    assert too_close(key, 0.9 * ROOM) == 0


def test_a_key_without_a_span_is_repaired_as_a_frame_alone(pressed: Path) -> None:
    key = keyposes(pressed, selection=Selection(frames="11"))
    repair_stage(pressed, out := pressed.with_name("out.usdc"), alone=True)
    assert np.array_equal(key, middle(out))
    # It touches: nothing passes by between keys.
    assert too_close(key, 0.9 * ROOM) > 0


def test_a_clearance_that_is_asked_for_is_the_room(pressed: Path) -> None:
    options = RepairOptions(clearance=8.0 * ROOM)
    assert too_close(keyposes(pressed, options=options), 7.0 * ROOM) == 0


def test_of_room_that_is_not_reached_nothing_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Room as wide as a clearance that a limit of the displacement lets nothing reach."""
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED, OPEN))
    wide = KeyRepairOptions(room=0.06 / diagonal(tube_pose(OPEN)))
    defaults = StageKeys.__init__.__kwdefaults__
    assert defaults is not None
    monkeypatch.setitem(defaults, "options", wide)
    for clearance in (0.0, 0.06):
        options = RepairOptions(maximum_displacement=0.07, clearance=clearance)
        report = repair_keyposes(path, tmp_path / "b.usdc", options=options)
        told = [
            any(frame.left.too_close for frame in report.frames),
            any("closer than" in frame.message for frame in report.frames),
            any("is not reached" in line for line in report.warnings),
        ]
        assert told == [clearance > 0.0] * 3


def test_clean_keys_keep_every_bit(pressed: Path) -> None:
    """Where they touch, too: what a frame alone ends with is not touched again."""
    repair_stage(pressed, out := pressed.with_name("out.usdc"), alone=True)
    flat = pressed.with_name("flat.usdc")
    Usd.Stage.Open(str(out)).Export(str(flat))
    assert too_close(middle(flat), 0.9 * ROOM) > 0
    repair_keyposes(flat, again := pressed.with_name("again.usdc"), keys=KeyOptions(keep_keys=True))
    for time in (1.0, MIDDLE, 21.0):
        assert np.array_equal(read_samples(again, ARM)[time], read_samples(flat, ARM)[time])


def test_what_is_clean_beside_it_keeps_every_bit(pressed: Path) -> None:
    """Two balls that nearly touch, far away."""
    ball, faces = icosphere(2, 0.1)
    given = Usd.Stage.Open(str(pressed))
    for name, aside in (("A", 0.0), ("B", 0.2 + 0.3 * ROOM)):
        mesh = UsdGeom.Mesh.Define(given, f"/Root/{name}")
        mesh.GetFaceVertexCountsAttr().Set([3] * len(faces))
        mesh.GetFaceVertexIndicesAttr().Set(faces.ravel().tolist())
        for time in (1.0, MIDDLE, 21.0):
            place = np.array([5.0 + aside, 0.1 * (time == MIDDLE), 0.0])
            mesh.GetPointsAttr().Set((ball + place).astype(np.float32), time)
    given.Save()
    repair_keyposes(pressed, out := pressed.with_name("keys.usdc"))
    after = Usd.Stage.Open(str(out))
    for name in ("A", "B"):
        prims = (
            own.GetPrimAtPath(f"/Root/{name}").GetAttribute("points") for own in (given, after)
        )
        before, kept = (np.asarray(points.Get(MIDDLE)) for points in prims)
        assert np.array_equal(before, kept)
    assert too_close(middle(out), 0.9 * ROOM) == 0


def test_a_lone_key_beside_others_needs_no_room(tmp_path: Path) -> None:
    path = arm_stage(tmp_path / "arm.usda", (1.0, 0.9, 1.0, 0.3, 1.0))
    repair_keyposes(path, out := tmp_path / "keys.usdc", selection=Selection(frames="1,11,31"))
    repair_stage(path, alone := tmp_path / "alone.usdc", alone=True)
    assert np.array_equal(read_samples(out, ARM)[31.0], read_samples(alone, ARM)[31.0])


def test_the_published_method_has_no_room(pressed: Path) -> None:
    options = RepairOptions(method="paper")
    repair_keyposes(pressed, out := pressed.with_name("keys.usdc"), options=options)
    repair_stage(pressed, alone := pressed.with_name("alone.usdc"), alone=True, options=options)
    assert np.array_equal(middle(out), middle(alone))


@pytest.fixture
def changed(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Changes the records of keys that were repaired near the input."""
    repair = solve._repaired

    def change(**changes: Any) -> None:
        def repaired(repairer: FrameRepairer, *given: Any) -> Repaired:
            found = repair(repairer, *given)
            near = repairer.repairer.options.tighten > 0
            return replace(found, record=replace(found.record, **changes)) if near else found

        monkeypatch.setattr(solve, "_repaired", repaired)

    return change


@pytest.mark.parametrize(
    "changes", [{"after": CountRecord(triangles=5, pairs=5)}, {"status": "strained"}]
)
def test_what_fails_near_the_input_goes_farther(
    pressed: Path, changed: Callable[..., None], changes: dict[str, Any]
) -> None:
    near, loose = keyposes(pressed), keyposes(pressed, options=RepairOptions(tighten=0))
    changed(**changes)
    far = keyposes(pressed)
    assert np.abs(far - loose).max() < ROOM < 0.2 * np.abs(far - near).max()


def test_what_fails_either_way_stays_near(pressed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    near = keyposes(pressed)
    monkeypatch.setattr(solve, "_wrong", lambda found: (1.0, True))
    assert np.array_equal(keyposes(pressed), near)


@pytest.mark.parametrize(("method", "ways"), [("full", 2), ("paper", 1)])
def test_what_is_between_keys_is_repaired_near_to_it_first(
    swing: Path, monkeypatch: pytest.MonkeyPatch, method: str, ways: int
) -> None:
    moved = list[float]()

    def search(prepared: object, keys: StageKeys, observer: object) -> KeyPoses:
        poses = [own.at(4.7) for own in keys.tracks]
        assert keys.pairs(4.7, poses)
        for way in keys.ways:
            found = keys.repair(4.7, poses, way)
            assert found is not None and (method == "paper" or not keys.pairs(4.7, found))
            moved.append(float(np.abs(found[0] - poses[0]).max()))
        return KeyPoses(keys.tracks, ())

    monkeypatch.setattr(stage, "_search", search)
    repair_keyposes(swing, swing.with_name("out.usdc"), options=RepairOptions(method=method))
    assert len(moved) == ways and (ways == 1 or 0.0 < moved[0] < 0.9 * moved[1])
