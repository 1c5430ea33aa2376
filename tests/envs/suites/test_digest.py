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


@pytest.mark.parametrize("level", [0.0, 0.0005, 0.0012])
def test_the_last_bits_of_heights_do_not_matter(make_scene, level):
    """Heights of 0 and 0.5 mm lie on a step of one of the digests, but not of the other."""
    scene = make_scene(lambda x, y: level + 0 * x)
    first = scene_digests(scene)
    rng = np.random.default_rng(0)
    noise = rng.uniform(-1e-7, 1e-7, scene.terrain.fine.heights.shape)
    assert any(a == b for a, b in zip(first, scene_digests(lifted(scene, noise))))


def test_the_light_does_not_matter(scene):
    assert scene_digests(scene.with_sun(10, 0)) == scene_digests(scene)
