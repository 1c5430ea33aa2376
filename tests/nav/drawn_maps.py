"""Elevation maps that are drawn, not measured."""

import numpy as np

from marssim.base.rover_spec import ZHURONG
from nav.ground.elevation import ElevationConfig, ElevationMap
from nav.ground.traversability import TraversabilityConfig, assess

SMALL = ElevationConfig(size=16.0)


def flat_map_with_rocks(rocks=(), seen=None):
    """A flat map with square rocks (x, y, half-width), seen where `seen`(x, y) says, and its traversability."""
    elevation = ElevationMap(SMALL)
    x, y = elevation.centres()
    x, y = np.meshgrid(x, y)
    z = np.zeros_like(x)
    for rx, ry, half in rocks:
        z[(np.abs(x - rx) < half) & (np.abs(y - ry) < half)] = 0.6
    if seen is not None:
        z[~seen(x, y)] = np.nan
    elevation.top = elevation.low = z.astype(np.float32)
    elevation.weight = np.isfinite(z).astype(np.float32)
    return elevation, assess(elevation, ZHURONG, TraversabilityConfig())


def map_of_height(height):
    """A map in which everything was seen, of the height that a function of (x, y) returns [m]."""
    elevation = ElevationMap(SMALL)
    x, y = np.meshgrid(*elevation.centres())
    elevation.top = elevation.low = height(x, y).astype(np.float32)
    elevation.weight = np.ones_like(elevation.top)
    return elevation
