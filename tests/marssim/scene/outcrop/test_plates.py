import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from marssim.scene.outcrop.plates import POINTS, Plates, nearest, outside, plate_bodies


def plates(count: int, level: int, seed: int, tilt: float = 0.1) -> Plates:
    rng = np.random.default_rng(seed)
    angle = np.arange(POINTS[level]) / POINTS[level] * 2 * np.pi
    radius = rng.uniform(0.2, 0.5, (count, 1)) * rng.uniform(0.8, 1, (count, POINTS[level]))
    middle = rng.uniform(-9, 9, (count, 2))
    shape = middle[:, None] + radius[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    plane = np.column_stack([rng.uniform(0, 1, count), rng.uniform(-tilt, tilt, (count, 2))])
    return Plates(
        outline=shape, plane=plane, thickness=rng.uniform(0.05, 0.2, count), undercut=rng.uniform(0, 0.1, count),
        bevel=np.full(count, 0.01), exposed=np.full(count, 0.1), diameter=2 * radius.mean(axis=1), middle=middle,
        albedo=np.ones(count), level=level,
    )  # fmt: skip


@settings(deadline=None, max_examples=20)
@given(level=st.integers(0, len(POINTS) - 1), seed=st.integers(0, 1000))
def test_plates_are_closed_bodies_whose_normals_point_outward(level, seed):
    drawn = plates(4, level, seed)
    bodies = plate_bodies(drawn, np.random.default_rng(seed))
    assert bodies.face_rock.tolist() == sorted(bodies.face_rock.tolist()) and len(bodies) == 4
    for n in range(4):
        mesh = trimesh.Trimesh(bodies.vertices, bodies.faces[bodies.face_rock == n])
        assert mesh.is_watertight and mesh.volume > 0
        assert mesh.volume == pytest.approx(drawn.thickness[n] * np.pi * (drawn.diameter[n] / 2) ** 2, rel=0.4)
        assert mesh.bounds[0, :2] == pytest.approx(drawn.outline[n].min(axis=0), abs=1e-9)
    lengths = np.linalg.norm(bodies.vertex_normals, axis=1)
    assert lengths == pytest.approx(1)


def test_tops_lie_on_their_planes_and_sides_reach_down_by_the_thickness():
    drawn = plates(30, 2, 0)
    bodies = plate_bodies(drawn, np.random.default_rng(0))
    vertices = bodies.vertices.reshape(30, -1, 3)
    below = drawn.top_at(vertices[..., 0], vertices[..., 1]) - vertices[..., 2]
    assert below.max(axis=1) == pytest.approx(drawn.thickness)
    assert (np.abs(below.min(axis=1)) <= drawn.bevel).all()
    up = bodies.vertex_normals.reshape(30, -1, 3)[:, -1]
    tilt = np.column_stack([-drawn.plane[:, 1:], np.ones(30)])
    assert np.einsum("ni,ni->n", up, tilt / np.linalg.norm(tilt, axis=1)[:, None]).min() > 0.99


def test_clear_discs_and_numbers_leave_plates_out():
    drawn = plates(50, 1, 3)
    kept = outside([drawn], ((0.0, 0.0, 3.0),))[0]
    gap = np.hypot(*kept.middle.T) - kept.diameter / 2
    assert 0 < len(kept) < 50 and gap.min() > 3
    few = nearest([drawn, drawn], 30)
    away = np.hypot(*drawn.middle.T)
    assert sum(map(len, few)) == 30 and np.hypot(*few[0].middle.T).max() == pytest.approx(np.sort(away)[14])
    assert nearest([drawn], 50) == [drawn]
