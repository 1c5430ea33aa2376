"""A map that nav.map wrote is read back as it was, at its place in the world, and broken ones are named."""

import json
import shutil

import numpy as np
import pytest

from marssim.base.files.json_file import DatasetError
from marssim.base.rover_spec import ZHURONG
from nav import ElevationConfig, ElevationMap, Navigator, TraversabilityConfig, assess, read_map
from nav.ground.map_files import window_of, write_map
from nav.ground.read_map import is_of_rover

PLACE = {"cell_m": 0.1, "origin_m": [1000.0, 2000.0], "frame": "world"}


@pytest.fixture(scope="module")
def elevation():
    """A wide strip of ground, seen by halves with other weights, with a rock, around (3, -2)."""
    made = ElevationMap(ElevationConfig(size=20.0), (3.0, -2.0))
    x, y = np.meshgrid(*made.centres())
    strip = (np.abs(x - 3) < 5) & (np.abs(y + 2) < 2)
    made.low[strip] = (0.05 * x - 0.02 * y)[strip]
    made.top[strip] = made.low[strip] + 0.01
    made.top[np.hypot(x - 4, y + 2) < 0.3] += 0.4
    made.weight[strip] = np.where(x < 3, 7.0, 0.25)[strip]
    return made


@pytest.fixture(scope="module")
def written(elevation, tmp_path_factory):
    out = tmp_path_factory.mktemp("map")
    ground = assess(elevation, ZHURONG, TraversabilityConfig())
    pose = np.eye(4)
    pose[:2, 3] = -1.0, -2.0
    window = window_of(elevation, ground, pose[None, :2, 3], PLACE["origin_m"])
    write_map(out, elevation, ground, window, pose[None])
    place = {"rows_columns": list(window.shape), "west_south_m": [window.west, window.south]}
    (out / "map.json").write_text(json.dumps(PLACE | place))
    return out


@pytest.fixture
def copy(written, tmp_path):
    return shutil.copytree(written, tmp_path / "copy")


def test_a_map_comes_back_at_its_place_in_the_world(elevation, written):
    read = read_map(written)
    assert read.measured.sum() == elevation.measured.sum() > 3000
    for made in np.argwhere(elevation.measured)[::37]:
        at = elevation.origin + (made[::-1] + 0.5) * 0.1
        ix, iy = read.cell_of(at)
        for name in ("top", "low", "weight"):
            assert getattr(read, name)[iy, ix] == getattr(elevation, name)[tuple(made)]
    assert np.isnan(read.top[~read.measured]).all() and not read.hidden_drop.any()
    assert not is_of_rover(written)


def test_the_navigator_knows_what_the_map_shows(elevation, written):
    # the same cells as if it had been given the map itself
    navigators = [Navigator(prior=prior) for prior in (read_map(written), elevation)]
    assert navigators[0].map.from_prior.sum() > 1000
    np.testing.assert_array_equal(*(navigator.map.top for navigator in navigators))
    np.testing.assert_array_equal(*(navigator.map.weight for navigator in navigators))


def test_a_small_map_is_read_too(copy):
    content = json.loads((copy / "map.json").read_text())
    (copy / "map.json").write_text(json.dumps({**content, "origin_m": [0, 0], "frame": "rover"}))
    assert read_map(str(copy)).origin == pytest.approx(content["west_south_m"]) and is_of_rover(copy)


def test_a_map_that_is_higher_than_wide_comes_back_too(tmp_path):
    """Without the cell of which a file lacks the lower height."""
    made = ElevationMap(ElevationConfig(size=20.0))
    x, y = np.meshgrid(*made.centres())
    strip = (np.abs(x) < 1) & (np.abs(y) < 6)
    made.low[strip], made.top[strip], made.weight[strip] = 0.1 * y[strip], 0.1 * y[strip], 1.0
    made.low[100, 100] = np.nan
    ground, pose = assess(made, ZHURONG, TraversabilityConfig()), np.eye(4)[None]
    window = window_of(made, ground, pose[:, :2, 3])
    assert window.shape[0] > 100 > window.shape[1]
    write_map(tmp_path, made, ground, window, pose)
    place = {"rows_columns": list(window.shape), "west_south_m": [window.west, window.south], "origin_m": [0, 0]}
    (tmp_path / "map.json").write_text(json.dumps(PLACE | place))
    read = read_map(tmp_path)
    assert read.measured.sum() == strip.sum() - 1
    (ix, jx), (iy, jy) = read.cell_of(np.array([[0.05, -5.95], [0.05, 0.05]])).T
    assert read.top[iy, ix] == pytest.approx(-0.595, abs=1e-4) and np.isnan(read.top[jy, jx])


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("origin_m", None, "field 'origin_m' is missing; make the map again with nav.map"),
        ("cell_m", "wide", "cell_m must be a finite number, got 'wide'"),
        ("cell_m", 0, "cell_m must be over 0 and up to 10 m, got 0"),
        ("rows_columns", [3, 0], "rows_columns must be two whole numbers of 1 to 4000, got 3 0"),
        ("rows_columns", [3.5, 4], "rows_columns must be two whole numbers of 1 to 4000, got 3.5 4"),
        ("rows_columns", 3, "rows_columns must be 2 finite numbers, got 3"),
        ("west_south_m", [True, 3], "west_south_m must be 2 finite numbers, got [True, 3]"),
    ],
)
def test_a_place_that_cannot_be_is_named(copy, name, value, message):
    content = json.loads((copy / "map.json").read_text())
    content = {k: v for k, v in {**content, name: value}.items() if v is not None}
    (copy / "map.json").write_text(json.dumps(content))
    with pytest.raises(DatasetError) as error:
        read_map(copy)
    assert str(error.value) == f"{copy / 'map.json'}: {message}"


@pytest.mark.parametrize("fault", ["gone", "broken", "another layer", "another size"])
def test_a_layer_that_cannot_be_read_is_named(copy, fault):
    file = copy / "weight.tif"
    if fault == "gone":
        file.unlink()
    elif fault == "broken":
        file.write_bytes(file.read_bytes()[:100])
    elif fault == "another layer":
        shutil.copy(copy / "traversability.tif", file)
    else:
        content = json.loads((copy / "map.json").read_text())
        content["rows_columns"][0] += 1
        (copy / "map.json").write_text(json.dumps(content))
        file = copy / "top.tif"
    with pytest.raises(DatasetError) as error:
        read_map(copy)
    assert str(error.value).startswith(f"{file}: ") and str(error.value).endswith("make the map again with nav.map")


def test_a_folder_without_a_map_is_named(tmp_path):
    with pytest.raises(DatasetError, match=r"holds no map\.json; give a folder that nav.map wrote"):
        read_map(tmp_path)
