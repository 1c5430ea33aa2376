"""From geometry to radiance: regolith and rock under sun, sky and dust.

Deferred: the light of a pixel is a function of what it sees (position, normal, surface), so both eyes see one world and
the ground truth stays exact. Radiance is linear RGB, relative to a white Lambert surface under the sun at zenith
without air.
"""

from __future__ import annotations

import math

import numpy as np

from marssim.compiled import compiled
from marssim.render.albedo import FAR_FROM, FAR_TO, GROUND_COLOUR, regolith_at, rock_at
from marssim.render.daylight import daylight, skies, sky_colour
from marssim.render.gbuffer import GROUND
from marssim.render.pavement import SIDE, plates
from marssim.render.pavement import VARIANTS as PLATE_VARIANTS
from marssim.render.pyramid import CODES
from marssim.render.regolith import TONES, VARIANTS, grit, ripple_tile
from marssim.render.surroundings import surroundings, surroundings_at
from marssim.render.texture import coded_tile, placing
from marssim.scene.rocks import ground_plane
from marssim.scene.scene import Scene

SKY_COLOUR = (1.0, 0.86, 0.70)  # of the light that the sky throws on the ground
DUST_SCALE_HEIGHT = 10_800.0  # [m]
THIN = 8e-4  # optical depth of dust too thin to show: it changes the image by an eighth of a grey level
RELIEF_WAVELENGTHS = 0.035 * 2.0 ** np.arange(4)  # [m] between the pebbles' tile and the ground's grid
STAIN_WAVELENGTHS = np.array([0.4, 1.7, 7.0])  # [m]
RIPPLE_WAVELENGTHS = (0.06, 0.15)  # [m]
FILLET = (0.03, 0.2)  # of a rock's height, up to which sand lies against it
ROCK_WAVELENGTHS = np.array([0.009, 0.02, 0.05, 0.14])  # [m]
STAIN = np.array([0.07, 0.07, 0.08])  # amplitude of each wavelength, at an albedo contrast of 1
ROCK_STAIN = np.array([0.15, 0.12, 0.10, 0.12])
FAR_DENSE = 0.2  # rock abundance at which the stones that the mesh leaves out show as much as their tile has
AHEAD = 0.9  # of skylight on a wall that faces a sun at the horizon, how much more than its mean over all walls
LEAST_SKY = 0.2  # of the mean, on a wall that faces away
NO_PLATES = np.zeros((1, 5), dtype=np.int8)


class Shader:
    """Radiance of surface points and sky of one Scene."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.look = look = scene.look
        self.sun_light, self.sky_light = daylight(look)
        self._rock_albedo = np.concatenate([[1.0], scene.rocks.albedo])
        relief = 0.085 * look.texture_strength * (RELIEF_WAVELENGTHS / 0.05) ** -0.35
        rock = 0.10 * look.texture_strength * (ROCK_WAVELENGTHS / 0.1) ** -0.25
        seed = look.texture_seed
        variant = VARIANTS * np.arange(3) + seed % VARIANTS  # few tiles, made once; places differ by the whole seed
        self._relief = coded_tile(int(variant[0])), placing(tuple(RELIEF_WAVELENGTHS), seed), _single(relief)
        self._stain = (
            coded_tile(int(variant[1]), False),
            placing(tuple(STAIN_WAVELENGTHS), seed + 1),
            _single(STAIN * look.albedo_contrast),
        )
        self._rock = (
            coded_tile(int(variant[2])),
            placing(tuple(ROCK_WAVELENGTHS), seed + 2),
            _single(ROCK_STAIN),
            _single(rock),
        )
        rng = np.random.default_rng((seed, 3))
        turn = rng.uniform(0, 2 * np.pi)
        pebble_tone = float(np.log(0.9 * scene.config.rocks.albedo))
        tile = grit(seed, turn, look.sun, pebble_tone)
        strong = np.array([
            np.cos(turn), np.sin(turn), rng.uniform(0, 1000), look.pebbles, look.wind_ripples, look.texture_strength,
            tile[-1, 2] * TONES / CODES, tile[-1, 3] / CODES,
        ], dtype=np.float32)  # fmt: skip
        self._grit = tile, strong
        wavelength = float(np.exp(rng.uniform(*np.log(RIPPLE_WAVELENGTHS))))
        self._ripples = ripple_tile(seed % VARIANTS), placing((wavelength,), seed + 3)
        _, cosine, sine = (float(value) for value in self._ripples[1][0, :3])
        far = min(scene.config.rocks.k / FAR_DENSE, 1.0) * min(look.albedo_contrast, 1.0)
        self._near = surroundings(scene.rocks, scene.half, (cosine, -sine)), np.float32(scene.half), np.float32(far)
        self._rock_foot = self._feet(rng)
        placed = np.random.default_rng((seed, 4))
        turn = placed.uniform(0, 2 * np.pi)
        bare = np.array([np.cos(turn), np.sin(turn), placed.uniform(0, SIDE), look.bedrock], dtype=np.float32)
        self._bedrock = plates(seed % PLATE_VARIANTS) if look.bedrock > 0 else NO_PLATES, bare

    def _feet(self, rng: np.random.Generator) -> np.ndarray:
        """(N + 1, 7) of each surface: z = a + b x + c y of the plane under a rock, height of the sand against it [m],
        how much its faces show of beds, 0 to 1, how red it is, -1 to 1, and how much dust clings to it, 0 to 1."""
        rocks = self.scene.rocks
        x, y = rocks.centre[:, 0], rocks.centre[:, 1]
        z, slope = ground_plane(rocks.centre[:, :2], rocks.diameter, self.scene.terrain.height_at)
        b, c = slope.T
        sand = np.minimum(rocks.height * rng.uniform(*FILLET, len(rocks)), 0.06)
        beds = self.look.bedding * rng.uniform(0.4, 1, len(rocks))
        warm = np.clip(rng.normal(0, 0.6, len(rocks)), -1, 1) * min(self.look.albedo_contrast, 1.0)
        film = self.look.rock_dust * rng.uniform(0, 1, len(rocks))
        return np.concatenate([np.zeros((1, 7)), np.stack([z - b * x - c * y, b, c, sand, beds, warm, film], axis=1)])

    def surface(
        self,
        points: np.ndarray,
        normals: np.ndarray,
        surface: np.ndarray,
        eye: np.ndarray,
        lit: np.ndarray,
        focal: float,
        at: np.ndarray | None = None,
        out: np.ndarray | None = None,
    ) -> np.ndarray:
        """(N, 3) float32 radiance towards the eye.

        points: (N, 3) world [m]; normals: (N, 3) shading normals, world; surface: (N,) ids (GROUND, rock n + 1);
        eye: (3,) world; lit: (N,) in [0, 1], share of the sun that is seen; focal [px] gives the pixel footprint.
        at: (M,) int32, of which of them the points are, which are then (M, 3); out: (N, 3) float32, written there only.
        """
        if at is None:
            at = np.arange(len(points), dtype=np.int32)
        if out is None:
            out = np.zeros((len(surface), 3), dtype=np.float32)
        _surface(
            np.ascontiguousarray(points, dtype=np.float64), at, np.ascontiguousarray(normals, dtype=np.float32),
            np.ascontiguousarray(surface, dtype=np.int32), np.asarray(eye, dtype=np.float64),
            np.ascontiguousarray(lit, dtype=np.float32), float(focal), self._rock_albedo, self.look.albedo_contrast,
            self._relief, self._stain, self._rock, self._rock_foot, self._grit, self._ripples, self._bedrock,
            self._near, self.look.sun, self.sun_light, self.sky_light, self.look.optical_depth, out,
        )  # fmt: skip
        return out

    def sky(self, directions: np.ndarray) -> np.ndarray:
        """(N, 3) float32 radiance of the sky along unit directions (N, 3), world frame.

        Butterscotch, paler and brighter towards the horizon and around the sun, where dust scatters forward.
        """
        directions = np.ascontiguousarray(directions, dtype=np.float64)
        return skies(directions, self.look.sun, self.sky_light, self.look.optical_depth)


@compiled
def _surface(
    points, at, normals, surface, eye, lit, focal, rock_albedo, contrast, relief, stain, rock, rock_foot, pebbles,
    ripples, bedrock, around, sun, sun_light, sky_light, optical_depth, out,
):  # fmt: skip
    """Sun by a mixture of Lambert and Lommel-Seeliger with a backscatter lobe; sky by how much of it is seen."""
    relief_tile, relief_places, relief_slope = relief
    stain_tile, stain_places, stain_amplitude = stain
    rock_tile, rock_places, rock_amplitude, rock_slope = rock
    grit_tile, strong = pebbles
    ripple_tile, ripple_places = ripples
    bed_tile, bare = bedrock
    near_map, near_half, far_stones = around
    sx, sy, sz = sun[0], sun[1], sun[2]
    ahead = AHEAD * math.sqrt(max(1 - sz * sz, 0.0))
    sun_red, sun_green, sun_blue = float(sun_light[0]), float(sun_light[1]), float(sun_light[2])
    for k in range(len(points)):
        m = at[k]
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        mx, my, mz = float(normals[m, 0]), float(normals[m, 1]), float(normals[m, 2])
        vx, vy, vz = eye[0] - x, eye[1] - y, eye[2] - z
        distance = math.sqrt(vx * vx + vy * vy + vz * vz)
        near = 1 / distance
        vx, vy, vz = vx * near, vy * near, vz * near
        slant = min(max(mx * vx + my * vy + mz * vz, 0.08), 1.0)
        # geometric mean of the two axes of the ellipse that a pixel covers
        footprint = np.float32(distance / (focal * math.sqrt(slant)))
        nx, ny, nz = mx, my, mz
        open_sun, hidden = np.float32(1), np.float32(0)
        if surface[m] == GROUND:
            hidden, drift, rubble = surroundings_at(near_map, near_half, np.float32(x), np.float32(y))
            beyond = (np.float32(max(abs(x), abs(y))) / near_half - np.float32(FAR_FROM)) * np.float32(
                1 / (FAR_TO - FAR_FROM)
            )
            far = far_stones * min(max(beyond, np.float32(0)), np.float32(1))
            red, green, blue, du, dv, open_sun = regolith_at(
                np.float32(x), np.float32(y), footprint, contrast, relief_tile, relief_places, relief_slope,
                stain_tile, stain_places, stain_amplitude, grit_tile, strong, ripple_tile, ripple_places, bed_tile,
                bare, far, drift, rubble,
            )  # fmt: skip
            nx, ny = nx - du, ny - dv
        else:
            # flat coordinates on the plane that the surface faces most
            across = 2
            if abs(mx) >= abs(my) and abs(mx) >= abs(mz):
                across = 0
            elif abs(my) >= abs(mz):
                across = 1
            shift = 0.37 * surface[m]
            foot = rock_foot[surface[m]]
            above = (z - foot[0] - foot[1] * x - foot[2] * y) / max(foot[3], 1e-3) - 1
            red, green, blue, du, dv, sand = rock_at(
                np.float32((y if across == 0 else x) + shift), np.float32((y if across == 2 else z) + shift), mz,
                np.float32(min(max(above, -1.0), 9.0)), np.float32(0.0 if across == 2 else 5 * foot[4]),
                rock_albedo[surface[m]], foot[5], foot[6], footprint, contrast, rock_tile, rock_places, rock_amplitude,
                rock_slope,
            )  # fmt: skip
            if across == 0:
                ny, nz = ny - du, nz - dv
            elif across == 1:
                nx, nz = nx - du, nz - dv
            else:
                nx, ny = nx - du, ny - dv
            nx, ny, nz = nx * (1 - 0.6 * sand), ny * (1 - 0.6 * sand), nz + 0.5 * sand
        unit = 1 / math.sqrt(max(nx * nx + ny * ny + nz * nz, 1e-12))
        nx, ny, nz = nx * unit, ny * unit, nz * unit
        cos_in = max(nx * sx + ny * sy + nz * sz, 0.0)
        # relief that lies in attached shadow gets no sun
        cos_in *= min(max((mx * sx + my * sy + mz * sz) * 12, 0.0), 1.0)
        cos_out = max(nx * vx + ny * vy + nz * vz, 0.05)
        back = (1 + vx * sx + vy * sy + vz * sz) / 2
        direct = (
            (0.55 * cos_in + 0.9 * cos_in / (cos_in + cos_out + 1e-3))
            * (0.86 + 0.32 * back * back * back)
            * (lit[m] * open_sun)
        )
        open_sky = (0.5 + 0.5 * nz) * (1 - hidden)
        bounce = 0.18 * (1 - open_sky) * sz / 0.27
        # dust scatters forward, so that the sky is brighter on the sun's side: relief shows in shadow, too
        sky = sky_light * open_sky * max(1 + ahead * (nx * sx + ny * sy), LEAST_SKY)
        red *= sun_red * (direct + bounce * GROUND_COLOUR[0]) + sky * SKY_COLOUR[0]
        green *= sun_green * (direct + bounce * GROUND_COLOUR[1]) + sky * SKY_COLOUR[1]
        blue *= sun_blue * (direct + bounce * GROUND_COLOUR[2]) + sky * SKY_COLOUR[2]
        veiled = distance * optical_depth / DUST_SCALE_HEIGHT
        if veiled > THIN:
            veil = 1 - math.exp(-veiled)
            haze_red, haze_green, haze_blue = sky_colour(-vx, -vy, -vz, sun, sky_light, optical_depth)
            red += veil * (haze_red - red)
            green += veil * (haze_green - green)
            blue += veil * (haze_blue - blue)
        out[m, 0], out[m, 1], out[m, 2] = red, green, blue


def _single(values: np.ndarray) -> np.ndarray:
    return values.astype(np.float32)
