"""Which time codes of a stage are key poses."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pytest

from tests.skinned_box import skinned_stage
from tests.usd_reading import edited_cube
from usd_io import FrameSpecError, StageTimes, key_times, open_stage, parse_frames, read_meshes

BAKED = {float(time): 3.0 * time for time in range(21)}


def keys_of(path: Path, spec: str | None = None) -> StageTimes:
    meshes = read_meshes(open_stage(path)).meshes
    return key_times(meshes, None if spec is None else parse_frames(spec))


def test_keys_of_a_skin_are_those_of_its_joints(tmp_path: Path) -> None:
    skinned_stage(tmp_path / "a.usda", keys={0.0: 0.0, 10.0: 45.0, 20.0: 90.0}).Save()
    found = keys_of(tmp_path / "a.usda")
    assert found.chosen.tolist() == found.every.tolist() == [0.0, 10.0, 20.0]
    assert found.keys.tolist() == list(range(21)) and not found.warnings
    some = keys_of(tmp_path / "a.usda", "0:10")
    assert some.chosen.tolist() == [0.0, 10.0] and some.every.tolist() == [0.0, 10.0, 20.0]


def test_a_frame_of_a_skin_is_a_key_where_it_is_named(tmp_path: Path) -> None:
    skinned_stage(tmp_path / "a.usda", keys={0.0: 0.0, 20.0: 90.0}).Save()
    found = keys_of(tmp_path / "a.usda", "0:20x5")
    assert found.chosen.tolist() == found.every.tolist() == [0.0, 5.0, 10.0, 15.0, 20.0]
    assert keys_of(tmp_path / "a.usda", "5").every.tolist() == [0.0, 5.0, 20.0]
    with pytest.raises(FrameSpecError):
        keys_of(tmp_path / "a.usda", "5:8")


def test_keys_of_points_are_their_samples(tmp_path: Path) -> None:
    path = edited_cube(tmp_path, lambda cube: None, times=[1.0, 4.0, 9.0])
    assert keys_of(path).every.tolist() == [1.0, 4.0, 9.0]
    apart = keys_of(path, "1,9")
    assert apart.chosen.tolist() == [1.0, 9.0] and apart.every.tolist() == [1.0, 4.0, 9.0]
    (told, _) = keys_of(path, "1,6,9").warnings
    assert told.endswith("6 is no key, and is left out")
    (told,) = apart.warnings
    assert told.startswith("frames '1,9': no two neighbouring keys are named")
    assert "--frames 1:9, or give each whole frame a sample" in told
    assert not keys_of(path, "4,9").warnings and not keys_of(path, "9").warnings


@pytest.mark.parametrize(
    ("times", "words"),
    [
        ([*range(1, 5), *range(6, 18)], "(so far 5 has none)"),
        (range(1, 18, 2), "(so far 2 and others have none)"),
        ((1, 9, 17, 25), None),
    ],
)
def test_what_makes_keys_of_frames_with_others_between_them(
    tmp_path: Path, times: Iterable[int], words: str | None
) -> None:
    path = edited_cube(tmp_path, lambda cube: None, times=[float(time) for time in times])
    (told,) = keys_of(path, "1,17").warnings
    assert f"such as --frames 1:{max(times)}" in told
    if words is None:  # real key poses
        assert "sample" not in told
    else:
        assert words in told and told.endswith("the frames that are named are the keys")


def test_of_baked_animation_the_keys_are_named(tmp_path: Path) -> None:
    path = tmp_path / "a.usda"
    skinned_stage(path, keys=BAKED).Save()
    every = keys_of(path)
    assert every.every.tolist() == list(BAKED)
    assert len(every.warnings) == 1 and "--frames 0,10,20" in every.warnings[0]
    named = keys_of(path, "4,8,16")
    assert named.chosen.tolist() == [4.0, 8.0, 16.0] and not named.warnings
    assert named.every.tolist() == [0, 1, 2, 3, 4, 8, 16, 17, 18, 19, 20]
    # A range is of the keys that there are, and one frame has none between it and another.
    assert keys_of(path, "4:8,16").every.tolist() == [*range(9), *range(16, 21)]
    assert keys_of(path, "4").every.tolist() == list(BAKED)


def test_points_on_every_frame_are_baked_as_well(tmp_path: Path) -> None:
    path = edited_cube(tmp_path, lambda cube: None, times=list(BAKED))
    assert len(keys_of(path).warnings) == 1
    assert keys_of(path, "0:20x10").every.tolist() == [0.0, 10.0, 20.0]


def test_a_few_poses_on_neighbouring_frames_are_no_bake(tmp_path: Path) -> None:
    path = edited_cube(tmp_path, lambda cube: None, times=[1.0, 2.0, 3.0])
    assert not keys_of(path).warnings
