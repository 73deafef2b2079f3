"""Hostile values and damaged bytes, and how a run on them may end."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from tests.command_line import Outcome, run

# Examples of each test; without the variable few, and the same ones everywhere.
EXAMPLES = int(os.environ.get("DTREPAIR_FUZZ", "0"))
fuzzed = settings(
    max_examples=EXAMPLES or 25,
    derandomize=not EXAMPLES,
    database=None,
    deadline=None,
    suppress_health_check=list(HealthCheck),
)

WHOLE = st.sampled_from(
    [0, 1, 2, 3, 4, 7, -1, -5, 127, 255, 2**31 - 1, -(2**31), 2**31, 2**63, 2**64]
)
REAL = st.sampled_from([0.0, -0.0, 1.0, 0.5, -3.0, 1e-300, 1e-40, 1e30, 1e38, 3.5e38, 1e300])
WORD = st.sampled_from(
    ["", "a", "x", "\x1b[31m", "\u202e", "K\xe4fer", "1/2", "nan", "none", "/", "//"]
)
PLAIN = st.none() | st.booleans() | WHOLE | REAL | WORD
VALUE: st.SearchStrategy[Any] = st.recursive(
    PLAIN,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORD, inner, max_size=3),
    max_leaves=5,
)


def damaged(data: bytes) -> st.SearchStrategy[bytes]:
    """Bytes of a file cut short, with some of them replaced, left out or said twice."""
    places = st.integers(0, len(data) - 1)

    def apply(edits: Sequence[tuple[str, int, int]]) -> bytes:
        result = bytearray(data)
        for kind, place, value in edits:
            if kind == "cut":
                del result[place:]
            elif kind == "drop":
                del result[place : place + 1 + value % 8]
            elif kind == "set":
                result[place : place + 1] = bytes([value])
            else:
                result[place:place] = result[place : place + 1 + value]
        return bytes(result)

    kind = st.sampled_from(["set", "set", "drop", "twice", "cut"])
    return st.lists(st.tuples(kind, places, st.integers(0, 255)), max_size=4).map(apply)


def replaced(document: Any) -> st.SearchStrategy[Any]:
    """A document of JSON values with hostile ones at a place or two."""
    places = list(_places(document))

    def apply(edits: Sequence[tuple[int, Any]]) -> Any:
        result = document
        for index, value in edits:
            result = _with(result, places[index], value)
        return result

    edit = st.tuples(st.integers(0, len(places) - 1), VALUE)
    return st.lists(edit, min_size=1, max_size=2).map(apply)


def _places(value: Any, above: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    items = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    return [above, *(place for key, item in items for place in _places(item, (*above, key)))]


def _with(value: Any, place: tuple[Any, ...], new: Any) -> Any:
    """The value with another one at a place, where that is still there."""
    if not place:
        return new
    key, *below = place
    if isinstance(value, dict) and key in value:
        return {**value, key: _with(value[key], tuple(below), new)}
    if isinstance(value, list) and isinstance(key, int) and key < len(value):
        return [*value[:key], _with(value[key], tuple(below), new), *value[key + 1 :]]
    return value


def ends_well(*arguments: object, codes: Sequence[int] = (0, 1, 2, 3, 4)) -> Outcome:
    """Run the program; it ends with one of the codes, errors in one line, and no escapes."""
    outcome = run(*arguments)
    assert outcome.code in codes, outcome
    assert "\x1b" not in outcome.out + outcome.err and "Traceback" not in outcome.err
    errors = [line for line in outcome.err.splitlines() if "dtrepair: error" in line]
    assert len(errors) == (outcome.code in (2, 3)), outcome
    return outcome
