import numpy as np
import pytest
import pywt
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from m3depth.network.wavelet import WaveletConv, haar_transform, inverse_haar_transform


def test_bands_are_those_of_pywavelets_under_other_names() -> None:
    x = np.random.default_rng(0).normal(size=(3, 8, 6))
    bands = haar_transform(torch.from_numpy(x)[None])[0].reshape(3, 4, 4, 3)
    for channel in range(3):
        c_a, (c_h, c_v, c_d) = pywt.dwt2(x[channel], "haar")
        for band, expected in zip(bands[channel], (c_a, c_v, c_h, c_d)):
            np.testing.assert_allclose(band.numpy(), expected, atol=1e-12)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 5), st.integers(1, 6), st.integers(1, 6))
def test_transform_is_inverted_and_keeps_energy(seed: int, channels: int, height: int, width: int) -> None:
    x = torch.randn(2, channels, 2 * height, 2 * width, dtype=torch.float64, generator=torch.manual_seed(seed))
    bands = haar_transform(x)
    torch.testing.assert_close(inverse_haar_transform(*bands.unflatten(1, (-1, 4)).unbind(2)), x)
    torch.testing.assert_close(bands.square().sum(), x.square().sum())


def test_odd_sizes_are_refused() -> None:
    with pytest.raises(ValueError, match="even"):
        haar_transform(torch.zeros(1, 1, 3, 4))


def test_beta_compounds_over_levels() -> None:
    """With identity kernels, Algorithm 1 is y_0 + IWT of bands whose low part is weighed by the betas."""
    conv = WaveletConv(2, levels=2, kernel=3).double()
    for layer in (conv.base, *conv.bands):
        torch.nn.init.dirac_(layer.weight, groups=layer.groups)
    torch.nn.init.zeros_(conv.base.bias)
    torch.nn.init.dirac_(conv.mix.weight)
    torch.nn.init.zeros_(conv.mix.bias)
    with torch.no_grad():
        conv.beta.copy_(torch.tensor([[2.0, 2.0], [3.0, 3.0]]))
    x = torch.ones(1, 2, 8, 8, dtype=torch.float64)  # only the low bands are not zero: 2 at level 1, 4 at level 2
    # z_2 = 3 * 4 / 2 = 6 at level 1; z_1 = 2 * (2 + 6) / 2 = 8; z_0 = 1 + 8
    torch.testing.assert_close(conv(x), torch.full_like(x, 9.0))


def test_gradients_of_the_wavelet_convolution_are_right() -> None:
    conv = WaveletConv(1, levels=2, kernel=3).double()
    x = torch.randn(1, 1, 4, 4, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(conv, (x,))
