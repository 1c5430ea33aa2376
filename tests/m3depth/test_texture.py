"""Texture measures of images whose values are known, and the command that prints them."""

import json

import cv2
import numpy as np
import pytest
from rock_samples import rock_sample
from rock_world import RockWorld

from m3depth.figures.texture import GRADIENTS, TextureExample, energy_below, gradient_shares
from m3depth.texture import find_images, high_share, main, measure, power_spectrum, spectral_slope
from marssim.base.camera import NATECAM
from marssim.base.dataset.dataset import write_index
from marssim.base.dataset.frame import StereoFrame
from marssim.base.dataset.sample import write_sample


@pytest.mark.parametrize(("waves", "share"), [(4, 0.0), (40, 1.0)])
def test_a_wave_has_its_energy_at_its_frequency(waves, share):
    """128 px: f_max is 64 waves, the border 6.4."""
    x = np.arange(128)
    image = np.round(128 + 60 * np.cos(2 * np.pi * waves * x / 128))[None].repeat(128, axis=0).astype(np.uint8)
    measures = measure(image)
    assert measures["high"] == pytest.approx(share, abs=0.01)
    assert measures["high_hann"] == pytest.approx(share, abs=0.01)
    assert measures["high_dc"] == pytest.approx(share * 0.5 * 60**2 / (0.5 * 60**2 + 128**2), abs=0.01)


def test_white_noise_spreads_its_energy_evenly():
    image = np.random.default_rng(0).integers(0, 256, (256, 256), dtype=np.uint8)
    measures = measure(image)
    assert measures["high"] == pytest.approx(1 - np.pi * 0.05**2, abs=0.005)


def test_the_energy_is_that_of_the_pixels():
    image = np.random.default_rng(1).integers(0, 256, (40, 56), dtype=np.uint8)
    power, frequency = power_spectrum(image)
    assert power.sum() / image.size == pytest.approx(((image - image.mean()) ** 2).sum())
    example = TextureExample("x", image, image, power, frequency, gradient_shares(image))
    assert energy_below(example, np.array([0.05, 0.8])) == pytest.approx([1 - high_share(power, frequency), 1])


def noise_of_slope(slope: float, seed: int = 0, size: int = 256) -> np.ndarray:
    """Return noise whose power spectrum falls with a power of the frequency, as an image of 8 bits."""
    rows, columns = np.fft.fftfreq(size)[:, None], np.fft.fftfreq(size)
    frequency = np.hypot(rows, columns)
    frequency[0, 0] = np.inf
    spectrum = np.fft.fft2(np.random.default_rng(seed).standard_normal((size, size))) * frequency ** (-slope / 2)
    image = np.fft.ifft2(spectrum).real
    return (128 + 30 * image / image.std()).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("slope", [0.0, 1.0, 2.0])
def test_the_slope_of_noise_is_that_of_its_spectrum(slope):
    slopes = [spectral_slope(*power_spectrum(noise_of_slope(slope, seed), hann=True)) for seed in range(8)]
    assert np.mean(slopes) == pytest.approx(slope, abs=0.06)


def test_what_is_too_small_or_of_one_tone_has_no_slope():
    assert measure(noise_of_slope(1.0)[:49])["slope"] is None
    for height, width in ((50, 256), (60, 60), (75, 75), (79, 50)):  # in some, rings of low frequencies hold none
        assert measure(noise_of_slope(1.0)[:height, :width])["slope"] is not None
    assert spectral_slope(*power_spectrum(np.full((60, 60), 9, np.uint8))) is None


def test_half_of_an_image_is_poor_in_texture_and_its_gradients_are_those_of_its_ramp():
    ramp = np.broadcast_to(2 * np.arange(100, dtype=np.uint8), (80, 100))  # 2 grey levels a px
    half = np.concatenate([ramp, np.full_like(ramp, 50)])
    measures = measure(half)
    assert measures["poor"] == pytest.approx(0.5, abs=0.03)
    assert measure(ramp)["gradient"] == 2 and measure(half[80:])["gradient"] == 0
    shares = gradient_shares(half)
    assert shares[GRADIENTS < 1.9] == pytest.approx(0.5, abs=0.03) and shares[-1] == 1


def test_one_tone_has_no_texture():
    measures = measure(np.full((20, 30), 77, np.uint8))
    assert measures["poor"] == 1 and measures["gradient"] == 0 and measures["slope"] is None
    assert measures["lbp_riu2"] == measures["lbp_codes"] == measures["high"] == measures["high_hann"] == 0


def test_the_command_writes_the_measures_of_both_groups(tmp_path, capsys):
    rng = np.random.default_rng(2)
    folder = tmp_path / "smooth"
    folder.mkdir()
    for i in range(3):
        noise = cv2.GaussianBlur(rng.standard_normal((60, 80)).astype(np.float32), (0, 0), 6)
        cv2.imwrite(str(folder / f"{i}.png"), cv2.normalize(noise, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8))
    rough = tmp_path / "rough.jpg"
    cv2.imwrite(str(rough), rng.integers(0, 255, (60, 80, 3), dtype=np.uint8))
    out = tmp_path / "out"
    args = [str(folder), "--beside", str(rough), "--names", "smooth", "rough", "--limit", "2", "--out", str(out)]
    assert main(args) == 0
    groups = json.loads((out / "texture.json").read_text())["groups"]
    assert groups["smooth"]["count"] == 2 and groups["rough"]["count"] == 1
    assert groups["smooth"]["mean"]["slope"] > 2 > groups["rough"]["mean"]["slope"]
    assert groups["smooth"]["mean"]["high"] < 0.3 < 0.9 < groups["rough"]["mean"]["high"]
    assert [record["image"] for record in groups["smooth"]["images"]] == [str(folder / f"{i}.png") for i in (0, 2)]
    assert cv2.imread(str(out / "texture.png")).std() > 10
    assert "LBP" in capsys.readouterr().out


def test_the_command_measures_the_left_images_of_a_dataset(tmp_path):
    sample = rock_sample(RockWorld(), NATECAM.resized(64, 64))
    frame = StereoFrame(
        sample.left, sample.right, sample.depth, sample.disparity, sample.normal,
        np.where(np.isinf(sample.depth), -1, 0), sample.occluded, sample.rig, np.eye(4),
    )  # fmt: skip
    write_sample(tmp_path / "set/scenes/00000/00", frame, {})
    write_index(tmp_path / "set", {}, ["00000/00"])
    assert main([str(tmp_path / "set"), "--out", str(tmp_path / "out")]) == 0
    [group] = json.loads((tmp_path / "out/texture.json").read_text())["groups"].values()
    assert group["images"][0]["high"] == pytest.approx(measure(cv2.cvtColor(sample.left, cv2.COLOR_RGB2GRAY))["high"])


def test_16_bit_images_are_scaled_before_they_are_measured(tmp_path):
    """Radiance of 12 bits in a file of 16 would fill 16 of 256 grey levels."""
    image = np.random.default_rng(0).integers(0, 256, (64, 64), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "8.png"), image)
    cv2.imwrite(str(tmp_path / "16.png"), image.astype(np.uint16) * 16)
    eight, sixteen = (measure(grey) for _, grey in find_images([tmp_path / "8.png", tmp_path / "16.png"], 10))
    assert sixteen == pytest.approx(eight, rel=0.01)


def test_an_image_that_is_given_twice_counts_once(tmp_path):
    for number in range(3):
        image = np.random.default_rng(number).integers(0, 255, (20, 30), dtype=np.uint8)
        cv2.imwrite(str(tmp_path / f"{number}.png"), image)
    names = [name for name, _ in find_images([tmp_path / "1.png", tmp_path, tmp_path / "1.png"], 50)]
    assert names == [str(tmp_path / f"{number}.png") for number in (1, 0, 2)]


@pytest.mark.parametrize(
    ("what", "message"),
    [("none", "none: no such file or folder"), ("empty", "holds no images"), ("text", "not a readable image"),
     ("tiny", "at least 3 x 3 pixels are needed"), ("limit", "--limit must be at least 1"),
     ("names", "--names must differ, got 'x' twice")],
)  # fmt: skip
def test_mistakes_exit_with_2_and_one_line(tmp_path, capsys, what, message):
    path, extra = tmp_path / what, []
    if what == "empty":
        path.mkdir()
    elif what == "text":
        path.write_text("words")
    elif what in ("tiny", "limit"):
        path = tmp_path / "tiny.png"
        cv2.imwrite(str(path), np.zeros((2, 9), np.uint8))
        extra = ["--limit", "0"] if what == "limit" else []
    elif what == "names":
        extra = ["--names", "x", "x"]
    assert main([str(path), "--out", str(tmp_path / "out"), *extra]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
    assert not (tmp_path / "out").exists()
