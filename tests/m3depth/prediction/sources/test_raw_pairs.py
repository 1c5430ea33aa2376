"""m3depth.predict of raw images: it rectifies them on the way in."""

import json
import shutil
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest
from raw_pairs import GROUND, SIZE, cahvore_pair, depth_of, opencv_pair, write_images, write_products

from m3depth.predict import main
from m3depth.prediction.options import PredictOptions
from m3depth.prediction.sources.inputs import find_inputs
from m3depth.prediction.sources.raw_pairs import must_be_rectified
from marssim.base.calibration.kalibr import kalibr_text
from marssim.base.calibration.opencv_file import opencv_text
from marssim.base.calibration.orientation import rectified_view
from marssim.base.images.resampling import pixel_grid

needs_pdr = pytest.mark.skipif(find_spec("pdr") is None, reason="needs the extra real")
PAIR = opencv_pair()
WRITE = ["--write", "depth", "confidence"]


@pytest.fixture(scope="module")
def images(tmp_path_factory) -> Path:
    """A folder with a raw pair and its calibration, as OpenCV and Kalibr write it."""
    folder = tmp_path_factory.mktemp("raw")
    write_images(folder, PAIR)
    (folder / "stereo.yml").write_text(opencv_text(PAIR))
    (folder / "camchain.yaml").write_text(kalibr_text(PAIR))
    return folder


@pytest.fixture(scope="module")
def products(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("products")
    write_products(folder, cahvore_pair())
    return folder


def predicted(out: Path, *args: object) -> int:
    return main([str(arg) for arg in (*args, "--estimator", "sgbm", "--out", out, *WRITE)])


def refused(capsys, out: Path, *args: object) -> str:
    assert predicted(out, *args) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and error.count("\n") == 1 and not out.exists()
    return error


def test_a_raw_pair_with_its_calibration_gives_true_depth(tmp_path, images, capsys):
    out = tmp_path / "out"
    assert predicted(out, images / "left.png", images / "right.png", "--calib", images / "stereo.yml") == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith(f"{out}/rectified: 480 x 360 px") and second.startswith(f"{out}: depth ")
    record, report = (json.loads((out / name).read_text()) for name in ("prediction.json", "rectified/report.json"))
    assert record["raw"] == [str(images / "left.png"), str(images / "right.png")]
    assert record["left"] == f"{out}/rectified/left.png" and (out / "rectified/rows.png").is_file()
    assert report["calibration"] == str(images / "stereo.yml") and report["rows"]["rectified"]["median_px"] < 0.05
    depth, fx = np.load(out / "depth.npy"), record["rig"]["fx"]
    true = depth_of(GROUND, rectified_view(PAIR, fx, SIZE), pixel_grid(*SIZE))
    known = np.isfinite(depth) & (true > 0) & (true < 8)
    assert known.mean() > 0.3 and np.median(np.abs(depth / true - 1)[known]) < 0.01


@needs_pdr
def test_the_left_product_alone_is_enough(tmp_path, products):
    (left,) = products.glob("NL*")
    assert predicted(tmp_path / "out", left, "--focal", 250, "--cloud-frame", "camera") == 0
    record = json.loads((tmp_path / "out/prediction.json").read_text())
    assert record["rig"]["fx"] == 250 and Path(record["raw"][1]).name.startswith("NRM")
    depth = np.load(tmp_path / "out/depth.npy")
    valid = cv2.imread(str(tmp_path / "out/rectified/left_valid.png"), 0) > 0
    assert np.isfinite(depth).mean() > 0.3 and not np.isfinite(depth[~valid]).any() and not valid.all()


@needs_pdr
def test_a_folder_of_products_is_many_pairs_and_resumes(tmp_path, products, capsys):
    folder, out = tmp_path / "sol", tmp_path / "out"
    shutil.copytree(products, folder)
    for file in products.iterdir():
        shutil.copy(file, folder / file.name.replace("0729882743", "0729882799"))
        shutil.copy(file, folder / f"{file.stem}.LBL")  # a label beside its product is no pair of its own
    assert predicted(out, folder) == 0
    names = sorted(path.name for path in out.glob("NL*"))
    assert len(names) == 2 and names[1].startswith("NLM_0709_0729882799")
    assert json.loads((out / names[0] / "prediction.json").read_text())["raw"][0].endswith(f"{names[0]}.IMG")
    assert not (out / names[0] / "rectified/rows.png").exists()  # its picture is of single pairs
    first = (out / names[1] / "depth.npy").read_bytes()
    shutil.rmtree(out / names[1])
    assert predicted(out, folder) == 0
    assert "1 of 2 pairs are predicted already" in capsys.readouterr().err
    assert (out / names[1] / "depth.npy").read_bytes() == first


def test_videos_of_raw_cameras(tmp_path, images):
    for eye in ("left", "right"):
        frame = cv2.imread(str(images / f"{eye}.png"))
        video = cv2.VideoWriter(str(tmp_path / f"{eye}.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 5, SIZE)
        for _ in range(2):
            video.write(frame)
        video.release()
    videos = tmp_path / "left.avi", tmp_path / "right.avi"
    assert predicted(tmp_path / "out", *videos, "--every", 2, "--calib", images / "camchain.yaml") == 0
    report = json.loads((tmp_path / "out/frame_000000/rectified/report.json").read_text())
    assert report["left"] == str(videos[0]) and report["rows"]["rectified"]["median_px"] < 0.2


def test_which_pairs_are_raw(tmp_path, images):
    def asks(left: Path = images / "left.png", **flags: object) -> bool:
        return must_be_rectified(PredictOptions((left,), tmp_path, **flags), left)

    both = tmp_path / "both.yml"  # stereoRectify's results beside what they were made of
    matrix = "{{rows: 3, cols: 4, dt: d, data: [300, 0, 240, {}, 0, 300, 180, 0, 0, 0, 1, 0]}}"
    both.write_text(f"{opencv_text(PAIR)}P1: {matrix.format(0)}\nP2: {matrix.format(-60)}\n")
    assert not asks() and asks(calib=(images / "stereo.yml",)) and asks(calib=(images / "camchain.yaml",))
    assert not asks(calib=(both,)) and asks(calib=(both,), rectify="always")
    assert not asks(calib=(images / "stereo.yml",), rectify="never") and not asks(calib=(tmp_path / "none.yml",))
    assert not asks(calib=(Path("natecam"),))


def test_results_depend_on_the_raw_images_and_their_calibration(tmp_path, images):
    flags = {"left": "left.png", "right": "right.png", "calib": (images / "stereo.yml",)}
    first, second = (
        find_inputs(options).state(options)
        for options in (
            PredictOptions((images,), tmp_path, **flags),
            PredictOptions((images,), tmp_path, **{**flags, "calib": (images / "camchain.yaml",)}),
        )
    )
    assert first["images"] == second["images"]
    assert first["calibration, masks and poses"] != second["calibration, masks and poses"]


def test_what_is_refused(tmp_path, images, capsys):
    pair, out = (images / "left.png", images / "right.png"), tmp_path / "out"
    calib = ("--calib", images / "stereo.yml")
    assert "--cx is of rectified images" in refused(capsys, out, *pair, *calib, "--cx", 240)
    assert "--rectify always needs the calibration" in refused(capsys, out, *pair, "--rectify", "always")
    assert "natecam is of rectified" in refused(capsys, out, *pair, "--calib", "natecam", "--rectify", "always")
    assert "match the wrong way round: exchange left and right" in refused(capsys, out, *pair[::-1], *calib)
    never = refused(capsys, out, *pair, *calib, "--rectify", "never")
    assert "is a calibration of images that are not rectified" in never
