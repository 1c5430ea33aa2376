"""python -m m3depth.rectify: products and images, its files, and what it refuses in one line."""

import json
import shutil
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest
from raw_pairs import SIZE, WALL, cahvore_pair, depth_of, opencv_pair, write_images, write_products

from m3depth.predict import main as predict
from m3depth.rectify import main
from marssim.base.calibration.cameras import PosedPair
from marssim.base.calibration.kalibr import kalibr_text
from marssim.base.calibration.opencv_file import opencv_text
from marssim.base.calibration.orientation import rectified_view
from marssim.base.calibration.rectified import read_calibration
from marssim.base.images.resampling import pixel_grid

needs_pdr = pytest.mark.skipif(find_spec("pdr") is None, reason="needs the extra real")
PAIR = opencv_pair()


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    """A raw pair, and its calibration as OpenCV's YAML."""
    folder = tmp_path_factory.mktemp("raw")
    left, right = write_images(folder, PAIR)
    (folder / "stereo.yml").write_text(opencv_text(PAIR))
    return left, right, folder / "stereo.yml"


@pytest.fixture(scope="module")
def products(tmp_path_factory):
    """A pair of products of 16 bits."""
    return write_products(tmp_path_factory.mktemp("products"), cahvore_pair())


def report_of(out: Path) -> dict:
    return json.loads((out / "report.json").read_text())


def refused(capsys, *args) -> str:
    """Run the command, which must refuse in one line and write nothing, and return the line."""
    out = Path(str(args[-1]))
    assert main([str(arg) for arg in args[:-1]] + ["--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and error.count("\n") == 1
    assert not out.exists()
    return error


def test_images_with_a_calibration(tmp_path, images, capsys):
    left, right, calib = images
    assert main([str(left), str(right), "--calib", str(calib), "--out", str(tmp_path / "out")]) == 0
    out = tmp_path / "out"
    assert {f.name for f in out.iterdir()} >= {
        "left.png", "right.png", "left_valid.png", "right_valid.png", "rig.json", "report.json", "rows.png"
    }  # fmt: skip
    said = capsys.readouterr().out
    assert "480 x 360 px" in said and "baseline 0.2000" in said and "rows 0.0" in said
    report = report_of(out)
    assert report["rows"]["rectified"]["median_px"] < 0.05 < report["rows"]["raw"]["median_px"]
    assert report["rows"]["rectified"]["points"] > 500 and report["scale"] == "metres"
    calibration = read_calibration(out / "rig.json")
    assert calibration.size == SIZE and calibration.baseline == pytest.approx(PAIR.baseline)
    assert cv2.imread(str(out / "left.png"), cv2.IMREAD_UNCHANGED).shape == SIZE[::-1]


def test_raw_images_in_the_folder_of_the_results_are_not_replaced(tmp_path, images, capsys):
    left, right = (shutil.copy(path, tmp_path / f"{eye}.png") for eye, path in zip(("left", "right"), images))
    before = left.read_bytes()
    assert main([str(left), str(right), "--calib", str(images[2]), "--out", str(tmp_path)]) == 2
    line = f"error: --out {tmp_path}: its left.png would be replaced, and no report.json says that it is of an earlier"
    assert capsys.readouterr().err.startswith(line) and left.read_bytes() == before


@pytest.mark.usefixtures("undrawn_rows")
def test_what_is_uncertain_about_a_calibration_is_a_warning(tmp_path, images, capsys, monkeypatch):
    noted = PosedPair(*(replace(camera, note="the orientation is uncertain") for camera in (PAIR.left, PAIR.right)))
    monkeypatch.setattr("m3depth.rectification.checked.read_raw_calibration", lambda paths, fisheye: noted)
    left, right, calib = map(str, images)
    assert main([left, right, "--calib", calib, "--out", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().err == f"warning: {left} and {right}: the orientation is uncertain\n"


@pytest.mark.usefixtures("undrawn_rows")
def test_a_rectified_pair_can_be_rectified_again_by_its_rig_file(tmp_path, images):
    """There is nothing left to take out; the content moves by pixels, as its middle comes to the image's middle."""
    left, right, calib = images
    assert main([str(left), str(right), "--calib", str(calib), "--out", str(tmp_path / "one")]) == 0
    one = tmp_path / "one"
    again = [str(one / "left.png"), str(one / "right.png"), "--calib", str(one / "rig.json")]
    assert main([*again, "--focal", str(read_calibration(one / "rig.json").fx), "--out", str(tmp_path / "two")]) == 0
    first, second = (cv2.imread(str(tmp_path / name / "left.png"), 0)[20:-20, 20:-20] for name in ("one", "two"))
    assert report_of(tmp_path / "two")["rows"]["rectified"]["median_px"] < 0.08
    assert first.std() == pytest.approx(second.std(), rel=0.1)


@needs_pdr
def test_products_are_rectified_by_their_labels_and_the_right_one_is_found(tmp_path, products, capsys):
    assert main([str(products[0]), "--out", str(tmp_path / "out")]) == 0
    report = report_of(tmp_path / "out")
    assert report["calibration"] == "the labels of the images" and report["right"] == str(products[1])
    assert report["rows"]["rectified"]["median_px"] < 0.06 and report["baseline_m"] == pytest.approx(0.2)
    left = cv2.imread(str(tmp_path / "out" / "left.png"), cv2.IMREAD_UNCHANGED)
    valid = cv2.imread(str(tmp_path / "out" / "left_valid.png"), cv2.IMREAD_UNCHANGED)
    assert left.dtype == np.uint16 and left.max() > 2000
    missing = valid[150:260, 200:400] == 0  # the square without data
    assert 200 < missing.sum() < 1500


@needs_pdr
@pytest.mark.usefixtures("undrawn_rows")
def test_companded_products_of_8_bits(tmp_path):
    left, right = write_products(tmp_path, cahvore_pair(), bits=8)
    assert main([str(left), str(right), "--out", str(tmp_path / "out")]) == 0
    assert report_of(tmp_path / "out")["rows"]["rectified"]["median_px"] < 0.06


@pytest.mark.usefixtures("undrawn_rows")
def test_a_common_disparity_is_given_back_when_the_pair_is_predicted(tmp_path):
    pair, wall = opencv_pair(vergence_deg=10), (WALL[0], 1.0)  # nearer, so that much is common to all disparities
    left, right = write_images(tmp_path, pair, wall)
    (tmp_path / "camchain.yaml").write_text(kalibr_text(pair))
    calib = ["--calib", str(tmp_path / "camchain.yaml")]
    assert main([str(left), str(right), *calib, "--out", str(tmp_path / "out")]) == 0
    out = tmp_path / "out"
    calibration = read_calibration(out / "rig.json")
    assert calibration.shift > 0.05 * SIZE[0]
    images = [str(out / "left.png"), str(out / "right.png"), "--calib", str(out / "rig.json")]
    assert predict([*images, "--estimator", "sgbm", "--out", str(tmp_path / "predicted")]) == 0
    depth = np.load(tmp_path / "predicted" / "depth.npy")
    view = rectified_view(pair, calibration.fx, calibration.size, apart=True)
    true = depth_of(wall, view, pixel_grid(*SIZE))
    known = np.isfinite(depth) & (cv2.imread(str(out / "left_valid.png"), 0) > 0)
    assert known.mean() > 0.5 and np.median(np.abs(depth / true - 1)[known]) < 0.01


def test_align_without_a_calibration_says_that_depth_has_no_scale(tmp_path, images, capsys):
    left, right, _ = images
    assert main([str(left), str(right), "--align", "--out", str(tmp_path / "out")]) == 0
    assert "no scale: depth has no unit" in capsys.readouterr().out
    report = report_of(tmp_path / "out")
    assert report["scale"].startswith("none") and not (tmp_path / "out" / "rig.json").exists()
    assert len(report["rows"]["removed"]["terms_px"]) == 6


@pytest.mark.usefixtures("undrawn_rows")
def test_predict_names_the_pair_that_has_no_scale(tmp_path, images, capsys):
    left, right, _ = images
    assert main([str(left), str(right), "--align", "--out", str(tmp_path / "pair")]) == 0
    capsys.readouterr()
    assert predict([str(tmp_path / "pair"), "--estimator", "sgbm", "--out", str(tmp_path / "out")]) == 2
    assert f"--focal is missing (nothing gave {tmp_path}/pair a scale" in capsys.readouterr().err


def test_exchanged_eyes(tmp_path, images, products, capsys):
    left, right, _ = images
    assert "the wrong way round: exchange left and right" in refused(capsys, right, left, "--align", tmp_path / "out")
    if find_spec("pdr"):
        line = refused(capsys, products[1], products[0], tmp_path / "out")
        assert "is of the right eye and" in line and "exchange left and right" in line
        assert "are both of the left eye" in refused(capsys, products[0], products[0], tmp_path / "out")


def test_units_in_millimetres(tmp_path, images, capsys):
    left, right, calib = images
    start, mark, t = calib.read_text().rpartition("data: [")
    metres = [float(value) for value in t.strip(" ]\n").split(",")]
    (tmp_path / "mm.yml").write_text(f"{start}{mark} {', '.join(str(1000 * value) for value in metres)} ]\n")
    line = refused(capsys, left, right, "--calib", tmp_path / "mm.yml", tmp_path / "out")
    assert "mm.yml: the cameras stand" in line and "is the translation in millimetres?" in line


def test_images_and_calibrations_of_mixed_sizes(tmp_path, images, capsys):
    left, right, calib = images
    cv2.imwrite(str(tmp_path / "small.png"), cv2.imread(str(right), 0)[:300])
    line = refused(capsys, left, tmp_path / "small.png", "--calib", calib, tmp_path / "out")
    assert "small.png: is 480 x 300 px, the calibration is for images of 480 x 360" in line and "stereo.yml" in line
    assert "must have one size" in refused(capsys, left, tmp_path / "small.png", "--align", tmp_path / "out")


def test_a_missing_half(tmp_path, images, products, capsys):
    left, right, calib = images
    assert "give the right image too" in refused(capsys, left, "--calib", calib, tmp_path / "out")
    (tmp_path / products[0].name).write_bytes(products[0].read_bytes())
    line = refused(capsys, tmp_path / products[0].name, tmp_path / "out")
    assert products[1].name in line and "is missing; put it there, or give both" in line
    assert "no such image" in refused(capsys, left, tmp_path / "none.png", "--calib", calib, tmp_path / "out")
    line = refused(capsys, left, right, "--calib", tmp_path / "none.yml", tmp_path / "out")
    assert "none.yml: no such calibration file" in line


@needs_pdr
def test_a_truncated_product(tmp_path, products, capsys):
    for file in products:
        (tmp_path / file.name).write_bytes(file.read_bytes())
    whole = products[1].read_bytes()
    right = tmp_path / products[1].name
    right.write_bytes(whole[:-1000])
    line = refused(capsys, tmp_path / products[0].name, right, tmp_path / "out")
    assert f"{right.name}: is truncated: it has {len(whole) - 1000} of {len(whole)} bytes; fetch it again" in line
    right.write_bytes(whole[:700])
    assert "is the file truncated?" in refused(capsys, tmp_path / products[0].name, right, tmp_path / "out")


@needs_pdr
@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("START_TIME", "2023-02-17T05:32:09.508", "were taken 600 s apart"),
        ("ROVER_MOTION_COUNTER", "(33,2842,1,0)", "the rover or its mast moved between them"),
    ],
)
@pytest.mark.usefixtures("undrawn_rows")
def test_products_of_different_times(tmp_path, capsys, key, value, says):
    left, right = write_products(tmp_path, cahvore_pair(), **{key: value})
    assert says in refused(capsys, left, right, tmp_path / "out")
    assert main([str(left), str(right), "--unchecked", "--out", str(tmp_path / "out")]) == 0


def test_products_without_the_extra(tmp_path, products, capsys, monkeypatch):
    monkeypatch.setattr("m3depth.rectification.products.find_spec", lambda name: None)
    line = refused(capsys, *products, tmp_path / "out")
    assert "need pdr" in line and 'pip install "mars-m3depth[real]"' in line


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--focal", "-3"], "--focal must be positive"),
        (["--size", "2", "2"], "--size must be 16 to 16384 px"),
        (["--size", "480", "2"], "--size must be 16 to 16384 px, got 480 2"),
        (["--shift", "nan"], "--shift must be a finite number"),
        (["--calib", "a", "b", "c"], "--calib c: a pair has two calibration files at most"),
        (["--mask", "a", "b", "c"], "--mask c: a pair has two masks at most"),
        (["--align", "--shift", "3"], "--shift needs a calibration"),
        ([], "give its calibration with --calib, or --align"),
    ],
)
def test_wrong_flags(tmp_path, images, capsys, flags, says):
    assert says in refused(capsys, *images[:2], *flags, tmp_path / "out")


@pytest.mark.parametrize("focal", ["0.006", "1e-5", "1e7"])
def test_a_focal_length_in_another_unit_is_refused_before_any_work(tmp_path, images, capsys, focal):
    left, right, calib = images
    line = refused(capsys, left, right, "--calib", calib, "--focal", focal, tmp_path / "out")
    assert f"a focal length of {float(focal):g} px makes rectified images of " in line


@pytest.mark.usefixtures("undrawn_rows")
def test_images_that_are_rectified_already_are_refused(tmp_path, images, capsys):
    left, right, calib = images
    assert main([str(left), str(right), "--calib", str(calib), "--out", str(tmp_path / "one")]) == 0
    capsys.readouterr()
    one = tmp_path / "one"
    line = refused(capsys, one / "left.png", one / "right.png", "--calib", calib, tmp_path / "two")
    assert "px after (medians): are the images rectified already?" in line


def test_a_lens_that_folds_over_inside_the_image_is_refused(tmp_path, images, capsys):
    left, right, _ = images
    absurd = replace(PAIR.right, lens=replace(PAIR.right.lens, coefficients=(-3.0, 0.0, 0.0, 0.0)))
    (tmp_path / "absurd.yml").write_text(opencv_text(PosedPair(PAIR.left, absurd)))
    line = refused(capsys, left, right, "--calib", tmp_path / "absurd.yml", tmp_path / "out")
    assert "absurd.yml: the distortion of the right camera folds over inside the image of 480 x 360 px: " in line


def test_a_calibration_of_another_rig_is_noticed(tmp_path, images, capsys):
    left, right, calib = images
    (tmp_path / "other.yml").write_text(calib.read_text().replace("183.5", "143.5").replace("295.5", "255.5"))
    line = refused(capsys, left, right, "--calib", tmp_path / "other.yml", "--size", "480", "360", tmp_path / "out")
    assert "px apart after rectification (median): is the calibration that of these images, and the left" in line


def test_help_lists_the_flags(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    text = capsys.readouterr().out
    assert all(flag in text for flag in ("--calib", "--align", "--mask", "--focal", "--size", "--shift", "--fisheye"))
