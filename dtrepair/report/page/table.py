"""Tables as HTML: texts are escaped, what is HTML already says so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape


@dataclass(frozen=True)
class Markup:
    """HTML that was made of escaped texts."""

    html: str


Cell = str | Markup


def html_table(
    header: Sequence[str], rows: Sequence[Sequence[Cell]], *, numbered: bool = False
) -> str:
    """Return a table; `numbered` rows carry their number as data-frame."""
    head = "".join(f"<th>{escape(cell)}</th>" for cell in header)
    body = "".join(
        f'<tr data-frame="{number}">' * numbered
        + "<tr>" * (not numbered)
        + "".join(f"<td>{_html(cell)}</td>" for cell in row)
        + "</tr>"
        for number, row in enumerate(rows)
    )
    return f"<div class=scroll><table><tr>{head}</tr>{body}</table></div>"


def rounded(value: float | None) -> str:
    """Return a number with three digits; nothing for None."""
    return "" if value is None else f"{value:.3g}"


def _html(cell: Cell) -> str:
    return cell.html if isinstance(cell, Markup) else escape(cell)
