"""The trees as their authors pack them, made by hand, with what is particular to each; and files that are wrong."""

import io
import json
import shutil
from dataclasses import fields, replace
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
import tyro

from m3depth.datasets import exr
from m3depth.datasets.config import FLAGS, DataConfig
from m3depth.datasets.folders import matches, read_list
from m3depth.datasets.oaisys import oaisys_rig
from m3depth.datasets.open import detect, open_folders, open_pairs
from m3depth.datasets.pair_files import SHIFT_KEY
from m3depth.datasets.state import state_of_pairs
from m3depth.evaluation.without_truth.pairs import are_without_truth
from m3depth.prediction.options import PredictOptions
from m3depth.prediction.sources.calibration import make_calibration
from m3depth.prediction.sources.inputs import find_inputs
from marssim.base.camera import PinholeCamera
from marssim.base.dataset.dataset import SPLITS
from marssim.base.files.json_file import DatasetError
from marssim.base.files.pfm import encode_pfm

H, W = 24, 40
MIDDLEBURY_CALIB = """\
cam0=[50 0 19.5; 0 50 11.5; 0 0 1]
cam1=[50 0 {right} ; 0 50 11.5; 0 0 1]
doffs={doffs}
baseline=270
width=40
height=24
ndisp=64
"""


def image(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (H, W, 3), dtype=np.uint8)


def put(path: Path, content: np.ndarray | str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(content, str):
        path.write_text(content)
    elif path.suffix == ".pfm":
        path.write_bytes(encode_pfm(content))
    elif path.suffix == ".exr":
        channels = dict.fromkeys("RGB", content)
        OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, channels).write(str(path))
    elif path.suffix == ".npy":
        np.save(path, content)
    else:
        cv2.imwrite(str(path), content)


def ramp(low: float = 5.0) -> np.ndarray:
    return (low + 0.1 * np.arange(W, dtype=np.float32))[None].repeat(H, 0)


def test_kitti_2015_with_its_shifted_projections(tmp_path) -> None:
    """P_rect_02 is not that of the reference camera: both colour eyes have a fourth column."""
    training = tmp_path / "training"
    for eye in ("image_2", "image_3"):
        put(training / eye / "000007_10.png", image())
        put(training / eye / "000007_11.png", image(1))  # the next frame is no pair
    known = np.round(ramp() * 256).astype(np.uint16)
    known[:10] = 0
    visible = known.copy()
    visible[:, :8] = 0
    put(training / "disp_occ_0" / "000007_10.png", known)
    put(training / "disp_noc_0" / "000007_10.png", visible)
    left, right = (f"50 0 19.5 {t} 0 50 11.5 0.2 0 0 1 0.003" for t in ("2.5", "-11.0"))
    put(training / "calib_cam_to_cam" / "000007.txt", f"S_02: 40 24\nP_rect_02: {left}\nP_rect_03: {right}\n")
    pairs = open_pairs(tmp_path, "all")
    assert len(pairs) == 1 and detect(tmp_path, DataConfig()) == "kitti"
    sample = pairs[0]
    assert sample.rig.baseline == pytest.approx(13.5 / 50)
    assert np.isnan(sample.depth[:10]).all() and not sample.valid[:10].any()
    np.testing.assert_allclose(sample.disparity[10:], ramp()[10:], atol=1 / 500)
    assert sample.occluded[10:, :8].all() and not sample.occluded[:10].any() and not sample.occluded[:, 8:].any()


def test_kitti_2012(tmp_path) -> None:
    training = tmp_path / "training"
    for eye in ("colored_0", "colored_1"):
        put(training / eye / "000000_10.png", image())
    put(training / "disp_occ" / "000000_10.png", np.full((H, W), 1280, np.uint16))
    rows = "50 0 19.5 {} 0 50 11.5 0 0 0 1 0"
    put(training / "calib" / "000000.txt", "".join(f"P{i}: {rows.format(-13.5 * (i % 2))}\n" for i in range(4)))
    sample = open_pairs(tmp_path, "all")[0]
    assert sample.rig.fb == pytest.approx(13.5) and np.allclose(sample.depth, 2.7)


def test_sceneflow_without_calibration(tmp_path) -> None:
    """FlyingThings3D has no VAL: the tenth training scene; and no calibration files: f is 1050 px at 960 px."""
    for split, count in (("TRAIN", 10), ("TEST", 1)):
        for scene in range(count):
            inside = f"{split}/A/{scene:04d}"
            for eye in ("left", "right"):
                put(tmp_path / "frames_finalpass" / inside / eye / "0006.png", image())
            put(tmp_path / "disparity" / inside / "left" / "0006.pfm", ramp())
    lengths = {split: len(open_pairs(tmp_path, split)) for split in ("train", "val", "test", "all")}
    assert lengths == {"train": 9, "val": 1, "test": 1, "all": 11}
    sample = open_pairs(tmp_path, "test")[0]
    assert sample.rig.camera.fx == pytest.approx(1050 * W / 960) and sample.rig.baseline == 0.2
    inside = "15mm_focallength/scene_forwards/fast"
    for eye in ("left", "right"):
        put(tmp_path / "driving" / "frames_cleanpass" / inside / eye / "0001.png", image())
    put(tmp_path / "driving" / "disparity" / inside / "left" / "0001.pfm", ramp())
    assert open_pairs(tmp_path / "driving", "all")[0].rig.camera.fx == pytest.approx(450 * W / 960)


def sceneflow_pair(root: Path, inside: str) -> None:
    for eye in ("left", "right"):
        put(root / "frames_cleanpass" / inside / eye / "0001.png", image())
    put(root / "disparity" / inside / "left" / "0001.pfm", ramp())


def test_sceneflow_is_all_of_its_parts_that_are_there(tmp_path) -> None:
    sceneflow_pair(tmp_path / "FlyingThings3D", "TRAIN/A/0000")
    sceneflow_pair(tmp_path / "FlyingThings3D", "TEST/A/0001")
    sceneflow_pair(tmp_path / "Monkaa", "eating_x2")
    for speed in ("fast", "slow"):
        sceneflow_pair(tmp_path / "Driving", f"35mm_focallength/scene_backwards/{speed}")
    pairs = {split: open_pairs(tmp_path, split).names for split in ("train", "test")}
    assert pairs["test"] == ["TEST/A/0001/0001"] and len(pairs["train"]) == 4
    assert "TRAIN/Monkaa/eating_x2/0001" in pairs["train"]
    (tmp_path / "FlyingThings3D").rename(tmp_path / "elsewhere")
    assert sorted(set(open_pairs(tmp_path, "all").scenes)) == ["eating_x2", "scene_backwards"]  # one road


def test_one_road_of_driving_is_its_test(tmp_path) -> None:
    for road in ("scene_backwards", "scene_forwards"):
        for speed in ("fast", "slow"):
            sceneflow_pair(tmp_path, f"15mm_focallength/{road}/{speed}")
    parts = {split: set(open_pairs(tmp_path, split).scenes) for split in SPLITS}
    assert parts == {"train": {"scene_backwards"}, "val": set(), "test": {"scene_forwards"}}


def test_both_rectifications_of_a_scene_of_middlebury_are_one_scene(tmp_path) -> None:
    for name in ("Adirondack-perfect", "Adirondack-imperfect", "Backpack-perfect"):
        for eye in ("im0", "im1"):
            put(tmp_path / name / f"{eye}.png", image())
        put(tmp_path / name / "disp0.pfm", ramp())
        put(tmp_path / name / "calib.txt", MIDDLEBURY_CALIB.format(right=19.5, doffs=0))
    assert sorted(open_pairs(tmp_path, "all").scenes) == ["Adirondack", "Adirondack", "Backpack"]


def test_middlebury_moves_the_right_eye_by_doffs(tmp_path) -> None:
    """Z = f B / (d + doffs): the sample's rig has no doffs, so disparity and right image are those of such a rig."""
    scene = tmp_path / "Adirondack"
    right = image()
    put(scene / "im0.png", image(1))
    put(scene / "im1.png", right)
    truth = ramp()
    truth[0] = np.inf
    put(scene / "disp0.pfm", truth)
    put(scene / "calib.txt", MIDDLEBURY_CALIB.format(right=22.5, doffs=3))
    sample = open_pairs(tmp_path, "all")[0]
    assert np.isnan(sample.depth[0]).all()
    np.testing.assert_allclose(sample.depth[1:], 50 * 0.27 / (truth[1:] + 3), rtol=1e-5)
    np.testing.assert_allclose(sample.disparity[1:], truth[1:] + 3, rtol=1e-5)
    np.testing.assert_array_equal(sample.right[:, :-3], right[:, 3:, ::-1])  # moved to the left by 3 px
    outside = np.arange(W) < sample.disparity - 0.5  # the match of these is not in the right image as it is now
    assert outside.any() and not outside.all()
    np.testing.assert_array_equal(sample.occluded, outside)


def test_the_shift_of_a_reduced_pair_counts_its_own_pixels(tmp_path) -> None:
    scene = tmp_path / "Adirondack"
    for name, content in (("im0.png", image(1)), ("im1.png", image()), ("disp0.pfm", ramp())):
        put(scene / name, content)
    put(scene / "calib.txt", MIDDLEBURY_CALIB.format(right=27.5, doffs=8))
    shifts = [open_pairs(tmp_path, "all", DataConfig(resize=resize))[0].meta[SHIFT_KEY] for resize in (1.0, 0.5)]
    assert shifts == [8, 4]


def test_a_right_image_that_would_be_moved_out_of_view_is_refused(tmp_path) -> None:
    scene = tmp_path / "Adirondack"
    for name, content in (("im0.png", image(1)), ("im1.png", image()), ("disp0.pfm", ramp())):
        put(scene / name, content)
    put(scene / "calib.txt", MIDDLEBURY_CALIB.format(right=19.5 + W, doffs=W))
    with pytest.raises(DatasetError, match=f"im0.png: its calibration takes {W} px out of all disparities"):
        open_pairs(tmp_path, "all")[0]


def test_middlebury_training_sets_leave_out_scenes_without_truth(tmp_path) -> None:
    for name in ("Teddy", "Secret"):
        scene = tmp_path / "MiddEval3" / "trainingH" / name
        put(scene / "im0.png", image())
        put(scene / "im1.png", image())
        put(scene / "calib.txt", MIDDLEBURY_CALIB.format(right=19.5, doffs=0))
    put(tmp_path / "MiddEval3" / "trainingH" / "Teddy" / "disp0GT.pfm", ramp())
    put(tmp_path / "MiddEval3" / "trainingH" / "Teddy" / "mask0nocc.png", np.full((H, W), 128, np.uint8))
    pairs = open_pairs(tmp_path, "all")
    assert pairs.names == ["Teddy"]  # type: ignore[attr-defined]
    assert pairs[0].occluded.all()


def test_eth3d(tmp_path) -> None:
    for eye in ("im0.png", "im1.png"):
        put(tmp_path / "two_view_training" / "delivery_area_1l" / eye, image())
    put(tmp_path / "two_view_training" / "delivery_area_1l" / "calib.txt", MIDDLEBURY_CALIB.format(right=19.5, doffs=0))
    put(tmp_path / "two_view_training_gt" / "delivery_area_1l" / "disp0GT.pfm", ramp())
    sample = open_pairs(tmp_path, "all")[0]
    np.testing.assert_allclose(sample.depth, 13.5 / ramp(), rtol=1e-6)


def oaisys_tree(root: Path) -> Path:
    """Two batches of one pair, as OAISYS names them, and its config. Returns the config's path."""
    for batch in ("batch_0001", "batch_0002"):
        for sensor in ("sensorLeft", "sensorRight"):
            put(root / batch / sensor / f"0001{sensor}_rgb_00.png", image())
            put(root / batch / sensor / f"0001{sensor}_semantic_label_00.png", image())
        depth = np.full((H, W), 4.0, np.float16)
        depth[:5] = np.inf  # 1e10 in half precision
        put(root / batch / "sensorLeft" / "0001sensorLeft_pinhole_depth_00.exr", depth)
        (root / batch / "blender_file").mkdir()

    def sensor_of(name: str, place: list[float]) -> dict:
        params = {
            "outputBaseName": name, "imageResolution": [W, H], "KMatrix": [50, 0, 19.5, 0, 50, 11.5, 0, 0, 1],
            "transformation": [*place, 0.5, 0.5, -0.5, -0.5],
        }  # fmt: skip
        return {"type": "SensorCameraRGBD", "sensorParams": params}

    # the quaternion turns the camera's right (x) to the base's -y
    eyes = [sensor_of("sensorLeft", [0, 0, 0]), sensor_of("sensorRight", [0, -0.27, 0])]
    put(root / "cfg.json", json.dumps({"SENSOR_SETUP": {"GENERAL": {}, "SENSORS": eyes}}))
    return root / "cfg.json"


def test_oaisys_with_its_own_config(tmp_path) -> None:
    config = oaisys_tree(tmp_path)
    pairs = open_pairs(tmp_path, "all", DataConfig(calib=config))
    assert pairs.names == ["batch_0001/0001", "batch_0002/0001"]  # type: ignore[attr-defined]
    assert pairs.scenes == ["batch_0001", "batch_0002"]  # type: ignore[attr-defined]
    sample = pairs[0]
    assert sample.rig.baseline == pytest.approx(0.27) and sample.rig.camera.cx == 19.5
    assert np.isinf(sample.depth[:5]).all() and (sample.disparity[:5] == 0).all()
    np.testing.assert_allclose(sample.disparity[5:], 50 * 0.27 / 4)
    other = DataConfig(focal=60, baseline=0.3, left="sensorRight", right="sensorLeft")
    with pytest.raises(DatasetError, match=r"0001sensorRight_pinhole_depth_00\.exr: no such file"):
        open_pairs(tmp_path, "all", other)[0]


def test_oaisys_moves_the_right_eye_by_the_difference_of_the_principal_points(tmp_path) -> None:
    path = oaisys_tree(tmp_path)
    config = json.loads(path.read_text())
    config["SENSOR_SETUP"]["SENSORS"][1]["sensorParams"]["KMatrix"][2] = 22.5
    path.write_text(json.dumps(config))
    right = image(1)
    put(tmp_path / "batch_0001" / "sensorRight" / "0001sensorRight_rgb_00.png", np.roll(right, 3, axis=1))
    sample = open_pairs(tmp_path, "all", DataConfig(calib=path))[0]
    np.testing.assert_array_equal(sample.right[:, :-3], right[:, :-3, ::-1])
    np.testing.assert_allclose(sample.disparity[5:], 50 * 0.27 / 4)
    rig = oaisys_rig(path, DataConfig())
    assert rig is not None and rig.shift == sample.meta[SHIFT_KEY] == 3


def test_sensors_of_oaisys_are_named_as_the_message_asks(tmp_path) -> None:
    config = oaisys_tree(tmp_path)
    config.write_text(config.read_text().replace("sensorLeft", "camA").replace("sensorRight", "camB"))
    for path in sorted(tmp_path.rglob("*sensor*"), key=lambda path: -len(path.parts)):
        path.rename(path.with_name(path.name.replace("sensorLeft", "camA").replace("sensorRight", "camB")))
    with pytest.raises(DatasetError, match="cannot tell the left sensor; name it by --left; its sensors: camA, camB"):
        open_pairs(tmp_path, "all", DataConfig(calib=config))
    named = DataConfig(calib=config, left="camA", right="camB")
    assert len(open_pairs(tmp_path, "all", named)) == 2 and not are_without_truth(tmp_path, named)
    flags = {"left": "camA", "right": "camB", "calib": (config,), "split": "all"}
    inputs = find_inputs(PredictOptions((tmp_path,), Path("out"), **flags))
    assert [pair.left.name for pair in inputs.pairs] == ["0001camA_rgb_00.png"] * 2
    patterns = DataConfig(calib=config, left="*/camA/*_rgb_00.png", right="*/camB/*_rgb_00.png")
    assert are_without_truth(tmp_path, patterns)


def test_a_config_of_oaisys_is_the_calibration_of_patterns_and_of_predictions(tmp_path) -> None:
    config = oaisys_tree(tmp_path)
    patterns = {"left": "*/sensorLeft/*sensorLeft_rgb_00.png", "right": "*/sensorRight/*sensorRight_rgb_00.png"}
    depth = "*/sensorLeft/*sensorLeft_pinhole_depth_00.exr"
    pairs = open_pairs(tmp_path, "all", DataConfig("folder", **patterns, depth=depth, calib=config))
    assert len(pairs) == 2 and pairs[0].rig.baseline == pytest.approx(0.27)
    for more in ({}, patterns):
        options = PredictOptions((tmp_path,), Path("out"), calib=(config,), **more)
        calibration = make_calibration(options, H, W, tmp_path / "left.png")
        assert (calibration.fx, calibration.cx, calibration.baseline) == (50, 19.5, pytest.approx(0.27))


def test_batches_of_several_runs_of_oaisys_have_their_own_names(tmp_path) -> None:
    configs = [oaisys_tree(tmp_path / run) for run in ("run1", "run2")]
    pairs = open_pairs(tmp_path, "all", DataConfig(calib=configs[0]))
    names = [f"run{run}/batch_000{batch}/0001" for run in (1, 2) for batch in (1, 2)]
    assert pairs.names == names  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"transformation": [0, -0.27, 0, 1, 0, 0, 0]}, "not a rectified pair"),
        ({"transformation": [0, 0.27, 0, 0.5, 0.5, -0.5, -0.5]}, "not a rectified pair"),
        ({"transformation": [0, -0.27, 0.1, 0.5, 0.5, -0.5, -0.5]}, "not a rectified pair"),
        ({"KMatrix": [51, 0, 19.5, 0, 50, 11.5, 0, 0, 1]}, "not a rectified pair"),
        ({"KMatrix": [51, 0]}, "lack KMatrix"),
        ({"KMatrix": [50, 0, 19.5, 0, 50, 12.5, 0, 0, 1]}, "not a rectified pair"),
        ({"KMatrix": [50, 0, float("nan"), 0, 50, 11.5, 0, 0, 1]}, "KMatrix and transformation .* must be finite"),
        ({"transformation": [0, -0.27, 0, float("nan"), 0.5, -0.5, -0.5]}, "transformation .* must be finite"),
        ({"transformation": [0, -270, 0, 0.5, 0.5, -0.5, -0.5]}, "baseline must be at most 10 m, got 270"),
        ({"outputBaseName": "second"}, "cannot tell the right sensor; name it by --right"),
        ({"outputBaseName": 5}, "cannot tell the right sensor; name it by --right; its sensors: sensorLeft, 5"),
    ],
)
def test_oaisys_sensors_that_are_not_a_pair_are_named(tmp_path, change, message) -> None:
    named_of_oaisys(tmp_path, 1, change, message)


@pytest.mark.parametrize(
    ("size", "message"),
    [([float("inf"), H], "lack KMatrix, transformation or imageRes"), ([0, H], "width must be at least 1 pixel")],
)
def test_a_size_of_oaisys_that_no_image_has_is_named(tmp_path, size, message) -> None:
    named_of_oaisys(tmp_path, 0, {"imageResolution": size}, message)


def named_of_oaisys(tmp_path: Path, eye: int, change: dict, message: str) -> None:
    """Assert that a config with a changed sensor is refused in one line."""
    path = oaisys_tree(tmp_path)
    config = json.loads(path.read_text())
    config["SENSOR_SETUP"]["SENSORS"][eye]["sensorParams"] |= change
    path.write_text(json.dumps(config))
    with pytest.raises(DatasetError, match=message) as error:
        open_pairs(tmp_path, "all", DataConfig(calib=path))
    assert str(path) in str(error.value) and "\n" not in str(error.value)


def test_a_changed_config_of_oaisys_is_other_data(tmp_path) -> None:
    path = oaisys_tree(tmp_path)
    states = [state_of_pairs(open_pairs(tmp_path, "all", DataConfig(calib=path)))]
    path.write_text(path.read_text() + " ")
    states.append(state_of_pairs(open_pairs(tmp_path, "all", DataConfig(calib=path))))
    assert states[0] != states[1]


def archive(values: np.ndarray) -> bytes:
    """What np.savez writes, whatever the file is called."""
    file = io.BytesIO()
    np.savez(file, values)
    return file.getvalue()


def patterns(root: Path, ending: str = ".npy", value: np.ndarray | None = None) -> None:
    for part in ("a", "b"):
        for number in range(5):
            put(root / part / f"{number}_left.jpg", image(number))
            put(root / part / f"{number}_right.jpg", image(number))
            put(root / part / f"{number}_map{ending}", ramp() if value is None else value)


def test_any_folder_by_patterns(tmp_path) -> None:
    """As SimMars6K has to be read, whose names are documented nowhere: NaTeCam, depth in metres."""
    patterns(tmp_path)
    config = DataConfig(left="**/*_left.jpg", right="**/*_right.jpg", depth="**/*_map.npy", focal=50, baseline=0.27)
    pairs = open_pairs(tmp_path, "all", config)
    assert len(pairs) == 10 and pairs.names[6] == "b/1_left"  # type: ignore[attr-defined]
    np.testing.assert_allclose(pairs[6].depth, ramp())
    sizes = [len(open_pairs(tmp_path, split, config)) for split in ("train", "val", "test")]
    assert sizes == [7, 2, 1]


def test_a_folder_of_pairs_is_one_scene_where_there_are_enough_for_all_splits(tmp_path) -> None:
    config = DataConfig(left="*/left/*.png", right="*/right/*.png", disparity="*/disparity/*.pfm", focal=50, baseline=1)
    for drive in range(10):
        for frame in range(2):
            for eye in ("left", "right"):
                put(tmp_path / f"drive{drive}" / eye / f"{frame}.png", image())
            put(tmp_path / f"drive{drive}" / "disparity" / f"{frame}.pfm", ramp())
    sizes = [len(open_pairs(tmp_path, split, config)) for split in SPLITS]
    assert sizes == [14, 4, 2] and len(set(open_pairs(tmp_path, "test", config).scenes)) == 1


@pytest.mark.parametrize("names", [("train", "validation", "test"), ("training", "valid", "testing")])
def test_folders_that_are_named_as_splits_are_splits(tmp_path, names) -> None:
    config = DataConfig(left="*/l/*.png", right="*/r/*.png", disparity="*/d/*.pfm", focal=50, baseline=1)
    for number, name in enumerate(names):
        for frame in range(number + 1):
            for eye in "lr":
                put(tmp_path / name / eye / f"{frame}.png", image())
            put(tmp_path / name / "d" / f"{frame}.pfm", ramp())
    assert [len(open_pairs(tmp_path, split, config)) for split in SPLITS] == [1, 2, 3]
    (tmp_path / names[0]).rename(tmp_path / "mine")
    with pytest.raises(DatasetError, match=r"lies in a folder of a split, but .*mine/l/0\.png does not; name all"):
        open_pairs(tmp_path, "train", config)


def test_one_file_is_not_both_images(tmp_path) -> None:
    patterns(tmp_path)
    config = DataConfig(left="a/*_left.jpg", right="a/*_left.jpg", depth="a/*_map.npy", focal=50, baseline=1)
    with pytest.raises(DatasetError, match=r"a/0_left\.jpg: --left and --right both find this file$"):
        open_pairs(tmp_path, "all", config)


def test_natecam_is_a_calibration_by_name(tmp_path) -> None:
    square = image()[:, :H]
    put(tmp_path / "l" / "0.png", square)
    put(tmp_path / "r" / "0.png", square)
    put(tmp_path / "d" / "0.exr", np.full((H, H), 3.0, np.float32))
    config = DataConfig(left="l/*.png", right="r/*.png", depth="d/*.exr", calib=Path("natecam"))
    sample = open_pairs(tmp_path, "all", config)[0]
    assert sample.rig.camera.fx == pytest.approx(595.9 * H / 512) and sample.rig.baseline == 0.27
    put(tmp_path / "l" / "0.png", image())
    put(tmp_path / "r" / "0.png", image())
    with pytest.raises(DatasetError, match="natecam: the images must be square"):
        open_pairs(tmp_path, "all", config)[0]


@pytest.mark.parametrize(
    ("ending", "stored", "unit"),
    [
        (".png", np.round(ramp() * 256).astype(np.uint16), None),
        (".png", np.round(ramp() * 32).astype(np.uint16), 32.0),  # CREStereo
        (".npy", -ramp(), -1.0),  # RAFT-Stereo's demo
        (".pfm", ramp(), None),
        (".tiff", ramp(), None),
        (".exr", ramp(), None),
    ],
)
def test_disparities_of_any_kind_of_file(tmp_path, ending, stored, unit) -> None:
    patterns(tmp_path, ending, stored)
    put(tmp_path / "calib.txt", MIDDLEBURY_CALIB.format(right=19.5, doffs=0))
    config = DataConfig(left="a/*_left.jpg", right="a/*_right.jpg", disparity=f"a/*_map{ending}", unit=unit)
    np.testing.assert_allclose(open_pairs(tmp_path, "all", config)[0].disparity, ramp(), atol=1 / 60)


def test_normals_from_depth_are_those_of_the_plane_and_unknown_at_gaps(tmp_path) -> None:
    v = np.arange(H, dtype=np.float32)[:, None].repeat(W, 1)
    patterns(tmp_path, ".pfm", np.where(v < 8, 0, 2 + 0.2 * v).astype(np.float32))
    shared = {"left": "a/*_left.jpg", "right": "a/*_right.jpg", "disparity": "a/*_map.pfm", "focal": 50, "baseline": 1}
    plain = open_pairs(tmp_path, "all", DataConfig(**shared))[0]
    assert not plain.normal.any()
    normal = open_pairs(tmp_path, "all", DataConfig(**shared, normals="depth"))[0].normal
    known = np.linalg.norm(normal, axis=-1) > 0.5
    assert not known[:11].any() and known[12:-3, 3:-3].all()
    # d = 2 + 0.2 v is the plane with n ~ -(0, 0.2 fy, d at the principal point)
    expected = -np.array([0, 0.2 * 50, 2 + 0.2 * 11.5])
    np.testing.assert_allclose(normal[known], np.tile(expected / np.linalg.norm(expected), (known.sum(), 1)), atol=1e-5)


def test_reduced_pairs_keep_their_depth(tmp_path) -> None:
    patterns(tmp_path)
    config = DataConfig(
        left="a/*_left.jpg", right="a/*_right.jpg", depth="a/*_map.npy", focal=50, baseline=1, resize=0.5
    )
    sample = open_pairs(tmp_path, "all", config)[0]
    assert sample.left.shape == (H // 2, W // 2, 3) and sample.rig.camera.fx == 25
    assert np.abs(sample.depth - ramp()[::2, ::2]).max() < 0.11
    np.testing.assert_allclose(sample.disparity * sample.depth, 25, rtol=1e-5)


@pytest.mark.parametrize("resize", [0.75, 0.5, 0.25])
def test_the_depth_of_reduced_pairs_is_that_of_the_reduced_camera(tmp_path, resize) -> None:
    """A plane, in which a quarter of a pixel makes an error, beside an edge, over which nothing is averaged."""
    camera = PinholeCamera.centred(W, H, 50.0)

    def scene(view: PinholeCamera) -> np.ndarray:
        depth = -1.5 / (view.rays() @ np.array([0, -np.cos(0.9), -np.sin(0.9)]))
        return np.where(np.arange(view.width) < view.width / 2, depth, 9.0).astype(np.float32)

    patterns(tmp_path, value=scene(camera))
    names = {"left": "a/*_left.jpg", "right": "a/*_right.jpg", "depth": "a/*_map.npy"}
    sample = open_pairs(tmp_path, "all", DataConfig(**names, focal=50, baseline=1, resize=resize))[0]
    truth = scene(sample.rig.camera)
    error = np.abs(sample.disparity - 50 * resize / truth)
    middle = sample.left.shape[1] // 2
    assert error[2:-2, 2 : middle - 2].max() < 0.01
    near = np.minimum(np.abs(sample.depth / truth[:, :1] - 1), np.abs(sample.depth / 9.0 - 1))
    assert near[2:-2].max() < 0.1  # of one surface or the other


def test_disparities_shrink_with_the_width_where_the_height_is_rounded(tmp_path) -> None:
    """40 x 24 px become 12 x 7, and 24 rows are not 7 / 0.3."""
    patterns(tmp_path, value=np.full((H, W), 5.0, np.float32))
    names = {"left": "a/*_left.jpg", "right": "a/*_right.jpg", "depth": "a/*_map.npy"}
    sample = open_pairs(tmp_path, "all", DataConfig(**names, focal=50, baseline=1, resize=0.3))[0]
    assert sample.depth.shape == (7, 12)
    np.testing.assert_allclose(sample.depth, 5, rtol=1e-3)
    np.testing.assert_allclose(sample.disparity, 0.3 * 50 / 5, rtol=1e-3)


def test_an_unknown_folder_says_which_flags_to_give(tmp_path) -> None:
    with pytest.raises(DatasetError, match=r"holds no dataset of marssim, KITTI.*--left"):
        open_pairs(tmp_path, "train")
    with pytest.raises(DatasetError, match="none: no such folder"):
        open_pairs(tmp_path / "none", "train")
    with pytest.raises(DatasetError, match="holds no pairs of layout eth3d"):
        open_pairs(tmp_path, "train", DataConfig(format="eth3d"))


def test_a_part_of_a_tree_names_the_whole(tmp_path) -> None:
    put(tmp_path / "tree" / "training" / "image_2" / "000007_10.png", image())
    put(tmp_path / "other" / "notes.txt", "")
    for part in ("training", "training/image_2"):
        with pytest.raises(DatasetError, match=rf"{part}: is a part of a dataset of layout kitti; give .*/tree$"):
            open_pairs(tmp_path / "tree" / part, "all")
    with pytest.raises(DatasetError, match="other: holds no dataset"):
        open_pairs(tmp_path / "other", "all")


def test_disparities_of_8_bits_are_refused_unless_their_unit_is_given(tmp_path) -> None:
    """KITTI's are of 16 bits, 256 for 1 px: a picture of 8 bits would be read as less than 1 px everywhere."""
    patterns(tmp_path, ".png", np.round(ramp() * 4).astype(np.uint8))
    put(tmp_path / "calib.txt", MIDDLEBURY_CALIB.format(right=19.5, doffs=0))
    flags = {"left": "a/*_left.jpg", "right": "a/*_right.jpg", "disparity": "a/*_map.png"}
    with pytest.raises(DatasetError, match=r"0_map\.png: has 8 bits; a PNG of disparity has 16 bits, 256 for 1 px"):
        open_pairs(tmp_path, "all", DataConfig(**flags))[0]
    np.testing.assert_allclose(open_pairs(tmp_path, "all", DataConfig(**flags, unit=4))[0].disparity, ramp(), atol=0.13)


@pytest.mark.parametrize(
    ("layout", "flags", "named"),
    [
        ("marssim", {"resize": 0.5}, "--resize does not belong to layout marssim, whose flags are none"),
        ("marssim", {"depth_range": (1.0, 5.0)}, "--depth-range does not"),
        ("marssim", {"normals": "depth"}, "--normals does not"),
        ("marssim", {"focal": 50.0, "baseline": 0.3}, "--focal does not"),
        ("kitti", {"left": "*.png"}, "--left does not belong to layout kitti, whose flags are --calib, --focal"),
        ("middlebury", {"unit": 2.0}, "--unit does not"),
        ("oaisys", {"depth": "*.exr"}, "--depth does not"),
        ("list", {"right": "*.png"}, "--right does not"),
    ],
)
def test_a_flag_that_the_layout_does_not_take_is_named(tmp_path, plane_set, layout, flags, named) -> None:
    root = plane_set if layout == "marssim" else tmp_path
    config = DataConfig(format="auto" if layout == "marssim" else layout, **flags)
    with pytest.raises(ValueError, match=f"{root.name}: {named}") as error:
        open_pairs(root, "train", config)
    assert "\n" not in str(error.value)


def test_every_field_of_the_config_is_a_flag_of_some_layout() -> None:
    assert {name for names in FLAGS.values() for name in names} | {"format"} == {f.name for f in fields(DataConfig)}


def test_the_flags_are_what_the_command_line_says() -> None:
    words = ["--left", "left/*.png", "--depth", "d/*.exr", "--calib", "natecam", "--depth-range", "0.5", "20.0"]
    config = tyro.cli(DataConfig, args=words)
    assert config.flags() == words and DataConfig().flags() == []


BROKEN = [
    (lambda r: (r / "a/0_right.jpg").unlink(), r"a/0_left\.jpg: has no partner in .*a/\*_right\.jpg"),
    (lambda r: (r / "a/0_map.npy").write_bytes(b""), r"a/0_map\.npy: holds no map"),
    (lambda r: (r / "a/0_map.npy").write_bytes(archive(ramp())), r"a/0_map\.npy: holds no map"),
    (lambda r: (r / "a/0_map.npy").write_bytes(b"PK\x03\x04"), r"a/0_map\.npy: holds no map"),
    (lambda r: (r / "a/0_left.jpg").write_bytes(b"x"), r"a/0_left\.jpg: not a readable image"),
    (lambda r: put(r / "a/0_right.jpg", image()[:20]), r"a/0_left\.jpg is 40 x 24, .*0_right\.jpg is 40 x 20"),
    (lambda r: put(r / "a/0_map.npy", ramp()[:20]), r"a/0_map\.npy: is 40 x 20, its image is 40 x 24"),
    (lambda r: put(r / "calib.txt", "cam0=[50 0 1]"), r"calib\.txt: field baseline is missing; give --calib"),
    (
        lambda r: put(r / "calib.txt", MIDDLEBURY_CALIB.format(right=19.5, doffs=0).replace("cam0=[50", "cam0=[0")),
        r"calib\.txt: fx must be positive and finite \[px\], got 0\.0; give --calib",
    ),
    (lambda r: (r / "calib.txt").unlink(), "needs --calib"),
    (
        lambda r: put(r / "calib.txt", MIDDLEBURY_CALIB.format(right=19.5, doffs=0).replace("width=40", "width=80")),
        r"calib\.txt: is for 80 x 24 px, .*0_left\.jpg is 40 x 24",
    ),
    (lambda r: np.save(r / "a/0_map.npy", np.array([{}, 1], object)), r"a/0_map\.npy: holds no map"),
]  # fmt: skip


@pytest.mark.parametrize(("damage", "message"), BROKEN)
def test_what_is_missing_or_does_not_fit_is_one_line_with_the_file(tmp_path, damage, message) -> None:
    patterns(tmp_path)
    put(tmp_path / "calib.txt", MIDDLEBURY_CALIB.format(right=19.5, doffs=0))
    damage(tmp_path)
    with pytest.raises(DatasetError, match=message) as error:
        open_pairs(tmp_path, "all", DataConfig(left="a/*_left.jpg", right="a/*_right.jpg", disparity="a/*_map.npy"))[0]
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("left", "message"), [
    ("a/*.png", r"no file matches a/\*\.png$"), ("./", r"no file matches \./$"),
    ("/data/a/*.png", r": /data/a/\*\.png is an absolute pattern; give one that starts from this folder$"),
])  # fmt: skip
def test_a_pattern_that_matches_nothing_is_named(tmp_path, left, message) -> None:
    config = DataConfig(left=left, right="b/*.png", depth="c/*.npy", focal=1, baseline=1)
    with pytest.raises(DatasetError, match=message):
        open_pairs(tmp_path, "all", config)


@pytest.mark.parametrize("start", ["./", "a/../", ".//./", "../data/"])
def test_a_pattern_is_what_its_path_means(tmp_path, start) -> None:
    patterns(tmp_path / "data")
    found = matches(tmp_path / "data", f"{start}*/*_left.jpg")
    assert list(found) == [(part, str(number)) for part in "ab" for number in range(5)]


@pytest.mark.parametrize(
    ("lefts", "scenes"),
    [
        (["left/00003_00.png", "left/00003_01.png", "left/00004_00.png"], ["00003", "00003", "00004"]),
        ([f"left/img_{i:04d}.png" for i in range(3)], [f"left/img_{i:04d}" for i in range(3)]),
        (["seq0/left_0.png", "seq0/left_1.png", "seq1/left_0.png"], ["seq0", "seq0", "seq1"]),
        (["a/0000/left/0006.png", "a/0000/left/0007.png", "a/0001/left/0006.png"], ["a/0000", "a/0000", "a/0001"]),
    ],
)
def test_pairs_of_a_list_that_show_one_scene_stay_together_and_others_do_not(tmp_path, lefts, scenes) -> None:
    put(tmp_path / "mine.txt", "".join(f"{left} right.png map.pfm\n" for left in lefts))
    assert open_pairs(tmp_path / "mine.txt", "all", DataConfig(focal=50, baseline=0.27)).scenes == scenes


@pytest.mark.parametrize("start", ["../other/", "sub/../../other/", "{}/other/"])
def test_no_pair_of_a_list_has_a_name_that_leads_out_of_a_folder_of_results(tmp_path, start) -> None:
    """As m3depth.predict writes its results to OUT/NAME."""
    left = start.format(tmp_path)
    (tmp_path / "set").mkdir()
    put(tmp_path / "set/all.txt", f"{left}a/left.png right.png map.pfm\n{left}b/left.png right.png map.pfm\n")
    pairs = open_pairs(tmp_path / "set/all.txt", "all", DataConfig(focal=50, baseline=0.27))
    assert [pair.name for pair in pairs.pairs] == ["a/left", "b/left"]


def test_an_unsorted_list_is_split_by_its_pairs(tmp_path) -> None:
    put(tmp_path / "mine.txt", "".join(f"left/img_{i:04d}.png right.png map.pfm\n" for i in range(20)))
    config = DataConfig(focal=50, baseline=0.27)
    assert [len(open_pairs(tmp_path / "mine.txt", part, config)) for part in SPLITS] == [14, 4, 2]


def test_lists_that_are_missing_are_named(tmp_path) -> None:
    config = DataConfig(format="list", focal=50, baseline=0.27)
    with pytest.raises(DatasetError, match=r"holds no list named train\.txt, val\.txt or test\.txt"):
        open_pairs(tmp_path, "all", config)
    with pytest.raises(DatasetError, match=r"mine\.txt: no such list"):
        read_list(tmp_path / "mine.txt", (3,))


def test_a_list_that_is_not_text_is_named(tmp_path) -> None:
    (tmp_path / "mine.txt").write_bytes(b"\x89PNG\r\n")
    with pytest.raises(DatasetError, match=r"mine\.txt: is not a text file"):
        open_pairs(tmp_path / "mine.txt", "all", DataConfig(focal=50, baseline=0.27))


@pytest.mark.parametrize("parts", [("TEST",), ("VAL", "TEST"), ("TRAIN", "VAL", "TEST")])
def test_what_is_named_after_splits_is_split_so(tmp_path, parts) -> None:
    """A download of SceneFlow's TEST alone, or an export of one split, is not divided again."""
    for part in parts:
        for number in range(10):
            frames = tmp_path / "frames_cleanpass" / part / "A" / f"{number:04d}"
            put(frames / "left" / "0006.png", image())
            put(frames / "right" / "0006.png", image())
            put(tmp_path / "disparity" / part / "A" / f"{number:04d}" / "left" / "0006.pfm", ramp())
    for split in SPLITS:
        expected = 10 if split.upper() in parts else 0
        assert len(open_pairs(tmp_path, split, DataConfig(format="sceneflow"))) == expected


@pytest.mark.parametrize("form", ["left/{}", "images/{}/left", "{}/left"])
@pytest.mark.parametrize("is_list", [False, True])
def test_folders_of_splits_may_lie_below_others(tmp_path, form, is_list) -> None:
    lines = []
    for part in ("training", "val", "test"):
        for number in range(3):
            left, right, truth = (
                f"{form.format(part).replace('left', eye)}/{number}" for eye in ("left", "right", "map")
            )
            put(tmp_path / f"{left}.png", image())
            put(tmp_path / f"{right}.png", image(1))
            put(tmp_path / f"{truth}.pfm", ramp())
            lines.append(f"{left}.png {right}.png {truth}.pfm\n")
    put(tmp_path / "all.txt", "".join(reversed(lines)))
    pattern = form.format("*")
    patterns = {
        name: f"{pattern.replace('left', eye)}/*.{ending}"
        for name, eye, ending in (("left", "left", "png"), ("right", "right", "png"), ("disparity", "map", "pfm"))
    }
    config = DataConfig(focal=50, baseline=0.27, **({"format": "list"} if is_list else patterns))
    for split in SPLITS:
        names = open_pairs(tmp_path / "all.txt" if is_list else tmp_path, split, config).names
        assert len(names) == 3 and all({"train": "training"}.get(split, split) in name for name in names)


def test_flags_that_fit_one_of_several_folders_are_explained(tmp_path) -> None:
    patterns(tmp_path / "mine", ".pfm")
    (tmp_path / "other").mkdir()
    config = DataConfig(left="**/*_left.jpg", right="**/*_right.jpg", disparity="**/*_map.pfm", focal=50, baseline=0.27)
    with pytest.raises(
        DatasetError, match=r"other: no file matches .*; the flags are for all folders but those of mars"
    ):
        open_folders([tmp_path / "mine", tmp_path / "other"], "train", config)
    with pytest.raises(DatasetError, match=r"other: no file matches \S+$"):
        open_folders([tmp_path / "other"], "train", config)


def test_a_folder_of_a_split_beside_others_is_named(tmp_path) -> None:
    for part in ("train", "test", "more"):
        for eye, content in (("left", image()), ("right", image(1))):
            put(tmp_path / eye / part / "0.png", content)
        put(tmp_path / "map" / part / "0.pfm", ramp())
    config = DataConfig(left="left/*/*.png", right="right/*/*.png", disparity="map/*/*.pfm", focal=50, baseline=0.27)
    with pytest.raises(
        DatasetError, match=r"left/test/0\.png: lies in a folder of a split, but .*left/more/0\.png does not"
    ):
        open_pairs(tmp_path, "train", config)
    assert len(open_pairs(tmp_path, "all", config)) == 3
    for eye, content in (("left", image()), ("right", image(1)), ("map", ramp())):
        shutil.rmtree(tmp_path / eye / "more")
        put(tmp_path / eye / ("2.pfm" if eye == "map" else "2.png"), content)  # beside the folders of splits
    config = replace(config, left="left/**/*.png", right="right/**/*.png", disparity="map/**/*.pfm")
    with pytest.raises(DatasetError, match=r"lies in a folder of a split, but .*left/2\.png does not"):
        open_pairs(tmp_path, "train", config)
    shutil.rmtree(tmp_path / "left/test")  # one split's name alone is no split
    assert [len(open_pairs(tmp_path, split, config)) for split in ("train", "all")] == [1, 2]


@pytest.mark.parametrize("source", ["--focal", "--calib", "calib.txt"])
def test_images_at_another_scale_need_a_focal_length_of_their_own(tmp_path, source) -> None:
    """But not those that are cut, as of KITTI, whose sizes differ by a few pixels."""
    height, width = image().shape[:2]
    sizes = {"0": (height, width), "1": (height, width - 2), "2": (height // 2, width), "3": (height // 2, width // 2)}
    for name, (rows, columns) in sizes.items():
        for eye in ("left", "right"):
            put(tmp_path / eye / f"{name}.png", image()[:rows, :columns])
        put(tmp_path / "map" / f"{name}.pfm", ramp()[:rows, :columns])
    put(tmp_path / "calib.txt", "P2: 50 0 9 0 0 50 5 0 0 0 1 0\nP3: 50 0 9 -13.5 0 50 5 0 0 0 1 0\n")
    sources = {"--focal": {"focal": 50, "baseline": 0.27}, "--calib": {"calib": tmp_path / "calib.txt"}}
    rig = sources.get(source, {})
    pairs = open_pairs(
        tmp_path, "all", DataConfig(left="left/*.png", right="right/*.png", disparity="map/*.pfm", **rig)
    )
    assert [len(pairs[i].left) for i in range(3)] == [rows for rows, _ in list(sizes.values())[:3]]
    with pytest.raises(DatasetError, match=r"left/3\.png: is .* px, and .*left/0\.png .* in pixels of one size"):
        pairs[3]


def test_a_baseline_in_metres_where_millimetres_are_expected_is_named(tmp_path) -> None:
    scene = tmp_path / "scene"
    for name, content in (("im0.png", image()), ("im1.png", image(1)), ("disp0.pfm", ramp())):
        put(scene / name, content)
    put(scene / "calib.txt", "cam0=[50 0 9; 0 50 5; 0 0 1]\nbaseline=0.27\n")
    with pytest.raises(DatasetError, match=r"calib\.txt: the baseline is 0\.00027 m; is it in the unit"):
        open_pairs(tmp_path, "all")[0]


def test_a_disparity_that_the_principal_points_make_impossible_is_unknown(tmp_path) -> None:
    """Of 3 px with doffs of -5, and of 5, the point would be behind what is farthest: no sky."""
    scene = tmp_path / "2014" / "Attic"
    truth = ramp()
    truth[0, :2] = 3, 5
    for name, content in (("im0.png", image()), ("im1.png", image()), ("disp0.pfm", truth)):
        put(scene / name, content)
    height, width = truth.shape
    text = f"cam0=[50 0 9; 0 50 5; 0 0 1]\ndoffs=-5\nbaseline=270\nwidth={width}\nheight={height}\n"
    put(scene / "calib.txt", text)
    sample = open_pairs(tmp_path, "all")[0]
    assert np.isnan(sample.depth[0, :2]).all() and (sample.disparity[0, :2] == 0).all()
    assert not np.isinf(sample.depth).any()


def test_a_list_of_pairs(tmp_path) -> None:
    patterns(tmp_path, ".pfm")
    put(tmp_path / "mine.txt", "".join(f"a/{i}_left.jpg a/{i}_right.jpg a/{i}_map.pfm\n" for i in range(5)) + "\n")
    config = DataConfig(focal=50, baseline=0.27)
    assert len(open_pairs(tmp_path / "mine.txt", "all", config)) == 5
    np.testing.assert_allclose(open_pairs(tmp_path / "mine.txt", "all", config)[4].disparity, ramp(), rtol=1e-6)
    put(tmp_path / "mine.txt", "a/0_left.jpg a/0_right.jpg\n")
    with pytest.raises(DatasetError, match=r"mine\.txt, line 1: expected left, right and disparity"):
        open_pairs(tmp_path / "mine.txt", "all", config)


@pytest.mark.parametrize("start", ["../pairs", "{}/pairs"])
def test_pairs_of_lists_that_lead_elsewhere_have_one_name_each(tmp_path, start) -> None:
    """The names of a split are the same, whichever splits are asked for."""
    for part in ("train", "test"):
        patterns(tmp_path / "pairs" / part, ".pfm")
        where = f"{start.format(tmp_path)}/{part}/a"
        lines = (f"{where}/{i}_left.jpg {where}/{i}_right.jpg {where}/{i}_map.pfm\n" for i in range(2))
        put(tmp_path / "lists" / f"{part}.txt", "".join(lines))
    config = DataConfig(format="list", focal=50, baseline=0.27)
    names = {split: open_pairs(tmp_path / "lists", split, config).names for split in ("train", "test", "all")}
    assert names["train"] == ["train/a/0_left", "train/a/1_left"]
    assert names["all"] == [*names["train"], "test/a/0_left", "test/a/1_left"] == [*names["train"], *names["test"]]


def test_paths_with_spaces_are_quoted_in_a_list(tmp_path) -> None:
    lines = '"my set/left 0.png" right.png map.pfm\n  a"b.png\t"c d.png"  "e.pfm"\n\n# x y\n'
    put(tmp_path / "mine.txt", lines)
    assert read_list(tmp_path / "mine.txt", (3,)) == [
        ["my set/left 0.png", "right.png", "map.pfm"],
        ['a"b.png', "c d.png", "e.pfm"],
    ]
    put(tmp_path / "mine.txt", "my set/0.png right.png map.pfm\n")
    with pytest.raises(DatasetError, match=r"line 1: expected left, right and disparity, .* in double quotes$"):
        read_list(tmp_path / "mine.txt", (3,))


def test_a_folder_of_exported_bags_names_one_of_them(tmp_path) -> None:
    put(tmp_path / "export.json", json.dumps({"format": "rosbag2"}))
    with pytest.raises(DatasetError, match="holds no dataset of marssim"):
        open_pairs(tmp_path, "all")
    for scene in ("00001", "00000"):
        put(tmp_path / "train" / scene / "metadata.yaml", "rosbag2_bagfile_information:\n")
    message = (
        rf"^{tmp_path}: holds ROS 2 bags and no dataset; m3depth.predict takes one of them, as {tmp_path}/train/00000$"
    )
    with pytest.raises(DatasetError, match=message):
        open_pairs(tmp_path, "all")


def test_distances_along_the_ray_are_read_as_depth(tmp_path) -> None:
    """The distances of a wall at 3 m, by the points of its pixels, and the sky."""
    u, v = np.meshgrid(np.arange(W), np.arange(H))
    x, y = 3 * (u - (W - 1) / 2) / 50, 3 * (v - (H - 1) / 2) / 50
    distance = np.sqrt(x**2 + y**2 + 9).astype(np.float32)
    distance[0] = np.inf
    for name, content in (("l/0.png", image()), ("r/0.png", image(1)), ("d/0.npy", distance)):
        put(tmp_path / name, content)
    config = DataConfig(left="l/*.png", right="r/*.png", depth="d/*.npy", focal=50, baseline=0.3, depth_along="ray")
    sample = open_pairs(tmp_path, "all", config)[0]
    np.testing.assert_allclose(sample.depth[1:], 3, rtol=1e-6)
    np.testing.assert_allclose(sample.disparity[1:], 5, rtol=1e-6)
    assert np.isinf(sample.depth[0]).all() and sample.depth.dtype == np.float32


def test_without_openexr_the_extra_is_named(tmp_path, monkeypatch) -> None:
    config = oaisys_tree(tmp_path)
    monkeypatch.setattr(exr, "find_spec", lambda name: None)
    with pytest.raises(ImportError, match=r'\.exr: OpenEXR is not installed; pip install "mars-m3depth\[exr\]"'):
        open_pairs(tmp_path, "all", DataConfig(calib=config))[0]


def test_a_truncated_exr_is_named(tmp_path) -> None:
    config = oaisys_tree(tmp_path)
    path = tmp_path / "batch_0001" / "sensorLeft" / "0001sensorLeft_pinhole_depth_00.exr"
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(DatasetError, match=r"pinhole_depth_00\.exr: holds no map"):
        open_pairs(tmp_path, "all", DataConfig(calib=config))[0]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"focal": 3.0}, "focal and --baseline belong together"),
        ({"focal": 3.0, "baseline": 1.0, "calib": Path("x")}, "calib and --focal exclude"),
        ({"disparity": "a", "depth": "b"}, "disparity and --depth exclude"),
        ({"normal": "a", "normals": "depth"}, "normal and --normals exclude"),
        ({"normal_frame": "opengl"}, "normal_frame belongs to --normal"),
        ({"depth_along": "ray"}, "depth_along belongs to --depth"),
        ({"resize": 1.5}, "resize must be"),
        ({"unit": 0.0}, "unit must be other than 0"),
        ({"baseline": -1.0}, "baseline must be positive"),
        ({"depth_range": (5.0, 1.0)}, "depth_range must be"),
    ],
)
def test_settings_that_cannot_work_name_their_field(values, message) -> None:
    with pytest.raises(ValueError, match=f"^{message}"):
        DataConfig(**values)


def test_what_lies_beyond_the_border_of_a_right_image_that_is_moved_to_the_right_is_occluded(tmp_path) -> None:
    scene = tmp_path / "Adirondack"
    truth = np.full((H, W), 16.0, np.float32)
    for name, content in (("im0.png", image(1)), ("im1.png", image()), ("disp0.pfm", truth)):
        put(scene / name, content)
    put(scene / "calib.txt", MIDDLEBURY_CALIB.format(right=13.5, doffs=-6))
    sample = open_pairs(tmp_path, "all")[0]
    assert (sample.disparity == 10).all()  # to the right image that was moved by 6 px, whose first 6 columns are empty
    assert sample.occluded[:, :16].all() and not sample.occluded[:, 16:].any()


def test_a_folder_with_another_name_of_a_split_is_named(tmp_path) -> None:
    for split in ("train", "test", "validation"):
        scene = tmp_path / split / "Teddy"
        for name, content in (("im0.png", image()), ("im1.png", image()), ("disp0.pfm", ramp())):
            put(scene / name, content)
        put(scene / "calib.txt", MIDDLEBURY_CALIB.format(right=19.5, doffs=0))
    message = f"{tmp_path / 'validation'}: holds pairs beside .*train and .*test; call the folder val$"
    with pytest.raises(DatasetError, match=message):
        open_pairs(tmp_path, "train")
    (tmp_path / "validation").rename(tmp_path / "val")
    assert [len(open_pairs(tmp_path, split)) for split in SPLITS] == [1, 1, 1]


@pytest.mark.parametrize("split", ["Test", "training", None, 5])
def test_a_split_that_is_none_is_named(tmp_path, split) -> None:
    scene = tmp_path / "Teddy"
    for name, content in (("im0.png", image()), ("im1.png", image()), ("disp0.pfm", ramp())):
        put(scene / name, content)
    put(scene / "calib.txt", MIDDLEBURY_CALIB.format(right=19.5, doffs=0))
    with pytest.raises(ValueError, match=f"^split {split!r} is unknown; choose from train, val, test, all$"):
        open_pairs(tmp_path, split)
