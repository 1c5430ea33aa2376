from types import SimpleNamespace

import numpy as np
import pytest

from m3depth.evaluation.surfaces import on_slab
from marssim.base.files.json_file import DatasetError

ROCK = np.array([[-1, 0, 1, 2], [3, 4, 5, 6]])


def sample(**meta):
    return SimpleNamespace(rock=ROCK, meta=meta)


def test_slabs_and_the_blocks_of_ledges_are_slabs_and_nothing_else_is():
    ids = {"rocks": [1, 2], "slabs": [3, 3], "ledges": [4, 5], "fragments": [6, 6]}
    assert on_slab(sample(surface_ids=ids)).tolist() == [[False] * 4, [True, True, True, False]]
    assert not on_slab(sample(surface_ids={"rocks": [1, 6], "slabs": [], "ledges": [], "fragments": []})).any()


def test_without_surface_ids_there_are_no_slabs():
    """As in datasets of release 0.1.0, and in the layouts of others, whose samples have no meta."""
    assert not on_slab(sample()).any()
    assert not on_slab(SimpleNamespace(rock=ROCK)).any()


@pytest.mark.parametrize("ids", [3, {"slabs": [1]}, {"slabs": 2}, {"ledges": [1, 2, 3]}, {"slabs": ["a", 2]}])
def test_malformed_surface_ids_are_named(ids):
    with pytest.raises(DatasetError, match="surface_ids of a sample must hold"):
        on_slab(sample(surface_ids=ids))
