import numpy as np
import pytest

from marssim.scene.look import Look
from marssim.scene.rocks.mesh import Rocks
from marssim.scene.rocks.shapes import icosphere
from marssim.scene.scene import Scene, SceneConfig
from marssim.scene.terrain import HeightGrid, Terrain

LOOK = Look(np.array([0.0, 0.0, 1.0]), 0.5, 1.0, 1.0, 0, 0.5, 0.5, 0.0, 0.0, 0.3)


def build(height=lambda x, y: 0 * x, half=4.0, cell=0.1, balls=()):
    """Return a function that makes a scene of a given relief, with spherical rocks (x, y, z of the middle, radius)."""
    grid = np.linspace(-half, half, round(2 * half / cell) + 1)
    fine = HeightGrid(height(*np.meshgrid(grid, grid)), -half, -half, float(grid[1] - grid[0]))
    unit, template = icosphere(3)
    balls = np.array(balls, dtype=float).reshape(-1, 4)
    n = len(balls)
    vertices = (unit[None] * balls[:, None, 3:] + balls[:, None, :3]).reshape(-1, 3)
    faces = (template[None] + len(unit) * np.arange(n)[:, None, None]).reshape(-1, 3).astype(np.int32)
    rocks = Rocks(
        centre=balls[:, :3], diameter=2 * balls[:, 3], height=balls[:, 2] + balls[:, 3], albedo=np.ones(n),
        vertices=vertices, faces=faces, face_rock=np.repeat(np.arange(n), len(template)).astype(np.int32),
        vertex_normals=np.tile(unit, (n, 1)),
    )  # fmt: skip
    return Scene(SceneConfig(size=2 * half, cell=cell, horizon=3 * half), Terrain(fine, fine), rocks, LOOK)


@pytest.fixture
def make_scene():
    return build
