"""Which focal lengths a pair has, by its files and the flags."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from m3depth.prediction.options import PredictOptions
from m3depth.prediction.sources.calibration import make_calibration
from marssim.base.calibration.rectified import Calibration


def test_focal_replaces_both_focal_lengths_and_keeps_their_ratio(tmp_path):
    rig = {"width": 320, "height": 240, "fx": 300.0, "fy": 280.0, "cx": 159.5, "cy": 119.5, "baseline": 0.2}
    (tmp_path / "rig.json").write_text(json.dumps(rig))
    for focal, expected in ((None, (300.0, 280.0)), (300.0, (300.0, 280.0)), (150.0, (150.0, 140.0))):
        options = PredictOptions((Path("l.png"), Path("r.png")), tmp_path, calib=(tmp_path / "rig.json",), focal=focal)
        found = make_calibration(options, 240, 320, Path("l.png"))
        assert (found.fx, found.fy) == expected


KITTI = "P2: 300 0 {cx} 0 0 300 {cy} 0 0 0 1 0\nP3: 300 0 {cx} -60 0 300 {cy} 0 0 0 1 0\n"


@pytest.mark.parametrize(
    ("width", "height", "fits"),
    [(320, 240, True), (160, 120, False), (640, 480, False), (220, 480, True), (160, 240, True), (1300, 240, True)],
)
def test_a_calibration_without_a_size_for_images_of_another_size_is_refused(tmp_path, width, height, fits):
    (tmp_path / "calib.txt").write_text(KITTI.format(cx=159.5, cy=119.5))
    options = PredictOptions((Path("l.png"), Path("r.png")), tmp_path, calib=(tmp_path / "calib.txt",))
    if fits:
        assert make_calibration(options, height, width, Path("l.png")).cx == 159.5
        return
    with pytest.raises(
        ValueError, match=rf"calib\.txt: the principal point \(159.5, 119.5\) px .* {width} x {height} px"
    ):
        make_calibration(options, height, width, Path("l.png"))
    part = replace(options, cx=20.0, cy=100.0)
    assert make_calibration(part, height, width, Path("l.png")).cx == 20


def test_only_a_principal_point_that_was_read_tells_the_size_of_the_images(tmp_path):
    options = PredictOptions((Path("l.png"), Path("r.png")), tmp_path, focal=1.0, baseline=0.1)
    assert make_calibration(options, 1, 1, Path("l.png")).cx == 0  # the middle of a single pixel
    of_dataset = Calibration(300.0, 300.0, 159.5, 119.5, 0.2)
    with pytest.raises(ValueError, match=r"l\.png: the principal point \(159.5, 119.5\) px .* 160 x 120 px"):
        make_calibration(replace(options, focal=None), 120, 160, Path("l.png"), lambda width, height: of_dataset)
