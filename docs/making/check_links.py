"""Checks the built site: every link, picture and anchor within it is there.

python docs/making/check_links.py build/site
"""

from __future__ import annotations

import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """The links and the anchors of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = {""}
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note where a tag leads, and what leads to it."""
        for name, value in attrs:
            if name in ("href", "src") and value:
                self.links.append(value)
            elif name in ("id", "name") and value:
                self.anchors.add(value)


@cache
def page_at(path: Path) -> Page:
    """The page of a file, read once."""
    return Page(path)


def broken(page: Path) -> list[str]:
    """The links of a page that lead nowhere within the site."""
    wrong = []
    for link in page_at(page).links:
        parts = urlsplit(link)
        if parts.scheme or parts.netloc:
            continue
        target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
        target = target / "index.html" if target.is_dir() else target
        if not target.is_file():
            wrong.append(link)
        elif target.suffix == ".html" and unquote(parts.fragment) not in page_at(target).anchors:
            wrong.append(link)
    return wrong


def main(site: Path) -> None:
    """Print the broken links of each page; the exit status is 1 if there are any."""
    # The page for what is not found is shown at any address: its links are absolute.
    pages = [page for page in sorted(site.resolve().rglob("*.html")) if page.name != "404.html"]
    found = {page: links for page in pages if (links := broken(page))}
    for page, links in found.items():
        print(f"{page.relative_to(site.resolve())}: {', '.join(links)}")
    print(f"{len(pages)} pages, {sum(map(len, found.values()))} broken links")
    raise SystemExit(1 if found or not pages else 0)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
