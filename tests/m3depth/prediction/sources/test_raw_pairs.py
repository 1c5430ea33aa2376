"""m3depth.predict of raw images: it rectifies them on the way in."""

import json
import shutil
from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from raw_pairs import GROUND, SIZE, cahvore_pair, depth_of, opencv_pair, write_images, write_products

from m3depth.predict import main
from m3depth.prediction.options import PredictOptions
from m3depth.prediction.sources.inputs import find_inputs
from m3depth.prediction.sources.raw_pairs import must_be_rectified
from marssim.base.calibration.camera_info import camera_info_texts
from marssim.base.calibration.cameras import PosedPair
from marssim.base.calibration.kalibr import kalibr_text
from marssim.base.calibration.lenses.fisheye import Fisheye
from marssim.base.calibration.opencv_file import opencv_text
from marssim.base.calibration.orientation import rectified_view
from marssim.base.calibration.rectified import read_calibration
from marssim.base.images.resampling import pixel_grid

pytestmark = pytest.mark.usefixtures("undrawn_rows")
needs_pdr = pytest.mark.skipif(find_spec("pdr") is None, reason="needs the extra real")
PAIR = opencv_pair()


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


def predicted(out: Path, *args: object, estimator: str = "sgbm", write: Sequence[str] = ("depth", "confidence")) -> int:
    return main([str(arg) for arg in (*args, "--estimator", estimator, "--out", out, "--write", *write)])


def refused(capsys, out: Path, *args: object, estimator: str = "sgbm") -> str:
    assert predicted(out, *args, estimator=estimator) == 2
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


def test_a_calibration_that_may_be_of_raw_images_is_reported(tmp_path, images, capsys):
    infos = tuple(tmp_path / name for name in ("left.yaml", "right.yaml"))
    for path, text in zip(infos, camera_info_texts(PAIR, rectified_view(PAIR))):
        path.write_text(text)
    left, both = images / "left.png", tmp_path / "both.yml"
    both.write_text(opencv_text(PAIR) + "P1: [1, 2]\nP2: [3, 4]\n")
    for calib in (infos, (both,)):
        assert not must_be_rectified(PredictOptions((left,), tmp_path, calib=calib), left)
        assert f"note: {calib[0]} is of a camera with distortion" in capsys.readouterr().err
        for rectify in ("always", "never"):
            must_be_rectified(PredictOptions((left,), tmp_path, calib=calib, rectify=rectify), left)
        assert not capsys.readouterr().err


def test_a_check_that_fails_after_the_rectification_leaves_nothing(tmp_path, images, capsys):
    pair = images / "left.png", images / "right.png", "--calib", images / "stereo.yml"
    line = refused(capsys, tmp_path / "out", *pair, "--weights", tmp_path / "none.safetensors", estimator="m3depth")
    assert "none.safetensors: no such weights file" in line
    assert predicted(tmp_path / "out", *pair) == 0
    before = {path: path.read_bytes() for path in (tmp_path / "out").rglob("*.*")}
    assert predicted(tmp_path / "out", *pair, "--focal", 240, "--cloud-frame", "world") == 2
    assert "has no pose, which --cloud-frame world needs" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in (tmp_path / "out").rglob("*.*")} == before


def test_the_rectified_images_of_an_earlier_pair_do_not_stay_unless_they_are_the_input(tmp_path, images):
    out, pair = tmp_path / "out", (images / "left.png", images / "right.png")
    assert predicted(out, *pair, "--calib", images / "stereo.yml") == 0
    assert predicted(out, out / "rectified", "--map-format", "npy") == 0
    assert (out / "rectified/left.png").is_file()
    shutil.copytree(out / "rectified", tmp_path / "elsewhere")
    assert predicted(out, tmp_path / "elsewhere") == 0
    assert (out / "depth.npy").is_file() and not (out / "rectified").exists()


@needs_pdr
def test_a_broken_product_is_named_and_what_is_wrong_with_it(tmp_path, products, capsys):
    left, right = (tmp_path / path.name for path in sorted(products.iterdir()))
    whole = (products / left.name).read_bytes()
    shutil.copy(products / right.name, right)
    for size, says in (
        (0, "does not begin with a label of PDS or VICAR: is it whole? It has 0 bytes"),
        (900, "has a label without an end: is the file truncated?"),
        (len(whole) - 1000, f"is truncated: it has {len(whole) - 1000} of {len(whole)} bytes; fetch it again"),
    ):
        left.write_bytes(whole[:size])
        for given in ([left], [left, right]):
            assert refused(capsys, tmp_path / "out", *given) == f"error: {left}: {says}\n"
    left.with_suffix(".LBL").write_bytes(b"PDS_VERSION_ID = PDS3")
    left.write_bytes(b"")
    assert f"give the label beside it, {left.stem}.LBL" in refused(capsys, tmp_path / "out", left, right)


@needs_pdr
def test_a_broken_product_in_a_folder_is_skipped(tmp_path, products, capsys):
    folder, out = tmp_path / "sol", tmp_path / "out"
    shutil.copytree(products, folder)
    (left,) = folder.glob("NL*")
    for clock, size in ((729882701, 0), (729882702, 900), (729882703, 40_000)):
        for file in products.iterdir():
            other = folder / file.name.replace("0729882743", f"0{clock}")
            other.write_bytes(file.read_bytes()[: size if file.name == left.name else None])
    assert predicted(out, folder) == 0
    printed = capsys.readouterr()
    assert printed.out.endswith("1 of 4 pairs; 3 skipped, see the warnings\n")
    for says in ("does not begin with a label", "has a label without an end", "is truncated: it has 40000 of"):
        assert says in printed.err
    assert [path.name for path in out.glob("N*")] == [left.stem]


def test_align_predicts_without_a_calibration_of_the_raw_cameras(tmp_path, images, capsys):
    """The scale is that of the flags, and the geometry that of the images as they are."""
    pair = images / "left.png", images / "right.png"
    assert "--focal is missing: give it, or" in refused(capsys, tmp_path / "out", *pair, "--align")
    flags = "--align", "--focal", 300, "--baseline", 0.2, "--cx", 243
    assert predicted(tmp_path / "out", *pair, *flags) == 0
    first, _ = capsys.readouterr().out.splitlines()
    assert "480 x 360 px; focal length 300.0 px, baseline 0.20000 m; rows " in first and "six terms" in first
    record, report = (
        json.loads((tmp_path / "out" / name).read_text()) for name in ("prediction.json", "rectified/report.json")
    )
    assert (record["rig"]["fx"], record["rig"]["cx"], record["rig"]["baseline"]) == (300, 243, 0.2)
    assert (report["scale"], report["focal_px"], report["baseline_m"]) == ("metres", 300, 0.2)
    assert report["rows"]["rectified"]["median_px"] < 0.1 < report["rows"]["raw"]["median_px"]
    assert np.isfinite(np.load(tmp_path / "out/depth.npy")).mean() > 0.3
    rig = read_calibration(tmp_path / "out/rectified/rig.json")
    assert (rig.fx, rig.cx, rig.cy, rig.baseline, rig.size) == (300, 243, 179.5, 0.2, SIZE)
    near, middle, _ = report["depth_of_matches_m"].values()
    assert near < middle < np.nanpercentile(np.load(tmp_path / "out/depth.npy"), 99)


def test_align_mends_a_calibration_that_has_aged(tmp_path, images):
    lens = PAIR.right.lens
    aged = PosedPair(PAIR.left, replace(PAIR.right, lens=replace(lens, cy=lens.cy + 1.5, fy=lens.fy + 2)))
    (tmp_path / "aged.yml").write_text(opencv_text(aged))
    for name, flags in (("constant", []), ("aligned", ["--align"])):
        folder = images, "--left", "left.png", "--right", "right.png", "--calib", tmp_path / "aged.yml"
        assert predicted(tmp_path / name, *folder, *flags) == 0
    rows = [
        json.loads((tmp_path / name / "left/rectified/report.json").read_text())["rows"]
        for name in ("constant", "aligned")
    ]
    assert [np.count_nonzero(each["removed"]["terms_px"]) for each in rows] == [1, 6]
    assert rows[1]["rectified"]["median_px"] < 0.06 < rows[0]["rectified"]["median_px"]


def test_a_fisheye_whose_file_does_not_say_so(tmp_path):
    pair = opencv_pair(Fisheye, (0.02, -0.01, 0.003, -0.001))
    left, right = write_images(tmp_path, pair)
    (tmp_path / "stereo.yml").write_text(opencv_text(pair).replace("distortion_model: fisheye\n", ""))
    calib = "--calib", tmp_path / "stereo.yml", "--fisheye"
    assert predicted(tmp_path / "out", left, right, *calib) == 0
    report = json.loads((tmp_path / "out/rectified/report.json").read_text())
    assert report["rows"]["rectified"]["median_px"] < 0.06


def test_poses_of_raw_images_are_those_of_the_raw_camera(tmp_path, images):
    """The scene is known in the frame of the raw left camera, which is the world here."""
    (tmp_path / "poses.txt").write_text("0 0 0 0 0 0 0 1\n")
    folder = images, "--left", "left.png", "--right", "right.png", "--calib", images / "stereo.yml"
    flags = "--poses", tmp_path / "poses.txt", "--cloud-frame", "world"
    assert predicted(tmp_path / "out", *folder, *flags, write=["cloud"]) == 0
    points = np.asarray(trimesh.load(tmp_path / "out/left/cloud.ply").vertices)
    normal, distance = GROUND
    across = np.cross(normal, [0, 0, 1])
    near = points[(points[:, 2] < 3) & (np.abs(points @ normal + distance) < 0.05)]
    in_plane = np.stack([near @ across, near @ np.cross(normal, across), np.ones(len(near))], axis=1)
    slope = np.linalg.lstsq(in_plane, near @ normal + distance, rcond=None)[0][:2]
    assert len(near) > 50_000 and np.rad2deg(np.abs(slope)).max() < 0.1  # 0.2 and 0.35 in the rectified camera's frame


def test_warnings_name_the_pair(tmp_path, images, capsys):
    lens = replace(PAIR.right.lens, coefficients=(-3.0, 0.0, 0.0, 0.0))
    (tmp_path / "absurd.yml").write_text(opencv_text(PosedPair(PAIR.left, replace(PAIR.right, lens=lens))))
    folder = images, "--left", "left.png", "--right", "right.png", "--calib", tmp_path / "absurd.yml"
    assert predicted(tmp_path / "out", *folder, "--unchecked") == 0
    assert "warning: left: " in capsys.readouterr().err


def test_results_depend_on_the_raw_images_and_their_calibration(tmp_path, images):
    flags = {"left": "left.png", "right": "right.png", "calib": (images / "stereo.yml",)}
    first, second = (
        find_inputs(options).state()
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
    assert "--align rectifies the images: leave" in refused(capsys, out, *pair, *calib, "--align", "--rectify", "never")
    assert "natecam is of rectified" in refused(capsys, out, *pair, "--calib", "natecam", "--rectify", "always")
    assert "match the wrong way round: exchange left and right" in refused(capsys, out, *pair[::-1], *calib)
    never = refused(capsys, out, *pair, *calib, "--rectify", "never")
    assert "is a calibration of images that are not rectified" in never


@needs_pdr
def test_a_fisheye_that_the_calibration_is_not_of_is_one_line(tmp_path, images, products, capsys):
    pair, out = (images / "left.png", images / "right.png"), tmp_path / "out"
    line = refused(capsys, out, *pair, "--calib", images / "camchain.yaml", "--fisheye")
    assert "camchain.yaml: says which lens it is of, and that is no fisheye; leave --fisheye out" in line
    (left,) = products.glob("NL*")
    for source in (left, products):
        assert "--fisheye is of a calibration with OpenCV's names" in refused(capsys, out, source, "--fisheye")
        never = refused(capsys, out, source, "--rectify", "never")
        assert never == f"error: --rectify never: {left} is a product of a rover, and these are raw; leave it out\n"
