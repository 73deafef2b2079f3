"""Connected components of links: those of the graph."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.device import Device
from dtrepair.intersect.topology.components import least_linked, link_labels

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
def test_roots_are_the_least_items_of_components(links: list[tuple[int, int]], count: int) -> None:
    given_links = np.array(links, dtype=np.int64).reshape(-1, 2)
    labels = components(given_links, count)
    expected = np.unique(labels, return_index=True)[1][labels]
    items = np.arange(count, dtype=np.int32)
    for order in (given_links, given_links[::-1], given_links[:, ::-1]):
        assert np.array_equal(least_linked(order, items, Device()), expected)
    assert np.array_equal(link_labels(given_links, count), labels)
