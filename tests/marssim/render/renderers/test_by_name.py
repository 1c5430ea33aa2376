import importlib.util
import subprocess
import sys

import numpy as np
import pytest

from marssim.render.renderers.by_name import default_renderer, make_renderer
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import SceneConfig, build_scene


def test_every_renderer_is_made_by_its_name():
    scene = build_scene(SceneConfig(size=4.0, horizon=6.0, rocks=RockConfig(k=0.0)), np.random.default_rng(0))
    embree, scan = make_renderer("embree", scene), make_renderer("scan", scene)
    embree.close()
    scan.close()
    pytest.importorskip("pybullet")
    bullet = make_renderer("pybullet", scene)
    bullet.close()
    names = [type(renderer).__name__ for renderer in (embree, scan, bullet)]
    assert names == ["EmbreeRenderer", "ScanRenderer", "PyBulletRenderer"]


def test_another_name_is_no_renderer():
    scene = build_scene(SceneConfig(size=4.0, horizon=6.0, rocks=RockConfig(k=0.0)), np.random.default_rng(0))
    with pytest.raises(ValueError, match="renderer 'embre' is unknown; choose from pybullet, embree, scan"):
        make_renderer("embre", scene)


def test_the_default_renderer_is_pybullet_where_it_is_installed(monkeypatch):
    monkeypatch.delitem(sys.modules, "pybullet", raising=False)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: name)
    assert default_renderer() == "pybullet"
    assert "pybullet" not in sys.modules


@pytest.mark.parametrize("blocked", [True, False])
def test_the_default_renderer_is_scan_where_pybullet_is_missing(monkeypatch, blocked):
    monkeypatch.delitem(sys.modules, "pybullet", raising=False)
    if blocked:
        monkeypatch.setitem(sys.modules, "pybullet", None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert default_renderer() == "scan"


def test_scanning_needs_neither_embree_nor_pybullet():
    code = (
        "import sys; sys.modules.update(embreex=None, pybullet=None); import numpy as np;"
        "from marssim.render.renderers.by_name import make_renderer; from marssim.base.camera import NATECAM;"
        "from marssim.scene.scene import SceneConfig, build_scene;"
        "scene = build_scene(SceneConfig(size=4.0, horizon=6.0), np.random.default_rng(0));"
        "pose = np.diag([1.0, -1, -1, 1]); pose[2, 3] = 5.0;"
        "print(make_renderer('scan', scene).render(NATECAM.resized(32, 32).camera, pose).hit.mean())"
    )
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(process.stdout) == 1.0


def test_the_renderers_need_no_command_line():
    code = (
        "import sys, marssim.render.renderers.by_name; print({'tyro', 'tqdm', 'marssim.generate'} & set(sys.modules))"
    )
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert process.stdout.strip() == "set()"
