from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.camera import NATECAM
from marssim.base.pose import look_pose
from marssim.render.renderers.embree_renderer import EmbreeRenderer
from marssim.render.sensor import Sensor
from marssim.render.stereo import render_stereo
from marssim.render.sun_glare import CORE, per_steradian, sun_glare
from marssim.render.surfaces.daylight import Daylight
from marssim.render.surfaces.shading import Shader
from marssim.scene.look import sun_direction
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import SceneConfig, build_scene

CAMERA = NATECAM.resized(65, 65).camera
LEVEL = look_pose(np.array([0.0, 0.0, 1.2]), 0.0, 0.0)  # looks east
SENSOR = Sensor(exposure=0.5, psf=0.0, full_well=1e12, read_noise=0.0, vignetting=0.0)


class Sky:
    """A renderer of nothing but the sun, of which a share is free."""

    def __init__(self, share=1.0):
        self.share = share

    def sun_share(self, points, normals):
        return np.full(len(points), self.share, np.float32)


def glare(elevation_deg, azimuth_deg=0.0, share=1.0, free=1.0):
    sun = sun_direction(np.deg2rad(elevation_deg), np.deg2rad(azimuth_deg))
    light = Daylight(sun, np.array([1.0, 0.5, 0.25], np.float32), 0.2, 0.5)
    return sun_glare(Sky(free), light, CAMERA, LEVEL, share)


def test_all_that_is_scattered_adds_up_to_the_share():
    angle = np.linspace(0, np.pi / 2, 200_001)
    ring = 2 * np.pi * np.sin(angle) * per_steradian() / (angle**2 + CORE**2)
    assert np.trapezoid(ring, angle) == pytest.approx(1, rel=1e-5)


@given(st.floats(0.0, 60.0), st.floats(-80.0, 80.0))
def test_the_veil_falls_with_the_square_of_the_angle_from_the_sun(elevation, azimuth):
    veil = glare(elevation, azimuth)[..., 0]
    rays = CAMERA.rays()
    east, north, up = np.cos(np.deg2rad(elevation)) * np.array([
        np.cos(np.deg2rad(azimuth)), np.sin(np.deg2rad(azimuth)), np.tan(np.deg2rad(elevation))
    ])  # fmt: skip
    sun = np.array([-north, -up, east])  # camera frame: right is south, down, ahead is east
    angle = np.arccos(np.clip(rays @ sun / np.linalg.norm(rays, axis=-1), -1, 1))
    assert np.allclose(veil * (angle**2 + CORE**2), np.pi * east * per_steradian(), rtol=1e-4)


def test_it_has_the_colour_of_the_sunlight_and_grows_with_the_share():
    veil = glare(30.0)
    assert np.allclose(veil[..., 1], 0.5 * veil[..., 0]) and np.allclose(veil[..., 2], 0.25 * veil[..., 0])
    assert np.allclose(glare(30.0, share=0.3), 0.3 * veil) and np.allclose(glare(30.0, free=0.5), 0.5 * veil)


@pytest.mark.parametrize("hidden", [{"azimuth_deg": 180.0}, {"azimuth_deg": 91.0}, {"free": 0.0}])
def test_a_sun_behind_the_camera_or_behind_a_hill_gives_none(hidden):
    assert not glare(20.0, **hidden).any()


def test_a_pair_into_the_sun_loses_contrast_and_keeps_its_truth():
    config = SceneConfig(size=10.0, horizon=20.0, rocks=RockConfig(k=0.1))
    scene = build_scene(config, np.random.default_rng(3)).with_sun(15.0, 0.0)
    height = float(scene.terrain.height_at(np.array(-2.0), np.array(0.0)))
    rig, renderer = NATECAM.resized(128, 128), EmbreeRenderer(scene)

    def pair(yaw, share):
        pose = look_pose(np.array([-2.0, 0.0, height + 1.2]), yaw, np.deg2rad(20))
        sensor = replace(SENSOR, sun_glare=share)
        return render_stereo(renderer, Shader(scene), rig, pose, sensor, np.random.default_rng(0))

    clear, veiled = pair(0.0, 0.0), pair(0.0, 0.3)
    assert np.array_equal(clear.depth, veiled.depth)
    for eye in ("left", "right"):
        spread = [getattr(frame, eye)[64:].std() / getattr(frame, eye)[64:].mean() for frame in (clear, veiled)]
        assert spread[1] < 0.9 * spread[0]
    away = pair(np.pi, 0.0), pair(np.pi, 0.3)
    assert np.array_equal(away[0].left, away[1].left)
    renderer.close()
