import numpy as np
import pytest

from marssim.render.detector.dust import through_dust, transmission


@pytest.mark.parametrize("loss", [0.05, 0.2, 0.5])
def test_dust_takes_away_its_share_of_the_light(loss):
    passed = [1 - transmission(loss, seed, eye, (96, 128)).mean() for seed in range(30) for eye in (0, 1)]
    assert np.mean(passed) == pytest.approx(loss, rel=0.2)


def test_each_eye_has_its_own_specks_and_the_seed_fixes_them():
    left, right = (transmission(0.3, 4, eye, (90, 120)) for eye in (0, 1))
    transmission.cache_clear()
    assert np.array_equal(left, transmission(0.3, 4, 0, (90, 120)))
    assert abs(np.corrcoef(left.ravel(), right.ravel())[0, 1]) < 0.6
    assert not np.array_equal(left, transmission(0.3, 5, 0, (90, 120)))


def test_dust_is_soft_and_the_same_at_every_resolution():
    coarse, fine = transmission(0.3, 4, 0, (120, 160)), transmission(0.3, 4, 0, (480, 640))
    assert np.abs(fine.reshape(120, 4, 160, 4).mean(axis=(1, 3)) - coarse).max() < 0.03
    assert np.abs(np.diff(fine, axis=1)).max() < 0.05


def test_dust_adds_light_where_it_takes_some_away():
    light, passed = 0.4, transmission(0.4, 1, 0, (60, 80))[..., None]
    behind = through_dust(np.full((60, 80, 3), light, np.float32), 0.4, 1, 0)
    added = (behind - passed * light) / ((1 - passed) * light)  # as a share of what is taken away
    assert 1 - passed.max() > 0.05 and np.ptp(passed) > 0.05
    np.testing.assert_allclose(added, added[0, 0, 0], rtol=1e-3)
    assert 0.3 <= added[0, 0, 0] <= 1.1


def test_dust_keeps_a_uniform_scene_within_its_scattered_light_and_lowers_contrast():
    level = np.full((60, 80, 3), 0.4, np.float32)
    assert np.abs(through_dust(level, 0.4, 1, 0) / 0.4 - 1).max() < 0.75
    texture = (level * np.random.default_rng(0).uniform(0.5, 1.5, (60, 80, 1))).astype(np.float32)
    local = [np.diff(image, axis=1).std() / image.mean() for image in (texture, through_dust(texture, 0.4, 1, 0))]
    assert local[1] < 0.9 * local[0]


def test_scattered_light_has_the_mean_colour_of_the_scene():
    colour = np.array([0.6, 0.4, 0.2], np.float32)
    behind = through_dust(np.tile(colour, (60, 80, 1)), 0.4, 1, 0) / colour
    np.testing.assert_allclose(behind[..., 0], behind[..., 2], rtol=1e-4)
    assert np.ptp(behind) > 0.02
