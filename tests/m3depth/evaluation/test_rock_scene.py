"""Rocks of known size on a plain: their measured heights and distances."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rock_samples import DOMES, ahead, rock_sample
from rock_samples import domes_on_a_plain as world
from rock_world import RockWorld

from m3depth.evaluation.rock_scene import CELL, REACH, _plane_around, rock_scene


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


def test_the_plane_around_a_place_is_that_of_the_ground_with_damped_slopes():
    """Least squares on a disc give the level in its middle, and slopes of var / (var + 0.1), var that of x over it."""
    slope, middle, radius = np.tan(np.radians([10.0, -4.0])), np.array([2.0, -3.0]), 2.03
    places = (np.arange(round(2 * REACH / CELL)) + 0.5) * CELL - REACH
    x, y = np.meshgrid(places, places)
    plane = _plane_around(0.7 + slope[0] * x + slope[1] * y, middle, radius)
    from_middle = x[np.hypot(x - middle[0], y - middle[1]) <= radius] - middle[0]
    var = (from_middle**2).mean()
    assert plane[:2] == pytest.approx(slope * var / (var + 0.1), rel=1e-9)
    assert plane[:2] == pytest.approx(slope, rel=0.1)
    assert plane @ [*middle, 1] == pytest.approx(0.7 + slope @ middle, abs=1e-9)


def test_a_rock_across_15_m_keeps_its_pixels_beyond():
    sample = rock_sample(RockWorld(boxes=np.array([[15.0, 0.0, 1.5, 1.0, 0.15]])), yaw=0.0)
    (rock,) = rock_scene(sample).rocks
    on_rock = np.flatnonzero(sample.rock)
    assert np.array_equal(rock.pixels, on_rock) and (sample.depth.ravel()[on_rock] > 15).any()


@pytest.mark.parametrize(("pixels", "both_eyes"), [(29, False), (30, True)])
def test_both_eyes_see_a_rock_of_which_the_right_one_sees_30_pixels(pixels, both_eyes):
    sample = rock_sample(world())
    sample.occluded.ravel()[np.flatnonzero(sample.rock == 1)[pixels:]] = True
    assert [rock.both_eyes for rock in rock_scene(sample).rocks] == [both_eyes, True, True, True]


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


def test_the_plane_is_that_of_ground_around_the_rock_not_at_its_foot():
    whole = rock_scene(rock_sample(world())).rocks
    sample = rock_sample(world())
    foot = cv2.dilate((sample.rock > 0).astype(np.uint8), np.ones((41, 41), np.uint8)) > 0
    sample.depth[foot & (sample.rock == 0)] = np.nan
    footless = rock_scene(sample).rocks
    assert [rock.height for rock in footless] == pytest.approx([rock.height for rock in whole], abs=0.02)
