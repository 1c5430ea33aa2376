import numpy as np
import pytest

from marssim.camera import NATECAM
from marssim.dataset import write_sample
from marssim.render.makers import make_renderer
from marssim.render.sensor import Sensor, SensorConfig
from marssim.render.shading import Shader
from marssim.render.stereo import render_stereo
from marssim.scene.scene import build_scene, preset
from marssim.viewpoint import ViewConfig, draw_pose

pytestmark = pytest.mark.benchmark


@pytest.mark.parametrize("place", ["utopia", "jezero"])
def test_scene(clock, place):
    assert clock(f"scene {place}", lambda: build_scene(preset(place), np.random.default_rng(1)), 3) > 0


@pytest.mark.parametrize("place", ["utopia", "jezero"])
@pytest.mark.parametrize("renderer", ["embree", "pybullet"])
def test_pair_with_ground_truth_and_files(clock, tmp_path, place, renderer):
    scene = build_scene(preset(place), np.random.default_rng(1))
    maker = make_renderer(renderer, scene)
    shader, rng = Shader(scene), np.random.default_rng(2)
    sensor = Sensor.draw(SensorConfig(), rng)

    def pair():
        frame = render_stereo(maker, shader, NATECAM, draw_pose(scene, ViewConfig(), rng), sensor, rng)
        write_sample(tmp_path / "sample", frame, {})

    assert clock(f"pair {place} {renderer}, 512 x 512, files written", pair, 6) > 0
    size = sum(f.stat().st_size for f in (tmp_path / "sample").iterdir())
    assert size < 2.5e6
    maker.close()
