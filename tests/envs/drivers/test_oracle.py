from types import SimpleNamespace

import numpy as np
import pytest

from envs.drivers.by_name import make_driver
from envs.drivers.oracle import true_map
from marssim.render.renderers.by_name import make_renderer


def test_the_true_map_has_ground_and_rocks_where_they_are(make_scene):
    """A ramp with one rock: the map's low heights are the ramp's, and its top heights the rock's over it."""
    scene = make_scene(height=lambda x, y: 0.1 * x, rocks=[(2.0, -3.0, 1.0, 0.5)])
    renderer = make_renderer("embree", scene)
    elevation = true_map(renderer, scene.half)
    renderer.close()
    x, y = elevation.centres()
    inside = (np.abs(y[:, None]) < 9.8) & (np.abs(x[None, :]) < 9.8)
    near = np.hypot(x[None, :] - 2.0, y[:, None] + 3.0) < 0.7
    ramp = np.broadcast_to(0.1 * x[None, :], near.shape)
    assert elevation.measured[inside].all()
    clear = inside & ~near
    assert np.abs(elevation.top - ramp)[clear].max() < 0.03  # half a cell of the slope, and relief
    assert np.abs(elevation.low - ramp)[clear].max() < 0.03
    row, column = np.argwhere(near & (elevation.top == elevation.top[near].max()))[0]
    assert np.hypot(x[column] - 2.0, y[row] + 3.0) < 0.15
    assert elevation.top[near].max() == pytest.approx(0.5, abs=0.05)


def test_posts_on_a_slope_stand_where_they_are_also_between_two_views():
    steep = np.tan(np.deg2rad(10))
    posts = [(5.0, -0.05), (10.0, -0.05), (12.05, 0.05), (10.05, 5.05), (16.95, 8.05), (-16.95, -8.05), (-9.95, 0.05)]

    class Slope:
        """Draws a plane and posts on it, 0.5 m high and 0.2 m wide, by their equations."""

        def render(self, camera, pose, sunlit=False):
            rays, eye = camera.rays() @ pose[:3, :3].T, pose[:3, 3]
            depth = (steep * eye[0] - eye[2]) / (rays[..., 2] - steep * rays[..., 0])
            for x, y in posts:
                at_top = (steep * x + 0.5 - eye[2]) / rays[..., 2]
                on_post = np.abs(eye[:2] + at_top[..., None] * rays[..., :2] - (x, y)).max(-1) < 0.1
                depth = np.where(on_post, at_top, depth)
            return SimpleNamespace(depth=depth)

    elevation = true_map(Slope(), 17.0)
    x, y = elevation.centres()
    course = (np.abs(y[:, None]) < 17) & (np.abs(x[None, :]) < 17)
    assert elevation.measured[course].all()
    height = np.where(course, elevation.top - steep * x[None, :], 0)
    for post_x, post_y in posts:
        on_post = (np.abs(x[None, :] - post_x) < 0.6) & (np.abs(y[:, None] - post_y) < 0.6) & (height > 0.4)
        rows, columns = np.nonzero(on_post)
        assert 1 <= len(rows) <= 9
        assert abs(x[columns].mean() - post_x) < 0.08 and abs(y[rows].mean() - post_y) < 0.08


def test_the_oracle_knows_ground_that_no_look_has_shown(make_env):
    env = make_env(mast=True, goal_distance=4.0)
    seen, known = {}, {}
    for name, out in (("navigator", seen), ("oracle", known)):
        driver = make_driver(name)
        observation, _ = env.reset(seed=3)
        driver.reset(env, 3)
        driver.act(env, observation)
        out.update(measured=driver.navigator.map.measured, ground=driver.navigator.ground, top=driver.navigator.map.top)
    ahead_and_behind = known["measured"][170:230, 170:230]
    assert ahead_and_behind.all() and not seen["measured"][170:230, 170:230].all()
    both = known["measured"] & seen["measured"]
    assert np.median(np.abs(known["top"] - seen["top"])[both]) < 0.03
