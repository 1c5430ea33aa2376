"""PyBullet's EGL renderer compared with scan conversion, on machines where EGL works."""

import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("pybullet")

from marssim.base.camera import PinholeCamera
from marssim.base.pose import look_pose
from marssim.engines.egl import Egl, probe
from marssim.inspection.agreement import agreements
from marssim.render.renderers import egl_tiles
from marssim.render.renderers.by_name import make_renderer
from marssim.render.renderers.pybullet_renderer import PyBulletRenderer
from marssim.render.renderers.scan_renderer import ScanRenderer
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import Scene, SceneConfig, build_scene

CAMERA = PinholeCamera(200, 150, 180.0, 210.0, 80.3, 91.7)  # principal point off the middle, fx != fy
PLACES = [(0.0, 0.0, 0.3, 20), (-3.1, 2.2, 4.0, 35), (2.0, -4.0, 2.1, 8)]


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene(SceneConfig(size=12.0, horizon=24.0, rocks=RockConfig(k=0.1)), np.random.default_rng(3))


@pytest.fixture(scope="module")
def poses(scene) -> list[np.ndarray]:
    out = []
    for x, y, yaw, pitch in PLACES:
        height = float(scene.terrain.height_at(np.array(x), np.array(y)))
        out.append(look_pose(np.array([x, y, height + 1.2]), yaw, np.deg2rad(pitch), 0.05))
    return out


@pytest.fixture
def rasterizer(scene):
    if not probe().works:
        pytest.skip(f"EGL does not work here: {probe().message}")
    renderer = make_renderer("pybullet", scene, egl=True)
    yield renderer
    renderer.close()


def test_egl_agrees_with_scanning(scene, poses, rasterizer):
    agreement = agreements({"egl": rasterizer}, ScanRenderer(scene), CAMERA, poses)["egl"]
    assert agreement.surface > 0.998 and agreement.depth > 0.999, str(agreement)
    assert agreement.good, str(agreement)  # also of its depth as it was drawn
    assert (rasterizer.render(CAMERA, poses[0]).surface > 0).mean() > 0.02, (
        "the view shows no rocks: it tests too little"
    )


def test_pictures_larger_than_its_window_are_drawn_in_parts(poses, rasterizer, monkeypatch):
    whole = rasterizer.render(CAMERA, poses[0])
    monkeypatch.setattr(egl_tiles, "WINDOW", (64, 48))
    parts = rasterizer.render(CAMERA, poses[0])
    assert (parts.surface == whole.surface).mean() > 0.998
    both = parts.hit & whole.hit
    assert (np.abs(parts.depth[both] / whole.depth[both] - 1) < 1e-5).mean() > 0.998


def test_of_more_triangles_than_it_holds_those_in_view_are_drawn(poses, rasterizer, monkeypatch):
    expected = [rasterizer.render(CAMERA, pose).surface for pose in poses]
    tiles = rasterizer._tiles
    monkeypatch.setattr(egl_tiles, "MOST_FACES", int(tiles._faces.sum()) - 1)
    for pose, surface in zip(poses, expected):
        assert (rasterizer.render(CAMERA, pose).surface == surface).mean() > 0.999
        assert 0 < len(tiles._tile_of_body) < len(tiles._tiles)
    monkeypatch.setattr(egl_tiles, "MOST_FACES", 1000)
    with pytest.raises(ValueError, match=r"^the view has \d+ triangles, more than the 1000 that"):
        rasterizer.render(CAMERA, poses[0])


@pytest.mark.parametrize("room", ["for all", "for those in view"])
def test_a_view_does_not_depend_on_those_before_it(scene, poses, rasterizer, monkeypatch, room):
    """Any number of workers writes the same bytes. The last view has two before it."""
    if room != "for all":
        monkeypatch.setattr(egl_tiles, "MOST_FACES", int(rasterizer._tiles._faces.sum()) - 1)
    through = [rasterizer.render(CAMERA, pose) for pose in poses]
    rasterizer.close()
    alone = PyBulletRenderer(scene, egl=True)
    view = alone.render(CAMERA, poses[-1])
    alone.close()
    assert np.array_equal(view.surface, through[-1].surface) and np.array_equal(view.depth, through[-1].depth)


def test_one_may_be_open_in_a_process(scene, poses, rasterizer):
    with pytest.raises(RuntimeError, match="close the PyBulletRenderer"):
        PyBulletRenderer(scene, egl=True)
    rasterizer.close()
    rasterizer.close()
    with pytest.raises(RuntimeError, match="closed"):
        rasterizer.render(CAMERA, poses[0])
    with pytest.raises(RuntimeError, match="closed"):
        rasterizer.lit(np.zeros((1, 3)), np.zeros((1, 3)))
    other = PyBulletRenderer(scene, egl=True)
    assert other.render(CAMERA, poses[0]).hit.mean() > 0.3
    other.close()


def test_where_egl_does_not_work_there_is_one_line(scene, monkeypatch):
    monkeypatch.setattr(egl_tiles, "probe", lambda: Egl(False, False, "the test ended with exit code -11"))
    with pytest.raises(OSError, match=r"^PyBullet cannot draw with EGL here: the test ended with exit code -11"):
        PyBulletRenderer(scene, egl=True)


def test_egl_prints_nothing(rasterizer):
    """The plugin's C code prints when it starts, when it draws and when it ends."""
    code = (
        "import numpy as np; from marssim.render.renderers.pybullet_renderer import PyBulletRenderer;"
        "from marssim.base.camera import NATECAM;"
        "from marssim.scene.scene import SceneConfig, build_scene;"
        "scene = build_scene(SceneConfig(size=4.0, horizon=6.0), np.random.default_rng(0));"
        "pose = np.diag([1.0, -1, -1, 1]); pose[2, 3] = 5.0; renderer = PyBulletRenderer(scene, egl=True);"
        "print(renderer.render(NATECAM.resized(32, 32).camera, pose).hit.mean()); renderer.close()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "1.0\n" and done.stderr == ""
