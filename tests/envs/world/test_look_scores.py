from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from envs.world.eyes import EyesConfig
from envs.world.look_scores import GroundAsSky, RockErrors, is_blind, look_abs_rel, look_ground_as_sky, look_rock_errors
from m3depth.stereo.prediction import Prediction


class Nothing:
    """An estimator that measures nothing."""

    def infer(self, left, right, rig):
        unknown = np.full(left.shape[:2], np.nan, np.float32)
        return Prediction(unknown, unknown, None, np.zeros_like(unknown))


@pytest.fixture
def sight(on_course, make_scene, make_course):
    """A look at a rock of 0.8 m, 0.5 m high, 4 m ahead, and at one beyond 8 m."""
    scene = make_scene(rocks=[(1.0, 0.0, 0.8, 0.5), (6.5, 0.0, 1.5, 0.9)])
    env = on_course(make_course(scene), perception=Nothing(), align_rows=False, eyes=EyesConfig(128))
    return env.sight


def test_the_truth_misses_no_rock_and_shows_no_other(sight):
    truth = replace(sight, depth=sight.true_depth.copy())
    assert look_rock_errors(truth) == RockErrors(1, 0, 0) and look_abs_rel(truth) == 0 and not is_blind(truth)


def test_a_rock_that_only_the_left_eye_sees_counts_as_any_other(sight):
    hidden = replace(sight, occluded=np.ones_like(sight.occluded))
    assert look_rock_errors(replace(hidden, depth=sight.true_depth.copy())) == RockErrors(1, 0, 0)
    assert look_rock_errors(hidden) == RockErrors(1, 1, 0)


def test_ground_of_more_than_192_px_of_disparity_is_not_scored(sight):
    wide = replace(sight.rig, baseline=0.8 * 192 / sight.rig.camera.fx)  # 192 px at 0.8 m
    true, depth = sight.true_depth.copy(), 1.1 * sight.true_depth
    true[100:], depth[100:] = 0.6, 6.0
    assert look_abs_rel(replace(sight, rig=wide, true_depth=true, depth=depth)) == pytest.approx(0.1)


def test_unknown_depth_misses_the_rock_within_8_m(sight):
    assert look_rock_errors(sight) == RockErrors(1, 1, 0)
    assert look_abs_rel(sight) > 4 and is_blind(sight)  # unknown counts as 80 m


def test_ground_that_is_measured_too_near_is_a_false_obstacle(sight):
    depth = sight.true_depth.copy()
    depth[90:110, 10:30] *= 0.6
    assert look_rock_errors(replace(sight, depth=depth)) == RockErrors(1, 0, 1)


def test_near_ground_that_is_taken_for_sky_is_counted(sight):
    near = sight.true_depth < 8
    assert look_ground_as_sky(sight) == GroundAsSky(near.sum(), 0)  # unknown is no sky
    some = near.copy()
    some[::2] = False
    depth = np.where(some | (sight.true_depth > 10), np.float32(np.inf), sight.true_depth)
    assert look_ground_as_sky(replace(sight, depth=depth)) == GroundAsSky(near.sum(), some.sum())


def test_true_depth_itself_has_no_errors(on_course, make_scene, make_course):
    env = on_course(make_course(make_scene()), eyes=EyesConfig(64, 64))
    assert look_rock_errors(env.sight) is None and look_abs_rel(env.sight) is None
    assert look_ground_as_sky(env.sight) is None


def test_a_look_without_ground_has_no_rocks(sight):
    sky = np.full_like(sight.true_depth, np.inf)
    up = replace(sight, depth=sky, true_depth=sky.copy(), true_surface=np.full(sky.shape, -1))
    assert look_rock_errors(up) == RockErrors(0, 0, 0) and look_abs_rel(up) is None and not is_blind(up)


def test_an_eye_that_knows_some_of_the_ground_is_not_blind():
    truth = np.full((4, 4), 3.0)
    some = truth.copy()
    some[1:] = np.nan
    assert not is_blind(SimpleNamespace(true_depth=truth, depth=some))
    assert is_blind(SimpleNamespace(true_depth=truth, depth=np.full((4, 4), np.nan)))
