"""Which focal lengths a pair has, by its files and the flags."""

import json
from pathlib import Path

from m3depth.prediction.options import PredictOptions
from m3depth.prediction.sources.calibration import make_calibration


def test_focal_replaces_both_focal_lengths_and_keeps_their_ratio(tmp_path):
    rig = {"width": 320, "height": 240, "fx": 300.0, "fy": 280.0, "cx": 159.5, "cy": 119.5, "baseline": 0.2}
    (tmp_path / "rig.json").write_text(json.dumps(rig))
    for focal, expected in ((None, (300.0, 280.0)), (300.0, (300.0, 280.0)), (150.0, (150.0, 140.0))):
        options = PredictOptions((Path("l.png"), Path("r.png")), tmp_path, calib=(tmp_path / "rig.json",), focal=focal)
        found = make_calibration(options, 240, 320, Path("l.png"))
        assert (found.fx, found.fy) == expected
