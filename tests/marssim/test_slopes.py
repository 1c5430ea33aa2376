import json
from dataclasses import replace

import numpy as np
import pytest

from marssim.scene.relief import ReliefConfig
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import build_scene
from marssim.scene.terrain import HeightGrid, build_terrain
from marssim.slopes import FITTED, LAGS, SlopesConfig, gentle_share, main, measure, rms_difference, slopes


def grid(height, cell=0.25, n=81):
    x = np.arange(n) * cell
    return HeightGrid(height(*np.meshgrid(x, x)), 0.0, 0.0, cell)


@pytest.mark.parametrize("lag", [0.25, 1.0, 1.1])
def test_a_plane_differs_by_its_slope_whatever_the_lag(lag):
    east, north = 0.3, -0.1
    plane = grid(lambda x, y: east * x + north * y)
    assert rms_difference(plane, lag) == pytest.approx(lag * np.sqrt((east**2 + north**2) / 2))


def test_a_wave_differs_as_its_phase_says():
    """E[(sin(k (x + r)) - sin(k x))^2] = 1 - cos(k r) over whole waves, along x; nothing along y."""
    k = 2 * np.pi / 4
    wave = grid(lambda x, y: np.sin(k * x), n=64 + 4)  # 16 m and the lag of 1 m
    assert rms_difference(wave, 1.0) == pytest.approx(np.sqrt((1 - np.cos(k * 1.0)) / 2), rel=1e-3)


def test_a_margin_leaves_out_the_border():
    step = grid(lambda x, y: np.where(x < 1, 5.0, 0.0))
    assert rms_difference(step, 1.0) > 0.1 and rms_difference(step, 1.0, margin=1.0) == 0
    assert gentle_share(step) < 1 and gentle_share(step, margin=1.0) == 1


@pytest.mark.parametrize("lag", [0.1, 30.0])
def test_a_lag_that_does_not_fit_is_refused(lag):
    with pytest.raises(ValueError, match="does not fit"):
        rms_difference(grid(lambda x, y: x), lag)


@pytest.mark.parametrize(("degrees", "share"), [(7.9, 1.0), (8.1, 0.0)])
def test_gentle_planes_are_those_under_eight_degrees(degrees, share):
    tilt = np.tan(np.deg2rad(degrees)) / np.sqrt(2)
    assert gentle_share(grid(lambda x, y: tilt * (x + y))) == share


def test_relief_has_the_slopes_that_were_asked_for():
    relief = ReliefConfig(hurst=0.6, rms_slope_deg=7.0, crater_density=0.0, ripple_amplitude=0.0)
    terrains = [build_terrain(relief, 24.0, 0.125, 96.0, np.random.default_rng((5, n))) for n in range(12)]
    result = measure(terrains, relief.hurst, relief.rms_slope_deg)
    assert result.asked[LAGS.index(1.0)] == pytest.approx(7.0)
    assert result.measured[:FITTED] == pytest.approx(result.asked[:FITTED], rel=0.08)
    assert result.hurst == pytest.approx(0.6, abs=0.05)
    assert (np.abs(result.measured - result.asked) < 0.08 * result.asked + 4 * result.error).all()
    assert (result.error > 0).all() and result.error[-1] / result.measured[-1] > result.error[1] / result.measured[1]
    other = measure(terrains, 0.8, 3.0)
    assert np.array_equal(other.measured, result.measured) and not np.allclose(other.asked, result.asked, rtol=0.2)


def test_the_error_is_the_scatter_of_repeated_measurements():
    """Of thirty times four terrains: what each says of itself, and how far they lie apart."""
    relief = ReliefConfig(hurst=0.6, rms_slope_deg=7.0, crater_density=0.0, ripple_amplitude=0.0)
    terrains = [build_terrain(relief, 12.0, 0.25, 96.0, np.random.default_rng((6, n))) for n in range(120)]
    results = [measure(terrains[i : i + 4], 0.6, 7.0) for i in range(0, 120, 4)]
    fine = [i for i, lag in enumerate(LAGS) if lag <= 2]
    scatter = np.std([f.measured for f in results], axis=0, ddof=1)[fine]
    error = np.sqrt(np.mean(np.square([f.error for f in results]), axis=0))[fine]
    assert error == pytest.approx(scatter, rel=0.35)


def test_the_terrains_are_those_of_the_scenes():
    config = SlopesConfig(scene="utopia", scenes=1, seed=3)
    bare = replace(config.scene_config(), rocks=RockConfig(k=0))
    scene = build_scene(bare, np.random.default_rng((3, 0)))
    relief = scene.config.relief
    assert np.array_equal(
        slopes(config).measured, measure([scene.terrain], relief.hurst, relief.rms_slope_deg).measured
    )


def test_level_ground_has_no_exponent(capsys):
    assert main(["--bare", "--rms-slope-deg", "0", "--scenes", "1"]) == 0
    out = capsys.readouterr().out
    assert "measured -" in out and "100.0%" in out


def test_the_command_prints_a_table(capsys):
    assert main(["--scene", "hard", "--hurst", "0.5", "--scenes", "1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "hard" in lines[0] and len(lines) == 2 + len(LAGS) + 2
    over, asked, measured, error = (float(word) for word in lines[3].split())
    assert (over, asked, error) == (1.0, 7.0, 0.0) and 5 < measured < 9
    assert "asked 0.50" in lines[-2]


@pytest.mark.parametrize("flag", ["--scenes 0", "--seed -1", "--hurst 1", "--rms-slope-deg nan", "--scene moon"])
def test_a_mistake_is_one_line(flag, capsys):
    assert main(flag.split()) == 2
    error = capsys.readouterr().err
    assert flag.split()[0] in error and error.count("\n") == 1


def test_the_smallest_place_has_no_planes_and_no_exponent(tmp_path, capsys, recwarn):
    (place := tmp_path / "tiny.json").write_text('{"preset": "gale", "size": 4, "horizon": 10}')
    assert main(["--scene", str(place), "--scenes", "1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1].endswith(": -") and lines[-2].endswith("measured -") and not recwarn.list


def test_a_small_place_lacks_the_long_lags(tmp_path, capsys):
    place = tmp_path / "small.json"
    place.write_text('{"preset": "gale", "size": 12, "horizon": 30}')
    assert main(["--scene", str(place), "--scenes", "1"]) == 0
    rows = capsys.readouterr().out.splitlines()[2:-2]
    assert [float(row.split()[0]) for row in rows] == [lag for lag in LAGS if lag < 100]


def test_a_heightmap_was_asked_for_no_slopes(tmp_path, capsys):
    np.save(tmp_path / "map.npy", np.tile(np.tan(np.deg2rad(6.0)) * np.arange(80.0), (80, 1)))
    relief = {"heightmap": "map.npy", "heightmap_scale": 1.0, "crater_density": 0, "ripple_amplitude": 0}
    place = tmp_path / "place.json"
    place.write_text(json.dumps({"preset": "gale", "size": 12, "horizon": 20, "relief": relief}))
    assert main(["--scene", str(place), "--scenes", "1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    over, asked, measured, _ = lines[3].split()
    along_x = np.rad2deg(np.arctan(np.tan(np.deg2rad(6.0)) / np.sqrt(2)))  # the mean of both axes
    assert (float(over), asked) == (1.0, "-") and float(measured) == pytest.approx(along_x, abs=0.05)
    assert "asked" not in lines[-2]
    assert main(["--scene", str(place), "--scenes", "1", "--rms-slope-deg", "20"]) == 2
    assert "--rms-slope-deg is for drawn relief" in capsys.readouterr().err
