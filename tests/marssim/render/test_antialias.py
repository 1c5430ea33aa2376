"""Anti-aliasing compared with its plain definition, pixel by pixel."""

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from marssim.base.camera import PinholeCamera
from marssim.base.dataset.frame import GROUND, SKY
from marssim.render.antialias import SUBPIXELS, average, colours_beside, edge_pixels, subpixel_rays
from marssim.render.geometry.gbuffer import GBuffer

CAMERA = PinholeCamera(9, 7, 20.0, 25.0, 3.6, 2.9)


def random_view(seed: int) -> tuple[GBuffer, np.ndarray, np.ndarray]:
    """Return patches of sky, ground and rocks with jumps of depth, the sunlight, and colours (H * W, 3)."""
    rng = np.random.default_rng(seed)
    shape = (CAMERA.height, CAMERA.width)
    surface = np.where(rng.random(shape) < 0.3, rng.integers(-1, 3, shape), rng.integers(-1, 3)).astype(np.int32)
    depth = (rng.choice([2.0, 2.02, 3.0], shape) * rng.uniform(0.999, 1.001, shape)).astype(np.float32)
    depth[surface == SKY] = np.inf
    empty = np.zeros((*shape, 3), np.float32)
    colour = rng.random((CAMERA.height * CAMERA.width, 3), dtype=np.float32)
    return GBuffer(depth, empty, empty, surface), rng.random(shape) < rng.choice([0.0, 0.9, 1.0]), colour


def borders(shown: np.ndarray) -> np.ndarray:
    """(H, W) bool: pixels beside one with another id, above, below, left or right."""
    around = np.pad(shown, 1, mode="edge")
    beside = around[1:-1, 2:], around[1:-1, :-2], around[2:, 1:-1], around[:-2, 1:-1]
    return np.any([shown != other for other in beside], axis=0)


@given(st.integers(0, 10**6))
def test_edges_are_changes_of_surface_light_and_depth(seed):
    view, lit, _ = random_view(seed)
    inverse = np.where(view.surface == SKY, np.float32(0), np.float32(1) / view.depth)
    kernel = np.ones((3, 3), np.uint8)
    step = cv2.dilate(inverse, kernel) - cv2.erode(inverse, kernel) > np.float32(0.06) * inverse + np.float32(1e-3)
    bent = np.zeros(inverse.shape, bool)
    for across, along in ((bent, inverse), (bent.T, inverse.T)):
        kink = np.abs(along[2:] - 2 * along[1:-1] + along[:-2])
        across[1:-1] |= kink > np.float32(0.1) * along[1:-1] + np.float32(1e-3)
    expected = borders(2 * view.surface + lit) | np.where(view.surface == GROUND, bent, step)
    assert np.array_equal(edge_pixels(view, lit), np.flatnonzero(expected))


@given(st.floats(-75, 75), st.floats(0, 360))
def test_on_ground_a_crest_is_an_edge_and_a_slant_is_none(slant, turn):
    """Planes 1 / Z = a u + b v + c seen as steeply as the ground far away; another one farther begins at row 3."""
    rays, shape = CAMERA.rays(), (CAMERA.height, CAMERA.width)
    steep, turn = np.tan(np.deg2rad(slant)), np.deg2rad(turn)
    inverse = 0.3 * (1 + steep * (np.cos(turn) * rays[..., 0] + np.sin(turn) * rays[..., 1]))
    assume(inverse.min() > 0.05)
    empty, lit = np.zeros((*shape, 3), np.float32), np.ones(shape, bool)
    ground = np.full(shape, GROUND, np.int32)
    plain = GBuffer((1 / inverse).astype(np.float32), empty, empty, ground)
    assert len(edge_pixels(plain, lit)) == 0
    crest = np.where(np.arange(CAMERA.height)[:, None] < 3, 0.8 * inverse, inverse)
    rows, _ = np.divmod(edge_pixels(GBuffer((1 / crest).astype(np.float32), empty, empty, ground), lit), CAMERA.width)
    assert np.array_equal(np.bincount(rows, minlength=7), [0, 0, 9, 9, 0, 0, 0])


def test_one_plain_surface_has_no_edges():
    shape = (CAMERA.height, CAMERA.width)
    depth = np.linspace(2, 2.2, CAMERA.width, dtype=np.float32) * np.ones((CAMERA.height, 1), np.float32)
    view = GBuffer(depth, np.zeros((*shape, 3)), np.zeros((*shape, 3)), np.ones(shape, np.int32))
    assert len(edge_pixels(view, np.ones(shape, bool))) == 0


def test_rays_of_a_pixel_are_spread_about_its_centre():
    pixels = np.array([0, 12, 62], dtype=np.int32)
    rays = subpixel_rays(CAMERA, pixels).reshape(3, 4, 3)
    at = CAMERA.project(rays)
    centre = np.stack([pixels % CAMERA.width, pixels // CAMERA.width], axis=1)
    assert np.allclose(at - centre[:, None], np.array(SUBPIXELS), atol=1e-9)
    assert np.allclose(rays.mean(axis=1), CAMERA.rays().reshape(-1, 3)[pixels], atol=1e-12)


def expected_colour(view, lit, colour, pixel, ray, z, own):
    """Return the colour of one ray by the plain definition of colours_beside; None if it is not known."""
    row, column = divmod(int(pixel), CAMERA.width)
    du, dv = SUBPIXELS[ray]
    weights, colours, lights = [], [], set()
    for j in range(max(row - 1, 0), min(row + 2, CAMERA.height)):
        for i in range(max(column - 1, 0), min(column + 2, CAMERA.width)):
            alike = own == SKY or abs(view.depth[j, i] - z) < 0.02 * z
            if view.surface[j, i] == own and alike:
                across, down = max(1 - abs(i - column - du), 1e-6), max(1 - abs(j - row - dv), 1e-6)
                weights.append(across * down)
                colours.append(colour[j * CAMERA.width + i].astype(float))
                lights.add(bool(lit[j, i]))
    return np.average(colours, axis=0, weights=weights) if len(lights) == 1 else None


@given(st.integers(0, 10**6))
def test_a_ray_takes_the_colour_of_pixels_that_show_the_same_place(seed):
    view, lit, colour = random_view(seed)
    rng = np.random.default_rng(seed)
    pixels = np.unique(rng.integers(0, colour.shape[0], 12)).astype(np.int32)
    surface = rng.integers(-1, 3, 4 * len(pixels)).astype(np.int32)
    depth = np.where(surface == SKY, np.inf, rng.choice([2.0, 3.0, 5.0], len(surface))).astype(np.float32)
    samples, known = colours_beside(pixels, depth, surface, view, lit, colour)
    for k in range(len(surface)):
        expected = expected_colour(view, lit, colour, pixels[k // 4], k % 4, depth[k], surface[k])
        assert known[k] == (expected is not None)
        if known[k]:
            assert samples[k] == pytest.approx(expected, rel=1e-5)


def test_a_pixel_is_the_mean_of_its_rays():
    colour = np.zeros((63, 3), dtype=np.float32)
    samples = np.random.default_rng(0).random((8, 3), dtype=np.float32)
    average(np.array([5, 60], dtype=np.int32), samples, colour)
    assert colour[5] == pytest.approx(samples[:4].mean(axis=0)) and colour[60] == pytest.approx(
        samples[4:].mean(axis=0)
    )
    assert np.count_nonzero(colour.any(axis=1)) == 2
