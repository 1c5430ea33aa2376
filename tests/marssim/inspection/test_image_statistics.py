import numpy as np
import pytest
from scipy.special import erf

from marssim.inspection.image_statistics import (
    BAND_EDGES,
    WINDOW,
    edge_widths,
    ground_texture,
    linear,
    peakedness,
    rise,
    spectrum,
)
from marssim.render.detector.codes import GAMMA

ALL = np.ones((256, 256), dtype=bool)
U, V = np.meshgrid(np.arange(256), np.arange(256))
NOISE = np.random.default_rng(0).standard_normal((256, 256))


def test_codes_become_light():
    grey = np.array([[0, 51, 255]], np.uint8)
    assert np.allclose(linear(grey)[0, 1:], [0.2**GAMMA, 1]) and linear(grey)[0, 0] > 0


@pytest.mark.parametrize(("wavelength", "band"), [(32 * 2**0.5, 0), (11.0, 2), (5.5, 3), (2.8, 4)])
@pytest.mark.parametrize("angle", [0.0, 0.9])
def test_a_wave_shows_in_its_band(wavelength, band, angle):
    """A wave of amplitude a in log-luminance has the contrast a / sqrt(2), nearly all of it in its octave."""
    wave = 0.1 * np.sin(2 * np.pi / wavelength * (np.cos(angle) * U + np.sin(angle) * V) + 0.3)
    look = ground_texture(np.exp(wave), ALL)
    if band > 0:
        assert look.contrast[band] == pytest.approx(0.1 / np.sqrt(2), rel=0.03)
        assert look.direction[band] == pytest.approx(6, rel=0.45)  # all in one sector of six, or in two beside
    assert look.contrast.argmax() == band


def test_the_power_adds_up_to_the_variance():
    power, windows = spectrum((0.2 * NOISE).astype(np.float32), ALL)
    assert power.sum() == pytest.approx(0.04, rel=0.03)
    assert windows == (256 // (WINDOW // 2) - 1) ** 2


@pytest.mark.parametrize("exponent", [0.0, 0.5, 1.0])  # above that the window leaks, as it does for all
def test_the_slope_of_noise_is_found(exponent):
    k = np.hypot(np.fft.fftfreq(256)[:, None], np.fft.fftfreq(256)[None, :])
    k[0, 0] = np.inf
    field = np.fft.ifft2(np.fft.fft2(NOISE) * k**-exponent).real
    look = ground_texture(np.exp(0.1 * field / field.std()), ALL)
    assert look.slope == pytest.approx(-2 * exponent, abs=0.12)
    assert (look.direction[1:] < 1.3).all()


def test_exposure_and_a_gradient_do_not_count():
    tilted = 0.1 * NOISE + 0.01 * U - 0.02 * V
    plain, other = ground_texture(np.exp(0.1 * NOISE), ALL), ground_texture(7 * np.exp(tilted), ALL)
    assert np.allclose(plain.contrast, other.contrast, rtol=1e-3)
    assert plain.slope == pytest.approx(other.slope, abs=1e-3)


def test_noise_is_not_peaked_and_few_spots_are():
    spots = np.zeros((256, 256))
    spots[tuple(np.random.default_rng(1).integers(0, 256, (2, 200)))] = 1
    for blur in (1.0, 2.0):
        assert abs(peakedness(NOISE.astype(np.float32), ALL, blur)) < 0.25
    assert peakedness(spots.astype(np.float32), ALL, 1.0) > 5


def test_only_the_mask_counts():
    mask = ALL.copy()
    mask[:, 128:] = False
    noisy = np.where(mask, 0.1 * NOISE, 3 * NOISE[::-1])
    texture, whole = ground_texture(np.exp(noisy), mask), ground_texture(np.exp(0.1 * NOISE), ALL)
    assert np.allclose(texture.contrast, whole.contrast, rtol=0.1)
    assert texture.windows == 7 * 3
    assert texture.shade == pytest.approx(np.exp(0.1 * np.array([-2.326, -1.645, 2.326])), rel=0.03)
    with pytest.raises(ValueError, match="64 x 64 px"):
        ground_texture(np.exp(0.1 * NOISE), ALL & (U < 60))


@pytest.mark.parametrize("angle", [0.0, 0.5, 2.0])
@pytest.mark.parametrize("blur", [0.5, 1.0, 1.5])
def test_the_width_of_a_blurred_edge(angle, blur):
    """A step blurred by a Gaussian of standard deviation s rises from 10 to 90 % over 2.563 s; pixels and the bilinear
    sampling widen it a little."""
    across = (U - 128.2) * np.cos(angle) + (V - 127.6) * np.sin(angle)
    image = 0.3 + 0.2 * (1 + erf(across / blur / np.sqrt(2)))
    widths = edge_widths(image.astype(np.float32))
    assert len(widths) >= 10
    assert 2.563 * blur * 0.97 < np.median(widths) < 2.563 * np.hypot(blur, 0.6)


def test_edges_of_an_image_of_many_columns_are_those_of_its_part():
    part = (0.3 + 0.2 * (1 + erf((U - 128.2) / 3))).astype(np.float32)
    wide = np.full((256, 40000), part[:, -1:], np.float32)
    wide[:, :256] = part
    np.testing.assert_array_equal(edge_widths(wide), edge_widths(part))


def test_a_ramp_rises_over_eight_tenths_of_its_length():
    profile = np.interp(np.arange(49) * 0.25, [4, 8], [1.0, 2.0])
    assert rise(profile, 0.25) == pytest.approx(0.8 * 4, abs=1e-6)
    assert rise(profile[::-1], 0.25) is None  # falls
    assert rise(1 + 0.01 * profile, 0.25) is None  # hardly rises
    assert len(edge_widths(np.ones((64, 64), np.float32))) == 0
    assert len(edge_widths(NOISE[:10, :12].astype(np.float32) ** 2 + 1)) == 0  # too small to follow one


def test_plain_ground_has_no_contrast():
    look = ground_texture(np.full((128, 128), 0.3, np.float32), ALL[:128, :128])
    assert np.allclose(look.contrast, 0, atol=1e-5) and not look.peakedness.any() and np.isfinite(look.slope)


def test_bands_are_octaves():
    assert np.allclose(np.diff(np.log2(BAND_EDGES)), 1) and BAND_EDGES[-1] == 0.5
