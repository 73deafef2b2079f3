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
