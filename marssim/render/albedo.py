"""What the light falls on: how bright regolith and rock are at a place, and which way their fine relief leans."""

from __future__ import annotations

import math

import numpy as np

from marssim.compiled import inlined
from marssim.render.pavement import pavement_at
from marssim.render.regolith import WIDEST, grit_at
from marssim.render.texture import fractal_slopes, octave_slopes, octave_value, octave_weight

GROUND_COLOUR = (0.40, 0.262, 0.158)
ROCK_COLOUR = (0.265, 0.205, 0.158)
BED_COLOUR = (0.45, 0.335, 0.235)
STAIN_HUE = (0.0, 0.10, 0.22)
PATCHES = 2  # the coarsest stains also tell sand from gravel and from bedrock
FAR_STONES = 8.0  # how much larger than pebbles the stones are that stand for the rocks which the mesh leaves out
FAR_FROM, FAR_TO = 1.0, 1.25  # half sides of the fine square: within it the mesh leaves none of that size out
WHITEST = 0.9  # the most light that any surface gives back


@inlined
def regolith_at(
    x, y, footprint, contrast, tile, places, slope, spot_tile, spot_places, spot_amplitude, grit_tile, strong,
    ripple_tile, ripple_places, plates, bare, far, drift, rubble,
):  # fmt: skip
    """Albedo of the ground, slopes of its fine relief along x and y, and share of the sun that reaches it.

    far: how much of the stones shows that the mesh leaves out at this place; drift, rubble: of surroundings.
    """
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
    # wind keeps some patches clean of all but sand, which it ripples, and leaves pebbles on others; bedrock lies bare
    # in the midst of those
    sand = _step(patch * np.float32(0.55) + np.float32(2) * strong[4] - one)
    rock, bed_tone, crack = zero, zero, zero
    if bare[3] > 0:
        swept = _swept(patch, bare[3]) + np.float32(0.6) * height
        if swept > 0:
            bu, bv, bed_tone, crack, cover = pavement_at(plates, x, y, footprint, bare[0], bare[1], bare[2])
            rock = min(max(np.float32(5) * (swept - cover) * (one - drift), zero), one)
            sand *= one - rock
    gravel = strong[3] * (one - np.float32(0.9) * max(sand, drift))
    gravel += rubble * (one - gravel)
    gravel *= one - np.float32(0.8) * rock
    smooth = (one - np.float32(0.7) * max(sand, drift)) * (one - np.float32(0.75) * rock)
    du, dv = du * smooth, dv * smooth
    if rock > 0:
        steep = rock * min(strong[5], one)
        du, dv = du + steep * bu, dv + steep * bv
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
    if far > 0:
        less = np.float32(1 / FAR_STONES)
        _, _, stone, dark, _ = grit_at(grit_tile, x * less, y * less, footprint * less, strong[0], strong[1], zero)
        tone += far * stone
        shade *= one - far * dark
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
    tone += np.float32(0.15) * contrast * bright + rock * bed_tone * min(contrast, one)
    shade *= one - rock * crack
    # coarse grains gather in the troughs and are darker; fine dust lies on the crests
    hue = min(max(spots + np.float32(0.5) * tone, np.float32(-0.5)), np.float32(0.5))
    brightness = math.exp(np.float32(min(max(spots + tone + 0.25 * contrast * height, -1.5), 1.2)))
    pale = rock * np.float32(0.8) * min(contrast, one)
    red = (GROUND_COLOUR[0] + pale * (BED_COLOUR[0] - GROUND_COLOUR[0])) * brightness * (1 + hue * STAIN_HUE[0])
    green = (GROUND_COLOUR[1] + pale * (BED_COLOUR[1] - GROUND_COLOUR[1])) * brightness * (1 + hue * STAIN_HUE[1])
    blue = (GROUND_COLOUR[2] + pale * (BED_COLOUR[2] - GROUND_COLOUR[2])) * brightness * (1 + hue * STAIN_HUE[2])
    return min(red, WHITEST), min(green, WHITEST), min(blue, WHITEST), du, dv, shade


@inlined
def _swept(patch, bedrock):
    """How bare of sand the ground lies: above 1 all plates show, below 0 none. patch: of about 1.4 times unit standard
    deviation; bedrock: of Look."""
    return np.float32(-0.45) * patch + np.float32(1.8) * bedrock - np.float32(0.45)


@inlined
def _step(value):
    """From 0 at -1/2 to 1 at 1/2, smoothly."""
    share = min(max(value + np.float32(0.5), np.float32(0)), np.float32(1))
    return share * share * (np.float32(3) - np.float32(2) * share)


@inlined
def rock_at(u, v, up, above, beds, albedo, warm, film, footprint, contrast, tile, places, amplitude, slope):
    """Albedo of a rock with dust on it, most on its top, and sand against its foot, slopes of its fine relief along u
    and v, and how much of it is sand.

    above: height above the sand that lies against it, over that of the sand; beds: how much finer its relief is along
    v than along u; warm: how much redder than the mean it is, about -1 to 1; film: share of its sides under dust.
    """
    value, du, dv = fractal_slopes(tile, places, amplitude, slope, u, v * (1 + beds), footprint * (1 + beds / 2))
    sand = _step(np.float32(-1.5) * above - 3 * value)
    dust = min(max((film * (0.7 + 0.5 * up) + 1.2 * max(up - 0.6, 0.0)) * (1 - 3 * value), 0.0), 0.8)
    dust += sand * (1 - dust)
    bare = albedo * math.exp(np.float32(contrast * value)) * 1.25 * (1 - dust)
    red = ROCK_COLOUR[0] * bare * (1 + 0.10 * warm) + (0.85 + 0.15 * sand) * GROUND_COLOUR[0] * dust
    green = ROCK_COLOUR[1] * bare + (0.85 + 0.15 * sand) * GROUND_COLOUR[1] * dust
    blue = ROCK_COLOUR[2] * bare * (1 - 0.16 * warm) + (0.85 + 0.15 * sand) * GROUND_COLOUR[2] * dust
    # some faces are smooth and some are pitted
    smooth = (1 - sand) * min(max(0.75 + 2.5 * value, 0.25), 1.25)
    return min(red, WHITEST), min(green, WHITEST), min(blue, WHITEST), du * smooth, dv * smooth, sand
