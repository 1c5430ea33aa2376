"""Rocks of known size on a plain: their measured heights and distances."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rock_samples import DOMES, ahead, rock_sample
from rock_samples import domes_on_a_plain as world
from rock_world import RockWorld

from m3depth.evaluation.rock_scene import rock_scene


def test_heights_and_distances_are_those_of_the_domes():
    sample = rock_sample(world())
    rocks = rock_scene(sample).rocks
    assert len(rocks) == len(DOMES)
    for rock, (distance, aside, radius, height) in zip(rocks, DOMES, strict=True):
        assert rock.height == pytest.approx(height, abs=0.015)
        assert 0.8 * rock.height < rock.top <= rock.height
        middle = np.hypot(distance, aside)
        assert middle - radius - 0.05 < rock.distance < middle + 0.05  # only its front is seen


@given(st.floats(-0.15, 0.15), st.floats(-0.15, 0.15))
@settings(max_examples=10)
def test_heights_are_measured_from_sloping_ground(along, across):
    """A box on a slope, given by hand: its top is level, so its height is that of its highest place above the plane."""
    x, y = ahead(4.0, 0.0)
    box = np.array([[x, y, 0.2, 0.2, 0.0]])
    base = along * x + across * y
    box[0, 4] = base + 0.35
    sample = rock_sample(RockWorld(boxes=box, slope=(along, across)))
    rock = rock_scene(sample).rocks[0]
    most = 0.35 + 0.2 * (abs(along) + abs(across))
    assert 0.33 < rock.height <= most + 0.02


def test_without_a_pose_there_are_no_heights():
    sample = rock_sample(world())
    sample.meta.clear()
    assert rock_scene(sample) is None


def slabs_sample():
    """Two slabs side by side, one of them low, a low slab alone, and a rock of the first slab's height."""
    boxes = [
        (*ahead(4.0, 0.0), 0.3, 0.3, 0.15), (*ahead(4.0, 0.7), 0.3, 0.3, 0.06), (*ahead(4.0, -1.2), 0.3, 0.3, 0.05),
        (*ahead(6.0, 0.6), 0.2, 0.2, 0.25),
    ]  # fmt: skip
    sample = rock_sample(RockWorld(boxes=np.array(boxes)))
    sample.meta["surface_ids"] = {"rocks": [], "slabs": [1, 3], "ledges": [], "fragments": [4, 4]}
    return sample


def test_edges_of_slabs_are_what_stands_out_of_a_pavement():
    scene = rock_scene(slabs_sample())
    assert [rock.height for rock in scene.rocks] == pytest.approx([0.15, 0.25], abs=0.01)
    (edge,) = scene.slab_edges
    assert edge.height == pytest.approx(0.15, abs=0.01) and 3.5 < edge.distance < 4.3
    assert set(slabs_sample().rock.ravel()[edge.pixels]) == {1}
    assert len(edge.pixels) < len(scene.rocks[0].pixels)  # its front stands less than 0.1 m above the ground


def test_the_edge_of_slabs_that_touch_is_one():
    boxes = [(*ahead(4.0, aside, yaw=0.0), 0.3, 0.25, 0.16) for aside in (-0.25, 0.25)]
    sample = rock_sample(RockWorld(boxes=np.array(boxes)), yaw=0.0)
    sample.meta["surface_ids"] = {"rocks": [], "slabs": [1, 1], "ledges": [2, 2], "fragments": []}
    scene = rock_scene(sample)
    assert len(scene.rocks) == 2 and len(scene.slab_edges) == 1
    assert set(sample.rock.ravel()[scene.slab_edges[0].pixels]) == {1, 2}


def test_rocks_have_no_edges_of_slabs():
    assert rock_scene(rock_sample(world())).slab_edges == []
