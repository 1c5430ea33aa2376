"""The light and the surface that a scene drew, as a suite records them for each episode."""

from __future__ import annotations

import math

from marssim.scene.look import Look

DECIMALS = 4
SAME_LOOK = 2e-4  # by which values of one look may differ


def look_values(look: Look) -> dict[str, float]:
    """Return the values of a look by the names of LookConfig, rounded, and the seed of the surface's patterns."""
    east, north, up = (float(value) for value in look.sun)
    values = {
        "sun_elevation_deg": math.degrees(math.asin(min(up, 1.0))),
        "sun_azimuth_deg": math.degrees(math.atan2(north, east)) % 360,
        **{name: value for name, value in vars(look).items() if name not in ("sun", "texture_seed")},
    }
    return {
        **{name: round(float(value), DECIMALS) for name, value in values.items()},
        "texture_seed": look.texture_seed,
    }


def same_look(one: dict[str, float], other: dict[str, float]) -> bool:
    """Return whether two records of look_values are of the same look."""
    if one.keys() != other.keys():
        return False
    turned = abs(one["sun_azimuth_deg"] - other["sun_azimuth_deg"]) % 360
    rest = (abs(one[name] - other[name]) for name in one if name != "sun_azimuth_deg")
    return max(min(turned, 360 - turned), *rest) <= SAME_LOOK
