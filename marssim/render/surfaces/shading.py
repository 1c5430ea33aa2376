"""Shading: the radiance of regolith and rock under sun, sky and dust.

It is deferred: the light of a pixel is a function of what the pixel shows (position, normal, surface). So both cameras
see the same world, and the ground truth stays exact. Radiance is linear RGB, relative to a white Lambert surface under
the sun at zenith without air.
"""

from __future__ import annotations

import math

import numpy as np

from marssim.base.compute.compiled import compiled_in_place, inlined, read_only
from marssim.base.dataset.frame import GROUND, ROVER
from marssim.render.geometry.gbuffer import Footprint
from marssim.render.relief.ground import ground_relief
from marssim.render.relief.height import cover_at, footprint_at
from marssim.render.relief.stones.flat import flat_stone
from marssim.render.relief.surroundings import hidden_sky_at
from marssim.render.surfaces.albedo import GROUND_COLOUR, regolith_at, rock_at
from marssim.render.surfaces.daylight import daylight, skies, sky_colour
from marssim.render.surfaces.materials import materials
from marssim.scene.scene import Scene

SKY_COLOUR = (1.0, 0.86, 0.70)  # colour of the light that the sky casts on the ground
DUST_SCALE_HEIGHT = 10_800.0  # [m] scale height of the dust
THIN = 8e-4  # optical depth of dust too thin to show: it changes the image by an eighth of a grey level
AHEAD = 0.9  # excess of skylight over its mean on a wall that faces a sun at the horizon
LEAST_SKY = 0.2  # least skylight over its mean, on a wall that faces away from the sun
LEAST_OUT = 0.05  # least cosine of the viewing angle to the fine relief, which may be turned away from the camera
DUSK = (
    12.0  # sunlight fades over the last twelfth of its cosine on the surface, so that relief catches no light after it
)


class Shader:
    """Computes the radiance of surface points and sky of one scene.

    Attributes:
        scene: The scene.
        light: Its Daylight.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._ground = ground_relief(scene)
        self._soil, self._rocks = materials(scene, self._ground)
        self.light = daylight(scene.look)

    def surface(
        self,
        points: np.ndarray,
        normals: np.ndarray,
        surface: np.ndarray,
        detail: np.ndarray,
        eye: np.ndarray,
        lit: np.ndarray,
        footprint: Footprint,
        at: np.ndarray | None = None,
        out: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the radiance of surface points towards the eye.

        Args:
            points: (N, 3) points, world frame [m]; (M, 3) if `at` is given.
            normals: (N, 3) shading normals, world frame.
            surface: (N,) surface ids: GROUND, ROVER or rock n + 1.
            detail: (N, 4) float32 details of the ground, see gbuffer.Hits.
            eye: (3,) position of the camera, world frame [m].
            lit: (N,) share of the sun that hills and rocks leave free, 0 to 1.
            footprint: The camera that patterns are filtered for.
            at: (M,) int32, the rows of the other arrays that the points belong to; None for all.
            out: (N, 3) float32, in which only these rows are written; None makes a new array.

        Returns:
            (N, 3) float32 radiance, `out` if it is given.
        """
        if at is None:
            at = np.arange(len(points), dtype=np.int32)
        if out is None:
            out = np.zeros((len(surface), 3), dtype=np.float32)
        _surface(
            np.ascontiguousarray(points, dtype=np.float64), at, np.ascontiguousarray(normals, dtype=np.float32),
            np.ascontiguousarray(surface, dtype=np.int32), np.ascontiguousarray(detail, dtype=np.float32),
            np.asarray(eye, dtype=np.float64), np.ascontiguousarray(lit, dtype=np.float32), read_only(footprint.eye),
            footprint.focal, self._ground.data, self._ground.relief.cover, self._ground.relief.plates,
            self._ground.stones, self._soil, self._rocks, self.light, out,
        )  # fmt: skip
        return out

    def sky(self, directions: np.ndarray) -> np.ndarray:
        """Return the radiance of the sky, (N, 3) float32, along unit directions (N, 3), world frame.

        The sky is butterscotch. It is paler and brighter towards the horizon, and around the sun, where dust scatters
        forward.
        """
        return skies(np.ascontiguousarray(directions, dtype=np.float64), self.light)


@compiled_in_place
def _surface(
    points, at, normals, surface, detail, eye, lit, left, focal, data, cover, placed, stones, soil, rocks, light, out
):  # fmt: skip
    """Fill in `out`, see Shader.surface. left: position of the camera that patterns are filtered for."""
    mix, stains, tones, plates, near_rocks, half = soil
    contrast, of_surface = rocks
    sun, sunlight, skylight, optical_depth = light
    sx, sy, sz = sun[0], sun[1], sun[2]
    ahead = AHEAD * math.sqrt(max(1 - sz * sz, 0.0))
    sun_red, sun_green, sun_blue = float(sunlight[0]), float(sunlight[1]), float(sunlight[2])
    for k in range(len(points)):
        m = at[k]
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        nx, ny, nz = float(normals[m, 0]), float(normals[m, 1]), float(normals[m, 2])
        vx, vy, vz = eye[0] - x, eye[1] - y, eye[2] - z
        distance = math.sqrt(vx * vx + vy * vy + vz * vz)
        near = 1 / distance
        vx, vy, vz = vx * near, vy * near, vz * near
        open_sun, hidden = np.float32(1), np.float32(0)
        if surface[m] == GROUND:
            east, north = np.float32(x), np.float32(y)
            hidden = hidden_sky_at(near_rocks, half, east, north)
            sand, _, _, gravel, _ = cover_at(data, cover, east, north)
            footprint = footprint_at(left, focal, x, y, z)
            pattern = flat_stone(data, cover, stones, footprint, east, north)
            red, green, blue = regolith_at(
                east, north, footprint, detail[m, 0], pattern, detail[m, 1], detail[m, 2], (sand, gravel), mix, stains,
                tones, plates, placed,
            )  # fmt: skip
            open_sun = detail[m, 3]
        elif surface[m] == ROVER:
            red, green, blue = float(detail[m, 0]), float(detail[m, 1]), float(detail[m, 2])
        else:
            red, green, blue = rock_at(detail[m, 1], nz, contrast, of_surface[surface[m]])
        unit = 1 / math.sqrt(max(nx * nx + ny * ny + nz * nz, 1e-12))
        nx, ny, nz = nx * unit, ny * unit, nz * unit
        cos_in = max(nx * sx + ny * sy + nz * sz, 0.0)
        if surface[m] != GROUND:
            cos_in *= min(cos_in * DUSK, 1.0)
        direct = _reflected(cos_in, max(nx * vx + ny * vy + nz * vz, LEAST_OUT), vx * sx + vy * sy + vz * sz)
        direct *= lit[m] * open_sun
        sky_side = 0.5 + 0.5 * nz
        open_sky = sky_side * (1 - hidden)
        # level ground under the sun reflects its albedo of the sunlight; the sun shines on half of the sides of rocks
        bounce = mix.soil * (1 - sky_side + 0.5 * hidden * sky_side) * sz
        # dust scatters forward, so the sky is brighter on the sun's side, and relief shows in shadow too
        sky = skylight * open_sky * max(1 + ahead * (nx * sx + ny * sy), LEAST_SKY)
        red *= sun_red * (direct + bounce * GROUND_COLOUR[0]) + sky * SKY_COLOUR[0]
        green *= sun_green * (direct + bounce * GROUND_COLOUR[1]) + sky * SKY_COLOUR[1]
        blue *= sun_blue * (direct + bounce * GROUND_COLOUR[2]) + sky * SKY_COLOUR[2]
        veiled = distance * optical_depth / DUST_SCALE_HEIGHT
        if veiled > THIN:
            veil = 1 - math.exp(-veiled)
            haze_red, haze_green, haze_blue = sky_colour(-vx, -vy, -vz, sun, skylight, optical_depth)
            red += veil * (haze_red - red)
            green += veil * (haze_green - green)
            blue += veil * (haze_blue - blue)
        out[m, 0], out[m, 1], out[m, 2] = red, green, blue


@inlined
def _reflected(cos_in, cos_out, cos_phase):
    """Return the reflected sunlight over that of a white Lambert surface under a sun at zenith.

    It is a mixture of Lambert and Lommel-Seeliger with a backscatter lobe. cos_in, cos_out: cosines of the angles of
    incidence and of view; cos_phase: of the angle between sun and view.
    """
    back = (1 + cos_phase) / 2
    return (0.55 * cos_in + 0.9 * cos_in / (cos_in + cos_out + 1e-3)) * (0.86 + 0.32 * back * back * back)
