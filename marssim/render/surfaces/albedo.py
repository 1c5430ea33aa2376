"""The albedo of regolith and rock at a point, and the slopes of their fine relief.

These kernels are inlined into that of shading.py; materials.py prepares their inputs. Surface coordinates are in
metres; footprint is the width of a pixel on the surface [m]. Constants are wrapped so that float32 stays float32.
"""

from __future__ import annotations

import math

import numpy as np

from marssim.base.compute.compiled import inlined
from marssim.render.surfaces.grain import fractal_slopes, octave_slopes, octave_value, octave_weight
from marssim.render.surfaces.pavement import pavement_at
from marssim.render.surfaces.pyramid import PlacedTile
from marssim.render.surfaces.regolith import WIDEST, grit_at

GROUND_COLOUR = (0.40, 0.262, 0.158)
ROCK_COLOUR = (0.265, 0.205, 0.158)
BED_COLOUR = (0.45, 0.335, 0.235)
STAIN_HUE = (0.0, 0.10, 0.22)  # how much more a stain changes each colour than red: bright stains are paler
WHITEST = 0.9  # largest albedo of any surface
PATCHES = 2  # number of the coarsest stains, which also separate sand, gravel and bedrock
SAND_PEBBLES, SAND_RELIEF = 0.9, 0.7  # shares of the pebbles and of the fine relief's slopes that sand buries
BED_PEBBLES, BED_RELIEF = 0.8, 0.75  # shares of both that bare bedrock lacks
BED_PALE = 0.8  # share of BED_COLOUR that bare bedrock shows: dust lies on it
LOOSE_GRAIN = 0.15  # slope of the ground's grain without pebbles, over that among pebbles
GRAIN_TONE = 0.08  # logarithm of brightness per standard deviation of grain
DUST_TONE = 0.15  # logarithm of brightness of the dust on the crests of ripples and behind rocks
FAR_STONES = 8.0  # size, over that of pebbles, of the painted stones that replace rocks which the mesh leaves out
FAR_FROM, FAR_TO = 2.5, 3.0  # half sides of the fine square between which these stones fade in


@inlined
def regolith_at(x, y, footprint, mix, relief, stains, ripples, pebbles, bedrock, drift, rubble):
    """Return the albedo (red, green, blue) of the ground, the slopes of its fine relief along x and y, and the share
    of sunlight that reaches it.

    mix, relief, stains, ripples, pebbles, bedrock: of materials.Ground; drift, rubble: cover of gathered sand and of
    fragments, 0 to 1 (surroundings_at).
    """
    one = np.float32(1)
    contrast, strength = mix.contrast, mix.strength
    spots, patch = _stains_at(x, y, footprint, stains)
    height, du, dv = fractal_slopes(relief, x, y, footprint)
    bed, bed_tone, crack, bu, bv = _bedrock_at(x, y, footprint, bedrock, mix.swept, patch, height, drift)
    sand, gravel, smooth = _cover(mix, patch, bed, drift, rubble)
    du, dv = du * smooth, dv * smooth
    if bed > 0:
        steep = bed * min(strength, one)
        du, dv = du + steep * bu, dv + steep * bv
    tone, shade, grain, visible, gu, gv = _pebbles_at(x, y, footprint, pebbles, mix)
    if visible > 0:
        steep = (np.float32(LOOSE_GRAIN) * mix.gravel + gravel) * strength * visible
        du, dv = du + steep * gu, dv + steep * gv
    stone, dark = _far_stones_at(x, y, footprint, pebbles, mix)
    dust, along, across = _ripples_at(x, y, footprint, ripples, sand * (one - drift), height, grain)
    du, dv = du + along, dv + across
    tone = (tone * gravel + np.float32(GRAIN_TONE) * grain) * contrast + stone
    tone += np.float32(DUST_TONE) * contrast * (drift + dust) + bed * bed_tone * min(contrast, one)
    shade = (one - shade * gravel * min(strength, one)) * (one - dark) * (one - bed * crack)
    red, green, blue = _ground_colour(spots, tone, height, bed, contrast)
    return red, green, blue, du, dv, shade


@inlined
def _cover(mix, patch, bed, drift, rubble):
    """Return the shares of sand and of gravel, and the share of the fine relief's slopes that they leave.

    The wind keeps some patches covered with rippled sand, and leaves pebbles on others, where bedrock may lie bare.
    patch: of _stains_at; bed: share of bare bedrock. See regolith_at.
    """
    one = np.float32(1)
    sand = _step(patch * np.float32(0.55) + np.float32(2) * mix.sand - one) * (one - bed)
    gravel = mix.gravel * (one - np.float32(SAND_PEBBLES) * max(sand, drift))
    gravel += rubble * (one - gravel)
    gravel *= one - np.float32(BED_PEBBLES) * bed
    smooth = (one - np.float32(SAND_RELIEF) * max(sand, drift)) * (one - np.float32(BED_RELIEF) * bed)
    return sand, gravel, smooth


@inlined
def _far_stones_at(x, y, footprint, pebbles, mix):
    """Return tone and shade of the painted stones that replace, far away, rocks which the mesh leaves out."""
    tone, shade = np.float32(0), np.float32(0)
    beyond = max(abs(x), abs(y)) / mix.half - np.float32(FAR_FROM)
    far = mix.far_stones * min(max(beyond * np.float32(1 / (FAR_TO - FAR_FROM)), np.float32(0)), np.float32(1))
    if far > 0:
        less = np.float32(1 / FAR_STONES)
        stones = PlacedTile(pebbles.codes, pebbles.cosine, pebbles.sine, np.float32(0))
        _, _, stone, dark, _ = grit_at(stones, x * less, y * less, footprint * less)
        tone, shade = far * stone, far * dark
    return tone, shade


@inlined
def _ripples_at(x, y, footprint, ripples, sand, height, grain):
    """Return the cover of bright dust on the wind's ripples, -1 to 1, and the ripples' slopes.

    sand: share of the ground that is rippled; height: of the fine relief; grain: of _pebbles_at.
    """
    one = np.float32(1)
    tile, places, _, slope = ripples
    dust, du, dv = np.float32(0), np.float32(0), np.float32(0)
    weight = sand * octave_weight(places[0, 0], footprint)
    if weight > 0:
        crest, along, across = octave_slopes(tile, places, 0, x, y)
        steep = slope[0] * weight
        du, dv = steep * along, steep * across
        # dust stays on one side of the crests, with ragged borders
        lying = np.float32(1.3) * crest + np.float32(2) * height + np.float32(1.4) * grain
        dust = weight * min(max(lying, -one), one)
    return dust, du, dv


@inlined
def _ground_colour(spots, tone, height, bed, contrast):
    """Return the ground's albedo (red, green, blue).

    spots, tone: logarithms of brightness of the stains, and of all else but the height; height: of the fine relief;
    bed: share of bedrock; contrast: of Mix.
    """
    # coarse dark grains gather in the troughs; fine bright dust lies on the crests
    hue = min(max(spots + np.float32(0.5) * tone, np.float32(-0.5)), np.float32(0.5))
    brightness = math.exp(np.float32(min(max(spots + tone + 0.25 * contrast * height, -1.5), 1.2)))
    pale = bed * np.float32(BED_PALE) * min(contrast, np.float32(1))
    red = (GROUND_COLOUR[0] + pale * (BED_COLOUR[0] - GROUND_COLOUR[0])) * brightness * (1 + hue * STAIN_HUE[0])
    green = (GROUND_COLOUR[1] + pale * (BED_COLOUR[1] - GROUND_COLOUR[1])) * brightness * (1 + hue * STAIN_HUE[1])
    blue = (GROUND_COLOUR[2] + pale * (BED_COLOUR[2] - GROUND_COLOUR[2])) * brightness * (1 + hue * STAIN_HUE[2])
    return min(red, WHITEST), min(green, WHITEST), min(blue, WHITEST)


@inlined
def _stains_at(x, y, footprint, stains):
    """Return the logarithm of the stains' brightness, and the sum of the PATCHES coarsest, of unit variance each."""
    tile, places, amplitude, _ = stains
    spots, patch = np.float32(0), np.float32(0)
    for octave in range(len(places)):
        weight = octave_weight(places[octave, 0], footprint)
        if weight > 0:
            value = weight * octave_value(tile, places, octave, x, y)
            spots += amplitude[octave] * value
            if octave >= len(places) - PATCHES:
                patch += value
    return spots, patch


@inlined
def _bedrock_at(x, y, footprint, bedrock, bareness, patch, height, drift):
    """Return how bare a plate of bedrock lies, 0 to 1, its tone, the share of light that cracks take, and slopes.

    bareness: Look.bedrock; patch: of _stains_at; height: of the fine relief; drift: see regolith_at.
    """
    zero, one = np.float32(0), np.float32(1)
    bare, tone, crack, bu, bv = zero, zero, zero, zero, zero
    if bareness > 0:
        swept = _swept(patch, bareness) + np.float32(0.6) * height
        if swept > 0:
            bu, bv, tone, crack, cover = pavement_at(bedrock, x, y, footprint)
            bare = min(max(np.float32(5) * (swept - cover) * (one - drift), zero), one)
    return bare, tone, crack, bu, bv


@inlined
def _pebbles_at(x, y, footprint, pebbles, mix):
    """Return tone and shade of pebbles, grain, how visible they are, 0 to 1, and their slopes; from afar the means."""
    tone, shade, grain = mix.pebble_tone, mix.pebble_shade, np.float32(0)
    visible, gu, gv = np.float32(1) - footprint * np.float32(1 / WIDEST), np.float32(0), np.float32(0)
    if visible > 0:
        visible = min(np.float32(2) * visible, np.float32(1))
        gu, gv, near_tone, near_shade, near_grain = grit_at(pebbles, x, y, footprint)
        tone += visible * (near_tone - tone)
        shade += visible * (near_shade - shade)
        grain = near_grain * visible
    return tone, shade, grain, visible, gu, gv


@inlined
def _swept(patch, bareness):
    """Return how bare of sand the ground lies: above 1 all plates show, below 0 none.

    patch: of _stains_at, with a standard deviation of about 1.4; bareness: Look.bedrock.
    """
    return np.float32(-0.45) * patch + np.float32(1.8) * bareness - np.float32(0.45)


@inlined
def _step(value):
    """Return a smooth step from 0 at -1/2 to 1 at 1/2."""
    share = min(max(value + np.float32(0.5), np.float32(0)), np.float32(1))
    return share * share * (np.float32(3) - np.float32(2) * share)


@inlined
def rock_at(u, v, up, above, beds, footprint, contrast, noise, rock):
    """Return the albedo (red, green, blue) of a rock, the slopes of its fine relief along u and v, and its sand cover.

    Dust lies on the rock, most of it on top, and sand against its foot. up: z of its normal; above: height above that
    sand, over the sand's height; beds: how much finer its relief is along v than along u; contrast:
    Look.albedo_contrast; noise: of materials.RockSurface; rock: of ROCK.
    """
    value, du, dv = fractal_slopes(noise, u, v * (1 + beds), footprint * (1 + beds / 2))
    sand = _step(np.float32(-1.5) * above - 3 * value)
    dust = min(max((rock.film * (0.7 + 0.5 * up) + 1.2 * max(up - 0.6, 0.0)) * (1 - 3 * value), 0.0), 0.8)
    dust += sand * (1 - dust)
    bare = rock.albedo * math.exp(np.float32(contrast * rock.stains * value)) * 1.25 * (1 - dust)
    red = ROCK_COLOUR[0] * bare * (1 + 0.10 * rock.red) + (0.85 + 0.15 * sand) * GROUND_COLOUR[0] * dust
    green = ROCK_COLOUR[1] * bare + (0.85 + 0.15 * sand) * GROUND_COLOUR[1] * dust
    blue = ROCK_COLOUR[2] * bare * (1 - 0.16 * rock.red) + (0.85 + 0.15 * sand) * GROUND_COLOUR[2] * dust
    # some faces are smooth and some are pitted
    smooth = (1 - sand) * min(max(0.75 + 2.5 * value, 0.25), 1.25)
    return min(red, WHITEST), min(green, WHITEST), min(blue, WHITEST), du * smooth, dv * smooth, sand
