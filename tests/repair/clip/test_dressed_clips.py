"""A sleeve goes along with the arm that is pushed out of the body, in clips and in single poses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from dtrepair import Body, SceneRepairer
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray, IntArray, lengths
from dtrepair.repair.clip import window_repairer
from dtrepair.repair.clip.clip_options import ClipOptions
from dtrepair.repair.clip.frames import Frame
from dtrepair.repair.clip.window_repairer import WindowRepairer
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.relief import other_ways
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.holding import is_tied
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import detected, gathered
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh, WeldedMeshes
from dtrepair.repair.separation.starts import Solved, Starts
from dtrepair.repair.solution_cache import remembering
from tests.exact_reference import exact_pairs
from tests.meshes import armed_body, joined, tube
from tests.repair.separation.test_lifting import ARM, SLEEVE

AROUND = 10


@dataclass(frozen=True)
class Dressed:
    """An armed body, and a shirt over some of its rings."""

    along: int
    first: int
    last: int
    off: float

    @property
    def ids(self) -> IntArray:
        """The vertices of the body that the shirt lies over, ring by ring."""
        return np.arange(self.first * AROUND, (self.last + 1) * AROUND, dtype=np.int32)

    @property
    def faces(self) -> list[IntArray]:
        faces = armed_body(0.0, self.along, AROUND)[1]
        own = faces[np.isin(faces, self.ids).all(axis=1)] - self.ids[0]
        return [faces, own.astype(np.int32)]

    def pose(self, curl: float) -> list[FloatArray]:
        points, faces = armed_body(curl, self.along, AROUND)
        corners = points[faces]
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals = np.zeros_like(points)
        np.add.at(normals, faces, areas[:, None])
        return [points, (points + self.off * normals / lengths(normals)[:, None])[self.ids]]

    @property
    def bodies(self) -> list[Body]:
        return [Body(*own) for own in zip(self.pose(0.0), self.faces, strict=True)]

    def beside(self, poses: list[FloatArray]) -> FloatArray:
        """How far each ring of the shirt is from the middle line of the body, in its radii."""
        rings = poses[0][: (self.along + 1) * AROUND].reshape(-1, AROUND, 3).mean(axis=1)
        shares = np.linspace(0.0, 1.0, 20)[:, None, None]
        line = (rings[:-1] + shares * np.diff(rings, axis=0)).reshape(-1, 3)
        cloth = poses[1].reshape(-1, AROUND, 3)
        middle = cloth.mean(axis=1)
        radius = np.linalg.norm(cloth - middle[:, None], axis=2).mean(axis=1)
        away: FloatArray = cKDTree(line).query(middle)[0] / radius
        return away


def clean(poses: list[FloatArray], faces: list[IntArray]) -> bool:
    """Whether a count of every pair, too, finds no intersection."""
    points, every = joined(*zip(poses, faces, strict=True))
    return len(exact_pairs(points, every)) == 0


def test_an_arm_leaves_the_body_with_its_sleeve() -> None:
    shirt = Dressed(30, 3, 24, 0.03)
    poses = [shirt.pose(curl) for curl in (4.3, 4.36, 4.41)]
    stream = SceneRepairer(shirt.bodies).animator.stream(list(enumerate(poses)), jobs=1)
    for frame in stream:
        assert [result.status for result in frame.results] == ["clean", "clean"]
        assert all(result.before.pairs > 20 for result in frame.results)
        found = [result.points for result in frame.results]
        assert clean(found, shirt.faces)
        assert shirt.beside(found).max() < 0.6


@pytest.mark.parametrize(
    "sleeve", [Dressed(40, 12, 33, 0.03), Dressed(30, 9, 24, 0.03)], ids=["long", "coarse"]
)
def test_so_it_does_in_a_single_pose(sleeve: Dressed) -> None:
    results = SceneRepairer(sleeve.bodies)(sleeve.pose(4.3))
    assert [result.status for result in results] == ["clean", "clean"]
    assert results[0].before.pairs > 10
    found = [result.points for result in results]
    assert clean(found, sleeve.faces) and sleeve.beside(found).max() < 0.6


# Of two frames, what is left in each of them on the first way, and with garments tied.
@pytest.mark.parametrize(
    ("why", "first", "tied", "taken", "tried"),
    [
        ("off", (0, 9), (0, 0), "tied", ["tied"]),
        ("stuck", (0, 9), (0, 0), "tied", ["tied"]),
        ("off", (9, 9), (3, 5), "tied", ["tied", "first"]),
        ("stuck", (0, 9), (3, 7), "first", ["tied", "first"]),
        ("stuck", (3, 4), (0, 9), "tied", ["tied", "first"]),
        ("", (0, 9), (0, 0), "first", ["first"]),
    ],
)
def test_what_leaves_less_is_taken_where_pushing_is_stuck_or_something_came_off(
    why: str,
    first: tuple[int, int],
    tied: tuple[int, int],
    taken: str,
    tried: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = make_scene([Body(*ARM), Body(*SLEEVE)], RepairOptions())
    meshes, wanted = WeldedMeshes(scene), {"first": first, "tied": tied}
    pose = np.concatenate([ARM[0], SLEEVE[0]])
    poses = {name: [pose + shift, pose - shift] for name, shift in (("first", 0.1), ("tied", 0.2))}
    opened = [detected(scene, gathered(scene, [ARM[0], SLEEVE[0]])) for _ in range(2)]
    frames = [Frame(**vars(own), time=float(time)) for time, own in enumerate(opened)]
    asked: list[str] = []
    comes_off = why == "off"

    def name_of(own: Scene) -> str:
        return "tied" if own.dressed else "first"

    def bounded(own: Scene, *_: Any, **__: Any) -> list[Judged]:
        asked.append(name_of(own))
        left = zip(poses[asked[-1]], wanted[asked[-1]], strict=True)
        return [Judged(points, lowered=number > 0) for points, number in left]

    def wrong_in(_: Scene, __: Any, found: list[FloatArray]) -> list[int]:
        (name,) = (name for name, own in poses.items() if own[0] is found[0])
        return list(wanted[name])

    stands_in = {
        "inside_out": lambda own, each, *_, **__: (own, each),
        "relieved_poses": lambda _, __, ___, own, **____: own,
        "started_again": lambda _, __, ___, own, *, leads, **____: own if leads.any() else None,
        "agreed": lambda _, __, ___, ____, own, *_____, **______: own,
        "came_off": lambda _, __, own: any(own is each for each in poses["first"]) and comes_off,
        "bounded_frames": bounded,
        "wrong_in": wrong_in,
    }
    for name, function in stands_in.items():
        module = other_ways if name in ("came_off", "wrong_in") else window_repairer
        monkeypatch.setattr(module, name, function)

    def solved(_: Any, own: Scene, *__: Any, unless_stuck: bool) -> Solved | None:
        stuck = unless_stuck and why == "stuck"
        return None if stuck else Solved(poses[name_of(own)], np.ones((2, *pose.shape)))

    monkeypatch.setattr(WindowRepairer, "_solved", solved)
    repairer = WindowRepairer(meshes, options=ClipOptions(), make_method=lambda _: None, jobs=1)  # type: ignore[arg-type, return-value]
    judged = repairer._judged(meshes, frames)
    assert [own.points is other for own, other in zip(judged, poses[taken], strict=True)] == [
        True,
        True,
    ]
    assert asked == tried


@pytest.mark.parametrize("attached", [True, False])
def test_attached_parts_take_their_garments_along_from_the_start(
    attached: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hand that ends in the arm, and a sleeve over it."""
    hand = tube(10, 12, 0.15, 0.5)
    end = ARM[0][ARM[0][:, 0] > ARM[0][:, 0].max() - 1e-6].mean(axis=0)
    turned = hand[0][:, [2, 1, 0]] + end, hand[1][:, ::-1]
    bodies = [Body(*ARM), Body(*turned), Body(*SLEEVE)]
    rest, faces = joined(ARM, turned, SLEEVE)
    references = [Reference(rest, Detector(rest, faces)(rest))] if attached else []
    meshes = WeldedMeshes(make_scene(bodies, RepairOptions(), references=references))
    assert is_tied(meshes.scene) == attached and meshes.dressed is not None
    assert meshes.dressed.scene.dressed and not meshes.dressed.undressed.scene.dressed
    opened = detected(meshes.scene, gathered(meshes.scene, [ARM[0], turned[0], SLEEVE[0]]))
    some = replace(opened, pairs=np.zeros((1, 2), dtype=np.int32))
    asked: list[WeldedMeshes] = []

    def judged(_: Any, own: WeldedMeshes, frames: list[Frame]) -> list[Judged]:
        asked.append(own)
        return [Judged(frame.centred) for frame in frames]

    monkeypatch.setattr(WindowRepairer, "_judged", judged)
    repairer = WindowRepairer(meshes, options=ClipOptions(), make_method=lambda _: None, jobs=1)  # type: ignore[arg-type, return-value]
    found, taken = repairer._on_all_ways(meshes, [Frame(**vars(some), time=0.0)], 1.0)
    assert asked[0] is (meshes.dressed if attached else meshes)
    # What comes after is of the garments as they were.
    assert taken is meshes and np.array_equal(found[0].points, opened.centred)


def test_free_parts_keep_the_meshes_of_the_way_they_took(monkeypatch: pytest.MonkeyPatch) -> None:
    meshes = WeldedMeshes(make_scene([Body(*ARM), Body(*SLEEVE)], RepairOptions()))
    opened = detected(meshes.scene, gathered(meshes.scene, [ARM[0], SLEEVE[0]]))
    some = replace(opened, pairs=np.zeros((1, 2), dtype=np.int32))
    other = WeldedMeshes(meshes.scene, way="undirected")

    def on_other_ways(_: Any, __: Any, judged: list[Judged], *___: Any, **____: Any) -> Any:
        return judged, other

    monkeypatch.setattr(window_repairer, "on_other_ways", on_other_ways)
    monkeypatch.setattr(
        WindowRepairer, "_judged", lambda _, __, frames: [Judged(own.centred) for own in frames]
    )
    repairer = WindowRepairer(meshes, options=ClipOptions(), make_method=lambda _: None, jobs=1)  # type: ignore[arg-type, return-value]
    assert repairer._on_all_ways(meshes, [Frame(**vars(some), time=0.0)], 1.0)[1] is other


@pytest.mark.parametrize("dirty", [1, 2])
@pytest.mark.parametrize("led", [False, True])
@pytest.mark.parametrize("may_end", [False, True])
def test_a_push_ends_where_it_is_stuck_in_a_fifth_of_the_frames(
    dirty: int, led: bool, may_end: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """led: whether sheets can be led apart, from where it is solved if it does not end."""
    scene = make_scene([Body(*ARM), Body(*SLEEVE)], RepairOptions())
    meshes, asked = WeldedMeshes(scene), list[bool | None]()
    opened = detected(scene, gathered(scene, [ARM[0], SLEEVE[0]]))
    pairs = np.zeros((1, 2), dtype=np.int32)
    frames = [Frame(**{**vars(opened), "pairs": pairs}, time=float(k)) for k in range(8)]
    mesh = meshes([own.sewn for own in frames])

    def make_method(_: WeldedMesh) -> Any:
        def solve(led: FloatArray, *_: Any, unless: Any) -> FloatArray | None:
            left = [pairs[: int(k < dirty)] for k in range(len(led))]
            asked.append(None if unless is None else unless(left))
            return None if asked[-1] else led

        return solve

    def otherwise(self: Starts, _: Any) -> FloatArray | None:
        return self.led if led else None

    monkeypatch.setattr(Starts, "otherwise", otherwise)
    repairer = WindowRepairer(meshes, options=ClipOptions(), make_method=make_method, jobs=1)
    found = repairer._solved(scene, mesh, frames, unless_stuck=may_end)
    ends = may_end and dirty == 2
    assert (found is None) == ends
    assert asked == ([True] if ends else [True, None] if led else [False])


def test_a_resumed_run_is_stuck_where_the_first_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was found where pushing went on is not taken for a push that may end as stuck."""
    scene = make_scene([Body(*ARM), Body(*SLEEVE)], RepairOptions())
    meshes, kept = WeldedMeshes(scene), dict[str, Any]()
    opened = detected(scene, gathered(scene, [ARM[0], SLEEVE[0]]))
    pairs = np.zeros((1, 2), dtype=np.int32)
    frames = [Frame(**{**vars(opened), "pairs": pairs}, time=float(k)) for k in range(4)]
    mesh = meshes([own.sewn for own in frames])

    class Kept:
        recall = staticmethod(kept.get)
        keep = staticmethod(kept.__setitem__)

    def make_method(_: WeldedMesh) -> Any:
        def solve(led: FloatArray, *_: Any, unless: Any) -> FloatArray | None:
            return None if unless([pairs] * len(led)) else led

        return solve

    monkeypatch.setattr(Starts, "otherwise", lambda *_: None)
    made = remembering(make_method, Kept())
    repairer = WindowRepairer(meshes, options=ClipOptions(), make_method=made, jobs=1)
    for _ in range(2):
        found = [repairer._solved(scene, mesh, frames, unless_stuck=own) for own in (True, False)]
        assert found[0] is None and found[1] is not None and len(kept) == 1


def test_progress_does_not_go_back_on_another_way() -> None:
    told: list[float] = []
    meshes = WeldedMeshes(make_scene([Body(*ARM), Body(*SLEEVE)], RepairOptions()))

    def make_method(_: WeldedMesh) -> Any:
        raise AssertionError("nothing is to be solved")

    repairer = WindowRepairer(
        meshes, options=ClipOptions(), make_method=make_method, progress=told.append
    )
    for share in (0.2, 0.7, 0.1, 0.8):
        repairer._tell(share, 10.0)
    assert told == [2.0, 7.0, 7.0, 8.0]
    # The next window begins anew.
    opened = detected(meshes.scene, gathered(meshes.scene, [ARM[0], SLEEVE[0] + [9.0, 0.0, 0.0]]))
    repairer([Frame(**vars(opened), time=0.0)])
    repairer._tell(0.1, 10.0)
    assert told[-1] == 1.0


def test_the_outer_sides_leave_the_progress_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four frames that hold a pose are one, which stands for all of them once more."""
    meshes = WeldedMeshes(make_scene([Body(*ARM), Body(*SLEEVE)], RepairOptions()))
    opened = detected(meshes.scene, gathered(meshes.scene, [ARM[0], SLEEVE[0]]))
    some = replace(opened, pairs=np.zeros((1, 2), dtype=np.int32))
    inner = list[float]()

    def first(own: WeldedMeshes, frames: list[Frame], judge: Any, *_: Any) -> list[Frame]:
        if not inner:
            inner.append(repairer._worth)
            judge(own, frames)
        return frames

    def judged(_: Any, __: Any, frames: list[Frame]) -> list[Judged]:
        return [Judged(frame.centred) for frame in frames]

    monkeypatch.setattr(window_repairer, "outer_sides_first", first)
    monkeypatch.setattr(WindowRepairer, "_judged", judged)
    repairer = WindowRepairer(meshes, options=ClipOptions(), make_method=lambda _: None, jobs=1)  # type: ignore[arg-type, return-value]
    frames = [Frame(**vars(some), time=float(k)) for k in range(4)]
    repairer._on_all_ways(meshes, frames, 1.0)
    assert inner == [4.0] and repairer._worth == 4.0
