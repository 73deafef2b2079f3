"""Tags of a page, as a browser finds them."""

from __future__ import annotations

from html.parser import HTMLParser

VOID = ("meta", "img", "input", "br")


class Tags(HTMLParser):
    """Collects start tags, and checks that what is opened is closed."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[tuple[str, dict[str, str]]] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attributes)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, {name: value or "" for name, value in attributes}))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def parsed(page: str) -> list[tuple[str, dict[str, str]]]:
    """Return the start tags of a page with their attributes; all that is opened is closed."""
    tags = Tags()
    tags.feed(page)
    assert tags.open == []
    return tags.seen
