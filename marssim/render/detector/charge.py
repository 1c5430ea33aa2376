"""What a CCD does to the charge in its columns: saturated pixels overflow, and the read-out smears."""

from __future__ import annotations

import numpy as np

from marssim.base.compute.compiled import compiled


def in_full_scale(radiance: np.ndarray, gain: float, vignetting: float) -> np.ndarray:
    """Return the signal as shares of full scale, (H, W, 3) float32; more than 1 is more than a pixel holds.

    Args:
        radiance: (H, W, 3) linear RGB radiance.
        gain: Factor from radiance to full scale.
        vignetting: Share of the light that is lost in the corners.
    """
    height, width = radiance.shape[:2]
    x, y = np.linspace(-1, 1, width, dtype=np.float32), np.linspace(-1, 1, height, dtype=np.float32)
    fall = (x[None] ** 2 + y[:, None] ** 2) * np.float32(vignetting / 2)
    return radiance * (np.float32(gain) * (1 - fall))[..., None]


def with_smear(signal: np.ndarray, share: float) -> np.ndarray:
    """Return the signal with the smear of frame transfer.

    A frame-transfer CCD has no shutter: on its way to the read-out, the charge of a pixel passes under all other pixels
    of its column and collects light there (the engineering cameras of the Mars Exploration Rovers, Maki et al., J.
    Geophys. Res. 108, 2003).

    Args:
        signal: (H, W, 3) shares of full scale.
        share: Time of the transfer as a share of the exposure.

    Returns:
        (H, W, 3) float32.
    """
    return signal + np.float32(share) * signal.mean(axis=0, keepdims=True)


def bled(signal: np.ndarray, share: float) -> np.ndarray:
    """Return the signal after saturated pixels have overflowed.

    Charge beyond full scale flows along the column, half of it up and half down, and fills the next pixels that have
    room. The pixels of a colour detector's column have different colours, so the overflow of one colour fills all.
    Anti-blooming drains remove the rest.

    Args:
        signal: (H, W, 3) shares of full scale.
        share: Share of the overflow that is not drained.

    Returns:
        (H, W, 3) float32, at most 1.
    """
    return _bled(np.ascontiguousarray(signal, dtype=np.float32), np.float32(share / 2))


@compiled
def _bled(signal, half):
    height, width, channels = signal.shape
    full, none = np.float32(1), np.float32(0)
    out = np.minimum(signal, full)
    for column in range(width):
        for way in (1, -1):
            carried = none
            for step in range(height):
                row = step if way == 1 else height - 1 - step
                for c in range(channels):
                    carried += half * max(signal[row, column, c] - full, none)
                if carried <= none:
                    continue
                for c in range(channels):  # an equal part for each colour that has room
                    taken = min(carried / np.float32(channels - c), full - out[row, column, c])
                    out[row, column, c] += taken
                    carried -= taken
    return out
