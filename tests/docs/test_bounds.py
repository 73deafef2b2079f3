"""The pictures of the bounds show what a repair calls strained, and the page says the same."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import pytest

from docs.making import bounds
from docs.making.bounds import Judge, captions, checked, panels
from docs.making.pictures import FOLDER
from dtrepair.diagnosis import StrainKind

MAKERS = {make.__name__: make for own in bounds.EXAMPLES.values() for make in own}
PAGE = (FOLDER.parent / "characters.md").read_text(encoding="utf-8")
TABLE = re.findall(
    r"^\| (.+?) \| (.+?) \| .+ \|$", PAGE.split("| measure |")[1].split("\n\n")[0], re.MULTILINE
)


@cache
def judge(name: str) -> Judge:
    return Judge(MAKERS[name]())


@pytest.mark.parametrize("name", MAKERS)
def test_only_what_is_beyond_the_bound_is_strained(name: str) -> None:
    own = judge(name)
    example, (value, _) = own.example, checked(own)
    assert own.strains(0.0) == () == own.strains(example.within)
    (strain,) = own.strains(example.beyond)
    assert strain.kind == example.kind and strain.size == pytest.approx(2.0)
    assert value <= strain.bound < strain.value


@pytest.mark.parametrize("name", MAKERS)
def test_the_table_has_the_bound_of_each_picture(name: str) -> None:
    example = judge(name).example
    (cell,) = [bound for row, bound in TABLE if row.startswith(example.row)]
    said = re.match(r"[\d.]+( %)?", cell)
    assert said is not None and said[0] == example.bound
    number = float(said[0].removesuffix(" %")) / (100.0 if said[1] else 1.0)
    (strain,) = judge(name).strains(example.beyond)
    assert strain.bound == pytest.approx(number)


def test_each_row_of_the_table_and_each_kind_has_a_picture() -> None:
    assert len(TABLE) == len(MAKERS)
    # What is worn is on or off: there is nothing just within the bound.
    drawn = set(StrainKind) - {StrainKind.WORN}
    assert {judge(name).example.kind for name in MAKERS} == drawn


@pytest.mark.parametrize("name", MAKERS)
def test_a_small_place_is_marked(name: str) -> None:
    own = judge(name)
    for harm in (own.example.within, own.example.beyond):
        marked = own.marked(harm)
        assert 0 < marked.sum() < 0.35 * len(marked) and len(marked) == len(own.example.paint)


def test_shapes_that_do_not_show_what_is_meant_are_refused() -> None:
    own = judge("crushed_edges")
    for wrong, match in (
        ({"within": 6.0}, "expected no strain within"),
        ({"beyond": 5.0}, "expected edges alone"),
        ({"beyond": 9.0}, "not near 5"),
    ):
        with pytest.raises(ValueError, match=match):
            checked(Judge(replace(own.example, **wrong)))  # type: ignore[arg-type]


def test_three_panels_of_one_size_with_the_place_in_its_colours() -> None:
    own = judge("crushed_edges")
    images = panels(own)
    assert len({image.shape for image in images}) == 1
    lacks = [image[..., :1].astype(int) - image[..., 1:] for image in images]
    little_green, little_blue = ([int((lack[..., k] > 90).sum()) for lack in lacks] for k in (0, 1))
    assert little_green[:2] == [0, 0] and little_green[2] > 50
    assert little_blue[0] == 0 and little_blue[1] > 50
    assert captions(own) == ["edges: at most 5 crushed", "within: 5", "beyond: 6"]
