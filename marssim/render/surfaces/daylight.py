"""The light of a scene: sunlight through dust, and the skylight that the dust scatters."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from marssim.base.compute.compiled import compiled, inlined
from marssim.scene.look import Look

EXTINCTION = (0.42, 0.46, 0.52)  # extinction of red, green and blue sunlight by dust of unit optical depth
SKY_STRENGTH = 0.55  # skylight under thick dust and a zenith sun
SKY_EXTINCTION = 0.75  # how fast skylight approaches that with optical depth
SKY_FALL = 0.75  # power of the sun's height with which skylight falls
LOWEST, LOWEST_SKY = 0.06, 0.12  # sines of the sun's elevation below which sunlight and skylight stay constant
HORIZON_HEIGHT = 0.25  # sine of the elevation over which the horizon's colour fades
HALO_WIDTH = 0.22  # [rad] width of the bright halo around the sun
ZENITH_COLOUR = (0.31, 0.235, 0.16)
HORIZON_COLOUR = (0.50, 0.41, 0.29)
HALO_COLOUR = (0.42, 0.40, 0.38)


class Daylight(NamedTuple):
    """The light of a scene, as kernels take it. Light is relative to the sunlight without air.

    Attributes:
        sun: (3,) unit vector towards the sun, world frame.
        sunlight: (3,) float32 RGB light on a surface that faces the sun.
        skylight: Light of the sky on level ground.
        optical_depth: Optical depth of the dust.
    """

    sun: np.ndarray
    sunlight: np.ndarray
    skylight: float
    optical_depth: float


def daylight(look: Look) -> Daylight:
    """Return the light of a Look. Dust scatters forward, so only half of what it removes from sunlight is lost."""
    height = float(look.sun[2])
    path = look.optical_depth / max(height, LOWEST)
    red, green, blue = np.exp(-path * np.array(EXTINCTION))
    sky = SKY_STRENGTH * (1 - np.exp(-SKY_EXTINCTION * path)) * max(height, LOWEST_SKY) ** SKY_FALL
    return Daylight(look.sun, np.array([red, green, blue], dtype=np.float32), float(sky), look.optical_depth)


@compiled
def skies(directions, light):
    """Return the radiance of the sky (N, 3) float32 along unit directions (N, 3), world frame. light: Daylight."""
    out = np.empty((len(directions), 3), dtype=np.float32)
    sun, _, skylight, optical_depth = light
    for k in range(len(directions)):
        red, green, blue = sky_colour(
            directions[k, 0], directions[k, 1], directions[k, 2], sun, skylight, optical_depth
        )
        out[k, 0], out[k, 1], out[k, 2] = red, green, blue
    return out


@inlined
def sky_colour(x, y, z, sun, skylight, optical_depth):
    """Return the radiance of the sky along a unit vector x, y, z. The other arguments are those of Daylight.

    The sky is paler towards the horizon and brighter around the sun.
    """
    towards_sun = min(max(x * sun[0] + y * sun[1] + z * sun[2], -1.0), 1.0)
    horizon = math.exp(np.float32(-min(z, 1.0) / HORIZON_HEIGHT)) if z > 0 else 1.0
    ahead = (1 + towards_sun) / 2
    forward = math.exp(np.float32(-1 / HALO_WIDTH) * math.acos(np.float32(towards_sun)))
    halo = (0.9 * forward + 0.35 * ahead * ahead * ahead * ahead) * optical_depth
    # the light of a low sun has passed through more dust before it reaches the dust in view
    strength = (0.5 + 1.1 * skylight) * min(0.3 + 1.75 * sun[2], 1.0)
    veil = 0.85 + 0.5 * optical_depth
    return (
        strength
        * ((ZENITH_COLOUR[0] + (HORIZON_COLOUR[0] - ZENITH_COLOUR[0]) * horizon) * veil + halo * HALO_COLOUR[0]),
        strength
        * ((ZENITH_COLOUR[1] + (HORIZON_COLOUR[1] - ZENITH_COLOUR[1]) * horizon) * veil + halo * HALO_COLOUR[1]),
        strength
        * ((ZENITH_COLOUR[2] + (HORIZON_COLOUR[2] - ZENITH_COLOUR[2]) * horizon) * veil + halo * HALO_COLOUR[2]),
    )
