"""A library is taken only if it is the one that was tested."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from dtrepair.report.page import libraries
from dtrepair.report.page.content import PageContent
from dtrepair.report.page.page import make_page
from tests.report.page.test_page import document


@pytest.fixture
def vendor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder of uPlot's files, which may be changed."""
    source = libraries._folder("youplot") / "vendor"
    for name in libraries.UPLOT:
        (tmp_path / "vendor" / name).parent.mkdir(exist_ok=True)
        (tmp_path / "vendor" / name).write_bytes((source / name).read_bytes())
    monkeypatch.setattr(libraries, "_folder", lambda package: tmp_path)
    libraries.chart_library.cache_clear()
    yield tmp_path / "vendor"
    libraries.chart_library.cache_clear()


def test_uplot_is_taken_as_it_was_published(vendor: Path) -> None:
    library = libraries.chart_library()
    assert "uPlot=function" in library.script and ".uplot" in library.style


@pytest.mark.parametrize("name", libraries.UPLOT)
def test_another_uplot_is_refused_and_the_page_tells(vendor: Path, name: str) -> None:
    (vendor / name).write_bytes((vendor / name).read_bytes() + b" ")
    with pytest.raises(libraries.LibraryError, match=r"expected uPlot 1\.6\.31, got another"):
        libraries.chart_library()
    page = make_page(document(), PageContent())
    assert "got another file" in page and "uPlot=function" not in page


def test_a_missing_uplot_is_told(vendor: Path) -> None:
    (vendor / "uplot.min.css").unlink()
    with pytest.raises(libraries.LibraryError, match="charts need uPlot of youplot"):
        libraries.chart_library()
