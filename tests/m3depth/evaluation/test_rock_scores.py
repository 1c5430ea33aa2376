"""Rocks of known size on a plain: measured, found, missed, and seen where none are."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rock_samples import ahead, rock_sample, without_rocks
from rock_world import RockWorld

from m3depth.evaluation.rock_scores import RockTally, false_obstacles, predicted_tops, rock_scene
from m3depth.stereo.prediction import Prediction

DOMES = ((3.0, -0.5, 0.3, 0.25), (5.0, 0.6, 0.5, 0.4), (9.0, -1.5, 0.6, 0.55), (2.5, 0.5, 0.25, 0.12))


def world(slope=(0.0, 0.0)) -> RockWorld:
    domes = [(*ahead(distance, aside), radius, height) for distance, aside, radius, height in DOMES]
    return RockWorld(domes=np.array(domes), slope=slope)


def prediction(sample, depth=None) -> Prediction:
    depth = sample.depth if depth is None else depth.astype(np.float32)
    return Prediction(depth, sample.rig.depth_to_disparity(depth), None, np.ones(depth.shape, np.float32))


def tally(sample, depth=None) -> RockTally:
    out = RockTally()
    out.add(prediction(sample, depth), rock_scene(sample))
    return out


def test_heights_and_distances_are_those_of_the_world():
    sample = rock_sample(world())
    rocks = rock_scene(sample).rocks
    assert len(rocks) == len(DOMES)
    for rock, (distance, aside, radius, height) in zip(rocks, DOMES, strict=True):
        assert rock.height == pytest.approx(height, abs=0.015)
        assert 0.8 * rock.height < rock.top <= rock.height
        middle = np.hypot(distance, aside)
        assert middle - radius - 0.05 < rock.away < middle + 0.05  # only its front is seen


@given(st.floats(-0.15, 0.15), st.floats(-0.15, 0.15))
@settings(max_examples=10)
def test_heights_stand_on_the_slope_that_the_ground_has(along, across):
    """A box on a slope, given by hand: its top is level, so its height is that of its highest place above the plane."""
    x, y = ahead(4.0, 0.0)
    box = np.array([[x, y, 0.2, 0.2, 0.0]])
    base = along * x + across * y
    box[0, 4] = base + 0.35
    sample = rock_sample(RockWorld(boxes=box, slope=(along, across)))
    rock = rock_scene(sample).rocks[0]
    most = 0.35 + 0.2 * (abs(along) + abs(across))
    assert 0.33 < rock.height <= most + 0.02


def test_true_depth_finds_every_rock_at_its_height_and_nothing_else():
    found = tally(rock_sample(world()))
    assert len(found.rocks) == len(DOMES) and all(rock[2] for rock in found.rocks)
    assert max(abs(rock[3]) for rock in found.rocks) < 1e-6
    assert found.false == []
    result = found.result()
    assert sum(b["rocks"] for b in result["bins"]) == len(DOMES)
    near = result["standing_0.2_m_within_8_m"]
    assert (near["rocks"], near["found"], near["found_share"], near["false"]) == (2, 2, 1.0, 0)


def test_melted_rocks_are_missed_and_the_others_are_not():
    sample = rock_sample(world())
    found = tally(sample, without_rocks(sample, keep=(2,)))
    assert [rock[2] for rock in found.rocks] == [False, True, False, False]
    assert found.false == []


def test_a_rock_at_the_wrong_depth_is_not_found():
    """A third too far, its top is higher above the ground than it should be, and yet it is no rock at its place."""
    sample = rock_sample(world())
    tops = predicted_tops(rock_scene(sample), sample.depth * np.float32(1.35))
    assert (tops < 0.05).all()


@pytest.mark.parametrize("unknown", [np.nan, np.inf, 0.0, -2.0])
def test_unknown_depth_shows_no_rock(unknown):
    sample = rock_sample(world())
    found = tally(sample, np.full_like(sample.depth, unknown))
    assert not any(rock[2] for rock in found.rocks) and found.false == []


def test_a_block_on_bare_ground_is_a_false_obstacle_of_its_height():
    """The depth of a world with one more rock, which the truth does not have."""
    sample = rock_sample(world())
    x, y = ahead(6.0, -1.6)
    more = RockWorld(domes=np.vstack([world().domes, [x, y, 0.3, 0.45]]))
    [(height, away)] = false_obstacles(rock_scene(sample), rock_sample(more).depth)
    assert height == pytest.approx(0.43, abs=0.05)
    assert away == pytest.approx(np.hypot(6.0, 1.6) - 0.2, abs=0.2)
    low = RockWorld(domes=np.vstack([world().domes, [x, y, 0.3, 0.15]]))
    assert false_obstacles(rock_scene(sample), rock_sample(low).depth) == []


def test_near_sky_is_a_false_obstacle_and_far_sky_is_not():
    sample = rock_sample(world())
    scene, sky = rock_scene(sample), np.isinf(sample.depth)
    assert sky.any()
    [(height, away)] = false_obstacles(scene, np.where(sky, np.float32(6), sample.depth))
    assert height > 1.2 and away == pytest.approx(6, abs=0.6)
    assert false_obstacles(scene, np.where(sky, np.float32(40), sample.depth)) == []


def test_specks_and_outlines_are_no_obstacles():
    sample = rock_sample(world())
    depth = sample.depth.copy()
    depth[150, 128] *= 0.6  # one pixel
    beside = np.roll(sample.rock == 2, 3, axis=1) & (sample.rock == 0)
    depth[beside] = np.median(sample.depth[sample.rock == 2])  # the rock, smeared
    assert false_obstacles(rock_scene(sample), depth) == []


def test_ground_that_is_all_too_near_is_told():
    """A tenth too near lifts the ground by 0.12 m, a third by 0.4 m."""
    sample = rock_sample(RockWorld())
    scene = rock_scene(sample)
    assert false_obstacles(scene, sample.depth * np.float32(0.9)) == []
    assert false_obstacles(scene, sample.depth * np.float32(0.67))


def test_without_a_pose_there_are_no_heights():
    sample = rock_sample(world())
    sample.meta.clear()
    assert rock_scene(sample) is None
    assert RockTally().result() == {}
