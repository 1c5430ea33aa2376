"""Measure the texture of the ground and the sharpness of edges in an image, to compare real and rendered frames.

Definitions. All are of luminance that is linear in light: the grey image's codes as shares of 255, to the power GAMMA,
which undoes the encoding of marssim.render.detector.codes. Other cameras need their own power.

spectrum    Power spectrum of log-luminance, mean over square windows of WINDOW px that lie wholly in the mask, half a
            window apart: the natural logarithm of luminance, less its least-squares plane, times a Hann window of unit
            mean square; the squared modulus of its discrete Fourier transform, divided by WINDOW^4. Its sum over all
            frequencies is the variance of log-luminance, so that the square root of the sum is a contrast.
bands       Octaves of the radial frequency [cycles/px] between BAND_EDGES. The contrast of a band is the square root of
            the power in it. The bands have wavelengths of 45, 23, 11, 5.7 and 2.8 px.
slope       Slope of the logarithm of the mean power on a ring of frequencies over the logarithm of the frequency, by
            least squares through one point an octave, from 1/32 to 1/2 cycles/px. It is 0 for white noise.
direction   Of a band: the largest mean power in a sector of 30 deg over the mean of the six sectors; 1 if the power is
            the same in all directions.
peakedness  Excess kurtosis of log-luminance after a band-pass by a difference of Gaussians (standard deviations s and
            2 s px, normalised to the mask): 0 for Gaussian noise, larger for few strong marks on plain ground.
shade       The 1st, 5th and 99th percentile of luminance, over its median.
edge width  Distance over which luminance rises from 10 to 90 % of its step, along the gradient [px].
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from marssim.render.detector.codes import GAMMA

WINDOW = 64  # side of a window of the spectrum [px]
BAND_EDGES = 0.5 ** np.arange(6, 0, -1)  # borders of the bands, 1/64 to 1/2 [cycles/px]
SECTORS = 6  # of direction, over half a turn
BLURS = (1.0, 2.0, 4.0)  # smaller standard deviation of each band-pass [px]
PERCENTILES = (1.0, 5.0, 99.0)  # of luminance, for the shade
DARKEST = 0.5 / 255  # luminance that a code of 0 stands for, before the power
REACH = 6  # distance that an edge is followed to either side [px]
LEAST_STEP = 0.35  # height of an edge in log-luminance


@dataclass(frozen=True)
class GroundTexture:
    """Texture of the ground in an image; the module defines the values.

    Attributes:
        contrast: (5,) contrast of each band, the longest wavelength first.
        direction: (5,) direction of each band; NaN for the longest wavelength.
        slope: Slope of the spectrum.
        peakedness: (3,) peakedness for each of BLURS.
        shade: (3,) shade for each of PERCENTILES.
        windows: Number of windows that gave the spectrum.
    """

    contrast: np.ndarray
    direction: np.ndarray
    slope: float
    peakedness: np.ndarray
    shade: np.ndarray
    windows: int


def linear(grey: np.ndarray) -> np.ndarray:
    """Return luminance that is linear in light.

    Args:
        grey: (H, W) uint8 image, whose encoding by the camera the power GAMMA undoes.

    Returns:
        (H, W) float32 in (0, 1].
    """
    share = np.maximum(grey.astype(np.float32) / 255, DARKEST)
    return np.asarray(share**GAMMA, dtype=np.float32)


def ground_texture(luminance: np.ndarray, mask: np.ndarray) -> GroundTexture:
    """Measure the texture of the ground in an image.

    Args:
        luminance: (H, W) above 0, linear in light.
        mask: (H, W) bool, the pixels that count.

    Raises:
        ValueError: No window lies wholly in the mask.
    """
    logs = np.log(luminance.astype(np.float32))
    power, windows = spectrum(logs, mask)
    frequency, sector = _polar(WINDOW)
    band = np.digitize(frequency, BAND_EDGES) - 1
    inside = [(band == n) & (frequency < BAND_EDGES[-1]) for n in range(len(BAND_EDGES) - 1)]
    total = np.array([power[where].sum() for where in inside])
    sectors = np.array([[power[where & (sector == s)].mean() for s in range(SECTORS)] for where in inside[1:]])
    direction = np.concatenate([[np.nan], sectors.max(axis=1) / np.maximum(sectors.mean(axis=1), 1e-30)])
    middle = np.sqrt(BAND_EDGES[:-1] * BAND_EDGES[1:])
    density = np.array([power[where].mean() for where in inside])
    slope = float(np.polyfit(np.log(middle[1:]), np.log(np.maximum(density[1:], 1e-30)), 1)[0])
    return GroundTexture(
        contrast=np.sqrt(total), direction=direction, slope=slope,
        peakedness=np.array([peakedness(logs, mask, blur) for blur in BLURS]),
        shade=np.percentile(luminance[mask], PERCENTILES) / np.median(luminance[mask]), windows=windows,
    )  # fmt: skip


def spectrum(logs: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the spectrum of log-luminance.

    Args:
        logs: (H, W) natural logarithm of luminance.
        mask: (H, W) bool, the pixels that count.

    Returns:
        (WINDOW, WINDOW) power at the frequencies of numpy.fft.fft2, and the number of windows.

    Raises:
        ValueError: No window lies wholly in the mask.
    """
    whole = cv2.integral(mask.astype(np.uint8))
    axis = np.linspace(-1, 1, WINDOW)
    plane = np.stack([np.ones((WINDOW, WINDOW)), *np.meshgrid(axis, axis)], axis=-1).reshape(-1, 3)
    fit = np.linalg.pinv(plane)
    hann = np.hanning(WINDOW + 1)[:-1]
    weight = np.outer(hann, hann)
    weight /= np.sqrt(np.mean(weight**2))
    total, count = np.zeros((WINDOW, WINDOW)), 0
    for top in range(0, logs.shape[0] - WINDOW + 1, WINDOW // 2):
        for left in range(0, logs.shape[1] - WINDOW + 1, WINDOW // 2):
            bottom, right = top + WINDOW, left + WINDOW
            if whole[bottom, right] - whole[top, right] - whole[bottom, left] + whole[top, left] < WINDOW**2:
                continue
            part = logs[top:bottom, left:right].astype(float).ravel()
            rest = (part - plane @ (fit @ part)).reshape(WINDOW, WINDOW)
            total += np.abs(np.fft.fft2(rest * weight)) ** 2 / WINDOW**4
            count += 1
    if count == 0:
        raise ValueError(f"no window of {WINDOW} x {WINDOW} px lies wholly in the mask")
    return total / count, count


def peakedness(logs: np.ndarray, mask: np.ndarray, blur: float) -> float:
    """Return the excess kurtosis of a band-passed image.

    Args:
        logs: (H, W) log-luminance.
        mask: (H, W) bool, the pixels that count.
        blur: Smaller standard deviation of the band-pass [px]; the larger one is twice that.
    """
    share = mask.astype(np.float32)
    fine, coarse = (_smooth(logs * share, s) / np.maximum(_smooth(share, s), 1e-6) for s in (blur, 2 * blur))
    part = (fine - coarse)[mask].astype(float)
    part -= part.mean()
    square = np.mean(part**2)
    return float(np.mean(part**4) / square**2 - 3) if square > 1e-12 else 0.0


def edge_widths(luminance: np.ndarray, most: int = 400) -> np.ndarray:
    """Return the widths of the strongest clean edges of an image.

    An edge is followed along the gradient, at the pixels where log-luminance is steepest and steeper than around them.
    It is clean if it rises by more than LEAST_STEP and stays level within a fifth of its step on either side.

    Args:
        luminance: (H, W), linear in light.
        most: Largest number of pixels at which an edge is followed, the steepest first.

    Returns:
        (N,) distance from 10 to 90 % of each step [px].
    """
    logs = np.log(cv2.GaussianBlur(luminance, (0, 0), 0.7))
    across, down = (cv2.Sobel(logs, cv2.CV_32F, *order, ksize=3, scale=1 / 8) for order in ((1, 0), (0, 1)))
    steep = np.hypot(across, down)
    inner = np.zeros(steep.shape, dtype=bool)
    inner[REACH + 1 : -REACH - 1, REACH + 1 : -REACH - 1] = True
    peak = (steep >= cv2.dilate(steep, np.ones((5, 5), np.uint8))) & inner
    row, column = np.nonzero(peak)
    order = np.argsort(-steep[row, column], kind="stable")[:most]
    row, column = row[order], column[order]
    if len(row) == 0:  # the image is too small to follow an edge
        return np.zeros(0)
    uphill = np.stack([across[row, column], down[row, column]], axis=1) / np.maximum(steep[row, column], 1e-9)[:, None]
    step = np.arange(-REACH, REACH + 0.01, 0.25, dtype=np.float32)
    reach = REACH + 1
    widths = []
    for r, c, (right, below) in zip(row, column, uphill, strict=True):
        around = luminance[r - reach : r + reach + 1, c - reach : c + reach + 1]  # remap takes no sides over 32766 px
        profile = cv2.remap(around, (reach + right * step)[None], (reach + below * step)[None], cv2.INTER_LINEAR)
        widths.append(rise(profile[0], 0.25))
    return np.array([width for width in widths if width is not None])


def rise(profile: np.ndarray, step: float) -> float | None:
    """Return the distance from 10 to 90 % of a rising profile, or None if it is no clean edge.

    Args:
        profile: (N,) values, `step` apart, that rise from the level of the first quarter to that of the last.
        step: Distance of two values.
    """
    quarter = len(profile) // 4
    low, high = float(np.median(profile[:quarter])), float(np.median(profile[-quarter:]))
    if not (low > 0 and np.log(high / low) > LEAST_STEP):
        return None
    share = (profile - low) / (high - low)
    if np.abs(share[:quarter]).max() > 0.2 or np.abs(share[-quarter:] - 1).max() > 0.2:
        return None
    high_end = int(np.flatnonzero(share >= 0.9)[0])
    low_end = int(np.flatnonzero(share[:high_end] < 0.1)[-1]) + 1

    def crossing(level: float, after: int) -> float:
        """Return where the profile crosses a level, just before the value `after`, in steps."""
        return after - 1 + float((level - share[after - 1]) / (share[after] - share[after - 1]))

    return (crossing(0.9, high_end) - crossing(0.1, low_end)) * step


def _polar(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the frequency [cycles/px] and the sector of each term of an (n, n) discrete Fourier transform."""
    along = np.fft.fftfreq(n)
    angle = np.arctan2(along[:, None], along[None, :]) % np.pi
    return np.hypot(along[:, None], along[None, :]), np.minimum((angle / np.pi * SECTORS).astype(int), SECTORS - 1)


def _smooth(image: np.ndarray, sigma: float) -> np.ndarray:
    return cv2.GaussianBlur(image, (0, 0), sigma, borderType=cv2.BORDER_REFLECT)
