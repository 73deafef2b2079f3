"""The page in headless Chromium: no error, every control works, nothing hostile runs.

Skipped where playwright or a browser is absent; `.ci/report` has both.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.display.packing import differences, packed
from dtrepair.report.page.content import Contact, PageContent
from dtrepair.report.page.page import make_page
from dtrepair.report.record import CountRecord, FrameRecord, PrimRecord, Report
from tests.meshes import icosphere
from tests.report.page.chromium import Opened, launched, opened
from tests.report.page.test_page import HOSTILE, hostile_page

FRAMES = 6


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    driver, started = launched()
    yield started
    started.close()
    driver.stop()


def view(frames: range, shift: float) -> dict[str, Any]:
    """A ball that turns red where it faces the viewer, and is moved to the right."""
    points, faces = icosphere(3)
    front = np.flatnonzero(points[faces].mean(axis=1)[:, 2] > 0.7).astype(np.uint32)
    poses = np.stack([points * (1 + 0.02 * k) for k in range(len(frames))])
    step = 4.0 / 32000
    counts = np.full(len(frames), len(front), dtype=np.uint32)
    moved = np.zeros_like(poses)
    moved[..., 0] = shift
    arrays: dict[str, NDArray[Any]] = {
        "faces": faces.astype(np.uint16),
        "objects": np.zeros(len(faces), dtype=np.uint16),
        "first": differences(poses, step),
        "moved": differences(moved, step),
        "red": np.tile(front, len(frames)),
        "red_counts": counts,
        "red_after": np.zeros(0, dtype=np.uint32),
        "red_after_counts": 0 * counts,
    }
    return {
        **packed(arrays),
        "names": ["before", "after"],
        "frames": list(frames),
        "worst": 1,
        "vertices": len(points),
        "step": step,
        "size": 3.5,
        "rotation": np.eye(3).tolist(),
        "target": [0.0, 0.0, 0.0],
        "half": 1.2,
        "whole": True,
    }


@pytest.fixture(scope="module")
def html() -> str:
    frames = tuple(
        FrameRecord(
            time=10.0 + k,
            status="clean",
            before=CountRecord(triangles=10 + k, pairs=9),
            after=CountRecord(),
            displacement_max=0.01 * k,
        )
        for k in range(FRAMES)
    )
    report = Report(
        command="repair",
        version="1",
        input="a.usd",
        output="b.usd",
        prims=(PrimRecord(path="/Ball", vertices=8, triangles=12, rest_intersections=0),),
        frames=frames,
    ).document()
    contacts = tuple(
        Contact(
            first="/Ball",
            second=second,
            frames=(first, first + 2, first + 1),
            triangles=(12, 0),
            view=view(range(first, first + 3), 0.8),
        )
        for first, second in ((0, "/Ball"), (3, "/Box"))
    )
    volume = [0.01 * k for k in range(FRAMES)]
    content = PageContent(contacts=contacts, measures={"volume": volume}, colours=[(0.2, 0.8, 0.2)])
    return make_page(report, content)


@pytest.fixture
def shown(browser: Any, html: str, tmp_path: Path) -> Iterator[Opened]:
    result = opened(browser, tmp_path / "r.html", html)
    result.wait_for_frame("11")
    yield result
    assert result.wrong == []
    result.page.context.close()


def red(pixels: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Which pixels (H, W) are red."""
    first, second = pixels[..., 0].astype(int), pixels[..., 1].astype(int)
    return np.asarray((first > 90) & (first > 2 * second))


def middle(shape: NDArray[np.bool_]) -> float:
    """Mean column of the pixels, of the width from 0 to 1."""
    return float(np.nonzero(shape)[1].mean() / shape.shape[1])


def test_the_chart_leads_to_a_frame(shown: Opened) -> None:
    assert shown.page.locator("#chart canvas").count() == 1
    shown.page.locator("#chart .u-over").scroll_into_view_if_needed()
    box = shown.page.locator("#chart .u-over").bounding_box()
    for share, frame, contact in ((0.2, 11, "0"), (0.8, 14, "1")):
        shown.page.mouse.click(box["x"] + share * box["width"], box["y"] + 0.5 * box["height"])
        shown.wait_for_frame(str(frame))
        assert shown.page.input_value("#contact") == contact
        assert shown.text("#told").startswith(f"Frame {frame}: ")
        assert shown.page.locator(f'tr.here[data-frame="{frame - 10}"]').count() == 1


WRITTEN = """
window.written = [];
const draw = CanvasRenderingContext2D.prototype.fillText;
CanvasRenderingContext2D.prototype.fillText = function (text, ...place) {
  written.push(text);
  return draw.call(this, text, ...place);
};
"""


def test_the_chart_has_whole_frames_and_triangles(browser: Any, html: str, tmp_path: Path) -> None:
    # Few frames are wider apart than the 50 pixels of a mark.
    page = opened(browser, tmp_path / "w.html", html, first=WRITTEN).page
    numbers = [text for text in page.evaluate("written") if text[:1].isdigit() and "%" not in text]
    assert {"11", "12"} <= set(numbers) and all(number.isdigit() for number in numbers)


def test_a_line_is_switched_off(shown: Opened) -> None:
    line = shown.page.locator(".u-series", has_text="largest move")
    line.locator("th").click()
    assert "u-off" in line.get_attribute("class")


def test_links_lead_to_frames_and_contacts(shown: Opened) -> None:
    shown.page.locator('tr[data-frame="4"] button').click()
    shown.wait_for_frame("14")
    shown.page.locator("figure button", has_text="Look at it").first.click()
    shown.wait_for_frame("11")
    shown.page.click("#next")
    shown.wait_for_frame("14")
    assert shown.page.input_value("#contact") == "1"
    shown.page.select_option("#contact", "0")
    shown.wait_for_frame("11")
    assert shown.page.locator('figure.here[data-contact="0"]').count() == 1


def test_before_after_and_the_wipe_between_them(shown: Opened) -> None:
    ball = {}
    for mode in ("before", "after", "wipe"):
        shown.page.click(f"[data-mode={mode}]")
        assert shown.page.get_attribute(f"[data-mode={mode}]", "aria-pressed") == "true"
        ball[mode] = shown.pixels()
    green = {
        name: own[..., 1].astype(int) > own[..., 2].astype(int) + 20 for name, own in ball.items()
    }
    assert red(ball["before"]).any() and not red(ball["after"]).any()
    assert middle(green["after"]) > middle(green["before"]) + 0.1
    half = ball["wipe"].shape[1] // 2
    assert np.array_equal(ball["wipe"][:, : half - 2], ball["before"][:, : half - 2])
    assert np.array_equal(ball["wipe"][:, half + 2 :], ball["after"][:, half + 2 :])
    shown.put("wipe", 100)
    assert np.array_equal(shown.pixels()[:, :-4], ball["before"][:, :-4])


def test_colours_red_and_see_through(shown: Opened) -> None:
    shown.page.click("[data-mode=before]")
    plain = shown.pixels()
    shown.page.uncheck("#red")
    assert not red(shown.pixels()).any() and red(plain).any()
    shown.page.select_option("#colour", "displacement")
    assert "23 % of the size" in shown.text("#legend")
    assert not np.array_equal(shown.pixels(), plain)
    shown.page.check("#clear")
    clear = shown.pixels()
    shown.page.uncheck("#clear")
    assert not np.array_equal(shown.pixels(), clear)


def test_it_turns_zooms_and_comes_back(shown: Opened) -> None:
    shown.page.locator("#stage").scroll_into_view_if_needed()
    first = shown.pixels()
    box = shown.page.locator("#stage").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    shown.page.mouse.move(x, y)
    shown.page.mouse.down()
    shown.page.mouse.move(x + 150, y + 20, steps=5)
    shown.page.mouse.up()
    turned = shown.pixels()
    assert not np.array_equal(turned, first)
    shown.page.mouse.wheel(0, 300)
    assert not np.array_equal(shown.pixels(), turned)
    shown.page.click("#close")
    assert np.array_equal(shown.pixels(), first)
    shown.page.click("#far")
    assert red(shown.pixels()).sum() < 0.9 * red(first).sum()


def test_it_plays(shown: Opened) -> None:
    shown.page.click("#play")
    assert shown.text("#play") == "Pause"
    for frame in (12, 10):
        shown.wait_for_frame(str(frame))
    shown.page.click("#play")
    assert shown.text("#play") == "Play"
    shown.put("slider", 2)
    assert shown.text("#at") == "12"


def test_dark_and_print(browser: Any, html: str, tmp_path: Path) -> None:
    dark = opened(browser, tmp_path / "d.html", html, color_scheme="dark")
    dark.wait_for_frame("11")
    assert dark.pixels()[2, 2, :3].max() < 80
    dark.page.emulate_media(media="print")
    assert not dark.page.is_visible("#viewer")
    dark.page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert dark.page.is_visible("dl") and dark.page.is_visible("#chart canvas")
    assert dark.wrong == []


@pytest.mark.parametrize("name", HOSTILE)
def test_nothing_hostile_runs(browser: Any, tmp_path: Path, name: str) -> None:
    result = opened(browser, tmp_path / "h.html", hostile_page(name))
    result.page.wait_for_timeout(100)
    assert result.page.evaluate("typeof hacked") == "undefined"
    assert result.page.locator("h1").inner_text().endswith(name.replace("\u2028", "\u2028"))


@pytest.mark.parametrize("width", [360, 480, 640, 760])
def test_nothing_sticks_out_of_a_narrow_window(shown: Opened, width: int) -> None:
    """A phone, half a screen: wide tables scroll by themselves, and the chart fits."""
    shown.page.set_viewport_size({"width": width, "height": 700})
    shown.page.wait_for_timeout(300)
    wide = shown.page.evaluate(
        "[...document.body.querySelectorAll('*')].filter((each) => !each.closest('.scroll')"
        " && each.getBoundingClientRect().right > innerWidth + 1).map((each) => each.outerHTML"
        ".slice(0, 80))"
    )
    assert wide == []
    assert shown.page.evaluate("document.documentElement.scrollWidth") <= width
