"""Numbers in sentences."""

from dtrepair.wording import counted, frame_list, length, listed
from usd_io.times import parse_frames


def test_one_is_singular() -> None:
    assert [counted(n, "pair") for n in (0, 1, 2)] == ["0 pairs", "1 pair", "2 pairs"]


def test_long_lists_are_cut() -> None:
    assert listed(["a"]) == "a" and listed([]) == ""
    assert listed(list("abc")) == "a, b, c" and listed(list("abcde")) == "a, b, c and 2 more"


def test_lengths_are_told_in_stage_units_and_per_cent_of_the_size() -> None:
    assert length(0.007, 180.0) == "1.26 (0.7 %)"
    assert length(1e-4, 0.02) == "2e-06 (0.01 %)"
    assert length(0.007, None) == "0.7 % of the size"


def test_frames_are_listed_as_they_are_chosen() -> None:
    assert frame_list([]) == "" and frame_list([7.0]) == "7" and frame_list([8.0, 7.0]) == "7, 8"
    assert frame_list([3.0, 1.0, 2.0, 2.0, 9.0]) == "1:3, 9"
    assert frame_list([-1.0, 0.0, 1.0, 2.5, 3.0, 3.5]) == "-1:1, 2.5, 3, 3.5"
    assert frame_list([1.5, 2.5, 3.5]) == "1.5, 2.5, 3.5"
    many = [*range(10, 20), *range(30, 60, 2)]
    assert frame_list(many, named=3) == "10:19, 30, 32 and 13 more"


def test_a_list_of_frames_chooses_these_frames() -> None:
    times = [-5.0, -4.0, -3.0, 2.0, 4.5, 6.0]
    assert parse_frames(frame_list(times)).values().tolist() == times
