from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from pxr import Usd, UsdUtils

from tests.present import present
from usd_io.errors import FrameSpecError
from usd_io.times import parse_frames, time_code


@pytest.mark.parametrize(
    "spec",
    ["7", "1:10", "-5:10", "1:100x2", "10:1", "10:1x-2", "1.5:3x0.5", "-3", "0:1x0.3", "4:4"],
)
def test_frames_are_those_of_usdrecord(spec: str) -> None:
    theirs = [code.GetValue() for code in UsdUtils.TimeCodeRange.CreateFromFrameSpec(spec)]
    np.testing.assert_allclose(parse_frames(spec).values(), sorted(theirs), atol=1e-12)


def test_commas_join_ranges() -> None:
    assert parse_frames("1:3, 10,2:4").values().tolist() == [1, 2, 3, 4, 10]


def test_a_descending_range_names_the_frames_it_visits() -> None:
    assert parse_frames("10:1").values().tolist() == list(range(1, 11))
    assert parse_frames("10:1x-4").values().tolist() == [2, 6, 10]


@pytest.mark.parametrize(
    "spec, reason",
    [
        ("", "no frames given"),
        (" , ", "no frames given"),
        ("1:inf", "cannot read '1:inf'"),
        ("nan", "cannot read"),
        ("x0", "cannot read 'x0'"),
        ("a:b", "cannot read 'a:b'"),
        ("1:2:3", "cannot read"),
        ("5x2", "cannot read"),
        ("1:1e999", "not finite"),
        ("1,,2", "cannot read ''"),
        ("1:10x0", "stride of '1:10x0' is zero"),
        ("1:10x-1", "leads away"),
        ("10:1x2", "leads away"),
    ],
)
def test_bad_specs_are_usage_errors(spec: str, reason: str) -> None:
    with pytest.raises(FrameSpecError, match=reason) as caught:
        parse_frames(spec)
    assert caught.value.exit_code == 2
    assert "\n" not in str(caught.value)


def test_select_takes_named_times_only() -> None:
    times = [-5.0, 0.0, 1.0, 1.5, 2.0, 9.0, 10.0, np.nan]
    assert parse_frames("-5:10x5").select(times).tolist() == [1, 1, 0, 0, 0, 0, 1, 0]
    assert parse_frames("1:3").select(times).tolist() == [0, 0, 1, 0, 1, 0, 0, 0]
    assert parse_frames("3:8").select(times).tolist() == [0] * 8
    assert parse_frames("1:3x0.5").select(times).tolist() == [0, 0, 1, 1, 1, 0, 0, 0]


def test_select_forgives_rounding_of_layer_offsets() -> None:
    assert parse_frames("0:1x0.1").select([0.1 * 3, 7 * 0.1, 0.1000001, 0.1001]).tolist() == [
        True,
        True,
        True,
        False,
    ]


def test_select_needs_no_list_of_frames() -> None:
    spec = parse_frames("0:1e15")
    assert spec.select([5.0, 5.5]).tolist() == [True, False]
    for frames in ("0:1e15", "0:1e300", "-1e300:7"):
        with pytest.raises(FrameSpecError, match="more than"):
            parse_frames(frames).values()


def test_frames_between_two_times_are_listed_up_to_a_number() -> None:
    assert present(parse_frames("0:1e300x2,7").between(3.0, 9.0, most=9)).tolist() == [4, 6, 7, 8]
    assert present(parse_frames("10:1x-4").between(2.5, 99.0, most=2)).tolist() == [6, 10]
    assert parse_frames("0:1e300x2").between(3.0, 9.0, most=2) is None
    assert len(present(parse_frames("5").between(6.0, 9.0, most=2))) == 0


def test_nothing_in_range_is_an_error_on_request() -> None:
    spec = parse_frames("20:30")
    assert not spec.select([1.0, 2.0]).any()
    with pytest.raises(FrameSpecError, match="none of the frames, 1 to 2, is among them"):
        spec.select([1.0, 2.0], require=True)
    with pytest.raises(FrameSpecError, match="the selected meshes have no time samples of"):
        spec.select([np.nan], require=True)


def test_time_code_of_nan_is_the_default_time() -> None:
    assert time_code(float("nan")).IsDefault()
    assert time_code(1.5) == Usd.TimeCode(1.5)


@pytest.mark.parametrize(
    ("times", "told"),
    [
        (range(2, 26), "the frames, 2 to 25, is"),
        ([2.0], "the frames, 2, is"),
        ([2, 9, 17, 25], "the frames, 2, 9, 17, 25, is"),
        ([2, 2.5, 3], "the frames, 2 to 3, is"),
        (range(2, 100, 8), "the frames, 2, 10, 18, 26, 34, 42, 50, 58 and 5 more up to 98, is"),
    ],
)
def test_frames_that_there_are_are_told(times: Sequence[float], told: str) -> None:
    with pytest.raises(FrameSpecError, match=told):
        parse_frames("1").select(times, require=True)
