"""Estimators by name, and what is said about names that mean nothing."""

import subprocess
import sys

import pytest

from m3depth.estimator import Estimator, load_estimator
from m3depth.matching import SGBM, BlockMatching


class NoEstimator:
    pass


def test_by_name():
    assert isinstance(load_estimator("sgbm"), SGBM)
    assert load_estimator("ncc") == BlockMatching("ncc")
    assert load_estimator("ssd-sgm") == BlockMatching("ssd", "sgm")
    assert isinstance(load_estimator("m3depth.matching:SGBM"), SGBM)


def test_an_object_comes_back_as_it_is():
    matcher = SGBM(block=3)
    assert load_estimator(matcher) is matcher
    assert isinstance(matcher, Estimator)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("raft", "estimator 'raft' is unknown; choose from m3depth, sgbm, m3depth:WEIGHTS, package.module:Class"),
        ("no_such_package:Net", "No module named 'no_such_package'"),
        ("m3depth.matching:Net", "has no class 'Net'"),
        ("m3depth.matching:fill_background", "has no class"),
        ("marssim.camera:StereoRig", "cannot be made without arguments"),
        ("collections:OrderedDict", "has no method infer"),
        (NoEstimator(), "has no method infer"),
        (SGBM, "has no method infer"),
    ],
)
def test_what_is_no_estimator_is_named(spec, message):
    with pytest.raises(ValueError, match=message) as caught:
        load_estimator(spec)
    assert "\n" not in str(caught.value)


def test_missing_weights_are_named():
    with pytest.raises(FileNotFoundError, match=r"nowhere/w\.safetensors"):
        load_estimator("m3depth:nowhere/w.safetensors")


def test_import_and_baselines_load_no_torch_and_no_other_floor():
    code = (
        "import sys, m3depth.estimator as e; [e.load_estimator(n) for n in ('sgbm', 'ncc-sgm')]; "
        "import m3depth.evaluate, m3depth.predict, m3depth.texture; "
        "sys.exit(' '.join({'torch', 'nav', 'envs', 'pybullet'} & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
