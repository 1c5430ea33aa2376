import subprocess
import sys

import numpy as np
import pytest

from marssim.render.makers import make_renderer
from marssim.scene.rocks import RockConfig
from marssim.scene.scene import SceneConfig, build_scene


def test_both_renderers_are_there_by_name():
    scene = build_scene(SceneConfig(size=4.0, horizon=6.0, rocks=RockConfig(k=0.0)), np.random.default_rng(0))
    embree = make_renderer("embree", scene)
    embree.close()
    pytest.importorskip("pybullet")
    bullet = make_renderer("pybullet", scene)
    bullet.close()
    assert type(embree).__name__ == "Raycaster" and type(bullet).__name__ == "Rasterizer"


def test_the_renderers_need_no_command_line():
    code = "import sys, marssim.render.makers; print({'tyro', 'tqdm', 'marssim.generate'} & set(sys.modules))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "set()"
