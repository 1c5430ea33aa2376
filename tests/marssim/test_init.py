"""The public names of marssim, and ten lines that render a frame."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import marssim
from marssim.base.version import VERSION

STUB = Path(marssim.__file__).with_suffix(".pyi")


def test_marssim_has_the_version_of_the_distribution():
    assert marssim.__version__ == VERSION


@pytest.mark.parametrize("name", marssim.__all__)
def test_every_name_is_there_and_is_no_module(name):
    assert not isinstance(getattr(marssim, name), type(sys)) and name in dir(marssim)


def test_every_name_is_that_of_the_stub():
    imported = {
        alias.name: node.module
        for node in ast.parse(STUB.read_text()).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert set(imported) == set(marssim.__all__)
    for name, module in imported.items():
        assert getattr(marssim, name) is getattr(importlib.import_module(f"marssim.{module}"), name)


def test_no_name_hides_a_module():
    files = {file.stem for file in STUB.parent.iterdir()}
    assert not files & set(marssim.__all__)
    from marssim import generate, scene

    assert generate.__name__ == "marssim.generate" and scene.__name__ == "marssim.scene"


PROGRAM = """
import marssim

place = marssim.preset("gale", size=12.0, horizon=16.0)
scene = marssim.build_scene(place, rng=7)
rig = marssim.NATECAM.resized(64, 64)
noon = marssim.render_view(scene, x=2.0, y=-1.0, yaw_deg=30, sun_elevation_deg=80, rig=rig)
dusk = marssim.render_view(scene, x=2.0, y=-1.0, yaw_deg=30, sun_elevation_deg=5, rig=rig)
print(noon.left.shape, float(noon.depth.min()) < 15, (noon.left == dusk.left).all(), (noon.depth == dusk.depth).all())
"""


def test_ten_lines_render_a_frame_from_any_place_under_another_sun():
    """Another sun changes the images and not the ground truth."""
    lines = [line for line in PROGRAM.splitlines() if line]
    assert len(lines) <= 10
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False)
    assert done.stdout.split("\n")[0] == "(64, 64, 3) True False True", done.stderr


def test_a_dataset_is_made_and_read_by_names_of_the_face(tmp_path):
    place = marssim.preset("utopia", size=12.0, horizon=16.0)
    rig = marssim.NATECAM.resized(48, 48)
    config = marssim.GenerateConfig(out=tmp_path / "set", pairs=1, scenes=(place,), rig=rig, renderer="scan")
    dataset = marssim.generate_dataset(config)
    sample = marssim.StereoDataset(tmp_path / "set")[0]
    assert isinstance(sample, marssim.StereoSample) and np.array_equal(sample.left, dataset[0].left)
