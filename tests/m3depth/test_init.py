"""The public names of m3depth."""

import m3depth
from marssim.base.version import VERSION


def test_every_public_name_of_m3depth_exists():
    assert {name for name in m3depth.__all__ if not hasattr(m3depth, name)} == set()
    assert {"M3Depth", "Prediction", "load_estimator"} <= set(dir(m3depth))


def test_m3depth_has_the_version_of_the_distribution():
    assert m3depth.__version__ == VERSION
