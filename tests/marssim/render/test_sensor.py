from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.camera import NATECAM
from marssim.render.faults import RANDOM
from marssim.render.sensor import ALWAYS, FAULTS, OF_FAULTS, Sensor, SensorConfig

CLEAN = Sensor(exposure=0.5, psf=0.0, full_well=1e12, read_noise=0.0, vignetting=0.0, gain_difference=0.0)


def flat(value: float, side: int = 160) -> np.ndarray:
    return np.full((side, side, 3), value, np.float32)


def linear(image: np.ndarray) -> np.ndarray:
    return (image / 255.0) ** 2.2


@pytest.mark.parametrize("signal", [0.1, 0.5])
@pytest.mark.parametrize(("full_well", "read_noise"), [(4000, 0), (4000, 14), (16000, 4), (8000, 60)])
def test_noise_is_that_of_shot_and_read_noise(signal, full_well, read_noise):
    sensor = replace(CLEAN, full_well=full_well, read_noise=read_noise)
    image = sensor.expose(flat(signal), 1.0, np.random.default_rng(0)).astype(float)
    spread = np.sqrt(signal * full_well + read_noise**2) / full_well
    slope = 255 / 2.2 * signal ** (1 / 2.2 - 1)  # of the gamma curve, codes per full scale
    assert image.std() == pytest.approx(np.hypot(slope * spread, np.sqrt(1 / 12)), rel=0.03)
    assert image.mean() == pytest.approx(255 * signal ** (1 / 2.2), abs=0.6)
    assert abs(np.corrcoef(image[:, :-1].ravel(), image[:, 1:].ravel())[0, 1]) < 0.02  # white


def test_noise_is_the_generators():
    sensor = replace(CLEAN, full_well=4000)
    first, same, other = (sensor.expose(flat(0.3), 1.0, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(first, same) and not np.array_equal(first, other)


@given(exposure=st.floats(0.2, 0.7), brightness=st.floats(0.01, 100))
def test_exposure_brings_the_median_to_the_code_asked_for(exposure, brightness):
    rng = np.random.default_rng(0)
    radiance = (brightness * rng.uniform(0.7, 1.3, (40, 40, 1)) * np.ones(3)).astype(np.float32)
    sensor = replace(CLEAN, exposure=exposure)
    image = sensor.expose(radiance, sensor.gain(radiance, np.ones((40, 40), bool)), rng)
    assert np.median(image) == pytest.approx(255 * exposure, abs=1)


def test_highlights_of_the_ground_are_kept():
    radiance = flat(0.1, 50)
    radiance[:5] = 2.0  # a tenth of the ground, twenty times as bright
    sensor = replace(CLEAN, exposure=0.6)
    image = sensor.expose(radiance, sensor.gain(radiance, np.ones((50, 50), bool)), np.random.default_rng(0))
    assert 200 < image[0, 0, 0] < 255


def test_the_sky_is_metered_only_where_half_of_it_would_saturate():
    radiance, ground = flat(0.2, 50), np.zeros((50, 50), bool)
    ground[25:] = True
    brighter, glaring, halo = (radiance.copy() for _ in range(3))
    brighter[:25] *= 4
    glaring[:25] *= 20
    halo[:12] *= 20  # less than half of the sky
    assert CLEAN.gain(brighter, ground) == CLEAN.gain(halo, ground) == CLEAN.gain(radiance, ground)
    assert CLEAN.gain(glaring, ground) * 4.0 == pytest.approx(1)
    only = np.zeros_like(ground)
    only[-1, -1] = True
    assert CLEAN.gain(brighter * 7, only) < CLEAN.gain(radiance, only)


def test_no_channel_of_the_ground_nor_of_the_sky_saturates_by_half():
    """Mars is red: its red channel is a fourth brighter than the mean of all."""
    tint = np.array([1.5, 1.0, 0.5], np.float32)
    ground = np.zeros((50, 50), bool)
    ground[25:] = True
    sky = flat(0.1, 50) * tint
    sky[:25] *= 30
    assert CLEAN.gain(sky, ground) * sky[0, 0, 0] == pytest.approx(1)
    bright = flat(0.05, 50) * tint
    bright[45:] *= 40
    assert CLEAN.gain(bright, np.ones_like(ground)) * bright[49, 0, 0] == pytest.approx(0.9)


@given(loss=st.floats(0.05, 0.9))
def test_vignetting_darkens_the_corners_by_its_share(loss):
    image = linear(replace(CLEAN, vignetting=loss).expose(flat(0.8, 101), 1.0, np.random.default_rng(0)))
    for corner in (image[0, 0], image[0, -1], image[-1, 0], image[-1, -1]):
        assert np.allclose(corner / image[50, 50], 1 - loss, atol=0.01)
    assert np.allclose(image[0, 50] / image[50, 50], 1 - loss / 2, atol=0.01)


def test_the_point_spread_has_its_standard_deviation():
    radiance = flat(0.1, 40)
    radiance[:, 20:] = 0.6
    sharp = CLEAN.expose(radiance, 1.0, np.random.default_rng(0))
    assert len(np.unique(sharp)) == 2
    row = linear(replace(CLEAN, psf=0.6).expose(radiance, 1.0, np.random.default_rng(0)))[20, :, 0]
    assert 0.1 < row[19] < 0.35 < row[20] < 0.6
    assert (np.diff(row) > -1e-9).all()
    assert row[19] + row[20] == pytest.approx(0.7, abs=0.01)  # an edge stays where it is
    spread = np.diff(row)  # the derivative of an edge is the line spread
    centre = np.arange(39) + 0.5
    assert (spread * centre).sum() / spread.sum() == pytest.approx(19.5, abs=0.02)
    assert (spread * (centre - 19.5) ** 2).sum() / spread.sum() == pytest.approx(0.6**2, rel=0.1)


def test_a_thin_line_spreads_by_the_standard_deviation():
    """On black, the codes also show the light that falls two pixels away, a four-hundredth."""
    radiance, away = flat(0.0, 41), np.arange(41) - 20
    radiance[:, 20] = 0.9
    row = linear(replace(CLEAN, psf=0.6).expose(radiance, 1.0, np.random.default_rng(0)))[20, :, 0]
    assert (row * away**2).sum() / row.sum() == pytest.approx(0.6**2, rel=0.04)


def test_darkness_is_nearly_black_and_overexposure_nearly_white():
    sensor = replace(CLEAN, full_well=4000, read_noise=4)
    assert sensor.expose(flat(0.0), 1.0, np.random.default_rng(0)).max() < 30
    bright = sensor.expose(flat(50.0), 1.0, np.random.default_rng(0))
    assert bright.dtype == np.uint8 and bright.min() > 245


@given(difference=st.floats(-0.5, 0.5), signal=st.floats(0.2, 0.6))
def test_the_right_eyes_noise_differs_by_its_share(difference, signal):
    left = replace(CLEAN, full_well=5000, read_noise=40, noise_difference=difference)
    spread = [linear_noise(sensor, signal) for sensor in (left, left.right)]
    assert spread[1] / spread[0] == pytest.approx(1 + difference, rel=0.05)


def linear_noise(sensor: Sensor, signal: float) -> float:
    """Standard deviation before the code, at one brightness; 8 bits are too coarse for it to be read off small."""
    image = sensor.expose(flat(signal, 200), 1.0, np.random.default_rng(0)).astype(float)
    return float(np.sqrt(image.var() - 1 / 12))


@pytest.mark.parametrize(
    ("rotation", "down", "right"),
    [(0.0, 2.0, 0.0), (1.0, 0.0, 0.0), (-0.7, -1.5, 0.0), (0.0, 0.0, 3.0), (0.3, 1.0, -2)],
)
def test_a_residual_of_rectification_moves_the_right_image(rotation, down, right):
    """Far points land where the image, turned clockwise about its middle and moved down and right, has them."""
    camera = NATECAM.camera
    moved = replace(CLEAN, rotation_deg=rotation, vertical_offset=down, horizontal_offset=right).right_rotation(camera)
    assert np.allclose(moved @ moved.T, np.eye(3))
    pixels = np.array([[255.5, 255.5], [400.0, 255.5], [255.5, 100.0], [300.0, 310.0]])
    points = np.column_stack([(pixels - 255.5) / camera.fx, np.ones(4)])
    angle = np.deg2rad(rotation)  # v points down, so that this matrix turns clockwise
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    expected = (pixels - 255.5) @ turn.T + 255.5 + [right, down]
    assert np.allclose(camera.project(points @ moved), expected, atol=0.02 + 0.08 * (abs(down) + abs(right)))


def test_offsets_are_pixels_of_their_own_axis():
    camera = replace(NATECAM.camera, fx=800.0, fy=500.0)
    moved = replace(CLEAN, vertical_offset=2.0, horizontal_offset=-3.0).right_rotation(camera)
    assert camera.project(np.array([0.0, 0.0, 1.0]) @ moved) == pytest.approx(
        [camera.cx - 3, camera.cy + 2], abs=1e-3
    )  # fmt: skip


def test_without_residuals_the_right_camera_is_not_turned_at_all():
    assert np.array_equal(CLEAN.right_rotation(NATECAM.camera), np.eye(3))


def test_draws_lie_in_their_ranges_and_follow_the_seed():
    config = SensorConfig()
    for seed in range(20):
        sensor = Sensor.draw(config, np.random.default_rng(seed))
        for field in fields(SensorConfig):
            low, high = getattr(config, field.name)
            assert low <= getattr(sensor, field.name) <= high
        assert sensor == Sensor.draw(config, np.random.default_rng(seed))
    assert Sensor.draw(config, np.random.default_rng(0)) != Sensor.draw(config, np.random.default_rng(1))
    assert Sensor.draw(SensorConfig(psf=(0.4, 0.4)), np.random.default_rng(0)).psf == 0.4


def test_every_value_is_drawn_always_or_as_a_fault():
    assert {field.name for field in fields(SensorConfig)} == {*ALWAYS, *FAULTS, *OF_FAULTS, "fault_chance"}
    assert {field.name for field in fields(Sensor)} == {*ALWAYS, *FAULTS, *OF_FAULTS, "fault_chance", "seed"}


def test_faults_are_off_by_default_and_leave_the_other_draws_alone():
    plain, faulty = (np.random.default_rng(5) for _ in range(2))
    first, second = Sensor.draw(SensorConfig(), plain), Sensor.draw(RANDOM, faulty)
    assert all(getattr(first, name) == getattr(CLEAN, name) for name in FAULTS)
    assert all(getattr(first, name) == getattr(second, name) for name in ALWAYS)
    assert plain.random() == faulty.random()


def test_a_pair_has_each_fault_with_its_chance():
    config = replace(RANDOM, sun_glare=(0.05, 0.4), fault_chance=(0.3, 0.3))
    sensors = [Sensor.draw(config, np.random.default_rng(seed)) for seed in range(400)]
    present = np.array([[getattr(sensor, name) != getattr(CLEAN, name) for name in FAULTS] for sensor in sensors])
    assert np.abs(present.mean(axis=0) - 0.3).max() < 0.08
    assert np.abs(np.corrcoef(present.T) - np.eye(len(FAULTS))).max() < 0.2  # each for itself
    for name in FAULTS:
        low, high = getattr(config, name)
        strengths = [value for sensor in sensors if (value := getattr(sensor, name)) != getattr(CLEAN, name)]
        assert low <= min(strengths) and max(strengths) <= high


def scene(side: int = 96) -> np.ndarray:
    """Radiance with texture, a bright patch and a dark one."""
    rng = np.random.default_rng(7)
    out = (0.2 * rng.uniform(0.6, 1.4, (side, side, 1)) * np.array([1.2, 1.0, 0.7])).astype(np.float32)
    out[20:30, 40:50] = 1.5
    out[60:80, 10:40] = 0.02
    return out


@pytest.mark.parametrize("name", sorted({*FAULTS} - {"horizontal_offset", "sun_glare"}))  # these concern the light
def test_every_fault_changes_both_images_and_follows_the_seed(name):
    ground = np.ones((96, 96), bool)
    common = {"overexposure": 1.0} if name == "bleeding" else {}
    sound = replace(CLEAN, full_well=8000.0, **common)
    faulty = replace(sound, **{name: max(getattr(RANDOM, name), key=lambda v: abs(v - getattr(CLEAN, name)))}, seed=3)
    pairs = [
        sensor.expose_pair(scene(), scene(), ground, np.random.default_rng(1)) for sensor in (sound, faulty, faulty)
    ]
    for eye in (0, 1):
        assert np.array_equal(pairs[1][eye], pairs[2][eye])
        assert (pairs[0][eye] != pairs[1][eye]).mean() > 0.001


def test_each_eye_has_hot_pixels_of_its_own():
    sensor = replace(CLEAN, hot_pixels=2e4, seed=3)
    images = sensor.expose_pair(flat(0.1), flat(0.1), np.ones((160, 160), bool), np.random.default_rng(0))
    left, right = (image[..., 0] > np.median(image) + 5 for image in images)
    assert left.any() and right.any() and (left & right).sum() < 0.1 * left.sum()


def test_a_pair_without_faults_is_each_eye_exposed_alone():
    sensor = replace(CLEAN, full_well=6000.0, read_noise=9.0, psf=0.4, gain_difference=0.1, noise_difference=0.2)
    ground, left, right = np.ones((96, 96), bool), scene(), scene()[:, ::-1]
    images = sensor.expose_pair(left, right, ground, np.random.default_rng(2))
    rng, gain = np.random.default_rng(2), sensor.gain(left, ground)
    assert np.array_equal(images[0], sensor.expose(left, gain, rng))
    assert np.array_equal(images[1], sensor.right.expose(right, gain * 1.1, rng))


def test_a_common_stretch_keeps_the_difference_of_the_eyes_and_a_separate_one_removes_it():
    ground, light = np.ones((96, 96), bool), scene()[31:59, :30]  # texture alone
    sensor = replace(CLEAN, gain_difference=0.3, stretch=0.01)
    common, alone = (
        replace(sensor, stretch_alone=share).expose_pair(light, light, ground[31:59, :30], np.random.default_rng(0))
        for share in (0.0, 1.0)
    )
    assert np.median(common[1]) > np.median(common[0]) + 8
    assert np.median(alone[1]) == pytest.approx(np.median(alone[0]), abs=4)


def test_the_left_image_decides_the_exposure_of_both():
    ground, left = np.ones((96, 96), bool), scene()
    images = CLEAN.expose_pair(left, 1.5 * left, ground, np.random.default_rng(0))
    alone = CLEAN.expose(left, CLEAN.gain(left, ground), np.random.default_rng(0))
    assert np.array_equal(images[0], alone)
    middle = images[0] < 150
    assert np.median(linear(images[1])[middle] / linear(images[0])[middle]) == pytest.approx(1.5, rel=0.02)


def test_each_eye_looks_through_dust_of_its_own():
    left, right = replace(CLEAN, dust=0.4, seed=3).expose_pair(
        flat(0.2), flat(0.2), np.ones((160, 160), bool), np.random.default_rng(0)
    )
    assert np.ptp(left) > 10 and np.ptp(right) > 10
    assert abs(np.corrcoef(left.ravel(), right.ravel())[0, 1]) < 0.6


def test_motion_blur_at_45_deg_goes_down_to_the_right():
    radiance = flat(0.0, 41)
    radiance[20, 20] = 20.0
    image = replace(CLEAN, motion_blur=12.0, motion_direction_deg=45.0).expose(radiance, 1.0, np.random.default_rng(0))
    assert image[23, 23].min() > 100 and image[17, 17].min() > 100
    assert not image[23, 17].any() and not image[17, 23].any()


def test_effects_of_a_ccd_apply_the_vignetting_and_the_gain_once():
    """Nothing saturates, so nothing bleeds."""
    plain = replace(CLEAN, vignetting=0.4)
    images = [
        sensor.expose(flat(0.3), 2.0, np.random.default_rng(0)).astype(int)
        for sensor in (plain, replace(plain, bleeding=0.5))
    ]
    assert np.abs(images[0] - images[1]).max() <= 1


def test_the_charge_of_a_hot_pixel_that_saturates_overflows_too():
    bright = replace(CLEAN, hot_pixels=2e4, seed=3)
    without, bled = (
        replace(bright, bleeding=share).expose(flat(0.97), 1.0, np.random.default_rng(0)) for share in (0.0, 1.0)
    )
    level = np.median(without)
    assert (bled > level).sum() > 1.2 * (without > level).sum() > 100


def test_a_separate_stretch_turns_the_same_share_of_each_image_black_and_white():
    ground, light = np.ones((28, 30), bool), scene()[31:59, :30]  # texture alone
    sensor = replace(CLEAN, gain_difference=0.3, stretch=0.05)
    images = replace(sensor, stretch_alone=1.0).expose_pair(light, light, ground, np.random.default_rng(0))
    for image in images:
        assert (image == 0).mean() == pytest.approx(0.05, abs=0.02)
        assert (image == 255).mean() == pytest.approx(0.05, abs=0.02)


def test_a_stop_of_overexposure_doubles_the_light():
    ground, light = np.ones((50, 50), bool), flat(0.1, 50)
    once, twice = (
        replace(CLEAN, exposure=0.4, overexposure=stops).expose_pair(light, light, ground, np.random.default_rng(0))[0]
        for stops in (0.0, 1.0)
    )
    assert linear(twice).mean() == pytest.approx(2 * linear(once).mean(), rel=0.03)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("exposure", (0.6, 0.4)),
        ("exposure", (0.0, 0.4)),
        ("exposure", (0.5, 1.5)),
        ("psf", (-0.1, 0.5)),
        ("full_well", (0.0, 1.0)),
        ("read_noise", (-1.0, 1.0)),
        ("vignetting", (0.0, 1.1)),
        ("gain_difference", (-1.0, 0.0)),
        ("noise_difference", (-1.0, 0.0)),
        ("vertical_offset", (0.0, 11.0)),
        ("rotation_deg", (-90.0, 0.0)),
        ("horizontal_offset", (-11.0, 0.0)),
        ("dust", (0.0, 0.9)),
        ("motion_blur", (-1.0, 0.0)),
        ("jpeg_quality", (0.0, 50.0)),
        ("fault_chance", (0.5, 1.5)),
        ("psf", (float("nan"), 0.5)),
        ("full_well", (4000.0, float("inf"))),
    ],
)
def test_impossible_detectors_are_refused(name, value):
    with pytest.raises(ValueError, match=name):
        SensorConfig(**{name: value})


@pytest.mark.parametrize(
    ("name", "value"),
    [("exposure", float("nan")), ("psf", -1.0), ("full_well", 0.0), ("noise_difference", -1.0), ("jpeg_quality", 0.0)],
)
def test_a_value_that_no_detector_has_is_named(name, value):
    with pytest.raises(ValueError, match=rf"^{name} must be finite, and "):
        Sensor(**{"exposure": 0.5, "psf": 0.5, "full_well": 8000, "read_noise": 8, "vignetting": 0, name: value})


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_light_that_is_not_finite_or_of_another_shape_is_named(value):
    light, rng = flat(0.2, 16), np.random.default_rng(0)
    wrong = light.copy()
    wrong[3, 4] = value
    ground = np.ones((16, 16), bool)
    sensor = Sensor(0.5, 0.5, 1e4, 5.0, 0.1)
    for left, right, name in ((wrong, light, "left"), (light, wrong, "right")):
        with pytest.raises(ValueError, match=f"^{name} must be finite light"):
            sensor.expose_pair(left, right, ground, rng)
    with pytest.raises(ValueError, match=r"^radiance must be finite light"):
        sensor.expose(wrong, 1.0, rng)
    with pytest.raises(ValueError, match=r"^gain must be finite"):
        sensor.expose(light, value, rng)
    with pytest.raises(ValueError, match=r"^radiance must have shape \(H, W, 3\), got \(16, 16\)"):
        sensor.expose(light[..., 0], 1.0, rng)
    for mask in (ground[:5], np.ones((32, 32), bool)):
        with pytest.raises(ValueError, match=r"^left, right and ground must be of one size"):
            sensor.expose_pair(light, light, mask, rng)
