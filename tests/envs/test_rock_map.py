"""What the navigator's map makes of rocks of known size, when the depth that goes into it is wrong in known ways."""

from dataclasses import replace

import numpy as np
import pytest
from rock_samples import RIG, ahead, rock_sample, without_rocks
from rock_world import RockWorld

from envs.rock_map import MapRockCounts, count_rocks, frame_map, true_rocks
from m3depth.evaluation.rock_scene import rock_scene

DOMES = ((3.0, -0.5, 0.35, 0.3), (9.0, 0.5, 0.5, 0.45))
SAMPLE = rock_sample(RockWorld(domes=np.array([(*ahead(d, aside), r, h) for d, aside, r, h in DOMES])))
ALL = np.ones(SAMPLE.depth.shape, np.float32)


def counts_of(depth, confidence=ALL, sample=SAMPLE, step=0.15) -> MapRockCounts:
    turn = np.array(sample.meta["pose"])[:3, :3]
    scene = rock_scene(sample)
    place = true_rocks(scene, frame_map(sample.depth, None, RIG, turn), sample.rock > 0, RIG.fb)
    counts = MapRockCounts()
    count_rocks(counts, frame_map(np.asarray(depth, np.float32), confidence, RIG, turn), scene, place, step)
    return counts


def shifted(pixels: float) -> np.ndarray:
    """The far rock, its disparity too large by so many pixels."""
    return np.where(SAMPLE.rock == 2, RIG.fb / (RIG.fb / SAMPLE.depth + pixels), SAMPLE.depth)


def test_the_map_of_true_depth_shows_every_rock_at_its_height():
    counts = counts_of(SAMPLE.depth)
    assert [rock.found for rock in counts.rocks] == [True, True]
    assert max(abs(rock.error) for rock in counts.rocks) < 0.05
    assert counts.false == [] and counts.displaced == []


@pytest.mark.parametrize("pixels", [0.6, 0.9])
def test_a_rock_within_the_range_error_is_displaced(pixels):
    counts = counts_of(shifted(pixels))
    assert counts.false == [] and len(counts.displaced) >= 1
    height, away = counts.displaced[0]
    assert height > 0.3 and 7.0 < away < 8.6


def test_a_rock_farther_off_than_the_range_error_is_false():
    counts = counts_of(shifted(3.0))
    assert counts.displaced == [] and len(counts.false) >= 1
    assert not counts.rocks[1].found and counts.rocks[0].found


def test_what_is_twice_as_high_as_all_about_it_is_not_displaced():
    """A rock of 0.12 m does not excuse a block of 0.5 m half a metre before it."""
    low = rock_sample(RockWorld(domes=np.array([[*ahead(8.0, 0.0), 0.3, 0.12]])))
    block = rock_sample(RockWorld(domes=np.array([[*ahead(7.2, 0.0), 0.2, 0.5]])))
    counts = counts_of(np.minimum(low.depth, block.depth), sample=low)
    assert len(counts.false) == 1 and counts.displaced == []


def test_a_pebble_explains_no_false_obstacle():
    low = rock_sample(RockWorld(domes=np.array([[*ahead(5.0, 0.3), 0.1, 0.06]])))
    block = rock_sample(RockWorld(domes=np.array([[*ahead(5.0, 0.0), 0.15, 0.4]])))
    counts = counts_of(np.minimum(low.depth, block.depth), sample=low)
    assert len(counts.false) == 1 and counts.displaced == []


def test_a_missed_rock_is_ground_or_left_unknown():
    melted = counts_of(without_rocks(SAMPLE))
    assert [rock.found for rock in melted.rocks] == [False, False] and melted.unknown == []
    unsure = counts_of(SAMPLE.depth, np.where(SAMPLE.rock == 1, 0.2, 1.0).astype(np.float32))
    first = unsure.rocks[0]
    assert not first.found and (first.height, first.distance) in unsure.unknown
    near = unsure.result()["standing_0.2_m_within_8_m"]
    assert (near["rocks"], near["found"], near["unknown"]) == (1, 0, 1)


def test_rocks_that_one_eye_sees_are_counted_apart():
    hidden = replace(SAMPLE, occluded=SAMPLE.rock == 1)
    counts = counts_of(without_rocks(hidden), sample=hidden)
    assert [rock.both_eyes for rock in counts.rocks] == [False, True]
    near = counts.result()["standing_0.2_m_within_8_m"]
    assert (near["rocks"], near["both_eyes"], near["both_eyes_share"]) == (1, 0, None)


def test_edges_of_slabs_are_counted_in_the_map_as_rocks_are():
    boxes = [(*ahead(4.0, 0.0), 0.3, 0.3, 0.22), (*ahead(5.0, 0.8), 0.3, 0.3, 0.3)]
    sample = rock_sample(RockWorld(boxes=np.array(boxes)))
    sample.meta["surface_ids"] = {"rocks": [], "slabs": [1, 1], "ledges": [2, 2], "fragments": []}
    assert [edge.found for edge in counts_of(sample.depth, sample=sample).edges] == [True, True]
    counts = counts_of(without_rocks(sample, keep=(1,)), sample=sample)
    assert [rock.found for rock in counts.rocks] == [True, False]
    assert sorted((edge.distance < 4.5, edge.found) for edge in counts.edges) == [(False, False), (True, True)]
    assert counts.result()["slab_edges"]["standing_0.2_m_within_8_m"]["rocks"] == 2
