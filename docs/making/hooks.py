"""Hooks of MkDocs: files of the checkout outside `docs/` that pages link to become pages, too."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

ROOT = Path(__file__).parents[2]
# Files from the top of the checkout; nothing but these may be linked to from outside the folder.
OUTSIDE = ("CHANGELOG.md", "CONTRIBUTING.md", "blender/README.md")


def on_files(files: Any, *, config: Any) -> Any:
    """Add the files from outside; their links into docs/ are links within the site."""
    for name in OUTSIDE:
        text = (ROOT / name).read_text(encoding="utf-8")
        files.append(File.generated(config, name, content=text.replace("](docs/", "](")))
    return files


def on_page_markdown(markdown: str, *, page: Any, config: Any, files: Any) -> str:
    """Take the way out of docs/ off links to those files: the site has them inside."""
    up = "../" * page.file.src_uri.count("/")
    names = "|".join(map(re.escape, OUTSIDE))
    return re.sub(rf"\]\({re.escape(up)}\.\./({names})", rf"]({up}\1", markdown)
