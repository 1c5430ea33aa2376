"""From geometry to radiance: regolith and rock under sun, sky and dust.

Deferred: the light of a pixel is a function of what it sees (position, normal, surface), so both eyes see one world and
the ground truth stays exact. Radiance is linear RGB, relative to a white Lambert surface under the sun at zenith
without air.
"""

from __future__ import annotations

import numpy as np

from marssim.render.gbuffer import GROUND
from marssim.render.texture import fractal
from marssim.scene.scene import Look, Scene

GROUND_COLOUR = np.array([0.40, 0.262, 0.158], dtype=np.float32)
ROCK_COLOUR = np.array([0.265, 0.205, 0.158], dtype=np.float32)
DUST_SCALE_HEIGHT = 10_800.0  # [m]
RELIEF_WAVELENGTHS = 0.014 * 2.0 ** np.arange(6)  # [m] below the ground's grid
STAIN_WAVELENGTHS = np.array([0.03, 0.09, 0.4, 1.7, 7.0])  # [m]
ROCK_WAVELENGTHS = np.array([0.012, 0.03, 0.08, 0.2])  # [m]


class Shader:
    """Radiance of surface points and sky of one Scene."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.look = scene.look
        self.sun_light, self.sky_light = _light(self.look)
        self._rock_albedo = np.concatenate([[1.0], scene.rocks.albedo]).astype(np.float32)

    def surface(
        self,
        points: np.ndarray,
        normals: np.ndarray,
        surface: np.ndarray,
        eye: np.ndarray,
        lit: np.ndarray,
        focal: float,
    ) -> np.ndarray:
        """(N, 3) float32 radiance towards the eye.

        points: (N, 3) world [m]; normals: (N, 3) shading normals, world; surface: (N,) ids (GROUND, rock n + 1);
        eye: (3,) world; lit: (N,) in [0, 1], share of the sun that is seen; focal [px] gives the pixel footprint.
        """
        view = (eye - points).astype(np.float32)
        distance = np.sqrt(np.einsum("ij,ij->i", view, view))
        view /= distance[:, None]
        normals = normals.astype(np.float32)
        slant = np.clip(np.einsum("ij,ij->i", normals, view), 0.08, 1).astype(np.float32)
        footprint = distance / focal / slant**0.6
        albedo = np.empty((len(points), 3), dtype=np.float32)
        bumped = np.empty_like(normals)
        ground = surface == GROUND
        for part, shade in ((ground, self._ground), (~ground, self._rocks)):
            index = np.flatnonzero(part)
            if len(index):
                albedo[index], bumped[index] = shade(points[index], normals[index], surface[index], footprint[index])
        radiance = self._reflect(albedo, bumped, normals, view, lit.astype(np.float32))
        clear = np.exp(-distance * self.look.optical_depth / DUST_SCALE_HEIGHT).astype(np.float32)[:, None]
        return radiance * clear + self.sky(-view) * (1 - clear)

    def sky(self, directions: np.ndarray) -> np.ndarray:
        """(N, 3) float32 radiance of the sky along unit directions (N, 3), world frame.

        Butterscotch, paler and brighter towards the horizon and around the sun, where dust scatters forward.
        """
        directions = directions.astype(np.float32)
        up = np.clip(directions[:, 2], 0, 1)
        towards_sun = np.clip(np.einsum("ij,j->i", directions, self.look.sun.astype(np.float32)), -1, 1)
        horizon = np.exp(-up / 0.25)[:, None]
        zenith_colour = np.array([0.36, 0.27, 0.18], dtype=np.float32)
        horizon_colour = np.array([0.50, 0.41, 0.29], dtype=np.float32)
        base = zenith_colour + (horizon_colour - zenith_colour) * horizon
        halo = 0.9 * np.exp(-np.arccos(towards_sun) / 0.22) + 0.35 * ((1 + towards_sun) / 2) ** 4
        strength = 0.5 + 1.1 * self.sky_light
        glow = halo[:, None] * np.array([0.42, 0.40, 0.38], dtype=np.float32) * self.look.optical_depth
        return (strength * (base * (0.85 + 0.5 * self.look.optical_depth) + glow)).astype(np.float32)

    def _ground(
        self, points: np.ndarray, normals: np.ndarray, surface: np.ndarray, footprint: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        strength, contrast = self.look.texture_strength, self.look.albedo_contrast
        slope = 0.115 * strength * (RELIEF_WAVELENGTHS / 0.1) ** -0.25
        relief, tilt = fractal(points[:, :2], footprint, RELIEF_WAVELENGTHS, slope, slope, self.look.texture_seed)
        stain, _ = fractal(
            points[:, :2], footprint, STAIN_WAVELENGTHS, np.array([0.05, 0.05, 0.06, 0.07, 0.08]) * contrast,
            None, self.look.texture_seed + 1,
        )  # fmt: skip
        # coarse grains gather in the troughs and are darker; fine dust lies on the crests
        brightness = np.exp(np.clip(stain + 0.25 * contrast * relief, -0.9, 0.9))[:, None]
        hue = 1 + np.clip(stain, -0.5, 0.5)[:, None] * np.array([0.0, 0.10, 0.22], dtype=np.float32)
        assert tilt is not None
        bumped = normals.copy()
        bumped[:, :2] -= tilt
        return GROUND_COLOUR * brightness * hue, _unit(bumped)

    def _rocks(
        self, points: np.ndarray, normals: np.ndarray, surface: np.ndarray, footprint: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        strength, contrast = self.look.texture_strength, self.look.albedo_contrast
        # flat coordinates on the plane that the surface faces most
        axis = np.abs(normals).argmax(axis=1)
        first, second = np.array([1, 0, 0])[axis], np.array([2, 2, 1])[axis]
        rows = np.arange(len(points))
        uv = np.stack([points[rows, first], points[rows, second]], axis=1) + 0.37 * surface[:, None]
        slope = 0.17 * strength * (ROCK_WAVELENGTHS / 0.1) ** -0.15
        value, tilt = fractal(
            uv, footprint, ROCK_WAVELENGTHS, np.array([0.06, 0.07, 0.08, 0.08]), slope, self.look.texture_seed + 2
        )
        assert tilt is not None
        bumped = normals.copy()
        bumped[rows, first] -= tilt[:, 0]
        bumped[rows, second] -= tilt[:, 1]
        dust = np.clip((normals[:, 2] - 0.75) / 0.35 - 2 * value, 0, 0.75)[:, None]
        bare = ROCK_COLOUR * self._rock_albedo[surface][:, None] * np.exp(contrast * value)[:, None] * 1.25
        return bare * (1 - dust) + 0.85 * GROUND_COLOUR * dust, _unit(bumped)

    def _reflect(
        self, albedo: np.ndarray, bumped: np.ndarray, smooth: np.ndarray, view: np.ndarray, lit: np.ndarray
    ) -> np.ndarray:
        """Sun by a mixture of Lambert and Lommel-Seeliger with a backscatter lobe; sky by how much of it is seen."""
        sun = self.look.sun.astype(np.float32)
        cos_in = np.maximum(np.einsum("ij,j->i", bumped, sun), 0)
        cos_in *= np.clip(
            np.einsum("ij,j->i", smooth, sun) * 12, 0, 1
        )  # relief that lies in attached shadow gets no sun
        cos_out = np.maximum(np.einsum("ij,ij->i", bumped, view), 0.05)
        phase = np.einsum("ij,j->i", view, sun)
        backscatter = 0.86 + 0.32 * ((1 + phase) / 2) ** 3
        reflectance = (0.55 * cos_in + 0.9 * cos_in / (cos_in + cos_out + 1e-3)) * backscatter
        open_sky = 0.5 + 0.5 * bumped[:, 2]
        direct = (reflectance * lit)[:, None] * self.sun_light
        sky_colour = np.array([1.0, 0.86, 0.70], dtype=np.float32)
        bounce = (0.18 * (1 - open_sky))[:, None] * self.sun_light * float(self.look.sun[2]) * GROUND_COLOUR / 0.27
        return albedo * (direct + self.sky_light * open_sky[:, None] * sky_colour + bounce)


def _light(look: Look) -> tuple[np.ndarray, float]:
    """Sunlight (3,) and skylight on level ground. Dust scatters forward: only half of what it removes is lost."""
    path = look.optical_depth / max(float(look.sun[2]), 0.06)
    red, green, blue = np.exp(-path * np.array([0.42, 0.46, 0.52]))
    sky = 0.42 * (1 - np.exp(-0.75 * path)) * max(float(look.sun[2]), 0.12) ** 0.75
    return np.array([red, green, blue], dtype=np.float32), float(sky)


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.sqrt(np.maximum(np.einsum("ij,ij->i", v, v), 1e-12))[:, None]
