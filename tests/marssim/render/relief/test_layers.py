import numpy as np
import pytest

from marssim.render.relief.layers import (
    FRACTAL,
    FRACTAL_WAVES,
    GRAIN,
    GRAIN_WAVES,
    SLOPE,
    SLOPE_AT,
    SLOPE_FALL,
    VARIANTS,
    fractal_levels,
    ripple_tile,
)
from marssim.scene.ground.noise import TEXELS, TILE


@pytest.mark.parametrize("seed", range(VARIANTS))
def test_ripples_run_across_the_wind(seed):
    field = ripple_tile(seed)
    assert field.shape == (TILE, TILE)
    assert field.std() == pytest.approx(1) and field.mean() == pytest.approx(0, abs=1e-9)
    along, across = ((np.roll(field, -1, axis) - np.roll(field, 1, axis)) / 2 for axis in (1, 0))
    assert along.std() > 2.5 * across.std()
    power = np.abs(np.fft.rfft2(field)) ** 2
    k = np.fft.rfftfreq(TILE) * TEXELS
    power[0, 0] = 0
    near = (k > 0.5) & (k < 1.5)
    assert 0.8 < (k * power.sum(0))[near].sum() / power.sum(0)[near].sum() < 1.2
    assert -np.percentile(along, 1) > 1.1 * np.percentile(along, 99)  # the lee is the steeper side


def test_ripples_have_no_seam():
    field = ripple_tile(0)
    for axis in (0, 1):
        step = np.abs(np.diff(field, axis=axis)).mean()
        assert np.abs(np.take(field, 0, axis) - np.take(field, -1, axis)).mean() < 1.3 * step


@pytest.mark.parametrize(("form", "waves"), [(FRACTAL, FRACTAL_WAVES), (GRAIN, GRAIN_WAVES)])
def test_each_octave_of_the_fine_relief_has_the_slope_that_its_wavelength_asks_for(form, waves):
    side, spacing, _ = form
    coefficients = fractal_levels(1, *form, waves)[: side * side].reshape(side, side).astype(float)
    # the spline's own response gives the field back from its coefficients
    response = 0.75 + 0.25 * np.cos(2 * np.pi * np.fft.fftfreq(side))
    spectrum = np.fft.fft2(coefficients) * response[:, None] * response[None, :]
    frequency = np.fft.fftfreq(side, spacing)
    k = np.hypot(frequency[:, None], frequency[None, :])
    square = np.abs(spectrum) ** 2 * (2 * np.pi * k) ** 2 / side**4
    middle = np.sqrt(waves[0] * waves[1])
    octave = (k > 1 / (middle * np.sqrt(2))) & (k < np.sqrt(2) / middle)
    assert np.sqrt(square[octave].sum() / 2) == pytest.approx(SLOPE * (middle / SLOPE_AT) ** SLOPE_FALL, rel=0.1)
    shorter, longer = k > 1 / (0.75 * waves[0]), (k > 0) & (k < 1 / (1.3 * waves[1]))
    assert square[shorter].sum() + square[longer].sum() < 1e-6 * square.sum()


def test_variants_differ():
    first, second = (fractal_levels(seed, *GRAIN, GRAIN_WAVES)[: GRAIN[0] ** 2] for seed in (0, 1))
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.05
    assert abs(np.corrcoef(ripple_tile(0).ravel(), ripple_tile(1).ravel())[0, 1]) < 0.05
