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
