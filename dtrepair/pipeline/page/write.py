"""Write the page of a report."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from dtrepair.files.atomic import write_atomically
from dtrepair.pipeline.errors import Cancelled
from dtrepair.pipeline.observer import SILENT, Observer, warn
from dtrepair.pipeline.page.gather import PageOptions, gather_content
from dtrepair.pipeline.page.posed_run import open_run, with_found_files
from dtrepair.pipeline.repair.records import REMEDIES
from dtrepair.pipeline.stages.outputs import FilePath, writing
from dtrepair.report.page.content import PageContent
from dtrepair.report.page.page import make_page
from dtrepair.report.record import Report


def write_page(
    report: Report | Mapping[str, Any],
    path: FilePath,
    *,
    beside: str | None = None,
    options: PageOptions = PageOptions(),
    observer: Observer = SILENT,
) -> None:
    """Write the HTML page of a report, whole or not at all.

    Where the input or the output of the run cannot be looked at, the page has numbers only; the
    observer hears of it, and the page tells why.

    Args:
        report: Of a run, or its document as `read_report` returns it.
        path: The page.
        beside: A folder in which input and output are looked for as well, that of the report.
        options: What the page shows.
        observer: Hears of the progress, and may cancel.

    Raises:
        OutputError: The page cannot be written.
    """
    document = report.document() if isinstance(report, Report) else report
    content, notes = PageContent(), []
    try:
        found = with_found_files(document, beside)
        content = gather_content(document, open_run(found), options=options, observer=observer)
    except Cancelled:
        raise
    except Exception as error:  # a page without pictures is better than none
        notes.append(f"without pictures: {error}")
        warn(observer, [f"{os.fspath(path)}: {notes[0]}"])
    with writing(os.fspath(path)):
        write_atomically(path, make_page(document, content, remedies=REMEDIES, notes=notes))
