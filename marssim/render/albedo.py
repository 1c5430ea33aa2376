"""What the light falls on: how bright regolith and rock are at a place, and which way their fine relief leans."""

from __future__ import annotations

import math

import numpy as np

from marssim.compiled import inlined
from marssim.render.regolith import WIDEST, grit_at
from marssim.render.texture import fractal_slopes, octave_slopes, octave_value, octave_weight

GROUND_COLOUR = (0.40, 0.262, 0.158)
ROCK_COLOUR = (0.265, 0.205, 0.158)
STAIN_HUE = (0.0, 0.10, 0.22)
PATCHES = 2  # the coarsest stains also tell sand from gravel


@inlined
def regolith_at(
    x, y, footprint, contrast, tile, places, slope, spot_tile, spot_places, spot_amplitude, grit_tile, strong,
    ripple_tile, ripple_places, drift,
):  # fmt: skip
    """Albedo of regolith, slopes of its fine relief along x and y, and share of the sun that reaches it."""
    zero, one = np.float32(0), np.float32(1)
    spots, patch = zero, zero
    for octave in range(len(spot_places)):
        weight = octave_weight(spot_places[octave, 0], footprint)
        if weight > 0:
            value = weight * octave_value(spot_tile, spot_places, octave, x, y)
            spots += spot_amplitude[octave] * value
            if octave >= len(spot_places) - PATCHES:
                patch += value
    height, du, dv = fractal_slopes(tile, places, slope, slope, x, y, footprint)
    # wind keeps some patches clean of all but sand, which it ripples, and leaves pebbles on others
    sand = _step(patch * np.float32(0.55) + np.float32(2) * strong[4] - one)
    gravel = strong[3] * (one - np.float32(0.9) * max(sand, drift))
    smooth = one - np.float32(0.7) * max(sand, drift)
    du, dv = du * smooth, dv * smooth
    seen = one - footprint * np.float32(1 / WIDEST)
    if seen > 0:
        seen = min(np.float32(2) * seen, one)
        gu, gv, tone, shade, grain = grit_at(grit_tile, x, y, footprint, strong[0], strong[1], strong[2])
        steep = (np.float32(0.15) * strong[3] + gravel) * strong[5] * seen
        du, dv = du + steep * gu, dv + steep * gv
        tone, shade = strong[6] + seen * (tone - strong[6]), strong[7] + seen * (shade - strong[7])
        grain *= seen
    else:
        tone, shade, grain = strong[6], strong[7], zero
    tone = (tone * gravel + np.float32(0.08) * grain) * contrast
    shade = one - shade * gravel * min(strong[5], one)
    bright = drift
    weight = sand * (one - drift) * octave_weight(ripple_places[0, 0], footprint)
    if weight > 0:
        crest, along, across = octave_slopes(ripple_tile, ripple_places, 0, x, y)
        steep = np.float32(0.22) * strong[5] * weight
        du, dv = du + steep * along, dv + steep * across
        # bright dust stays on one side of the crests, with ragged borders
        bright += weight * min(
            max(np.float32(1.3) * crest + np.float32(2) * height + np.float32(1.4) * grain, -one), one
        )
    tone += np.float32(0.15) * contrast * bright
    # coarse grains gather in the troughs and are darker; fine dust lies on the crests
    hue = min(max(spots + np.float32(0.5) * tone, np.float32(-0.5)), np.float32(0.5))
    brightness = math.exp(np.float32(min(max(spots + tone + 0.25 * contrast * height, -1.5), 1.2)))
    red = GROUND_COLOUR[0] * brightness * (1 + hue * STAIN_HUE[0])
    green = GROUND_COLOUR[1] * brightness * (1 + hue * STAIN_HUE[1])
    blue = GROUND_COLOUR[2] * brightness * (1 + hue * STAIN_HUE[2])
    return red, green, blue, du, dv, shade


@inlined
def _step(value):
    """From 0 at -1/2 to 1 at 1/2, smoothly."""
    share = min(max(value + np.float32(0.5), np.float32(0)), np.float32(1))
    return share * share * (np.float32(3) - np.float32(2) * share)


@inlined
def rock_at(u, v, up, above, beds, albedo, footprint, contrast, tile, places, amplitude, slope):
    """Albedo of a rock with dust on its top and sand against its foot, slopes of its fine relief along u and v, and
    how much of it is sand.

    above: height above the sand that lies against it, over that of the sand; beds: how much finer its relief is along
    v than along u.
    """
    value, du, dv = fractal_slopes(tile, places, amplitude, slope, u, v * (1 + beds), footprint * (1 + beds / 2))
    sand = _step(np.float32(-1.5) * above - 3 * value)
    dust = min(max((up - 0.78) / 0.3 - 1.5 * value, 0.0), 0.75)
    dust += sand * (1 - dust)
    bare = albedo * math.exp(np.float32(contrast * value)) * 1.25 * (1 - dust)
    red = ROCK_COLOUR[0] * bare + (0.85 + 0.15 * sand) * GROUND_COLOUR[0] * dust
    green = ROCK_COLOUR[1] * bare + (0.85 + 0.15 * sand) * GROUND_COLOUR[1] * dust
    blue = ROCK_COLOUR[2] * bare + (0.85 + 0.15 * sand) * GROUND_COLOUR[2] * dust
    return red, green, blue, du * (1 - sand), dv * (1 - sand), sand
