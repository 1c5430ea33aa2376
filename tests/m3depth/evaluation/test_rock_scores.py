"""Rocks of known size on a plain: found, missed, and predicted where none are."""

import numpy as np
import pytest
from rock_samples import DOMES, RIG, ahead, rock_sample, without_rocks
from rock_samples import domes_on_a_plain as world
from rock_world import RockWorld

from m3depth.evaluation.rock_scene import rock_scene
from m3depth.evaluation.rock_scores import RockCounts, RockOutcome, false_obstacles, outcome_figures, predicted_tops
from m3depth.stereo.prediction import Prediction


def prediction(sample, depth=None) -> Prediction:
    depth = sample.depth if depth is None else depth.astype(np.float32)
    return Prediction(depth, sample.rig.depth_to_disparity(depth), None, np.ones(depth.shape, np.float32))


def counted(sample, depth=None) -> RockCounts:
    out = RockCounts()
    out.add(prediction(sample, depth), rock_scene(sample))
    return out


def test_true_depth_finds_every_rock_at_its_height_and_nothing_else():
    counts = counted(rock_sample(world()))
    assert len(counts.rocks) == len(DOMES) and all(rock[2] for rock in counts.rocks)
    assert max(abs(rock[3]) for rock in counts.rocks) < 1e-6
    assert counts.false == []
    result = counts.result()
    assert sum(b["rocks"] for b in result["bins"]) == len(DOMES)
    near = result["standing_0.2_m_within_8_m"]
    assert (near["rocks"], near["found"], near["found_share"], near["false"]) == (2, 2, 1.0, 0)


def test_melted_rocks_are_missed_and_the_others_are_not():
    sample = rock_sample(world())
    counts = counted(sample, without_rocks(sample, keep=(2,)))
    assert [rock[2] for rock in counts.rocks] == [False, True, False, False]
    assert counts.false == []


def test_rocks_that_are_predicted_too_low_have_a_negative_bias():
    lower = RockWorld(domes=world().domes * [1, 1, 1, 0.8])
    near = counted(rock_sample(world()), rock_sample(lower).depth).result()["standing_0.2_m_within_8_m"]
    assert near["found"] == 2 and near["height_bias_m"] == -near["height_error_m"] < 0


def test_a_rock_at_the_wrong_depth_is_not_found():
    """A third too far, its top is even higher above the ground, but no rock is at its place."""
    sample = rock_sample(world())
    tops = predicted_tops(scene := rock_scene(sample), scene.rocks, sample.depth * np.float32(1.35))
    assert (tops < 0.05).all()


@pytest.mark.parametrize(("factor", "kept"), [(1.24, True), (1.26, False), (0.76, True), (0.74, False)])
def test_depth_off_by_more_than_a_quarter_of_the_true_one_is_of_another_surface(factor, kept):
    """Tops without any pixel of the rock are 0 to the last bit."""
    sample = rock_sample(world())
    tops = predicted_tops(scene := rock_scene(sample), scene.rocks, sample.depth * np.float32(factor))
    assert ((tops != 0) == kept).all()


@pytest.mark.parametrize(("share", "found"), [(0.51, True), (0.49, False)])
def test_a_rock_is_found_if_its_top_stands_half_as_high_as_the_true_top(share, found):
    """Every pixel of the rock is moved along its ray to that share of its height above the ground."""
    sample = rock_sample(RockWorld(domes=np.array([[*ahead(3.0, -0.5), 0.3, 0.25]])))
    scene = rock_scene(sample)
    (rock,) = scene.rocks
    assert 0.51 * rock.top < 0.5 * rock.height
    flat, rays = sample.depth.ravel().astype(float), scene.rays.reshape(-1, 3)[rock.pixels]
    slope, level = rock.plane[:2], rock.plane[2]
    rise = rays[:, 2] - rays[:, :2] @ slope
    flat[rock.pixels] = (share * (flat[rock.pixels] * rise - level) + level) / rise
    (outcome,) = counted(sample, flat.reshape(sample.depth.shape)).rocks
    assert outcome.found == found and outcome.error == pytest.approx((share - 1) * rock.top, abs=1e-5)


def test_the_error_of_the_heights_is_the_median_of_its_size_over_the_rocks_found():
    outcomes = [RockOutcome(0.3, 4.0, True, error) for error in (0.01, -0.02, 0.5)]
    figures = outcome_figures([*outcomes, RockOutcome(0.3, 4.0, False, -0.3)], 0.2, np.inf, 0.0, 8.0)
    assert (figures["height_error_m"], figures["height_bias_m"]) == (0.02, 0.01)


@pytest.mark.parametrize("unknown", [np.nan, np.inf, 0.0, -2.0])
def test_unknown_depth_shows_no_rock(unknown):
    sample = rock_sample(world())
    counts = counted(sample, np.full_like(sample.depth, unknown))
    assert not any(rock[2] for rock in counts.rocks) and counts.false == []


def test_a_block_on_bare_ground_is_a_false_obstacle_of_its_height():
    """The depth of a world with one more rock, which the truth does not have."""
    sample = rock_sample(world())
    x, y = ahead(6.0, -1.6)
    more = RockWorld(domes=np.vstack([world().domes, [x, y, 0.3, 0.45]]))
    [(height, distance)] = false_obstacles(rock_scene(sample), rock_sample(more).depth)
    assert height == pytest.approx(0.43, abs=0.05)
    assert distance == pytest.approx(np.hypot(6.0, 1.6) - 0.2, abs=0.2)
    low = RockWorld(domes=np.vstack([world().domes, [x, y, 0.3, 0.15]]))
    assert false_obstacles(rock_scene(sample), rock_sample(low).depth) == []


def test_near_sky_is_a_false_obstacle_and_far_sky_is_not():
    sample = rock_sample(world())
    scene, sky = rock_scene(sample), np.isinf(sample.depth)
    assert sky.any()
    [(height, distance)] = false_obstacles(scene, np.where(sky, np.float32(6), sample.depth))
    assert height > 1.2 and distance == pytest.approx(6, abs=0.6)
    assert false_obstacles(scene, np.where(sky, np.float32(40), sample.depth)) == []


def test_a_false_obstacle_beyond_15_m_of_ground_does_not_count():
    """A sky at 14.5 m along the optical axis, which looks down by 20 deg, hangs farther away than that."""
    sample = rock_sample(world())
    near_sky = np.where(np.isinf(sample.depth), np.float32(14.5), sample.depth)
    assert false_obstacles(rock_scene(sample), near_sky) == []


@pytest.mark.parametrize("sky_id", [0, -1])
def test_the_rover_in_view_is_no_obstacle_and_near_sky_above_it_is_one(sky_id):
    """A deck half a metre below the eye, in a sample (sky 0) and in a map of surface ids (sky -1)."""
    sample = rock_sample(world())
    deck, sky = np.s_[200:, 60:200], np.isinf(sample.depth)
    sample.rock[sky] = sky_id
    sample.rock[deck], sample.depth[deck] = -1 if sky_id == 0 else -2, 0.7
    scene = rock_scene(sample)
    assert (scene.heights((scene.rays[deck] * 0.7).reshape(-1, 3)) > 0.2).all()
    assert false_obstacles(scene, sample.depth) == []
    smeared = sample.depth.copy()
    smeared[197:, 57:203] = 0.7
    assert false_obstacles(scene, smeared) == []
    assert len(false_obstacles(scene, np.where(sky, np.float32(6), sample.depth))) == 1


def test_specks_and_outlines_are_no_obstacles():
    sample = rock_sample(world())
    depth = sample.depth.copy()
    depth[150, 128] *= 0.6  # one pixel
    beside = np.roll(sample.rock == 2, 3, axis=1) & (sample.rock == 0)
    depth[beside] = np.median(sample.depth[sample.rock == 2])  # the rock, smeared
    assert false_obstacles(rock_scene(sample), depth) == []


@pytest.mark.parametrize(("edge", "obstacles"), [(8, 0), (9, 1)])
def test_a_false_obstacle_fills_a_square_of_a_tenth_of_a_metre(edge, obstacles):
    """At this depth, which is in the sky, 0.1 m are 8.5 px."""
    sample = rock_sample(RockWorld())
    depth = sample.depth.copy()
    assert np.isinf(depth[:edge, 100 : 100 + edge]).all()
    depth[:edge, 100 : 100 + edge] = 0.1 * RIG.camera.fy / 8.5
    assert len(false_obstacles(rock_scene(sample), depth)) == obstacles


def test_ground_that_is_predicted_too_near_is_a_false_obstacle():
    """A tenth too near lifts the ground by 0.12 m, a third by 0.4 m."""
    sample = rock_sample(RockWorld())
    scene = rock_scene(sample)
    assert false_obstacles(scene, sample.depth * np.float32(0.9)) == []
    assert false_obstacles(scene, sample.depth * np.float32(0.67))


def test_without_images_there_are_no_figures():
    assert RockCounts().result() == {}


def test_edges_of_slabs_are_found_and_missed_beside_the_rocks():
    boxes = [(*ahead(4.0, 0.0), 0.3, 0.3, 0.15), (*ahead(6.0, 0.6), 0.3, 0.3, 0.25)]
    sample = rock_sample(RockWorld(boxes=np.array(boxes)))
    sample.meta["surface_ids"] = {"rocks": [], "slabs": [1, 1], "ledges": [2, 2], "fragments": []}
    counts = counted(sample, without_rocks(sample, keep=(2,)))
    assert [rock.found for rock in counts.rocks] == [False, True]
    assert sorted((edge.distance < 5, edge.found) for edge in counts.edges) == [(False, True), (True, False)]
    edges = counts.result()["slab_edges"]
    assert {(b["height_from_m"], b["range_from_m"]): b["found"] for b in edges["bins"] if b["rocks"]} == {
        (0.1, 0.0): 0, (0.2, 4.0): 1,
    }  # fmt: skip
    assert (edges["standing_0.2_m_within_8_m"]["rocks"], edges["standing_0.2_m_within_8_m"]["found"]) == (1, 1)


def test_merged_counts_are_those_of_all_images():
    sample = rock_sample(world())
    whole, one, other = counted(sample), counted(sample), counted(sample, without_rocks(sample))
    whole.add(prediction(sample, without_rocks(sample)), rock_scene(sample))
    one.merge(other)
    assert one == whole and one.images == 2
