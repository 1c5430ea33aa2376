"""A baseline that is in millimetres is named before it makes a camera."""

import re
from pathlib import Path

import pytest

from m3depth.datasets.config import DataConfig
from m3depth.datasets.rigs import FileRig
from marssim.base.files.json_file import DatasetError

CALIB = "cam0=[50 0 20; 0 50 12; 0 0 1]\ncam1=[50 0 20; 0 50 12; 0 0 1]\ndoffs=0\nbaseline={}\nwidth=40\nheight=24\n"


def test_a_file_whose_baseline_no_rig_has_is_named(tmp_path: Path) -> None:
    calib = tmp_path / "calib.txt"
    calib.write_text(CALIB.format(270_000))  # Middlebury's are in mm
    with pytest.raises(DatasetError, match=rf"{re.escape(str(calib))}: the baseline is 270 m, over 10; is it in mill"):
        FileRig(calib, tmp_path / "left.png")(40, 24)
    calib.write_text(CALIB.format(10_000))
    assert FileRig(calib, tmp_path / "left.png")(40, 24).rig(40, 24).baseline == 10


def test_a_flag_whose_baseline_no_rig_has_is_named() -> None:
    with pytest.raises(ValueError, match=r"^baseline must be at most 10 m, got 270; is it in millimetres\?"):
        DataConfig(focal=50.0, baseline=270.0)
