"""From the files of m3depth.predict to GeoTIFF: heights, places and obstacles, and what is said about other folders."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from drawn_maps import map_of_height
from PIL import Image

from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.dataset.map_file import encode_map
from marssim.base.pose import look_pose
from marssim.base.rover_spec import ZHURONG
from nav import TraversabilityConfig, assess
from nav.ground.map_files import LEFT, STRIP
from nav.map import DepthCount, MapOptions, PredictedPair, _summary, find_pairs, main, make_map

RIG = StereoRig(PinholeCamera.centred(160, 120, 120.0), 0.3)
BLOCK = np.array([5.0, -0.5]), 0.5, 0.6  # centre [m], half of its side [m], height [m]


def seen_from(pose: np.ndarray) -> np.ndarray:
    """Depth of level ground at z = 0 with a block on it, by the nearest of its top and front face."""
    rays = RIG.camera.rays() @ pose[:3, :3].T
    eye = pose[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        ground = np.where(rays[..., 2] < -1e-6, -eye[2] / rays[..., 2], np.inf)
        centre, half, height = BLOCK
        top = (height - eye[2]) / rays[..., 2]
        at = eye + rays * top[..., None]
        on_top = (top > 0) & (np.abs(at[..., :2] - centre) <= half).all(axis=-1)
        face = (centre[0] - half - eye[0]) / rays[..., 0]
        at = eye + rays * face[..., None]
        on_face = (face > 0) & (np.abs(at[..., 1] - centre[1]) <= half) & (at[..., 2] >= 0) & (at[..., 2] <= height)
    nearest = np.minimum(np.where(on_top, top, np.inf), np.where(on_face, face, np.inf))
    return np.minimum(ground, nearest).astype(np.float32)


def write_pair(folder: Path, x: float = 0.0, pose: bool = True, form: str = "npy", world: str | None = None) -> None:
    """A prediction of a camera 1.2 m above the ground that looks along world x, 20 deg down."""
    folder.mkdir(parents=True)
    camera = look_pose(np.array([x, 0.15, 1.2]), yaw=0.0, pitch=np.deg2rad(20))
    depth = seen_from(camera)
    (folder / f"depth.{form}").write_bytes(encode_map(depth, "depth", form))
    (folder / f"confidence.{form}").write_bytes(encode_map(np.ones_like(depth), "confidence", form))
    record = {"rig": RIG.to_dict(), "pose": camera.tolist() if pose else None, "world": world,
              "camera_to_rover": camera.tolist()}  # fmt: skip
    (folder / "prediction.json").write_text(json.dumps(record))


def layer(out: Path, name: str) -> tuple[np.ndarray, float, float]:
    """The numbers of a layer, west and north of its corner [m]."""
    with Image.open(out / f"{name}.tif") as image:
        tie = image.tag_v2[33922]
        return np.asarray(image), tie[3], tie[4]


def at(out: Path, name: str, x: float, y: float) -> float:
    values, west, north = layer(out, name)
    return float(values[int((north - y) / 0.1), int((x - west) / 0.1)])


def test_a_map_in_the_rovers_frame_says_so_and_has_no_place_on_mars(tmp_path, capsys):
    write_pair(tmp_path / "pair", pose=False)
    arguments = [str(tmp_path / "pair"), "--out", str(tmp_path / "map"), "--max-range", "6"]
    assert main(arguments) == 0
    with Image.open(tmp_path / "map" / "elevation.tif") as image:
        assert image.tag_v2[34737] == "frame of the rover: x ahead, y left, metres|"
    assert main([*arguments, "--epsg", "32631"]) == 2
    assert "has no pose in a world; its map is in the rover's frame" in capsys.readouterr().err
    assert main([*arguments, "--origin", "5", "7"]) == 2
    assert capsys.readouterr().err.startswith(f"error: --origin 5 7: {tmp_path / 'pair'} has no pose in a world")


def test_the_map_holds_what_the_corners_of_an_image_show_within_the_range(tmp_path):
    write_pair(tmp_path / "pair")
    options = MapOptions(tmp_path / "pair", tmp_path / "out", max_range=6.0)
    elevation, _ = make_map(find_pairs(options.data), options)
    assert elevation.config.size / 2 > 6 * np.linalg.norm(RIG.camera.rays(), axis=-1).max() > 7


def test_a_map_of_several_pairs_reaches_as_far_around_the_first_as_around_the_last(tmp_path):
    """Cameras of two focal lengths stand 8 m apart; the wider one sees farther to the side."""
    wide = StereoRig(PinholeCamera.centred(160, 120, 60.0), 0.3)
    pairs = []
    for name, x, rig in (("a", 0.0, RIG), ("b", 8.0, wide)):
        (tmp_path / name).mkdir()
        np.save(tmp_path / name / "depth.npy", np.full((120, 160), np.nan, np.float32))
        pose = look_pose(np.array([x, 0.0, 1.2]), yaw=0.0, pitch=np.deg2rad(20))
        pairs.append(PredictedPair(tmp_path / name, rig, pose, 1.2))
    elevation, _ = make_map(pairs, MapOptions(tmp_path, tmp_path / "out", max_range=6.0))
    reach = 6 * np.linalg.norm(wide.camera.rays(), axis=-1).max()
    for low, high, axis in ((0.0, 8.0, 0), (0.0, 0.0, 1)):
        start = elevation.origin[axis]
        assert start < low - reach and start + elevation.config.size > high + reach


def test_a_map_that_is_being_replaced_has_no_record(tmp_path, monkeypatch):
    write_pair(tmp_path / "pair")
    arguments = [str(tmp_path / "pair"), "--out", str(tmp_path / "map"), "--max-range", "6"]
    assert main(arguments) == 0
    monkeypatch.setattr("nav.ground.map_files.encode_png", lambda picture: (_ for _ in ()).throw(KeyboardInterrupt))
    assert main([*arguments, "--cell", "0.3"]) == 130
    assert (tmp_path / "map" / "elevation.tif").is_file() and not (tmp_path / "map" / "map.json").exists()


@pytest.mark.parametrize("form", ["npy", "png"])
def test_one_pair_becomes_a_map_around_the_rover(tmp_path, capsys, form):
    write_pair(tmp_path / "pair", pose=False, form=form)
    assert main([str(tmp_path / "pair"), "--out", str(tmp_path / "map")]) == 0
    out = tmp_path / "map"
    assert {path.name for path in out.iterdir()} == {
        "elevation.tif", "top.tif", "weight.tif", "step.tif", "slope_deg.tif", "roughness.tif", "cost.tif",
        "traversability.tif", "map.png", "map.json",
    }  # fmt: skip
    heights = layer(out, "elevation")[0]
    ground = np.abs(heights) < 0.03
    assert ground.sum() > 0.8 * np.isfinite(heights).sum() > 1000
    assert at(out, "top", 4.55, -0.5) == pytest.approx(0.6, abs=0.05)  # the front of the block, right of the rover
    assert at(out, "traversability", 4.55, -0.5) == 2 and at(out, "traversability", 3.0, 0.5) == 0
    assert at(out, "traversability", 4.0, -0.5) == 1 and at(out, "traversability", 0.5, 0.2) == 255
    assert np.isnan(at(out, "elevation", 0.5, 0.2))
    assert capsys.readouterr().out.startswith(f"{out}: 1 pair; ")
    picture = cv2.imread(str(out / "map.png"))
    assert picture.shape[0] >= 600 and (picture == 128).all(axis=-1).any()


def test_the_files_end_where_nothing_more_was_seen(tmp_path):
    write_pair(tmp_path / "pair", pose=False)
    assert main([str(tmp_path / "pair"), "--out", str(tmp_path / "map")]) == 0
    code, west, north = layer(tmp_path / "map", "traversability")
    known = code != 255
    assert known[0].any() and known[-1].any() and known[:, -1].any()  # north, south and east
    assert west == pytest.approx(0.0, abs=0.11) and not known[:, :10].any()  # the camera, before what it sees
    about = json.loads((tmp_path / "map/map.json").read_text())
    assert about["rows_columns"] == list(code.shape)
    assert about["west_south_m"] == pytest.approx([west, north - 0.1 * code.shape[0]])
    picture = cv2.imread(str(tmp_path / "map/map.png"))
    factor = 600 // max(code.shape) + 1
    row, column = 6 + int((north - 0.15) / 0.1 * factor), LEFT + 6 + int((0.05 - west) / 0.1 * factor)
    assert (picture[row, column] > 200).all()  # the mark of the camera, and the arrow ahead
    assert (picture[row, column + 15] > 200).all() and not (picture[row, column - 6 : column - 3] > 200).any()
    height = picture.shape[0]
    assert (picture[: height - STRIP, : LEFT - 8] < 100).any() and (picture[height - STRIP :, LEFT:] < 100).any()


def test_the_summary_counts_the_cells_of_the_files(tmp_path, capsys):
    write_pair(tmp_path / "pair", pose=False)
    assert main([str(tmp_path / "pair"), "--out", str(tmp_path / "map")]) == 0
    code, heights = (layer(tmp_path / "map", name)[0] for name in ("traversability", "elevation"))
    low, high = np.nanpercentile(heights, [5, 95])
    assert capsys.readouterr().out == (
        f"{tmp_path / 'map'}: 1 pair; {(code != 255).sum() * 0.01:.0f} m2 visible, heights {low:.2f} to {high:.2f} m "
        f"(5 to 95 %); obstacles on {(code == 2).sum() * 0.01:.1f} m2\n"
    )
    assert (code == 2).any()


def test_the_summary_gives_the_heights_from_low_to_high(tmp_path):
    elevation = map_of_height(lambda x, y: 0.1 * x)  # x is -8 to 8 m
    pairs = [PredictedPair(tmp_path, RIG, np.eye(4))]
    words = _summary(pairs, elevation, assess(elevation, ZHURONG, TraversabilityConfig()))
    assert words == "1 pair; 256 m2 visible, heights -0.72 to 0.72 m (5 to 95 %); obstacles on 0.0 m2"


@pytest.mark.parametrize(("height", "expected"), [(1.2, 1.2), (0.01, None), (-0.3, None)])
def test_a_cameras_height_is_that_on_the_rover(tmp_path, height, expected):
    write_pair(tmp_path / "pair", x=3.0)
    record = json.loads((tmp_path / "pair/prediction.json").read_text())
    record["camera_to_rover"] = look_pose(np.array([0.5, 0.1, height]), 0.0, 0.3).tolist()
    (tmp_path / "pair/prediction.json").write_text(json.dumps(record))
    assert find_pairs(tmp_path / "pair")[0].camera_height == (None if expected is None else pytest.approx(expected))


def test_wide_cells_need_fewer_points(tmp_path):
    write_pair(tmp_path / "pair", pose=False)
    assert main([str(tmp_path / "pair"), "--out", str(tmp_path / "map"), "--cell", "0.5", "--max-range", "6"]) == 0
    heights = layer(tmp_path / "map", "elevation")[0]
    assert np.isfinite(heights).sum() >= 4 and np.nanmedian(np.abs(heights)) < 0.05


def test_pairs_with_poses_become_one_map_at_its_place(tmp_path):
    for number, x in enumerate((0.0, 3.0, 8.0)):
        write_pair(tmp_path / f"drive/{number}", x)
    flags = ["--origin", "1000", "2000", "--epsg", "32631", "--max-range", "6"]
    assert main([str(tmp_path / "drive"), "--out", str(tmp_path / "map"), *flags]) == 0
    out = tmp_path / "map"
    for x in (3.0, 8.5, 11.0):  # seen by one camera each
        assert abs(at(out, "elevation", 1000 + x, 2000.5)) < 0.03
    assert at(out, "traversability", 1004.55, 1999.5) == 2
    about = json.loads((out / "map.json").read_text())
    assert about["pairs"] == 3 and about["west_south_m"][0] == pytest.approx(1000, abs=0.11)


def test_a_code_in_degrees_is_refused(tmp_path, capsys):
    write_pair(tmp_path / "drive/0")
    for code in ("4326", "4979", "4617", "4230", "1023"):
        assert main([str(tmp_path / "drive"), "--out", str(tmp_path / "map"), "--epsg", code]) == 2
        error = capsys.readouterr().err
        assert error.startswith("error: --epsg must be ") and error.count("\n") == 1
    assert not (tmp_path / "map").exists()


@pytest.mark.parametrize("code", [32631, 4037, 4048, 4647])
def test_a_code_in_metres_is_taken(code):
    assert MapOptions(Path("drive"), Path("map"), epsg=code).epsg == code


def test_an_assumed_place_on_the_rover_is_a_warning(tmp_path, capsys):
    write_pair(tmp_path / "pair", pose=False)
    record = json.loads((tmp_path / "pair/prediction.json").read_text())
    for assumed in (True, False):
        (tmp_path / "pair/prediction.json").write_text(json.dumps({**record, "mount_assumed": assumed}))
        assert main([str(tmp_path / "pair"), "--out", str(tmp_path / "map")]) == 0
        error = capsys.readouterr().err
        assert ("pair: nothing said where the camera is on the rover, so Zhurong's place" in error) == assumed
    assert error == ""


def test_depth_beyond_the_range_is_a_warning(tmp_path, capsys):
    write_pair(tmp_path / "pair", pose=False)
    depth = np.load(tmp_path / "pair/depth.npy")
    depth[:-3] = 40.0  # a plain behind a strip of ground, which hardly makes a map
    np.save(tmp_path / "pair/depth.npy", depth)
    assert main([str(tmp_path / "pair"), "--out", str(tmp_path / "map")]) == 0
    first, second = capsys.readouterr().err.splitlines()
    assert first == "warning: 98 % of the depth lies beyond --max-range 12 m: give a larger one"
    assert second.startswith("warning: only 0.") and "m2 of ground are visible, too little" in second
    depth[:] = 40.0
    np.save(tmp_path / "pair/depth.npy", depth)
    assert main([str(tmp_path / "pair"), "--out", str(tmp_path / "map")]) == 2
    assert "makes a map: 100 % of the depth lies beyond --max-range 12 m" in capsys.readouterr().err


def test_depth_at_the_range_does_not_lie_beyond_it():
    count = DepthCount()
    count.add(np.array([[11.0, 12.0, 12.1], [np.nan, np.inf, 0.0]]), 12.0)
    assert (count.known, count.beyond) == (3, 1)


def test_pairs_without_a_pose_stay_out_of_a_map_of_many(tmp_path, capsys):
    for name, posed in (("a", False), ("b", True), ("c", True)):
        write_pair(tmp_path / "drive" / name, float(ord(name)), posed)
    assert main([str(tmp_path / "drive"), "--out", str(tmp_path / "map")]) == 0
    said = capsys.readouterr()
    assert said.err == "note: the map lacks 1 pair of 3, which have no pose\n" and "2 pairs;" in said.out


def test_pairs_without_confidence_are_a_warning_and_refuse_its_limit(tmp_path, capsys):
    write_pair(tmp_path / "pair")
    (tmp_path / "pair/confidence.npy").unlink()
    command = [str(tmp_path / "pair"), "--out", str(tmp_path / "map")]
    assert main([*command, "--min-confidence", "0.9"]) == 2
    assert capsys.readouterr().err.startswith("error: --min-confidence 0.9: " + str(tmp_path / "pair") + " holds no")
    assert main(command) == 0
    assert capsys.readouterr().err.startswith("warning: 1 pair of 1 have no confidence")
    assert json.loads((tmp_path / "map/map.json").read_text())["min_confidence"] is None


def known_with(folder: Path, shift: float | None) -> int:
    """Cells that a pair of uncertain depth measures, of cameras whose principal points are a shift [px] apart."""
    write_pair(folder)
    (folder / "confidence.npy").write_bytes(encode_map(np.full((120, 160), 0.6), "confidence", "npy"))
    record = json.loads((folder / "prediction.json").read_text())
    (folder / "prediction.json").write_text(json.dumps(record | ({} if shift is None else {"shift_px": shift})))
    elevation, _ = make_map(find_pairs(folder), MapOptions(folder, folder))
    return int(elevation.measured.sum())


def test_cameras_that_are_toed_in_see_more_of_the_near_ground_with_both_eyes(tmp_path):
    """Their right image begins farther to the left in the view, and ends there too."""
    names = {"recorded before": None, "parallel": 0.0, "toed in": 6.0, "apart": 150.0}
    known = {name: known_with(tmp_path / name, shift) for name, shift in names.items()}
    assert known["recorded before"] == known["parallel"] < known["toed in"] > 4 * known["apart"]


@pytest.mark.parametrize("is_known", [True, False])
@pytest.mark.parametrize(("baseline", "height"), [(0.3, 1.2), (0.3, 0.5), (0.3, 0.25), (0.05, 0.1)])
def test_level_ground_is_no_edge_for_cameras_close_to_it(tmp_path, baseline, height, is_known):
    """Its disparity changes by baseline / height per row: by over 1 px from row to row for the third."""
    rig, pose = StereoRig(RIG.camera, baseline), look_pose(np.array([0, 0, height]), yaw=0.0, pitch=np.deg2rad(20))
    rays = rig.camera.rays() @ pose[:3, :3].T
    depth = np.where(rays[..., 2] < 0, -height / np.minimum(rays[..., 2], -1e-9), np.inf).astype(np.float32)
    folder = tmp_path / "pair"
    folder.mkdir()
    np.save(folder / "depth.npy", depth)
    pair = PredictedPair(folder, rig, pose, height if is_known else None)
    elevation, _ = make_map([pair], MapOptions(folder, tmp_path, max_range=4.0))
    x, y = np.meshgrid(*elevation.centres())
    farthest = np.sqrt(0.08 * rig.camera.fy * height)  # rows are 8 cm apart there
    ahead = (x > max(1.1 * height, 0.7)) & (x < farthest) & (abs(y) < 0.2)
    assert ahead.sum() > 8 and elevation.measured[ahead].all()


@pytest.mark.parametrize("fall_deg", [0, 15, 25])
def test_ground_that_falls_away_is_known_as_well_by_an_assumed_place_as_by_zhurongs(tmp_path, fall_deg):
    slope = np.tan(np.deg2rad(fall_deg))
    pose = look_pose(np.array([0, 0, 1.2]), yaw=0.0, pitch=np.deg2rad(20))
    rays = RIG.camera.rays() @ pose[:3, :3].T
    steep = rays[..., 2] + slope * rays[..., 0]
    depth = np.where(steep < 0, -1.2 / np.minimum(steep, -1e-9), np.inf).astype(np.float32)
    folder = tmp_path / "pair"
    folder.mkdir()
    np.save(folder / "depth.npy", depth)
    cells = []
    for height in (None, 1.2):
        elevation, _ = make_map([PredictedPair(folder, RIG, pose, height)], MapOptions(folder, tmp_path))
        cells.append(int(elevation.measured.sum()))
    assert cells[0] == cells[1] > 1000


def test_what_stands_above_the_camera_does_not_blur_the_edges_between_surfaces(tmp_path):
    """Nothing below it says how high the camera is."""
    depth = np.full((120, 160), 8.0, np.float32)
    depth[:, 60:100], depth[:, 100:102] = 3.0, 5.0  # a column before a wall, and pixels that hang between them
    folder = tmp_path / "pair"
    folder.mkdir()
    np.save(folder / "depth.npy", depth)
    pose = look_pose(np.array([0, 0, 1.2]), yaw=0.0, pitch=np.deg2rad(-35))
    elevation, _ = make_map([PredictedPair(folder, RIG, pose)], MapOptions(folder, tmp_path))
    known, _ = make_map([PredictedPair(folder, RIG, pose, 1.2)], MapOptions(folder, tmp_path))
    assert known.measured.sum() > 20
    np.testing.assert_array_equal(elevation.measured, known.measured)


@pytest.mark.parametrize(
    ("case", "message"),
    [
        ("no folder", "gone: no such folder"),
        ("no pairs", "holds no prediction.json; give a folder that m3depth.predict wrote"),
        ("no pose", "a/prediction.json: has no pose, which a map of many pairs needs"),
        ("scenes", "holds pairs of 2 scenes; give the folder of one"),
        ("no depth", "a: holds no depth; m3depth.predict --write depth"),
        ("broken", "depth.npy: is not a map of depth"),
        ("size", "a: depth is (7, 7), the rig's camera has (120, 160) pixels"),
        ("record", "a/prediction.json: holds no rig and pose of a pair"),
        ("shift", "a/prediction.json: shift_px must be a number [px], got 'wide'; predict it again"),
        ("turned", "a/prediction.json: pose must be a rotation and a translation above the row 0 0 0 1; predict it"),
        ("far apart", "--cell 0.1: the pairs lie up to 9000 m apart"),
        ("far range", "--max-range 400: the pairs lie up to 0 m apart, and depth reaches 5"),
        ("unsure", "no depth of up to 12 m is sure enough"),
        ("out", "map: holds predictions; choose another"),
        ("cell", "--cell must be 0.02 to 0.5 m, got 9"),
        ("unknown", "no depth of up to 12 m is sure enough"),
    ],
)
def test_what_cannot_become_a_map_is_one_line(tmp_path, capsys, case, message):
    data, out, flags = tmp_path / "data", tmp_path / "map", ["--cell", "9"] if case == "cell" else []
    posed, apart = case != "no pose", 9000.0 if case == "far apart" else 0.0
    write_pair(data / "a", pose=posed, world="1" if case == "scenes" else None)
    if case in ("no pose", "scenes", "far apart"):
        write_pair(data / "b", apart, posed, world="2" if case == "scenes" else None)
    if case == "far range":
        flags = ["--max-range", "400"]
    if case == "no folder":
        data = tmp_path / "gone"
    elif case == "no pairs":
        (data / "a/prediction.json").unlink()
    elif case == "no depth":
        (data / "a/depth.npy").unlink()
    elif case == "broken":
        (data / "a/depth.npy").write_bytes(b"none")
    elif case == "size":
        np.save(data / "a/depth.npy", np.ones((7, 7), np.float32))
    elif case == "record":
        (data / "a/prediction.json").write_text('{"pose": [1, 2]}')
    elif case == "shift":
        record = json.loads((data / "a/prediction.json").read_text())
        (data / "a/prediction.json").write_text(json.dumps(record | {"shift_px": "wide"}))
    elif case == "turned":
        record = json.loads((data / "a/prediction.json").read_text())
        record["pose"] = np.transpose(record["pose"]).tolist()
        (data / "a/prediction.json").write_text(json.dumps(record))
    elif case == "unknown":
        np.save(data / "a/depth.npy", np.full((120, 160), np.nan, np.float32))
    elif case == "unsure":
        np.save(data / "a/confidence.npy", np.zeros((120, 160), np.float32))
    elif case == "out":
        write_pair(out)
    assert main([str(data), "--out", str(out), *flags]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
    assert case == "out" or not out.exists()


def test_a_prediction_that_was_interrupted_makes_a_map_with_a_note(tmp_path, capsys):
    for name in "bc":
        write_pair(tmp_path / "drive" / name, float(ord(name)))
    for of_all, note in ((3, True), (2, False)):
        (tmp_path / "drive/predictions.json").write_text(json.dumps({"pairs": of_all}))
        assert main([str(tmp_path / "drive"), "--out", str(tmp_path / "map")]) == 0
        expected = f"note: {tmp_path / 'drive'} holds 2 of 3 pairs, and the map lacks the others\n"
        assert capsys.readouterr().err == (expected if note else "")
