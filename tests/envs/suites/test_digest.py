from dataclasses import replace

import numpy as np
import pytest

from envs.suites.digest import scene_digests


@pytest.fixture(scope="module")
def scene(make_scene):
    return make_scene(lambda x, y: 0.0113 * x, rocks=[(1.0, 2.0, 0.6, 0.3), (3.0, 0.0, 0.2, 0.1)])


def lifted(scene, by):
    fine = scene.terrain.fine
    return replace(scene, terrain=replace(scene.terrain, fine=replace(fine, heights=fine.heights + by)))


def test_a_changed_height_or_rock_changes_both_digests(scene):
    first = scene_digests(scene)
    assert first == scene_digests(scene) and first[0] != first[1]
    bump = np.zeros_like(scene.terrain.fine.heights)
    bump[np.ix_(*[range(38, 43)] * 2)] = 0.01
    for other in (
        lifted(scene, bump),
        replace(scene, rocks=replace(scene.rocks, diameter=scene.rocks.diameter + 0.01)),
    ):
        assert not set(scene_digests(other)) & set(first)


def changed_by(make_scene, heights, noise, share=1.0):
    """Whether noise [m] on a share of the heights changes both digests of a scene of these heights every metre."""
    scene = make_scene(lambda x, y: heights, cell=1.0, half=(len(heights) - 1) / 2)
    rng = np.random.default_rng(1)
    drawn = rng.uniform(-noise, noise, heights.shape) * (rng.random(heights.shape) < share)
    return not any(a == b for a, b in zip(scene_digests(scene), scene_digests(lifted(scene, drawn))))


@pytest.mark.parametrize("level", [0.0, 0.0005, 0.0012])
def test_numbers_at_the_steps_of_one_digest_do_not_matter(make_scene, level):
    """Heights of 0 and 0.5 mm lie on a step of one of the digests, but not of the other."""
    assert not changed_by(make_scene, np.full((21, 21), level), 1e-7)


def test_the_last_bits_of_any_heights_do_not_matter_and_more_may(make_scene):
    """20,000 random heights, as many as a scene of a suite has numbers: what the two digests forgive, and what not."""
    scenes = [np.random.default_rng(n).uniform(-1, 1, (141, 141)) for n in range(12)]
    assert not any(changed_by(make_scene, heights, 1e-12) for heights in scenes)
    assert 0 < sum(changed_by(make_scene, heights, 1e-7) for heights in scenes) < len(scenes)
    assert all(changed_by(make_scene, heights, 1e-5) for heights in scenes)
    assert not any(changed_by(make_scene, heights, 1e-6, share=1e-3) for heights in scenes)


def test_the_light_does_not_matter(scene):
    assert scene_digests(scene.with_sun(10, 0)) == scene_digests(scene)
