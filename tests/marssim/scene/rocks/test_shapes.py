import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from marssim.scene.rocks.shapes import FAMILIES, LEVELS, draw_shape, icosphere, snap


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(FAMILIES), st.integers(LEVELS[0], LEVELS[-2]), st.integers(0, 10_000))
def test_shapes_are_closed_star_shaped_and_without_slivers(family, level, seed):
    vertices, middle = draw_shape(family, level, np.random.default_rng(seed))
    faces = icosphere(level)[1]
    assert vertices[:, 2].min() == pytest.approx(0)
    assert vertices[:, 2].max() == pytest.approx(1)
    a, b, c = (vertices[faces[:, i]] - (0, 0, middle) for i in range(3))
    assert (np.einsum("ij,ij->i", a, np.cross(b, c)) > 0).all()  # every face is seen from the centre, outward
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
    assert mesh.area_faces.min() > 0.02 * mesh.area_faces.mean()


@pytest.mark.parametrize("family", FAMILIES)
def test_a_rock_is_the_same_at_every_level_but_for_what_its_triangles_cannot_show(family):
    for variant in range(6):
        shapes = [draw_shape(family, level, np.random.default_rng((3, variant)))[0] for level in (2, 3, 4)]
        ends = [np.concatenate([shape.min(axis=0), shape.max(axis=0)]) for shape in shapes]
        # few triangles cut off beds that weather back by up to 0.1 of the radius, and scars of up to 0.6 of their width
        assert np.abs(ends[0] - ends[2]).max() < 0.3 and np.abs(ends[1] - ends[2]).max() < 0.17


@pytest.mark.parametrize("family", FAMILIES)
def test_the_finest_shapes_turn_no_face_over(family):
    for variant in range(4):
        vertices, middle = draw_shape(family, LEVELS[-1], np.random.default_rng((4, variant)))
        a, b, c = (vertices[icosphere(LEVELS[-1])[1][:, i]] - (0, 0, middle) for i in range(3))
        assert (np.einsum("ij,ij->i", a, np.cross(b, c)) > 0).all()


def test_snapped_directions_lie_on_the_edges_of_a_cube():
    """The edges of a cube end up as rows of vertices, so that a worn cube keeps straight edges."""
    directions, faces = icosphere(3)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    directions = directions @ turn.T
    normal = np.concatenate([np.eye(3), -np.eye(3)])
    out = snap(directions, faces, normal, np.ones(6))
    cube = out / np.abs(out).max(axis=1, keepdims=True)
    crossing = 0.0
    for one, other in ((0, 1), (1, 2), (2, 0)):  # length of mesh edges that run from one side of the cube to another
        side = np.abs(cube).argmax(axis=1)
        ends = cube[np.stack([faces[:, one], faces[:, other]])]
        free = (np.sort(np.abs(ends), axis=2)[..., 1] < 0.999).all(axis=0)
        crossing += np.sum(free & (side[faces[:, one]] != side[faces[:, other]]))
    assert crossing <= 0.02 * 3 * len(faces)
    assert np.sum(np.sort(np.abs(cube), axis=1)[:, 1] > 0.999) > 60  # on an edge
    assert np.sum(np.abs(cube).min(axis=1) > 0.999) >= 6  # on one of the eight corners
    assert (np.linalg.det(out[faces]) > 0).all()
