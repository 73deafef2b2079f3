"""Headless Chromium, and a page in it. Skipped where playwright or a browser is absent."""

from __future__ import annotations

import base64
import io
import os
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
BROWSER = os.environ.get("CHROMIUM") or next(filter(None, map(shutil.which, NAMES)), None)
# Software rendering: a machine of CI has no GPU.
ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def launched() -> Any:
    """A browser of playwright; skips where there is none, unless one has to be there."""
    needed = bool(os.environ.get("DTREPAIR_BROWSER"))
    if not needed and BROWSER is None:
        pytest.skip("no Chromium")
    if not needed:
        pytest.importorskip("playwright")
    from playwright.sync_api import sync_playwright

    driver = sync_playwright().start()
    return driver, driver.chromium.launch(executable_path=BROWSER, args=ARGUMENTS)


@dataclass
class Opened:
    """A page, and what went wrong in it."""

    page: Any
    wrong: list[str] = field(default_factory=list)

    def text(self, selector: str) -> str:
        """The text of an element."""
        found: str = self.page.inner_text(selector)
        return found

    def pixels(self) -> NDArray[np.uint8]:
        """What the viewer shows (H, W, 4), read from its canvas."""
        self.page.wait_for_timeout(150)
        url = self.page.evaluate("document.querySelector('#stage canvas').toDataURL()")
        image = Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2])))
        return np.asarray(image.convert("RGBA"))

    def put(self, name: str, value: int) -> None:
        """Move a slider."""
        self.page.evaluate(
            "([name, value]) => { const slider = document.getElementById(name);"
            "slider.value = value; slider.dispatchEvent(new Event('input')); }",
            [name, value],
        )

    def wait_for_frame(self, label: str) -> None:
        """Wait until the viewer is at a frame."""
        # Without functions of the driver's own, which the policy of the page forbids.
        self.page.locator("#at").get_by_text(label, exact=True).wait_for()


def opened(browser: Any, path: Path, html: str, first: str = "", **options: Any) -> Opened:
    """Open a page of its own file; requests and messages of the console are wrong.

    first: a script that runs before those of the page.
    """
    path.write_text(html, encoding="utf-8")
    context = browser.new_context(viewport={"width": 900, "height": 700}, **options)
    context.set_default_timeout(30_000)
    context.add_init_script(first)
    result = Opened(context.new_page())
    address = path.as_uri()
    result.page.on("console", lambda message: result.wrong.append(message.text))
    result.page.on("pageerror", lambda error: result.wrong.append(str(error)))
    result.page.on("dialog", lambda dialog: result.wrong.append(dialog.message))
    result.page.on(
        "request",
        lambda asked: (
            None if asked.url.startswith((address, "data:")) else result.wrong.append(asked.url)
        ),
    )
    result.page.goto(address)
    result.page.wait_for_load_state("load")
    return result
