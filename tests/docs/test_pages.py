"""The pages of docs/: commands that are understood, links that lead somewhere."""

from __future__ import annotations

import re
import shlex
from functools import cache
from pathlib import Path

import click
import pytest

from dtrepair.cli.app import COMMANDS, group

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
TEXTS = [*PAGES, *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "blender/README.md"))]


def named(path: Path) -> str:
    return str(path.relative_to(ROOT))


def lines(page: Path) -> list[str]:
    """The commands of a page, in indented or fenced blocks; -q and -v may stand before them."""
    text = page.read_text(encoding="utf-8")
    found = re.findall(r"^(?:    )?dtrepair (?:-[qv]+ )*([^-].*)$", text, re.MULTILINE)
    return [f"dtrepair {line}" for line in found]


@cache
def anchors(page: Path) -> set[str]:
    """What headings are called in links."""
    found = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", text.lower()).strip().replace(" ", "-") for text in found}


def broken(page: Path, text: str) -> list[str]:
    """The links of a text that lead nowhere."""
    wrong = []
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if link.startswith(("https://", "http://")):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        if not target.is_file() or (anchor and anchor not in anchors(target)):
            wrong.append(link)
    return wrong


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_commands_and_options_exist(page: Path) -> None:
    for line in lines(page):
        name, *arguments = shlex.split(line, comments=True)[1:]
        assert name in COMMANDS, line
        command = group.get_command(click.Context(group), name)
        assert command is not None
        assert command.make_context(name, arguments).params, line


def test_the_guide_shows_every_command() -> None:
    shown = {shlex.split(line)[1] for page in (DOCS / "guide").iterdir() for line in lines(page)}
    assert shown == set(COMMANDS)


@pytest.mark.parametrize("page", TEXTS, ids=named)
def test_links_lead_somewhere(page: Path) -> None:
    assert broken(page, page.read_text(encoding="utf-8")) == []


def test_a_broken_link_is_found() -> None:
    page = DOCS / "index.md"
    good = "[a](guide/choosing.md#the-rest-pose) [b](https://docs.blender.org/x)"
    assert broken(page, good) == []
    bad = "[a](nowhere.md) [b](guide/choosing.md#nowhere) [c](#nowhere)"
    assert broken(page, bad) == ["nowhere.md", "guide/choosing.md#nowhere", "#nowhere"]


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_python_compiles(page: Path) -> None:
    for block in re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
        compile(block, named(page), "exec")


def test_the_api_page_names_what_there_is() -> None:
    from importlib import import_module

    for name in re.findall(r"^::: (\S+)$", (DOCS / "api.md").read_text(), re.MULTILINE):
        package, _, last = name.rpartition(".")
        found = getattr(import_module(package), last, None) or import_module(name)
        assert found.__doc__, name


def test_every_page_is_in_the_table_of_contents() -> None:
    text = (DOCS / "making" / "mkdocs.yml").read_text()
    listed = set(re.findall(r"([\w/]+\.md)$", text, re.MULTILINE))
    assert {str(page.relative_to(DOCS)) for page in PAGES} <= listed


def test_every_picture_is_shown() -> None:
    text = "".join(page.read_text(encoding="utf-8") for page in TEXTS)
    for picture in (DOCS / "pictures").iterdir():
        assert f"pictures/{picture.name}" in text
        assert picture.stat().st_size < 200_000
