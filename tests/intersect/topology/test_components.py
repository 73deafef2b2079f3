"""Connected components of links: those of the graph, by one thread and by many."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.device import Device, start_warp
from dtrepair.intersect.topology.components import link_labels, roots_at_once, roots_in_turn

ITEMS = 300


def components(links: NDArray[np.int64], count: int) -> NDArray[np.int32]:
    """The components of the graph by scipy, which numbers them by their first items as well."""
    graph = sparse.coo_matrix((np.ones(len(links)), links.T), shape=(count, count))
    return np.asarray(csgraph.connected_components(graph, directed=False)[1])


@pytest.mark.parametrize("count", [0, 20, 200, 2000])
def test_components_of_links_are_those_of_the_graph(count: int) -> None:
    links = np.random.default_rng(count).integers(0, ITEMS, size=(count, 2))
    assert np.array_equal(link_labels(links, ITEMS), components(links, ITEMS))
    # In a row, worst order first.
    chain = np.stack([np.arange(ITEMS - 1), np.arange(1, ITEMS)], axis=1)
    assert not link_labels(chain[::-1], ITEMS).any()


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 39), st.integers(0, 39)), max_size=80),
    st.integers(40, 50),
)
def test_many_threads_find_the_roots_of_one(links: list[tuple[int, int]], count: int) -> None:
    given_links = np.array(links, dtype=np.int64).reshape(-1, 2)
    device, items = Device(), np.arange(count, dtype=np.int32)
    uploaded = device.array(given_links.astype(np.int32), start_warp().vec2i)
    one, many = (search(device, uploaded, items) for search in (roots_in_turn, roots_at_once))
    # The root of each component is its least item.
    labels = components(given_links, count)
    first = np.unique(labels, return_index=True)[1]
    assert np.array_equal(one, first[labels])
    assert np.array_equal(many, first[labels])
