"""What a body of a scene may say, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dtrepair import Body, SceneRepairer
from dtrepair.repair.scene.bodies import layer_of
from tests.meshes import icosphere

BALL, FACES = icosphere(1)
COUNT = len(FACES)


def test_a_layer_is_one_whole_number_for_each_triangle() -> None:
    assert layer_of(Body(BALL, FACES), COUNT).tolist() == [0] * COUNT
    layer = layer_of(Body(BALL, FACES, layer=list(range(COUNT))), COUNT)
    assert layer.dtype == np.int32 and layer.tolist() == list(range(COUNT))
    kept = SceneRepairer([Body(BALL, FACES, layer=layer)]).bodies[0].layer
    assert kept is layer


@pytest.mark.parametrize("layer", [[1, 2], np.ones(COUNT), np.ones((COUNT, 1), dtype=int)])
def test_layers_that_do_not_fit_are_refused(layer: Any) -> None:
    with pytest.raises(ValueError, match=f"a whole number for each of {COUNT} triangles"):
        SceneRepairer([Body(BALL, FACES, layer=layer)])


@pytest.mark.parametrize("value", [2, -0.1, float("nan"), None, "1", np.ones(3)])
def test_a_mobility_out_of_range_is_refused_at_once(value: Any) -> None:
    with pytest.raises(ValueError, match="mobility should be a number from 0, never moves, to 1"):
        Body(BALL, FACES, mobility=value)
    half: Any = np.float32(0.5)  # a number of numpy is one
    assert Body(BALL, FACES, mobility=half).mobility == 0.5


def test_a_number_of_any_kind_is_a_mobility() -> None:
    values: list[Any] = [0.5, np.float32(0.5), np.array(0.5), 1]
    for value in values:
        assert Body(*icosphere(0), mobility=value).mobility == value


@pytest.mark.parametrize("value", [0, -1.0, float("inf"), float("nan"), "99"])
def test_a_diffusion_out_of_range_is_refused_at_once(value: Any) -> None:
    with pytest.raises(ValueError, match="diffusion should be positive and finite, got"):
        Body(BALL, FACES, diffusion=value)
    assert Body(BALL, FACES, diffusion=None).diffusion is None
