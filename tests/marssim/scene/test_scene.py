import pickle
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest

from marssim.base.dataset.encoding import FARTHEST
from marssim.scene.rocks.population import CAMERA_EXTENT, RockConfig
from marssim.scene.scene import SCENE_LIMITS, SceneConfig, build_scene

SMALL = SceneConfig(size=8.0, horizon=16.0, rocks=RockConfig(k=0.1))


def small(seed: int, **changes):
    return build_scene(replace(SMALL, **changes), np.random.default_rng(seed))


def assert_equal(a: object, b: object) -> None:
    if is_dataclass(a):
        for field in fields(a):
            assert_equal(getattr(a, field.name), getattr(b, field.name))
    else:
        assert np.array_equal(a, b)


def test_the_same_seed_gives_the_same_scene():
    scene = small(4)
    assert_equal(scene, small(4))
    other = small(5)
    assert not np.array_equal(scene.terrain.fine.heights, other.terrain.fine.heights)
    assert not np.array_equal(scene.look.sun, other.look.sun)


def test_rocks_do_not_change_the_ground_nor_the_light():
    few, many = small(4, rocks=RockConfig(k=0.02)), small(4, rocks=RockConfig(k=0.2))
    assert len(few.rocks) < len(many.rocks)
    assert_equal(few.terrain, many.terrain)
    assert_equal(few.look, many.look)


def test_a_scene_is_plain_data_that_travels_between_processes():
    scene = small(4)
    assert_equal(pickle.loads(pickle.dumps(scene)), scene)


def test_rocks_stand_on_the_ground_within_the_scene():
    scene = small(1)
    rocks = scene.rocks
    assert len(rocks) > 100 and scene.half == pytest.approx(4.0)
    assert np.abs(rocks.centre[:, :2]).max() <= SMALL.horizon
    ground = scene.terrain.height_at(rocks.centre[:, 0], rocks.centre[:, 1])
    top = np.full(len(rocks), -np.inf)
    np.maximum.at(top, rocks.face_rock, rocks.vertices[rocks.faces].max(axis=1)[:, 2])
    # heights count from the plane under the rock, which its middle lies near
    assert np.abs(top - ground - rocks.height).max() < 0.1 and np.median(np.abs(top - ground - rocks.height)) < 0.01


@pytest.mark.parametrize("radius", [1.0, 2.5])
def test_discs_stay_clear_of_rocks(radius):
    discs = ((0.0, 0.0, radius), (-2.5, 1.0, 1.0))
    scene = build_scene(SMALL, np.random.default_rng(2), discs)
    large = scene.rocks.diameter >= 0.1
    for x, y, r in discs:
        gap = np.hypot(scene.rocks.centre[:, 0] - x, scene.rocks.centre[:, 1] - y) - scene.rocks.diameter / 2
        assert (gap[large] > r).all()
    assert large.sum() > 10


def test_sizes_that_make_no_scene_are_refused():
    with pytest.raises(ValueError, match="size"):
        small(0, size=40.0)
    for name in ("size", "cell", "horizon"):
        for value in (0.0, -1.0, float("inf"), float("nan")):
            with pytest.raises(ValueError, match=f"^{name} must lie in"):
                replace(SMALL, **{name: value})
    with pytest.raises(ValueError, match=r"^size must be at most"):
        replace(SMALL, size=100.0, cell=0.01, horizon=100.0)


def test_the_farthest_corner_fits_the_code_of_depth():
    most = SCENE_LIMITS["horizon"][1]
    camera = CAMERA_EXTENT * most  # a fine square as large as all
    assert np.hypot(most + camera, most + camera) < FARTHEST
