import pytest

from envs.world.eyes import EyesConfig
from marssim.base.camera import NATECAM
from marssim.render.sensor import SensorConfig


def test_sound_eyes_are_those_of_before():
    assert EyesConfig().rig is NATECAM and EyesConfig().sensor() == SensorConfig()
    assert EyesConfig().ground_truth_rig.camera.width == 128
    assert EyesConfig(image_pixels=256, ground_truth_pixels=0).ground_truth_rig.camera.width == 256


def test_fewer_pixels_show_the_same_view():
    rig = EyesConfig(image_pixels=256).rig
    assert (rig.camera.width, rig.camera.height) == (256, 256)
    assert rig.camera.fx == pytest.approx(NATECAM.camera.fx / 2) and rig.baseline == NATECAM.baseline


def test_faults_reach_the_detectors():
    sensor = EyesConfig(lens_dust=0.3, lens_glare=0.2, jpeg_quality=40.0, temperature=50.0).sensor()
    assert sensor.dust == (0.3, 0.3) and sensor.sun_glare == (0.2, 0.2) and sensor.jpeg_quality == (40.0, 40.0)
    assert sensor.vertical_offset[0] == pytest.approx(-0.15 + 0.7, rel=1e-3)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("image_pixels", 63), ("image_pixels", 300), ("ground_truth_pixels", 96),
        ("image_pixels", 256.0), ("lens_dust", 0.9), ("lens_glare", 1.1), ("temperature", float("nan")),
        ("jpeg_quality", 0), ("look_every", -1.0), ("look_every", True), ("ground_truth_pixels", 4096),
        ("ground_truth_pixels", False),
    ],
)  # fmt: skip
def test_a_setting_out_of_range_is_named(name, value):
    with pytest.raises(ValueError, match=f"^{name} must"):
        EyesConfig(**{name: value})
