import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import fft

from marssim.scene.terrain import HeightGrid, ReliefConfig, build_terrain, self_affine

SMOOTH = {"crater_density": 0.0, "ripple_amplitude": 0.0}


def small(seed=0, **changes):
    return build_terrain(ReliefConfig(**changes), size=12.0, cell=0.1, horizon=20.0, rng=np.random.default_rng(seed))


GRID = small().fine


@pytest.mark.parametrize("hurst", [0.5, 0.7, 0.8])
def test_height_differences_grow_as_the_hurst_exponent_says(hurst):
    n, cell, slope = 512, 0.25, 0.09
    lags = np.array([4, 8, 16])  # 1, 2, 4 m: well inside the grid's band
    spread = np.zeros(3)
    for seed in range(6):
        h = fft.irfft2(self_affine(n, cell, hurst, slope, np.random.default_rng(seed)), s=(n, n))
        spread += [np.mean((np.roll(h, lag, axis=1) - h) ** 2) / 6 for lag in lags]
    rms = np.sqrt(spread)
    assert rms[0] == pytest.approx(slope, rel=0.12)  # the RMS slope at 1 m
    grown = np.polyfit(np.log(lags), np.log(rms), 1)[0]
    assert grown == pytest.approx(hurst, abs=0.12)


def test_built_relief_has_the_rms_slope_that_was_asked_for():
    ratio = []
    for seed in range(8):
        terrain = build_terrain(ReliefConfig(rms_slope_deg=5.0, **SMOOTH), 24.0, 0.1, 48.0, np.random.default_rng(seed))
        h = terrain.fine.heights[30:-30, 30:-30]
        ratio.append(np.mean((h[:, 10:] - h[:, :-10]) ** 2))
    assert np.sqrt(np.mean(ratio)) == pytest.approx(np.tan(np.deg2rad(5.0)), rel=0.2)


@given(st.floats(-5.9, 5.9), st.floats(-5.9, 5.9))
def test_height_and_normal_are_those_of_the_triangle_below(x, y):
    grid = GRID
    h, gx, gy = grid.gradient_at(np.array(x), np.array(y))
    vertices, faces = grid.mesh()
    i, j, s, t = (v.item() for v in grid.locate(np.array(x), np.array(y)))
    face = faces.reshape(grid.heights.shape[0] - 1, grid.heights.shape[1] - 1, 2, 3)[j, i, 0 if s >= t else 1]
    a, b, c = vertices[face]
    normal = np.cross(b - a, c - a)
    assert normal[2] > 0
    assert np.allclose([-gx, -gy], normal[:2] / normal[2], atol=1e-9)
    assert normal @ (np.array([x, y, h]) - a) == pytest.approx(0, abs=1e-9)


def test_fine_and_coarse_ground_meet_without_a_gap():
    terrain = small()
    x0, _, x1, _ = terrain.fine.bounds
    edge = np.linspace(x0, x1, 500)
    for fixed in (x0, x1):
        for x, y in ((edge, np.full_like(edge, fixed)), (np.full_like(edge, fixed), edge)):
            gap = terrain.fine.gradient_at(x, y)[0] - terrain.coarse.gradient_at(x, y)[0]
            assert np.abs(gap).max() < 1e-9


def test_meshes_cover_the_whole_square_once():
    terrain = small()
    area = 0.0
    for vertices, faces in terrain.meshes():
        a, b, c = (vertices[faces[:, i], :2] for i in range(3))
        area += 0.5 * np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]).sum()
    x0, y0, x1, y1 = terrain.coarse.bounds
    assert area == pytest.approx((x1 - x0) * (y1 - y0))


def test_regional_slope_tilts_the_scene():
    flat = {**SMOOTH, "rms_slope_deg": 0.0}
    terrain = small(regional_slope_deg=10.0, regional_azimuth_deg=90.0, **flat)
    rise = terrain.height_at(0.0, 5.0) - terrain.height_at(0.0, -5.0)
    assert rise == pytest.approx(10 * np.tan(np.deg2rad(10)))
    assert terrain.height_at(5.0, 0.0) == pytest.approx(terrain.height_at(-5.0, 0.0))


def test_craters_and_ripples_change_the_ground():
    flat = {"rms_slope_deg": 0.0}
    bare = small(**flat, **SMOOTH).fine.heights
    assert np.ptp(bare) < 1e-9
    cratered = small(**flat, crater_density=0.05, ripple_amplitude=0.0).fine.heights
    assert np.ptp(cratered) > 0.05
    rippled = small(**flat, crater_density=0.0, ripple_amplitude=0.02, ripple_cover=0.9).fine.heights
    assert 0.01 < np.ptp(rippled) < 0.05


def test_same_seed_same_ground():
    assert np.array_equal(small(3).fine.heights, small(3).fine.heights)
    assert not np.array_equal(small(3).fine.heights, small(4).fine.heights)


def test_points_outside_the_grid_take_the_edge():
    grid = HeightGrid(np.array([[0.0, 1.0], [2.0, 3.0]]), 0.0, 0.0, 1.0)
    assert grid.gradient_at(np.array(9.0), np.array(9.0))[0] == 3.0


@pytest.mark.parametrize("bad", [{"hurst": 1.2}, {"rms_slope_deg": -1}, {"regional_slope_deg": 60}])
def test_impossible_relief_is_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        ReliefConfig(**bad)
