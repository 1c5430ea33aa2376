from dataclasses import replace

import numpy as np
import pytest

from envs.courses.course import Course, TrueGround
from envs.evaluate import evaluate
from envs.evaluation.config import EvaluateConfig
from envs.mars_nav import MarsNavEnv
from envs.suites.making import make_suite, suite_text
from envs.world.eyes import EyesConfig
from marssim.base.rover_spec import ZHURONG
from marssim.scene.look import Look
from marssim.scene.place_file import save_place
from marssim.scene.presets import preset
from marssim.scene.rocks.mesh import Rocks
from marssim.scene.rocks.shapes import icosphere
from marssim.scene.scene import Scene, SceneConfig
from marssim.scene.terrain import HeightGrid, Terrain

LOOK = Look(np.array([0.6, 0.0, 0.8]), 0.5, 1.0, 1.0, 0, 0.5, 0.5, 0.0, 0.0, 0.3)


def build_scene(height=lambda x, y: 0 * x, half=10.0, cell=0.25, rocks=()):
    """A scene of a given relief; rocks: (x, y, diameter, height) of half-buried ellipsoids on the level z = 0."""
    coarse_half = 3 * half
    fine, coarse = (
        HeightGrid(height(*np.meshgrid(axis, axis)), axis[0], axis[0], float(axis[1] - axis[0]))
        for axis in (np.linspace(-half, half, round(2 * half / cell) + 1), np.arange(-coarse_half, coarse_half + 1))
    )
    unit, template = icosphere(2)
    rocks = np.array(rocks, dtype=float).reshape(-1, 4)
    n = len(rocks)
    size = np.column_stack([rocks[:, 2] / 2, rocks[:, 2] / 2, rocks[:, 3]])
    centre = np.column_stack([rocks[:, :2], np.zeros(n)])
    stones = Rocks(
        centre=centre, diameter=rocks[:, 2], height=rocks[:, 3], albedo=np.ones(n),
        vertices=(unit[None] * size[:, None] + centre[:, None]).reshape(-1, 3),
        faces=(template[None] + len(unit) * np.arange(n)[:, None, None]).reshape(-1, 3).astype(np.int32),
        face_rock=np.repeat(np.arange(n), len(template)).astype(np.int32),
        vertex_normals=np.tile(unit, (n, 1)),
    )  # fmt: skip
    return Scene(SceneConfig(size=2 * half, cell=cell, horizon=coarse_half), Terrain(fine, coarse), stones, LOOK)


def build_course(scene, start=(-3.0, 0.0, 0.0), goal=(3.0, 0.0)):
    goal = np.array(goal)
    ground = TrueGround(scene, ZHURONG, goal)
    return Course(scene, ground, np.array(start), goal, ground.distance_to_goal(*start[:2]), 0)


@pytest.fixture(scope="session")
def make_scene():
    return build_scene


@pytest.fixture(scope="session")
def make_course():
    return build_course


@pytest.fixture(scope="session")
def small_scene():
    """A drawn place, cheap to build: no bedrock, no stones or small rocks, no drifts, a near horizon."""
    config = preset("utopia", size=12.0, horizon=14.0)
    look = replace(config.look, **dict.fromkeys(("pebbles", "gravel", "drifts"), (0.0, 0.0)))
    return replace(config, look=look, rocks=replace(config.rocks, min_diameter=0.2))


@pytest.fixture(scope="session")
def small_place(small_scene, tmp_path_factory):
    """File of small_scene."""
    file = tmp_path_factory.mktemp("place") / "place.json"
    save_place(small_scene, file)
    return file


@pytest.fixture(scope="session")
def small_suite(small_place, tmp_path_factory):
    """File of a suite with two conditions, two dev courses and one test course of 3 m on a cheap place."""
    clear = {"scene": str(small_place), "goal_distance": 3.0, "k": 0.01, "ground_truth_pixels": 64}
    splits = {"dev": {"seed": 5, "courses": 2}, "test": {"seed": 6, "courses": 1}}
    content = make_suite("small-v1", splits, {"clear": clear, "rare_looks": {**clear, "look_every": 1.0}})
    file = tmp_path_factory.mktemp("suite") / "small-v1.json"
    file.write_text(suite_text(content))
    return file


@pytest.fixture(scope="session")
def suite_run(small_suite, tmp_path_factory):
    """Folder of an evaluation of the dev split of small_suite by two drivers."""
    out = tmp_path_factory.mktemp("suite_run")
    evaluate(suite_config(small_suite, out))
    return out


def suite_config(suite, out, **changes):
    settings = {"driver": ("straight", "random"), "perception": ("ground_truth",), "videos": False, **changes}
    return EvaluateConfig(out, suite=str(suite), **settings)


@pytest.fixture(scope="session")
def make_suite_config():
    return suite_config


@pytest.fixture
def small_pictures(monkeypatch):
    """Pictures from outside of an eighth of their width and height."""
    monkeypatch.setattr("envs.world.outside_view.WIDTH", 100)
    monkeypatch.setattr("envs.world.outside_view.HEIGHT", 50)


@pytest.fixture
def make_env(small_scene):
    """MarsNavEnv, cheap by default, closed after the test."""
    made = []

    def make(**changes):
        settings = {
            "perception": "ground_truth", "dynamics": "kinematic", "scene": small_scene, "goal_distance": 6.0,
            "eyes": EyesConfig(image_pixels=64, ground_truth_pixels=64), **changes,
        }  # fmt: skip
        made.append(MarsNavEnv(**settings))
        return made[-1]

    yield make
    for env in made:
        env.close()


@pytest.fixture
def on_course(make_env, monkeypatch):
    """A MarsNavEnv, after its reset, on a course made by hand."""

    def place(course, **changes):
        monkeypatch.setattr("envs.suites.drawn_course.draw_course", lambda *_: course)
        env = make_env(**changes)
        env.reset(seed=0)
        return env

    return place
