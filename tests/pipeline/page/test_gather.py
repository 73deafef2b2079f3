"""What a page shows of a run: contacts as the exact counter has them, poses as they are written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.display.closeups import CloseupOptions
from dtrepair.display.excerpt import ExcerptOptions
from dtrepair.display.packing import unpacked
from dtrepair.pipeline import check_stage, repair_stage
from dtrepair.pipeline.errors import InputError
from dtrepair.pipeline.page.contact_data import DataOptions
from dtrepair.pipeline.page.gather import PageOptions, gather_content
from dtrepair.pipeline.page.posed_run import PosedRun, open_run, with_found_files
from dtrepair.report.page.content import PageContent
from tests.command_line import CLOSED, OPEN, tube_stage
from tests.usd_stages import define_cube, new_stage

Poses = NDArray[np.float64]
SMALL = PageOptions(closeup=CloseupOptions(size=40, azimuths=(25,), elevations=(12,)))


@pytest.fixture(scope="module")
def repaired(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], PosedRun]:
    """A tube whose ends meet in the last two of four frames, and are led apart."""
    folder = tmp_path_factory.mktemp("run")
    source = tube_stage(folder / "a.usda", (OPEN, OPEN + 0.1, CLOSED, CLOSED + 0.1))
    report = repair_stage(source, folder / "b.usdc", device="cpu", jobs=1).document()
    return report, open_run(report)


def poses_of(view: dict[str, Any]) -> tuple[Poses, Poses, dict[str, NDArray[Any]]]:
    """Positions (T, N, 3) before and after, as the viewer adds them up; the arrays."""
    arrays = unpacked(view)
    shape = (len(view["frames"]), view["vertices"], 3)

    def summed(name: str) -> NDArray[np.uint16]:
        steps = arrays[name].reshape(shape).astype(np.int64)
        return np.cumsum(steps, axis=0).astype(np.uint16)

    first = summed("first")
    second = (first + summed("moved")).astype(np.uint16) if "moved" in arrays else first
    before, after = (own.view(np.int16) * view["step"] for own in (first, second))
    return before, after, arrays


def test_a_contact_has_its_frames_counts_and_poses(
    repaired: tuple[dict[str, Any], PosedRun],
) -> None:
    report, run = repaired
    (contact,) = gather_content(report, run, options=SMALL).contacts
    assert contact.frames[:2] == (2, 3) and contact.first == contact.second
    worst = contact.frames[2]
    counts = [report["frames"][worst][when]["triangles"] for when in ("before", "after")]
    assert list(contact.triangles) == counts and counts[0] > 0 == counts[1]
    assert contact.png.startswith(b"\x89PNG") and contact.view is not None
    view = dict(contact.view)
    before, after, arrays = poses_of(view)
    assert view["names"] == ["before", "after"] and view["whole"]
    for place, number in enumerate(view["frames"]):
        time = report["frames"][number]["time"]
        for scene, shown in zip(run.scenes.values(), (before, after), strict=True):
            off = scene.points(time) - shown[place]
            # The same but for where the contact is, and rounding of both poses.
            assert np.ptp(off, axis=0).max() <= 2.1 * view["step"]
    reds = np.split(arrays["red"], np.cumsum(arrays["red_counts"])[:-1])
    assert len(reds[view["frames"].index(worst)]) == counts[0]
    assert not arrays["red_after_counts"].any()


def test_jitter_of_the_frames_sums_to_that_of_the_run(
    repaired: tuple[dict[str, Any], PosedRun],
) -> None:
    report, run = repaired
    measures = gather_content(report, run, options=PageOptions(contacts=0)).measures
    assert set(measures) == {"jitter"}  # the tube is open: it has no volume
    first, *inner, last = measures["jitter"]
    assert first is last is None and all(value is not None for value in inner)
    # The figure of the run is the root mean square of those of the frames.
    known = [value for value in inner if value is not None]
    rms = float(np.sqrt(np.mean(np.square(known))))
    assert rms == pytest.approx(report["summary"]["jitter"], rel=1e-6)


def test_data_that_is_too_long_is_thinned_out(repaired: tuple[dict[str, Any], PosedRun]) -> None:
    report, run = repaired
    data = DataOptions(excerpt=ExcerptOptions(triangles=350))

    def view(limit: int) -> dict[str, Any]:
        options = replace(SMALL, bytes=limit, data=data)
        found = gather_content(report, run, options=options).contacts[0].view
        assert found is not None
        return dict(found)

    whole, short = view(10**6), view(2000)
    assert len(short["data"]) < len(whole["data"])
    assert short["vertices"] < whole["vertices"] and not short["whole"]
    assert short["frames"][short["worst"]] == whole["frames"][whole["worst"]]


def test_frames_are_thinned_out_but_the_worst(repaired: tuple[dict[str, Any], PosedRun]) -> None:
    report, run = repaired
    options = PageOptions(contacts=0, frames=1)
    (contact,) = gather_content(report, run, options=options).contacts
    pairs = [frame["before"]["pairs"] for frame in report["frames"]]
    assert contact.frames[2] == int(np.argmax(pairs))
    assert contact.png == b"" and contact.view is None


def test_a_check_has_one_pose(tmp_path: Path) -> None:
    source = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED))
    report = check_stage(source, device="cpu", jobs=1).document()
    content: PageContent = gather_content(report, open_run(report), options=SMALL)
    (contact,) = content.contacts
    assert contact.triangles == (report["frames"][1]["before"]["triangles"], None)
    assert contact.view is not None and contact.view["names"] == ["before"]
    assert content.measures == {}


def test_a_contact_of_several_meshes_says_of_how_many_more_it_is(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "a.usda")
    for number, name in enumerate("ABC"):
        corner = define_cube(stage, f"/Root/{name}").AddTranslateOp()
        corner.Set((1.7 * number, 0.1 * number, 0.13 * number))
    stage.GetRootLayer().Save()
    report = check_stage(tmp_path / "a.usda", device="cpu").document()
    (contact,) = gather_content(report, open_run(report), options=SMALL).contacts
    assert {contact.first, contact.second} < {"/Root/A", "/Root/B", "/Root/C"}
    assert contact.others == 1 and contact.between.endswith(f"{contact.second}, and 1 more pair")


def test_other_meshes_are_refused(
    repaired: tuple[dict[str, Any], PosedRun], tmp_path: Path
) -> None:
    report, _ = repaired
    other = tmp_path / "c.obj"
    other.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match="other meshes"):
        open_run({**report, "output": str(other)})


def test_files_are_found_beside_the_report(tmp_path: Path) -> None:
    (tmp_path / "in.usda").touch()
    report = {"input": "gone/in.usda", "output": None, "folder": "/nowhere"}
    assert with_found_files(report)["input"] == "gone/in.usda"
    found = with_found_files(report, str(tmp_path))
    assert found["input"] == str(tmp_path / "in.usda") and found["output"] is None
