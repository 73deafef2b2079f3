"""Transfer of a dressed pair: body, sleeve and eyes onto a body of another topology."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.numerics.geometry import lengths
from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.selection import ObjectOptions, Selection
from dtrepair.pipeline.transfer.options import TransferOptions
from dtrepair.pipeline.transfer.run import plan_transfer, transfer_stage
from dtrepair.pipeline.transfer.settings import TransferSettings
from dtrepair.repair.options import RepairOptions
from dtrepair.report.record import Report
from tests.command_line import read_samples
from tests.dressed_limb import Limb, centres
from tests.exact_reference import exact_pairs
from tests.meshes import grid
from tests.usd_stages import authored_properties
from usd_io import AuthoredMesh, write_animation

CAT, LION = Limb(8, 24, 0.16), Limb(12, 32, 0.22)
NAMES = ("body", "sleeve", "eyes")
# The last one presses the sleeve into the other half of the limb.
BENDS = (0.0, 1.3, 2.6)


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a bending cat, a resting lion, and markers of their bodies and sleeves."""
    folder = tmp_path_factory.mktemp("pair")
    for path, root, limb, bends in (("cat", "Cat", CAT, BENDS), ("lion", "Lion", LION, ())):
        meshes = []
        for name in NAMES:
            rest, faces = getattr(limb, name)(0.0)
            points = [getattr(limb, name)(bend)[0].astype(np.float32) for bend in bends]
            meshes.append(AuthoredMesh(f"/{root}/{name}", faces.tolist(), points, rest=rest))
        write_animation(folder / f"{path}.usda", meshes, times=range(1, len(bends) + 1))
    body = np.stack([CAT.marked(), LION.marked()], axis=1)
    np.savetxt(folder / "body.txt", body, fmt="%d")
    return folder


def transferred(pair: Path, out: Path, **choices: Any) -> tuple[Report, dict[str, Any]]:
    """The report, and the points of each mesh over time."""
    options = choices.pop("options", TransferOptions(markers=str(pair / "body.txt")))
    target = choices.pop("target", pair / "lion.usda")
    report = transfer_stage(pair / "cat.usda", target, out, options=options, **choices)
    return report, {name: read_samples(out, f"/Lion/{name}") for name in NAMES}


def strayed(found: dict[str, Any], name: str, frame: int) -> NDArray[np.float64]:
    """How far vertices are from a lion that bends itself, where its body is at all."""
    truth = {part: getattr(LION, part)(BENDS[frame])[0] for part in ("body", name)}
    travel = (found["body"][frame + 1.0] - truth["body"]).mean(axis=0)
    return lengths(found[name][frame + 1.0] - truth[name] - travel)


def test_clothes_and_eyes_follow_the_body(pair: Path, tmp_path: Path) -> None:
    report, found = transferred(pair, tmp_path / "out.usdc")
    assert any("/Lion/sleeve: follows the nearest part" in text for text in report.warnings)
    assert (
        report.transfer is not None
        and report.transfer.target == "/Lion/body, /Lion/sleeve, /Lion/eyes"
    )
    for frame in range(len(BENDS)):
        for name in NAMES:
            assert strayed(found, name, frame).max() < 0.25 * LION.radius, (name, frame)
    # Eyes of the cat and the lion have one topology: they turn, and keep their shape.
    rest, faces = LION.eyes(0.0)
    last = found["eyes"][3.0]
    edges = [np.linalg.norm(p[faces[:, 0]] - p[faces[:, 1]], axis=1) for p in (rest, last)]
    assert np.abs(edges[1] / edges[0] - 1.0).max() < 0.02
    assert authored_properties(tmp_path / "out.usdc") == {
        f"/Lion/{name}.{what}" for name in NAMES for what in ("points", "extent")
    }
    # Contacts of the rest were modelled: eyes in their body are no fault.
    assert [frame.after.pairs > 0 for frame in report.frames if frame.after] == [False] * 2 + [True]


def test_a_dressed_character_is_repaired_as_one_scene(pair: Path, tmp_path: Path) -> None:
    report, found = transferred(pair, tmp_path / "out.usdc", repair=RepairOptions())
    last = report.frames[-1]
    assert last.before is not None and last.before.inter_pairs > 0
    for frame in report.frames:
        assert frame.status == "clean" and frame.after is not None
        assert frame.after.pairs == 0 and frame.after.modelled_pairs > 0
    assert len(report.attached.listed) == 2
    for index, bend in enumerate(BENDS):
        body, sleeve = (found[name][index + 1.0] for name in ("body", "sleeve"))
        faces = LION.body(0.0)[1], LION.sleeve(0.0)[1] + len(body)
        assert len(exact_pairs(np.concatenate([body, sleeve]), np.concatenate(faces))) == 0
        # It stays on, and at its place along the limb.
        assert strayed(found, "sleeve", index).max() < 0.35 * LION.radius, bend


def test_meshes_go_together_as_the_user_says(pair: Path, tmp_path: Path) -> None:
    body = str(pair / "body.txt")
    names = ("/Cat/body,/Lion/body=" + body, "/Cat/eyes,/Lion/eyes")
    report, found = transferred(pair, tmp_path / "out.usdc", options=TransferOptions(match=names))
    other, same = transferred(pair, tmp_path / "same.usdc")
    assert report.transfer is not None and other.transfer is not None
    assert report.transfer.pairs == other.transfer.pairs
    for name in NAMES:
        assert np.array_equal(found[name][3.0], same[name][3.0])
    assert TransferSettings.from_report(report.settings).options.match == names
    for wrong, words in (
        ("/Cat/body", "expected a prim of SOURCE"),
        ("/Cat,/Lion/body", "/Cat is 3 meshes, expected 1"),
        ("/Cat/tail,/Lion/body", "matches none"),
    ):
        with pytest.raises(UsageError, match=words):
            transferred(pair, tmp_path / "no.usdc", options=TransferOptions(match=(wrong,)))


def test_bodies_of_other_topology_need_markers(pair: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no mesh has the topology of one of"):
        transferred(
            pair,
            tmp_path / "out.usdc",
            options=TransferOptions(target_prim="/Lion/body"),
        )


def test_objects_take_part_as_in_a_repair(pair: Path, tmp_path: Path) -> None:
    # A small wall that the sleeve brushes when the limb is half bent.
    wall, faces = grid(4, 4, 0.2)
    middle = centres(np.array([0.55]), BENDS[1])[0]
    placed = wall[:, [1, 2, 0]] + middle + np.array([-0.1, 1.15 * LION.radius, -0.1])
    meshes = [
        AuthoredMesh(f"/Lion/{name}", part[1].tolist(), rest=part[0])
        for name, part in ((name, getattr(LION, name)(0.0)) for name in NAMES)
    ]
    meshes.append(AuthoredMesh("/Lion/wall", faces.tolist(), rest=placed))
    write_animation(tmp_path / "walled.usda", meshes)
    objects = ObjectOptions(collider="/Lion/wall", rigid="/Lion/eyes")
    report, found = transferred(
        pair,
        tmp_path / "out.usdc",
        target=tmp_path / "walled.usda",
        selection=Selection(frames="1:2"),
        repair=RepairOptions(),
        objects=objects,
    )
    assert "/Lion/wall.points" not in authored_properties(tmp_path / "out.usdc")
    last = report.frames[-1]
    met = {(contact.first, contact.second): contact for contact in last.contacts}
    assert met["/Lion/sleeve", "/Lion/wall"].before > 0
    assert last.after is not None and last.after.pairs == 0
    assert strayed(found, "eyes", 1).max() < 0.25 * LION.radius
    assert TransferSettings.from_report(report.settings).objects == objects
    plan = plan_transfer(
        pair / "cat.usda",
        tmp_path / "walled.usda",
        tmp_path / "other.usdc",
        options=TransferOptions(markers=str(pair / "body.txt")),
        objects=objects,
    )
    assert [mesh.path.rpartition("/")[2] for mesh in plan.meshes] == [*NAMES, *NAMES, "wall"]
