import json
import os
import struct
from dataclasses import asdict, replace

import cv2
import numpy as np
import pytest
from PIL import Image, TiffImagePlugin
from scipy import fft

from marssim.scene.heightmap import file_digest, read_heightmap
from marssim.scene.relief import ReliefConfig, long_waves, self_affine
from marssim.scene.terrain import build_terrain

BARE = {"crater_density": 0.0, "ripple_amplitude": 0.0, "hurst": 0.7}


def read(path, scale=None, height=None):
    return read_heightmap(str(path), file_digest(str(path)), scale, height)


def build(path, size=12.0, horizon=16.0, seed=0, **changes):
    config = ReliefConfig(heightmap=str(path), **{**BARE, **changes})
    return build_terrain(config, size=size, cell=0.1, horizon=horizon, rng=np.random.default_rng(seed))


def geotiff(path, values, scale=(2.0, 2.0, 0.0), model=1, unit=9001, nodata=None, matrix=None, tie=None, items=None):
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    for tag, value in ((34264, matrix), (33922, tie)):
        if value is not None:
            tags[tag], tags.tagtype[tag] = value, 12
    if items is not None:
        tags[42112], tags.tagtype[42112] = items, 2
    if scale is not None:
        tags[33550], tags.tagtype[33550] = scale, 12
    tags[34735], tags.tagtype[34735] = (1, 1, 0, 2, 1024, 0, 1, model, 3076, 0, 1, unit), 3
    if nodata is not None:
        tags[42113], tags.tagtype[42113] = nodata, 2
    Image.fromarray(values).save(path, tiffinfo=tags)
    return path


@pytest.mark.parametrize(
    ("tag", "kind", "value"),
    [
        (33550, 12, (2.0,)), (33550, 12, (0.0, 0.0, 0.0)), (33550, 12, (-1.0, -1.0)), (33550, 12, (float("nan"),) * 3),
        (33550, 2, "two metres"), (34735, 2, "keys"), (34735, 3, (1,)), (34735, 12, (float("inf"),) * 8),
        (34264, 12, (1.0,) * 15), (34264, 2, "a matrix"),
    ],
)  # fmt: skip
def test_geotiff_tags_of_a_wrong_kind_are_named(tmp_path, tag, kind, value):
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    tags[tag], tags.tagtype[tag] = value, kind
    Image.fromarray(np.zeros((4, 4), np.float32)).save(tmp_path / "map.tif", tiffinfo=tags)
    with pytest.raises(ValueError, match=rf"map\.tif: its tag of .* \({tag}\) must be") as refusal:
        read(tmp_path / "map.tif")
    assert "\n" not in str(refusal.value)
    assert read(tmp_path / "map.tif", scale=2.0).cell == 2.0  # the tags are not needed then


def hills(n, cell):
    """Return the coordinates [m] of a map's cells, and the height [m] of a smooth surface as a function of x, y [m]."""
    axis = (np.arange(n) - (n - 1) / 2) * cell
    return axis, lambda x, y: 0.05 * y + 0.4 * np.sin(2 * np.pi * x / 14.0)


def transformation(east, north, turn=0.0):
    """Return GeoTIFF's matrix of columns and rows to x and y."""
    return (east, turn, 0.0, 1000.0, turn, north, 0.0, 2000.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize("given", [None, 2.0])
@pytest.mark.parametrize(("east", "north"), [(2.0, -2.0), (2.0, 2.0), (-2.0, -2.0)])
def test_rows_and_columns_may_begin_at_any_edge(tmp_path, east, north, given):
    values = np.arange(30.0, dtype=np.float32).reshape(5, 6)  # row 0 north, column 0 west
    stored = values[:: 1 if north < 0 else -1, :: 1 if east > 0 else -1]
    path = geotiff(tmp_path / "map.tif", np.ascontiguousarray(stored), scale=None, matrix=transformation(east, north))
    found = read(path, scale=given)
    assert found.cell == 2.0
    np.testing.assert_array_equal(found.heights, values[::-1])


@pytest.mark.parametrize(
    ("tags", "says"),
    [
        (
            {"scale": None, "matrix": transformation(2.0, -2.0, 0.5)},
            "is turned: its rows do not run along the east; resample it with north up",
        ),
        ({"scale": (1.0, 2.0, 0.0)}, "its cells are 1 x 2, not square"),
        (
            {"scale": (1e-5, 1e-5, 0.0), "model": 2, "tie": (0.0, 0.0, 0.0, 77.4, 45.0, 0.0)},
            "its cells are in degrees, and at 45 deg of latitude 0.71 times as wide as high; project it",
        ),
    ],
)
def test_a_given_size_of_cells_does_not_make_others_of_them(tmp_path, tags, says):
    path = geotiff(tmp_path / "map.tif", np.zeros((6, 6), np.float32), **tags)
    with pytest.raises(ValueError, match=rf"^`relief\.heightmap` .*map\.tif: {says}"):
        read(path, scale=1.0)


def test_cells_in_degrees_that_are_square_on_the_ground_may_be_given_a_size(tmp_path):
    for width, latitude in ((1e-5, -4.5), (2e-5, 60.0)):  # those of twice the degrees are square there
        tags = {"scale": (width, 1e-5, 0.0), "model": 2, "tie": (0.0, 0.0, 0.0, 77.4, latitude, 0.0)}
        path = geotiff(tmp_path / "map.tif", np.zeros((6, 6), np.float32), **tags)
        assert read(path, scale=0.6).cell == 0.6
        with pytest.raises(ValueError, match=r"its cells are in degrees; project it, or give `relief.heightmap_scale`"):
            read(path)


@pytest.mark.parametrize("place", [1, 4])
def test_a_map_whose_rows_or_columns_alone_lean_is_turned(tmp_path, place):
    matrix = list(transformation(2.0, -2.0))
    matrix[place] = 0.1
    path = geotiff(tmp_path / "map.tif", np.zeros((6, 6), np.float32), scale=None, matrix=tuple(matrix))
    with pytest.raises(ValueError, match="is turned: its rows do not run along the east"):
        read(path)


@pytest.mark.parametrize("line", [0.0, 20.0])
def test_cells_in_degrees_are_judged_at_the_middle_of_the_map(tmp_path, line):
    """The middle of these 40 rows of half a degree lies at 60 deg, 10 deg south of the upper edge."""
    tags = {"scale": (0.5, 0.5, 0.0), "model": 2, "tie": (0.0, line, 0.0, 77.4, 70.0 - line / 2, 0.0)}
    path = geotiff(tmp_path / "map.tif", np.zeros((40, 6), np.float32), **tags)
    with pytest.raises(ValueError, match=r"at 60 deg of latitude 0\.50 times as wide as high"):
        read(path, scale=1.0)


def test_the_scale_and_the_offset_of_gdal_give_the_heights(tmp_path):
    items = (
        '<GDALMetadata>\n  <Item name="OFFSET" sample="0" role="offset">-4500</Item>\n'
        '  <Item name="SCALE" sample="0" role="scale">0.5</Item>\n'
        '  <Item name="SCALE" sample="1" role="scale">9</Item>\n</GDALMetadata>'
    )
    values = np.arange(36, dtype=np.int16).reshape(6, 6)
    path = geotiff(tmp_path / "map.tif", values, nodata="7", items=items)
    expected = np.where(values == 7, np.nan, 0.5 * values - 4500)
    np.testing.assert_array_equal(read(path).heights, expected[::-1])
    np.testing.assert_array_equal(read(path, height=2.0).heights, np.where(values == 7, np.nan, 2.0 * values)[::-1])
    for role, text in (("scale", "0"), ("scale", "half"), ("offset", "inf")):
        broken_items = f'<Item sample="0" role="{role}">{text}</Item>'
        says = rf"map\.tif: the {role} of its heights must be a finite number.*, is '{text}'$"
        with pytest.raises(ValueError, match=says):
            read(geotiff(tmp_path / "map.tif", values, items=broken_items))


def test_the_heights_are_those_of_the_first_band_whatever_comes_first_in_the_file(tmp_path):
    items = "".join(
        f'<Item name="SCALE" sample="{band}" role="scale">{scale}</Item>' for band, scale in ((1, 9), (0, 0.5))
    )
    values = np.arange(36, dtype=np.int16).reshape(6, 6)
    path = geotiff(tmp_path / "map.tif", values, items=f"<GDALMetadata>{items}</GDALMetadata>")
    np.testing.assert_array_equal(read(path).heights, 0.5 * values[::-1])


def test_a_picture_is_no_map_of_heights_unless_they_are_given(tmp_path, recwarn):
    path = geotiff(tmp_path / "map.tif", np.full((6, 6), 7, np.uint8))
    with pytest.raises(ValueError, match=r"map\.tif: has 8 bits a pixel, as pictures have; give `relief.heightmap_hei"):
        read(path)
    assert (read(path, height=0.5).heights == 3.5).all()
    path = geotiff(tmp_path / "wide.tif", np.zeros((6, 6), np.float32), nodata="-1.79769e+308")
    assert np.isfinite(read(path).heights).all() and not recwarn.list


def test_a_file_that_another_has_replaced_is_not_read(tmp_path):
    """As on a worker that has another file in the place of the one that the command has."""
    np.save(path := tmp_path / "map.npy", np.zeros((6, 6)))
    digest = file_digest(str(path))
    np.save(path, np.ones((6, 6)))
    with pytest.raises(ValueError, match=rf"map\.npy: its SHA-256 is {file_digest(str(path))}, not {digest}"):
        read_heightmap(str(path), digest, 1.0, None)


@pytest.mark.parametrize("kind", ["npy", "png", "tif", "tif64"])
def test_every_kind_of_file_gives_the_same_heights(tmp_path, kind):
    axis, surface = hills(50, 1.0)
    values = surface(axis[None, :], axis[::-1, None])  # row 0 is north
    if kind == "npy":
        np.save(path := tmp_path / "map.npy", values.astype(np.float32))
        got = read(path, scale=1.0)
    elif kind == "png":
        cv2.imwrite(str(path := tmp_path / "map.png"), np.round((values + 10) / 0.001).astype(np.uint16))
        got = read(path, scale=1.0, height=0.001)
        values = values + 10
    elif kind == "tif":
        path = geotiff(tmp_path / "map.tif", values.astype(np.float32), scale=(1.0, 1.0, 0.0))
        got = read(path)
    else:
        cv2.imwrite(str(path := tmp_path / "map.tif"), values)
        got = read(path, scale=1.0)
    assert got.cell == 1.0
    assert got.heights == pytest.approx(values[::-1], abs=6e-4)


def test_the_scene_lies_on_the_map_north_up(tmp_path):
    axis, surface = hills(80, 0.5)
    np.save(tmp_path / "map.npy", surface(axis[None, :], axis[::-1, None]))
    for at in ((0.0, 0.0), (2.25, -1.5)):
        terrain = build(tmp_path / "map.npy", heightmap_scale=0.5, heightmap_at=at)
        x, y = np.random.default_rng(0).uniform(-4, 4, (2, 200))
        true = surface(x + at[0], y + at[1]) - surface(*at)
        drawn = terrain.height_at(x, y) - terrain.height_at(0.0, 0.0)
        assert drawn == pytest.approx(true, abs=0.03)  # and a little roughness below the map's cells
        edge = np.full(20, 14.0)
        assert terrain.height_at(edge, np.linspace(-9, 9, 20)) - terrain.height_at(0.0, 0.0) == pytest.approx(
            surface(edge + at[0], np.linspace(-9, 9, 20) + at[1]) - surface(*at), abs=0.1
        )


@pytest.mark.parametrize("step", [4, 16])
def test_relief_goes_on_below_the_resolution_of_the_map(tmp_path, step):
    """A rough surface is known on every 4th and 16th cell only: the refined one is as rough at every lag."""
    n, cell, lags = 480, 0.1, np.array([1, 2, 5, 10, 20])
    true, refined, bare = np.zeros(5), np.zeros(5), np.zeros(5)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        h = fft.irfft2(self_affine(n, cell, 0.7, 0.09, rng), s=(n, n))
        h += long_waves(np.arange(n) * cell, n * cell, 0.7, 0.09, rng)
        np.save(path := tmp_path / f"{seed}.npy", h[step // 2 :: step, step // 2 :: step])
        window = read(path, scale=step * cell).window(16.0, (0.0, 0.0), rng)
        x = np.arange(-8, 8.01, cell)
        smooth, middle = (
            window.sample(x, x),
            build(path, 20.0, 16.0, heightmap_scale=step * cell).fine.heights[25:-25, 25:-25],
        )
        for out, grid in ((true, h), (refined, middle), (bare, smooth)):
            out += [np.mean((grid[:, lag:] - grid[:, :-lag]) ** 2) / 4 for lag in lags]
    assert np.sqrt(refined / true) == pytest.approx(np.ones(5), abs=0.2)
    assert np.sqrt(bare / true)[0] < 0.8  # which splines alone are not


def test_no_facets_are_seen(tmp_path):
    """Curvature is spread evenly: not gathered on the lines of the map's cells, as bilinear facets would have it."""
    np.save(tmp_path / "map.npy", np.random.default_rng(0).normal(0, 0.3, (40, 40)))
    grid = build(tmp_path / "map.npy", size=20.0, heightmap_scale=1.0).fine
    bend = np.abs(np.diff(grid.heights[30:-30, 30:-30], 2, axis=1)).mean(axis=0)
    by_place = bend[: len(bend) // 10 * 10].reshape(-1, 10).mean(axis=0)
    assert by_place.max() < 1.6 * by_place.min()


@pytest.mark.parametrize("at", [(2.25, -1.5), None])
def test_place_and_datum_lead_back_to_the_files_heights(tmp_path, at):
    axis, surface = hills(80, 0.5)
    np.save(tmp_path / "map.npy", surface(axis[None, :], axis[::-1, None]) - 2500)
    terrain = build(tmp_path / "map.npy", heightmap_scale=0.5, heightmap_at=at)
    assert at in (None, terrain.at) and terrain.height_at(0.0, 0.0) == pytest.approx(0, abs=1e-9)
    x, y = np.random.default_rng(0).uniform(-4, 4, (2, 200))
    expected_heights = surface(x + terrain.at[0], y + terrain.at[1]) - 2500
    assert terrain.height_at(x, y) + terrain.datum == pytest.approx(expected_heights, abs=0.03)


def test_a_scene_may_draw_its_own_place_and_keeps_off_gaps(tmp_path):
    values = np.add.outer(np.zeros(120), np.arange(120.0) ** 2 / 400).astype(np.float32)
    values[:, :40] = -9999
    path = geotiff(tmp_path / "map.tif", values, scale=(1.0, 1.0, 0.0), nodata="-9999")
    slopes = []
    for seed in range(6):
        terrain = build(path, seed=seed, heightmap_at=None)
        assert np.isfinite(terrain.coarse.heights).all()
        slopes.append(float(terrain.height_at(5.0, 0.0) - terrain.height_at(-5.0, 0.0)))
    assert np.std(slopes) > 0.1 and min(slopes) > 2.0
    with pytest.raises(ValueError, match=r"map\.tif.*no data.*`relief.heightmap_at`"):
        build(path, heightmap_at=(-20.0, 0.0))


def test_a_map_with_gaps_everywhere_has_no_place_to_draw(tmp_path):
    values = np.zeros((120, 120), np.float32)
    values[::8, ::8] = np.nan
    np.save(tmp_path / "map.npy", values)
    with pytest.raises(ValueError, match=r"map\.npy: no place without gaps in the data was found for a scene of \d+ m"):
        build(tmp_path / "map.npy", heightmap_scale=1.0, heightmap_at=None)


def test_a_map_of_one_row_is_refused(tmp_path):
    np.save(tmp_path / "map.npy", np.zeros((1, 120)))
    with pytest.raises(ValueError, match=r"map\.npy: has 120 x 1 cells, too few"):
        build(tmp_path / "map.npy", heightmap_scale=1.0)


@pytest.mark.parametrize(
    ("kind", "nodata", "empty"),
    [
        (np.uint16, "-9999", None),  # 55537 in this type's arithmetic is a height like any other
        (np.uint16, "65535", 65535),
        (np.float32, "-3.40282346638529e+38", np.finfo(np.float32).min),  # as GDAL writes it: not quite that in float64
        (np.float32, "nan", np.nan),
    ],
)
def test_only_what_equals_the_nodata_value_is_a_gap(tmp_path, kind, nodata, empty):
    values = np.full((12, 12), 55537, kind)
    if empty is not None:
        values[3, 4] = empty
    read_back = read(geotiff(tmp_path / "map.tif", values, nodata=nodata)).heights[::-1]
    assert np.isnan(read_back[3, 4]) == (empty is not None) and np.isnan(read_back).sum() == (empty is not None)


@pytest.mark.parametrize("cell", [1.0, 0.1, 0.3])
def test_a_map_just_as_large_as_the_scene_is_enough(tmp_path, cell):
    """A value holds for its whole cell, so the outermost values cover the last half of a cell."""
    n = round(24 / cell)
    axis = (np.arange(n) - (n - 1) / 2) * cell
    slope = np.broadcast_to(0.1 * axis, (n, n))
    np.save(path := tmp_path / "map.npy", slope)
    terrain = build(path, horizon=12.0, size=8.0, heightmap_scale=cell)
    edge = terrain.height_at(np.array([-12.0, 12.0]), 0.0) - terrain.height_at(0.0, 0.0)
    assert edge == pytest.approx([-1.2, 1.2], abs=0.05 * cell + 0.05)
    assert build(path, horizon=12.0, size=8.0, heightmap_scale=cell, heightmap_at=None) is not None
    np.save(path, slope[1:])
    with pytest.raises(ValueError, match=rf"covers 24 x {24 - cell:g} m, too small for the scene of 24 x 24 m"):
        build(path, horizon=12.0, size=8.0, heightmap_scale=cell)


def test_only_craters_too_small_for_the_map_are_added(tmp_path):
    np.save(tmp_path / "map.npy", np.zeros((60, 60)))
    config = {"crater_density": 0.05, "heightmap_scale": 1.0}
    assert np.ptp(build(tmp_path / "map.npy", **config).fine.heights) > 0.05
    assert np.ptp(build(tmp_path / "map.npy", **config).coarse.heights) < 1.0
    fine = {"crater_density": 0.05, "heightmap_scale": 0.2}
    np.save(tmp_path / "fine.npy", np.zeros((200, 200)))
    assert np.ptp(build(tmp_path / "fine.npy", **fine).fine.heights) == 0


@pytest.mark.parametrize(("cell", "shown"), [(0.25, True), (0.5, False)])
def test_only_ripples_too_short_for_the_map_are_added(tmp_path, cell, shown):
    np.save(path := tmp_path / "map.npy", np.zeros((200, 200)))
    heights = [
        build(
            path, heightmap_scale=cell, ripple_amplitude=amplitude, ripple_wavelength=1.2, ripple_cover=1.0
        ).fine.heights
        for amplitude in (0.0, 0.05)
    ]
    assert np.array_equal(*heights) == shown


def test_the_config_records_the_digest_of_the_file(tmp_path):
    np.save(path := tmp_path / "map.npy", np.zeros((60, 60)))
    config = ReliefConfig(heightmap=str(path), heightmap_scale=1.0)
    assert config.heightmap_sha256 == file_digest(str(path)) and len(config.heightmap_sha256) == 64
    assert replace(config, hurst=0.6).heightmap_sha256 == config.heightmap_sha256
    json.dumps(asdict(config))
    np.save(path, np.ones((60, 61)))
    with pytest.raises(ValueError, match=r"map\.npy: its SHA-256 is"):
        replace(config, hurst=0.5)


HEADERS = {  # of .npy files, that numpy stumbles over in ways of its own
    "header without end": (b"}", b" "),
    "header of no type": (b"<f4", b"<04"),
    "negative side": (b"60, 60)", b"60,-60)"),
}


def broken(tmp_path, case):
    """Return a file with a fault, and the fields of ReliefConfig to read it."""
    path, config = tmp_path / "map.npy", {"heightmap_scale": 1.0}
    level = np.zeros((60, 60), np.float32)
    if case == "missing":
        pass
    elif case == "folder":
        path.mkdir()
    elif case == "empty":
        path.write_bytes(b"")
    elif case == "cut off":
        np.save(path, level)
        path.write_bytes(path.read_bytes()[:900])
    elif case == "lying":
        with path.open("wb") as file:
            header = {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**6)}
            np.lib.format.write_array_header_1_0(file, header)
            file.write(bytes(100))
    elif case == "pickle":
        np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    elif case in ("text", "cut archive"):
        path.write_bytes(b"1.0 2.0\n" if case == "text" else b"PK\3\4 and no more")
    elif case in HEADERS:
        np.save(path, level)
        path.write_bytes(path.read_bytes().replace(*HEADERS[case]))
    elif case == "three dimensions":
        np.save(path, np.zeros((4, 60, 60)))
    elif case == "complex":
        np.save(path, level.astype(complex))
    elif case == "nan":
        level[30, 30] = np.nan
        np.save(path, level)
    elif case == "too small":
        np.save(path, level[:20])
    elif case == "too coarse":
        np.save(path, level)
        config = {"heightmap_scale": 50.0}
    elif case == "beyond":
        np.save(path, level)
        config |= {"heightmap_at": (20.0, 0.0)}
    elif case == "no scale":
        np.save(path, level)
        config = {}
    elif case == "kind":
        path = tmp_path / "map.jpg"
        path.write_bytes(b"x")
    elif case in ("8 bits", "colour", "no height"):
        path = tmp_path / "map.png"
        kind = np.uint8 if case == "8 bits" else np.uint16
        cv2.imwrite(str(path), np.zeros((60, 60, 3) if case == "colour" else (60, 60), kind))
        config |= {} if case == "no height" else {"heightmap_height": 0.01}
    elif case in ("cut png", "flipped png"):
        path = tmp_path / "map.png"
        cv2.imwrite(str(path), np.random.default_rng(0).integers(0, 65536, (60, 60)).astype(np.uint16))
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 4
        path.write_bytes(bytes(data) if case == "flipped png" else path.read_bytes()[: len(data) // 2])
        config |= {"heightmap_height": 0.01}
    elif case == "cut tif":
        path = geotiff(tmp_path / "map.tif", level + np.random.default_rng(0).normal(size=(60, 60)).astype(np.float32))
        path.write_bytes(path.read_bytes()[:9000])
    elif case == "complex tif":
        path = tmp_path / "map.tif"
        data, entries = np.zeros((60, 60), np.complex64).tobytes(), []
        for tag, value in ((256, 60), (257, 60), (258, 64), (259, 1), (262, 1), (273, 8), (277, 1), (278, 60),
                           (279, len(data)), (339, 6)):  # fmt: skip
            entries.append(struct.pack("<HHII", tag, 4, 1, value))
        directory = struct.pack("<H", len(entries)) + b"".join(entries) + bytes(4)
        path.write_bytes(b"II*\0" + struct.pack("<I", 8 + len(data)) + data + directory)
    elif case == "unmarked gaps":
        level[10:20] = -9999
        np.save(path, level)
    elif case == "gaps alone":
        np.save(path, np.full((60, 60), np.finfo(np.float32).min))
    elif case == "no image":
        path = tmp_path / "map.tif"
        path.write_bytes(b"II*\0" + struct.pack("<I", 8) + b"\0\0")
    else:
        path, config = tmp_path / "map.tif", {}
        extra = {
            "degrees": {"model": 2}, "feet": {"unit": 9002}, "not square": {"scale": (1.0, 2.0, 0.0)},
            "no tags": {"scale": None}, "odd nodata": {"nodata": "none"},
        }[case]  # fmt: skip
        geotiff(path, level, **{"scale": (1.0, 1.0, 0.0), **extra})
    return path, config


@pytest.mark.parametrize(
    ("case", "says"),
    [
        ("missing", "no such file"), ("folder", "directory"), ("empty", "cannot be read as a .npy"),
        ("cut off", "cannot be read as a .npy"), ("lying", "cannot be read as a .npy"),
        ("unmarked gaps", "rises by 9999 m"),
        ("gaps alone", "heights of 3.40282e+38 m"),
        *((case, "cannot be read as a .npy") for case in HEADERS),
        ("cut png", "cannot be read as an image"), ("flipped png", "cannot be read as an image"),
        ("cut tif", "cannot be read as an image"), ("complex tif", "cannot be read as an image"),
        ("pickle", "cannot be read as a .npy"), ("text", "does not begin like one"),
        ("cut archive", "does not begin like one"),
        ("three dimensions", "two-dimensional"),
        ("complex", "two-dimensional"), ("nan", "no data"), ("too small", "60 x 20 m, too small"),
        ("too coarse", "cells of 50 m"), ("beyond", "`relief.heightmap_at`"), ("no scale", "`relief.heightmap_scale`"),
        ("kind", ".npy, .png, .tif"), ("8 bits", "8 bits"), ("colour", "3 channels"),
        ("no height", "`relief.heightmap_height`"),
        ("no image", "cannot be read as an image"), ("degrees", "degrees"), ("feet", "not measured in metres"),
        ("not square", "not square"), ("no tags", "`relief.heightmap_scale`"), ("odd nodata", "nodata"),
    ],
)  # fmt: skip
def test_a_broken_file_is_one_line(tmp_path, case, says, capfd):
    path, config = broken(tmp_path, case)
    capfd.readouterr()
    with pytest.raises(ValueError, match=r"^`relief\.heightmap` /") as error:
        build(path, **config)
    message = str(error.value)
    assert path.name in message and says in message and "\n" not in message
    assert capfd.readouterr() == ("", "")  # nor have the libraries that read images anything to add


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    """As an untrusted place file may name one, or a device without an end."""
    os.mkfifo(tmp_path / "map.npy")
    with pytest.raises(ValueError, match=r"^`relief\.heightmap` .*map\.npy: is a device or a pipe, not a file$"):
        build(tmp_path / "map.npy", heightmap_scale=1.0)
