"""What marssim.export writes, these readers read back as the dataset that it came from."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from m3depth.datasets.config import DataConfig
from m3depth.datasets.open import open_pairs
from marssim.base.dataset.dataset import SPLITS, StereoDataset
from marssim.export import ExportConfig, export

LAYOUTS = ("kitti", "sceneflow", "middlebury", "eth3d", "openstereo")


@pytest.fixture(scope="module", params=LAYOUTS)
def exported(request, plane_set, tmp_path_factory) -> tuple[str, Path]:
    out = tmp_path_factory.mktemp("exports") / request.param
    export(ExportConfig(plane_set, request.param, out))
    return request.param, out


@pytest.mark.parametrize("split", SPLITS)
def test_every_pair_comes_back(exported, plane_set, split) -> None:
    layout, out = exported
    read, written = open_pairs(out, split), StereoDataset(plane_set, split)
    read = pickle.loads(pickle.dumps(read))  # as the workers of a DataLoader get it
    assert len(read) == len(written) > 0
    for got, true in zip((read[i] for i in range(len(read))), written):
        np.testing.assert_array_equal(got.left, true.left)
        np.testing.assert_array_equal(got.right, true.right)
        assert got.rig.to_dict() == pytest.approx(true.rig.to_dict(), rel=1e-9)
        sky = np.isinf(true.depth)
        np.testing.assert_array_equal(np.isfinite(got.depth), ~sky)
        tolerance = 0.5 / 256 + 1e-5 if layout == "kitti" else 1e-5  # of its 16-bit code
        np.testing.assert_allclose(got.disparity[~sky], true.disparity[~sky], atol=tolerance)
        np.testing.assert_allclose(got.depth[~sky], got.rig.disparity_to_depth(got.disparity[~sky]), rtol=1e-5)
        assert np.isinf(got.depth[sky]).all() if layout == "sceneflow" else np.isnan(got.depth[sky]).all()
        assert (got.disparity[sky] == 0).all()
        np.testing.assert_array_equal(got.occluded, true.occluded)
        assert got.valid.sum() == (~sky).sum() and not got.rock.any() and not got.normal.any()


def test_all_is_every_split_and_named_layouts_equal_found_ones(exported, plane_set) -> None:
    layout, out = exported
    everything = open_pairs(out, "all")
    assert len(everything) == len(StereoDataset(plane_set))
    named = open_pairs(out, "all", DataConfig(format="list" if layout == "openstereo" else layout))  # type: ignore[arg-type]
    assert named.names == everything.names  # type: ignore[attr-defined]
    assert len(set(named.names)) == len(named)  # type: ignore[attr-defined]


def test_the_depth_that_is_scored_can_be_limited(exported, plane_set) -> None:
    _, out = exported
    read = open_pairs(out, "val", DataConfig(depth_range=(0.5, 15)))[0]
    true = StereoDataset(plane_set, "val")[0]
    agree = read.valid == true.valid
    assert agree.mean() > 0.999  # a depth at the limit may fall to either side


def test_layouts_are_found_without_the_mark_of_an_export(exported) -> None:
    """As others pack them: no export.json. OpenStereo's lists have to be named."""
    layout, out = exported
    mark = out / "export.json"
    hidden = mark.rename(out / "elsewhere")
    try:
        config = DataConfig(format="list") if layout == "openstereo" else DataConfig()
        assert len(open_pairs(out, "test", config)) == 2
    finally:
        hidden.rename(mark)
