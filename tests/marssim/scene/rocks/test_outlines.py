import numpy as np
import pytest
import trimesh

from marssim.scene.rocks.mesh import build_rocks
from marssim.scene.rocks.outlines import reach_above_ground
from marssim.scene.rocks.population import RockConfig


def level_ground(x, y):
    return np.zeros_like(x)


def test_a_rock_reaches_as_far_as_its_part_above_ground_and_beyond_its_disc():
    """Compared with the section that trimesh cuts at ground level, and the corners above it."""
    rocks = build_rocks(RockConfig(k=0.1), 10.0, 20.0, level_ground, np.random.default_rng(0))
    which = np.arange(0, len(rocks), 300)
    reach = reach_above_ground(rocks, which, level_ground)
    for rock, distance in zip(which, reach):
        mesh = trimesh.Trimesh(rocks.vertices, rocks.faces[rocks.face_rock == rock], process=False)
        outline = trimesh.intersections.mesh_plane(mesh, [0, 0, 1], [0, 0, 0]).reshape(-1, 3)
        corners = rocks.vertices[np.unique(mesh.faces)]
        part = np.concatenate([outline, corners[corners[:, 2] > 0]])
        assert distance == pytest.approx(np.hypot(*(part[:, :2] - rocks.centre[rock, :2]).T).max(), abs=1e-6)
    # tetrahedra and octahedra have long corners, and rocks are up to 2.2 times as long as they are wide
    assert 1.2 < np.median(reach / rocks.diameter[which] * 2) < 1.75
    assert not reach_above_ground(rocks, which, lambda x, y: np.full_like(x, 9.0)).any()
