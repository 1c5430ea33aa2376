import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.scene.presets import PRESETS, preset
from marssim.scene.terrain import HeightGrid, ReliefConfig, _sampled, build_terrain

SMOOTH = {"crater_density": 0.0, "ripple_amplitude": 0.0}


def small(seed=0, **changes):
    return build_terrain(ReliefConfig(**changes), size=12.0, cell=0.1, horizon=20.0, rng=np.random.default_rng(seed))


GRID = small().fine


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


def test_the_nodes_on_the_edge_of_the_fine_grid_lie_on_the_smooth_coarse_ground():
    terrain = small()
    x0, _, x1, _ = terrain.fine.bounds
    edge = np.linspace(x0, x1, len(terrain.fine.heights))
    for fixed in (x0, x1):
        for x, y in ((edge, np.full_like(edge, fixed)), (np.full_like(edge, fixed), edge)):
            gap = terrain.fine.gradient_at(x, y)[0] - terrain.coarse.smooth_heights(x, y)
            assert np.abs(gap).max() < 1e-9


def test_smooth_heights_pass_through_the_nodes_and_keep_planes_and_parabolas():
    axis = np.arange(21) * 0.5 - 3.0
    grid = HeightGrid(0.1 * axis[None, :] ** 2 - 0.3 * axis[:, None], -3.0, -3.0, 0.5)
    x, y = np.random.default_rng(0).uniform(0.0, 4.0, (2, 200))  # the spline is symmetric about the edge, far away
    assert np.allclose(grid.smooth_heights(*np.meshgrid(axis, axis)), grid.heights, atol=1e-12)
    assert np.allclose(grid.smooth_heights(x, y), 0.1 * x**2 - 0.3 * y, atol=2e-3)


def test_meshes_cover_the_whole_square_once():
    terrain = small()
    area = 0.0
    for vertices, faces in (terrain.fine.mesh(), terrain.coarse.mesh(terrain.coarse_cells)):
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
    assert 0.02 < np.ptp(rippled) < 0.06


def rms_slope(lags, name=None, scenes=16, far=False, **changes):
    """Return RMS slopes [deg] over lags [m], measured by differences of the heights of built terrains."""
    config = ReliefConfig(**changes) if name is None else preset(name).relief
    total = np.zeros(len(lags))
    for seed in range(scenes):
        rng = np.random.default_rng((7, seed))
        terrain = build_terrain(config, size=24.0, cell=0.125, horizon=96.0 if far else 64.0, rng=rng)
        grid = terrain.coarse if far else terrain.fine
        h = grid.heights[16:-16, 16:-16]
        for row, lag in enumerate(lags):
            n = round(lag / grid.cell)
            east, north = h[:, n:] - h[:, :-n], h[n:] - h[:-n]
            total[row] += (np.mean(east**2) + np.mean(north**2)) / 2 / (n * grid.cell) ** 2
    return np.rad2deg(np.arctan(np.sqrt(total / scenes)))


@pytest.mark.parametrize(("hurst", "slope"), [(0.5, 3.0), (0.65, 5.0), (0.8, 8.0)])
def test_built_relief_has_the_slopes_and_the_hurst_exponent_that_were_asked_for(hurst, slope):
    """The knobs, measured back: slope over 1 m, its fall to 10 m and 50 m, and the exponent of the structure function.

    Waves of less than a few decimetres are left to the fine relief of marssim.render.relief. A scene is a small piece
    of the relief: what is long in it differs from scene to scene.
    """
    knobs = {"hurst": hurst, "rms_slope_deg": slope, **SMOOTH}

    def due(lag):
        return np.rad2deg(np.arctan(np.tan(np.deg2rad(slope)) * lag ** (hurst - 1)))

    lags = np.array([1.0, 2.0, 4.0, 10.0])
    measured = rms_slope(lags, scenes=24, **knobs)
    assert measured[:3] == pytest.approx(due(lags[:3]), rel=0.06)
    assert measured[3] == pytest.approx(due(10.0), rel=0.1)
    exponent = 1 + np.polyfit(np.log(lags[:3]), np.log(np.tan(np.deg2rad(measured[:3]))), 1)[0]
    assert exponent == pytest.approx(hurst, abs=0.03)
    lags = np.array([20.0, 50.0])
    assert rms_slope(lags, scenes=24, far=True, **knobs) == pytest.approx(due(lags), rel=0.1)


def test_presets_are_as_steep_as_the_places_they_are_named_after():
    """Pathfinder and Viking 1: 4.8 to 5.4 deg over 1 m, 2.5 to 3.0 over 10 m, 1.2 to 1.7 over 100 m; utopia is
    smoother, hard is not. Within what so many scenes scatter."""
    near = {name: rms_slope([1.0], name, scenes=6)[0] for name in PRESETS}
    for name in ("gusev", "gale", "jezero"):
        assert 4.7 < near[name] < 5.5
        over_ten, over_hundred = rms_slope([10.0, 100.0], name, scenes=10, far=True)
        assert 2.5 < over_ten < 3.0 and 1.1 < over_hundred < 1.8
    assert near["utopia"] < 3.2 and near["hard"] > 6.5


def test_slopes_in_utopia_are_under_8_degrees():
    """98 % of the planes of 1 m x 1 m, as at the landing site."""
    slopes = []
    for seed in range(12):
        rng = np.random.default_rng((8, seed))
        grid = build_terrain(preset("utopia").relief, size=24.0, cell=0.125, horizon=64.0, rng=rng).fine
        h = grid.heights[16:-16, 16:-16]
        east, north = h[:, 8:] - h[:, :-8], h[8:] - h[:-8]
        slopes.append(np.hypot(east[8:] + east[:-8], north[:, 8:] + north[:, :-8]) / 2)
    assert np.mean(np.rad2deg(np.arctan(np.stack(slopes))) < 8) == pytest.approx(0.98, abs=0.012)


def test_same_seed_same_ground():
    assert np.array_equal(small(3).fine.heights, small(3).fine.heights)
    assert not np.array_equal(small(3).fine.heights, small(4).fine.heights)


def test_points_outside_the_grid_take_the_edge():
    grid = HeightGrid(np.array([[0.0, 1.0], [2.0, 3.0]]), 0.0, 0.0, 1.0)
    assert grid.gradient_at(np.array(9.0), np.array(9.0))[0] == 3.0


@pytest.mark.parametrize(
    "bad",
    [
        {"hurst": 1.2},
        {"rms_slope_deg": -1},
        {"regional_slope_deg": 60},
        {"crater_density": -0.1},
        {"crater_max_diameter": 0.5},
        {"crater_depth": (0.2, 0.1)},
        {"crater_fill_diameter": 0.0},
        {"crater_fill_diameter": float("inf")},
        {"regional_azimuth_deg": float("inf")},
        {"heightmap_at": (0.0, float("nan"))},
        {"fresh_crater_density": 0.2},
        {"fresh_crater_diameter": (5.0, 2.0)},
        {"ditch_density": -0.1},
        {"ditch_width": (0.1, 2.0)},
        {"ditch_depth": (0.5, float("nan"))},
        {"ditch_wall_deg": (40.0, 85.0)},
        {"ditch_length": (0.0, 5.0)},
        {"ditch_meander_deg": (0.0, 120.0)},
        {"ripple_amplitude": -0.01},
        {"ripple_wavelength": 0.0},
        {"ripple_cover": 1.5},
        {"heightmap_scale": 0.0},
        {"heightmap_height": float("nan")},
    ],
)
def test_impossible_relief_is_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        ReliefConfig(**bad)


def test_sides_become_even_metres_and_the_cell_a_whole_part_of_them():
    """A side of 7 m becomes 8 m, which cells of 0.3 m do not fill; 15.2 m becomes 16 m."""
    terrain = build_terrain(ReliefConfig(), size=7.0, cell=0.3, horizon=15.2, rng=np.random.default_rng(0))
    assert terrain.fine.bounds == pytest.approx((-4, -4, 4, 4)) and terrain.fine.cell == pytest.approx(8 / 27)
    assert terrain.coarse.bounds == (-16, -16, 16, 16)


def test_sampling_is_cubic_convolution_as_opencv_computes_it():
    heights, at = np.random.default_rng(0).standard_normal((12, 12)), np.linspace(0, 11, 89)
    column, row = np.meshgrid(at.astype(np.float32), at.astype(np.float32))
    expected = cv2.remap(heights.astype(np.float32), column, row, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    assert np.allclose(_sampled(heights, at), expected, atol=1e-5)
    assert np.array_equal(_sampled(heights, np.arange(12.0)), heights)


@pytest.mark.parametrize("cell", [0.08, 0.09, 0.3])
def test_the_origin_lies_on_the_ground_also_in_the_middle_of_a_cell(cell):
    terrain = build_terrain(ReliefConfig(regional_slope_deg=20.0), 8.0, cell, 16.0, np.random.default_rng(0))
    assert terrain.height_at(np.array(0.0), np.array(0.0)) == pytest.approx(0, abs=1e-6)
