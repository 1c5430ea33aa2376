"""The albedo of regolith and rock at a point.

These kernels are inlined into that of shading.py; materials.py prepares their inputs. Surface coordinates are in
metres; footprint is the width of a pixel on the surface [m]. Constants are wrapped so that float32 stays float32.
"""

from __future__ import annotations

import math

import numpy as np

from marssim.base.compute.compiled import inlined
from marssim.render.relief.plates import plate_look_at
from marssim.render.relief.stones.bodies import SAND_STONES
from marssim.scene.ground.noise import octave_value, octave_weight

GROUND_COLOUR = (0.40, 0.262, 0.158)
ROCK_COLOUR = (0.265, 0.205, 0.158)
BED_COLOUR = (0.45, 0.335, 0.235)
ROCK_SCALE = 1.25  # brightness of a rock of albedo 1 over ROCK_COLOUR
STAIN_HUE = (0.0, 0.10, 0.22)  # how much more a stain changes each colour than red: bright stains are paler
WHITEST = 0.9  # largest albedo of any surface
BED_PALE = 0.8  # share of BED_COLOUR that bare bedrock shows: dust lies on it
RELIEF_HEIGHT = 0.004  # [m] height of the fine relief that changes the brightness by RELIEF_TONE times the contrast
RELIEF_TONE = 0.02  # coarse dark grains gather in troughs
STONE_TONE = 0.22  # logarithm of brightness per standard deviation of stones' tones
HIDDEN_AT, HIDDEN_MOST = 0.02, 0.7  # [m] width of a pixel at which most stones are too small; share of their tone
DUST_EDGE = 1.3  # steepness of the borders of patches of dust on sand
DUST = 0.85  # brightness of the dust on rocks over that of the ground


@inlined
def regolith_at(x, y, footprint, stone, pattern, fine, bare, cover, mix, stains, tones, plates, placed):
    """Return the albedo (red, green, blue) of the ground.

    stone, fine, bare: of gbuffer.Hits.detail; pattern: of flat_stone; cover: (sand, gravel) of height.cover_at; mix,
    stains, tones, plates: of materials.Soil; placed: Tile of the plates.
    """
    zero, one, half = np.float32(0), np.float32(1), np.float32(0.5)
    sand, gravel = cover
    contrast = mix.contrast
    spots = _stains_at(x, y, footprint, stains)
    height = fine * np.float32(1 / RELIEF_HEIGHT)
    tone, soil = np.float32(RELIEF_TONE) * contrast * height, zero
    if stone >= 0:
        tone = mix.pebble_tone + np.float32(STONE_TONE) * contrast * tones[np.int32(stone)]
    else:
        soil = (one - bare) * mix.soil_tone
        tone += soil
        # stones too small to stand out still change the ground's brightness
        hidden = mix.hidden_bare * (one - np.float32(SAND_STONES) * sand) + mix.hidden_gravel * gravel
        tone += (
            min(hidden * footprint * np.float32(1 / HIDDEN_AT), one)
            * np.float32(HIDDEN_MOST)
            * (mix.pebble_tone - soil)
        )
        patch = min(max(height * np.float32(DUST_EDGE), -one), one)
        tone += mix.dust_tone * contrast * sand * patch
        flat, covered = pattern
        if flat >= 0:
            tone += covered * (mix.pebble_tone + np.float32(STONE_TONE) * contrast * tones[flat] - tone)
            bare, soil = bare * (one - covered), soil * (one - covered)
    if bare > zero and stone < 0:
        plate_tone, crack = plate_look_at(plates, placed, x, y, footprint)
        tone += bare * (plate_tone * min(contrast, one) - crack * half)
    else:
        bare = zero
    # coarse dark grains gather in the troughs; fine bright dust lies on the crests; dark sand is greyer than dust
    hue = min(max(spots + half * tone - soil, -half), half)
    brightness = math.exp(min(max(spots + tone, np.float32(-1.5)), np.float32(1.2)))
    pale = bare * np.float32(BED_PALE) * min(contrast, one)
    red = (np.float32(GROUND_COLOUR[0]) + pale * np.float32(BED_COLOUR[0] - GROUND_COLOUR[0])) * brightness
    green = (np.float32(GROUND_COLOUR[1]) + pale * np.float32(BED_COLOUR[1] - GROUND_COLOUR[1])) * brightness
    blue = (np.float32(GROUND_COLOUR[2]) + pale * np.float32(BED_COLOUR[2] - GROUND_COLOUR[2])) * brightness
    green *= one + hue * np.float32(STAIN_HUE[1])
    blue *= one + hue * np.float32(STAIN_HUE[2])
    most = np.float32(WHITEST)
    return min(red, most), min(green, most), min(blue, most)


@inlined
def _stains_at(x, y, footprint, stains):
    """Return the logarithm of the stains' brightness."""
    tile, places, amplitude, _ = stains
    spots = np.float32(0)
    for octave in range(len(places)):
        weight = octave_weight(places[octave, 0], footprint)
        if weight > 0:
            spots += amplitude[octave] * weight * octave_value(tile, places, octave, x, y)
    return spots


@inlined
def rock_at(stain, up, contrast, rock):
    """Return the albedo (red, green, blue) of a rock. Dust lies on it, most of it on top.

    stain: logarithm of its brightness; up: z of its normal; contrast: Look.albedo_contrast; rock: of ROCK.
    """
    dust = min(max((rock.film * (0.7 + 0.5 * up) + 1.2 * max(up - 0.6, 0.0)) * (1 - 1.5 * stain), 0.0), 0.8)
    bare = rock.albedo * math.exp(np.float32(contrast * rock.stains * stain)) * ROCK_SCALE * (1 - dust)
    red = ROCK_COLOUR[0] * bare * (1 + 0.10 * rock.red) + DUST * GROUND_COLOUR[0] * dust
    green = ROCK_COLOUR[1] * bare + DUST * GROUND_COLOUR[1] * dust
    blue = ROCK_COLOUR[2] * bare * (1 - 0.16 * rock.red) + DUST * GROUND_COLOUR[2] * dust
    return min(red, WHITEST), min(green, WHITEST), min(blue, WHITEST)
