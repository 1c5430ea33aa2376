"""Anti-aliasing compared with its plain definition, pixel by pixel."""

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from marssim.base.camera import PinholeCamera
from marssim.base.dataset.frame import GROUND, SKY
from marssim.render.antialias import RAYS, SUBPIXELS, average, colours_beside, edge_pixels, subpixel_rays
from marssim.render.geometry.gbuffer import GBuffer, Hits

CAMERA = PinholeCamera(9, 7, 20.0, 25.0, 3.6, 2.9)


def random_view(seed: int) -> tuple[GBuffer, np.ndarray, np.ndarray]:
    """Return patches of sky, ground, stones and rocks with jumps of depth, the sunlight, and colours (H * W, 3)."""
    rng = np.random.default_rng(seed)
    shape = (CAMERA.height, CAMERA.width)
    surface = np.where(rng.random(shape) < 0.1, rng.integers(-1, 3, shape), rng.integers(-1, 2)).astype(np.int32)
    depth = (rng.choice([2.0, 2.02, 3.0], shape) * rng.uniform(0.999, 1.001, shape)).astype(np.float32)
    depth[surface == SKY] = np.inf
    detail = np.zeros((*shape, 4), np.float32)
    detail[..., 0] = np.where(rng.random(shape) < rng.choice([0.0, 0.3]), 4, -1)
    empty = np.zeros((*shape, 3), np.float32)
    colour = rng.uniform(0.7, 0.8, (CAMERA.height * CAMERA.width, 3)).astype(np.float32)
    lit = (rng.random(shape) < rng.choice([0.0, 0.9, 1.0])).astype(np.float32)
    lit[rng.random(shape) < rng.choice([0.0, 0.0, 0.1])] = 0.4  # soft borders of shadows
    return GBuffer(depth, empty, empty, surface, detail), lit, colour


def view_of_ground(inverse: np.ndarray) -> GBuffer:
    """Return a view of ground without stones, of 1 / Z (H, W)."""
    shape = inverse.shape
    empty, detail = np.zeros((*shape, 3), np.float32), np.full((*shape, 4), -1, np.float32)
    return GBuffer((1 / inverse).astype(np.float32), empty, empty, np.full(shape, GROUND, np.int32), detail)


def edge_towards(view: GBuffer, lit: np.ndarray, colour: np.ndarray, at: tuple[int, int], to: tuple[int, int]) -> bool:
    """Return whether brightness changes from a pixel to one beside it, and surface, light, stone or depth as well."""
    red = colour[:, 0].reshape(lit.shape)
    if abs(red[at] - red[to]) <= 0.04 * (red[at] + red[to]):
        return False
    if view.surface[at] != view.surface[to] or abs(lit[at] - lit[to]) == 1:
        return True
    if view.surface[at] == SKY:
        return False
    z, before = float(view.depth[at]), float(view.depth[to])
    if view.surface[at] != GROUND:
        return abs(1 / before - 1 / z) > 0.06 / z + 1e-3
    opposite = 2 * at[0] - to[0], 2 * at[1] - to[1]
    inside = 0 < at[0] < CAMERA.height - 1 and 0 < at[1] < CAMERA.width - 1
    after = float(view.depth[opposite]) if inside else z
    kink = abs(1 / before + 1 / after - 2 / z)
    return bool(view.detail[at][0] != view.detail[to][0]) or kink > 0.1 / z + 1e-3


@given(st.integers(0, 10**6))
def test_edges_are_changes_of_brightness_with_one_of_surface_light_stone_or_depth(seed):
    view, lit, colour = random_view(seed)
    expected = np.zeros(lit.shape, bool)
    for row, column in np.ndindex(lit.shape):
        for to in ((row, column - 1), (row, column + 1), (row - 1, column), (row + 1, column)):
            if 0 <= to[0] < CAMERA.height and 0 <= to[1] < CAMERA.width:
                expected[row, column] |= edge_towards(view, lit, colour, (row, column), to)
    assert np.array_equal(np.sort(edge_pixels(view, lit, colour)[0]), np.flatnonzero(expected))


@given(st.integers(0, 10**6))
def test_rays_begin_a_little_before_what_is_around_them_unless_that_is_sky(seed):
    view, lit, colour = random_view(seed)
    pixels, begin, amid = edge_pixels(view, lit, colour)
    kernel = np.ones((3, 3), np.uint8)
    nearest = cv2.erode(np.where(view.surface == SKY, 0, view.depth).astype(float), kernel)
    assert begin == pytest.approx(0.99 * nearest.ravel()[pixels])
    alone = cv2.dilate((view.surface != GROUND).astype(np.uint8), kernel).ravel() == 0
    assert alone[pixels[:amid]].all() and not alone[pixels[amid:]].any()
    for part in (pixels[:amid], pixels[amid:]):
        assert (np.diff(part) > 0).all()


@given(st.floats(-75, 75), st.floats(0, 360))
def test_on_ground_a_crest_is_an_edge_and_a_slant_is_none(slant, turn):
    """Planes 1 / Z = a u + b v + c seen as steeply as the ground far away; another one farther begins at row 3."""
    rays, shape = CAMERA.rays(), (CAMERA.height, CAMERA.width)
    steep, turn = np.tan(np.deg2rad(slant)), np.deg2rad(turn)
    inverse = 0.3 * (1 + steep * (np.cos(turn) * rays[..., 0] + np.sin(turn) * rays[..., 1]))
    assume(inverse.min() > 0.05)
    chequered = np.repeat(0.5 + 0.5 * (np.indices(shape).sum(axis=0) % 2).reshape(-1, 1), 3, axis=1).astype(np.float32)
    lit = np.ones(shape, np.float32)

    def inner(inverse: np.ndarray) -> np.ndarray:
        """Return the edges (H - 2, W - 2) bool within the image's border."""
        edges = np.zeros(shape, bool)
        edges.ravel()[edge_pixels(view_of_ground(inverse), lit, chequered)[0]] = True
        return edges[1:-1, 1:-1]

    assert not inner(inverse).any()
    crest = np.where(np.arange(CAMERA.height)[:, None] < 3, 0.8 * inverse, inverse)
    assert np.array_equal(inner(crest), np.broadcast_to(np.isin(np.arange(1, 6), (2, 3))[:, None], (5, 7)))


def test_amid_ground_of_one_colour_there_are_no_edges():
    inverse = np.where(np.arange(CAMERA.width) < 4, 0.5, 0.2) * np.ones((CAMERA.height, 1))
    lit, grey = np.ones(inverse.shape, np.float32), np.full((63, 3), 0.4, np.float32)
    pixels, _, _ = edge_pixels(view_of_ground(inverse), lit, grey)
    assert len(pixels) == 0


def test_one_plain_surface_has_no_edges():
    shape = (CAMERA.height, CAMERA.width)
    depth = np.linspace(2, 2.2, CAMERA.width, dtype=np.float32) * np.ones((CAMERA.height, 1), np.float32)
    none, detail = np.zeros((*shape, 3), np.float32), np.zeros((*shape, 4), np.float32)
    view = GBuffer(depth, none, none, np.ones(shape, np.int32), detail)
    assert len(edge_pixels(view, np.ones(shape, np.float32), np.ones((63, 3), np.float32))[0]) == 0


def test_rays_of_a_pixel_are_spread_about_its_centre():
    pixels = np.array([0, 12, 62], dtype=np.int32)
    rays = subpixel_rays(CAMERA, pixels).reshape(3, RAYS, 3)
    at = CAMERA.project(rays)
    centre = np.stack([pixels % CAMERA.width, pixels // CAMERA.width], axis=1)
    assert np.allclose(at - centre[:, None], SUBPIXELS, atol=1e-9)


def expected_colour(view, lit, colour, pixel, ray, z, own, stone):
    """Return the colour of one ray by the plain definition of colours_beside; None if it is not known."""
    row, column = divmod(int(pixel), CAMERA.width)
    du, dv = SUBPIXELS[ray]
    weights, colours, lights = [], [], set()
    for j in range(max(row - 1, 0), min(row + 2, CAMERA.height)):
        for i in range(max(column - 1, 0), min(column + 2, CAMERA.width)):
            alike = own == SKY or abs(view.depth[j, i] - z) < 0.02 * z
            alike &= own != GROUND or view.detail[j, i, 0] == stone
            if view.surface[j, i] == own and alike:
                across, down = max(1 - abs(i - column - du), 1e-6), max(1 - abs(j - row - dv), 1e-6)
                weights.append(across * down)
                colours.append(colour[j * CAMERA.width + i].astype(float))
                lights.add(float(lit[j, i]))
    return np.average(colours, axis=0, weights=weights) if lights and lights != {0.0, 1.0} else None


@given(st.integers(0, 10**6))
def test_a_ray_takes_the_colour_of_pixels_that_show_the_same_place(seed):
    view, lit, colour = random_view(seed)
    rng = np.random.default_rng(seed)
    pixels = np.unique(rng.integers(0, colour.shape[0], 12)).astype(np.int32)
    surface = rng.integers(-1, 3, RAYS * len(pixels)).astype(np.int32)
    depth = np.where(surface == SKY, np.inf, rng.choice([2.0, 3.0, 5.0], len(surface))).astype(np.float32)
    detail = np.zeros((len(surface), 4), np.float32)
    detail[:, 0] = rng.choice([-1, -1, 4], len(surface))
    none = np.zeros((len(surface), 3), np.float32)
    samples, known = colours_beside(pixels, Hits(depth, none, none, surface, detail), view, lit, colour)
    for k in range(len(surface)):
        at = pixels[k // RAYS], k % RAYS, depth[k], surface[k], detail[k, 0]
        expected = expected_colour(view, lit, colour, *at)
        assert known[k] == (expected is not None)
        if known[k]:
            assert samples[k] == pytest.approx(expected, rel=1e-5)


def test_a_pixel_is_the_mean_of_its_rays():
    rng = np.random.default_rng(0)
    colour, samples = rng.random((63, 3), dtype=np.float32), rng.random((2 * RAYS, 3), dtype=np.float32)
    expected = colour.copy()
    for pixel, own in ((5, samples[:RAYS]), (60, samples[RAYS:])):
        expected[pixel] = np.mean([colour[pixel], *own], axis=0)
    average(np.array([5, 60], dtype=np.int32), samples, colour)
    assert colour == pytest.approx(expected)
