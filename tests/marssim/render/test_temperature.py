from dataclasses import replace

import numpy as np
import pytest

from marssim.base.camera import NATECAM
from marssim.render.sensor import Sensor, SensorConfig
from marssim.render.temperature import at_temperature

IDEAL = SensorConfig(vertical_offset=(0, 0), rotation_deg=(0, 0), gain_difference=(0, 0))


def draw(kelvin, rig=NATECAM):
    return Sensor.draw(at_temperature(IDEAL, kelvin, rig), np.random.default_rng(0))


def test_fifty_kelvin_turn_the_right_camera_and_change_its_gain():
    warm = draw(50.0)
    assert warm.vertical_offset == pytest.approx(0.7, rel=1e-3)
    assert warm.horizontal_offset == pytest.approx(0.5, rel=1e-3)
    assert warm.gain_difference == pytest.approx(0.10)
    x, y, z = warm.right_rotation(NATECAM.camera).T @ [0, 0, 1]  # where the middle of the image moves to
    assert (NATECAM.camera.fx * x / z, NATECAM.camera.fy * y / z) == pytest.approx((0.5, 0.7), rel=1e-2)


def test_a_colder_rig_bends_the_other_way_and_a_smaller_image_by_fewer_pixels():
    cold, small = draw(-50.0), draw(50.0, NATECAM.resized(256, 256))
    assert (cold.vertical_offset, cold.horizontal_offset) == pytest.approx((-0.7, -0.5), rel=1e-3)
    assert (small.vertical_offset, small.horizontal_offset) == pytest.approx((0.35, 0.25), rel=1e-3)


def test_the_temperature_of_calibration_changes_nothing():
    assert at_temperature(SensorConfig(), 0.0, NATECAM) == SensorConfig()


def test_a_temperature_beyond_the_limits_is_refused():
    with pytest.raises(ValueError, match=r"temperature must lie in \[-100, 100\] K, got 101"):
        at_temperature(SensorConfig(), 101, NATECAM)


def test_a_temperature_beside_faults_that_some_pairs_lack_is_refused():
    with pytest.raises(ValueError, match=r"fault_chance must be 1 with it, got \(0.3, 0.5\)$"):
        at_temperature(SensorConfig(fault_chance=(0.3, 0.5)), 50, NATECAM)


def test_a_rig_of_many_pixels_names_the_temperature_that_moves_its_image_too_far():
    with pytest.raises(ValueError, match=r"a temperature of 100 K moves the right image by 11.* rows and .*10, got"):
        at_temperature(SensorConfig(), 100.0, NATECAM.resized(4096, 4096))


def test_offsets_follow_the_focal_length_of_their_own_axis():
    camera = replace(NATECAM.camera, fx=2 * NATECAM.camera.fx)
    warm = draw(50.0, replace(NATECAM, camera=camera))
    assert (warm.vertical_offset, warm.horizontal_offset) == pytest.approx((0.7, 1.0), rel=1e-3)


def test_a_warm_rig_keeps_the_spread_of_its_detectors():
    warm = at_temperature(SensorConfig(), 50.0, NATECAM)
    for name, change in (("vertical_offset", 0.7), ("horizontal_offset", 0.5), ("gain_difference", 0.10)):
        assert np.subtract(getattr(warm, name), getattr(SensorConfig(), name)) == pytest.approx(change, rel=1e-3)
