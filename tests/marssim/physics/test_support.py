import numpy as np
import pytest

from marssim.physics.support import SupportMap, coarse_faces, split_rocks
from marssim.scene.presets import preset
from marssim.scene.rocks.shapes import icosphere
from marssim.scene.scene import build_scene

BALLS = [(1.0, 0.0, 0.0, 0.25), (-1.0, 0.5, 0.3, 0.4), (2.0, 2.0, 0.0, 0.04)]  # climbable, obstacle, too small


def test_rasters_of_spheres(make_scene):
    scene = make_scene(balls=BALLS, half=3.0)
    support = SupportMap.from_scene(scene, 0.30)
    x, y = np.meshgrid(np.arange(-10, 11) * 0.05, np.zeros(1))
    expected = np.sqrt(np.maximum(0.25**2 - x**2, 0))
    np.testing.assert_allclose(support.nearest(support.drive, x + 1.0, y), expected, atol=0.02)
    at = (np.array(-1.0), np.array(0.5))
    assert support.sample(support.drive, *at) == 0
    assert support.sample(support.top, *at) == pytest.approx(0.7, abs=0.02)
    assert support.sample(support.top, np.array(2.0), np.array(2.0)) == 0
    area = support.obstacle.sum() * support.cell**2
    assert area == pytest.approx(np.pi * 0.4**2, rel=0.06)


def test_split_by_exposed_height(make_scene):
    climbable, blocking = split_rocks(make_scene(balls=BALLS), 0.30)
    assert climbable.tolist() == [0] and blocking.tolist() == [1]


def test_collision_shape_stays_near_the_drawn_rock():
    scene = build_scene(preset("jezero", size=8.0, cell=0.1, horizon=8.0), np.random.default_rng(1))
    members = np.concatenate(split_rocks(scene, 0.30))
    lost = []
    for member in members:
        faces = scene.bodies.faces[scene.bodies.face_rock == member]
        coarse = coarse_faces(scene.bodies, np.array([member]))
        assert set(coarse.ravel()) <= set(faces.ravel()) and len(coarse) <= len(icosphere(2)[1])
        full, thin = (np.ptp(scene.bodies.vertices[np.unique(f)], axis=0) for f in (faces, coarse))
        lost.append(np.abs(full - thin).max() / scene.bodies.diameter[member])
    assert len(lost) > 20 and np.median(lost) < 0.1 and max(lost) < 0.3
