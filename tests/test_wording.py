"""Numbers in sentences."""

from dtrepair.wording import counted, listed


def test_one_is_singular() -> None:
    assert [counted(n, "pair") for n in (0, 1, 2)] == ["0 pairs", "1 pair", "2 pairs"]


def test_long_lists_are_cut() -> None:
    assert listed(["a"]) == "a" and listed([]) == ""
    assert listed(list("abc")) == "a, b, c" and listed(list("abcde")) == "a, b, c and 2 more"
