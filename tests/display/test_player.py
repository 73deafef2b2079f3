"""Which frame is shown: played in time, and the worst one after another."""

from __future__ import annotations

from dtrepair.display.player import Player


def test_it_plays_round_and_round_in_its_time() -> None:
    seconds = [0.0]
    player = Player(3, lambda index: 0, first=1, rate=8.0, now=lambda: seconds[0])
    seconds[0] = 5.0
    assert not player.tick() and player.index == 1  # it does not play yet
    player.play(True)
    seen = []
    for step in (0.0625, 0.0625, 0.125, 0.125, 9.0):
        seconds[0] += step
        seen.append((player.tick(), player.index))
    assert seen == [(False, 1), (True, 2), (True, 0), (True, 1), (True, 2)]
    player.play(False)
    seconds[0] += 1.0
    assert not player.tick()


def test_a_single_frame_does_not_change() -> None:
    seconds = [0.0]
    player = Player(1, lambda index: 0, now=lambda: seconds[0])
    player.play(True)
    seconds[0] = 1.0
    assert not player.tick() and player.index == 0


def test_the_worst_frames_come_in_turn() -> None:
    looked: list[int] = []

    def severity(index: int) -> int:
        looked.append(index)
        return (0, 3, 9, 0, 3)[index]

    player = Player(5, severity)
    seen = []
    for _ in range(4):
        player.next_worst()
        seen.append(player.index)
    assert seen == [2, 1, 4, 2] and looked == [0, 1, 2, 3, 4]
    player.go(3)
    assert player.next_worst() and player.index == 2


def test_without_a_bad_frame_it_stays() -> None:
    player = Player(4, lambda index: 0, first=2)
    assert not player.next_worst() and player.index == 2
