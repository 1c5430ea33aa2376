import gc
import sys
from importlib import metadata

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from marssim.engines import embree
from marssim.engines.embree import FAR, TriangleRays

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
HALVES = np.array([[0, 1, 2], [0, 2, 3]])
DOWN = np.array([0.0, 0.0, -1.0])


def brute_force(corners, origins, directions, reach):
    """Face met first and its distance, of every ray against every triangle, by volumes of tetrahedra in float64; and
    how far each ray stays from deciding otherwise, as a share."""
    a, b, c = (corners[None, :, k] - origins[:, None] for k in range(3))
    toward = np.broadcast_to(directions[:, None], a.shape)
    volumes = np.stack([np.einsum("nfi,nfi->nf", toward, np.cross(p, q)) for p, q in ((b, c), (c, a), (a, b))])
    total = volumes.sum(axis=0)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        share = volumes / total
        distance = np.einsum("nfi,fi->nf", a, normal) / np.einsum("ni,fi->nf", directions, normal)
    met = (share > 0).all(axis=0) & (distance > 0) & (distance < reach[:, None])
    distance = np.where(met, distance, np.inf)
    face = np.where(met.any(axis=1), distance.argmin(axis=1), -1)
    margin = np.minimum(np.abs(share).min(axis=(0, 2)), np.abs(total / np.linalg.norm(normal, axis=1)).min(axis=1))
    ordered = np.sort(distance, axis=1)
    with np.errstate(invalid="ignore"):
        apart = np.nan_to_num(ordered[:, 1] - ordered[:, 0], nan=np.inf)
    return face, np.minimum(ordered[:, 0], reach), np.minimum(margin, apart)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), rays=st.integers(1, 40), faces=st.integers(2, 60), one_origin=st.booleans())
def test_rays_are_those_of_brute_force(seed, rays, faces, one_origin):
    rng = np.random.default_rng(seed)
    vertices = rng.uniform(-1, 1, (faces + 2, 3)).astype(np.float32)
    triangles = np.stack([rng.permutation(faces + 2)[:3] for _ in range(faces)])
    origins = rng.uniform(-2, 2, (1 if one_origin else rays, 3)).astype(np.float32)
    directions = rng.normal(size=(rays, 3)).astype(np.float32)
    reach = rng.uniform(0.2, 5, rays).astype(np.float32)
    face, distance = TriangleRays(vertices, triangles).meet(origins, directions, reach)
    wide = np.broadcast_to(origins, directions.shape).astype(float)
    expected, far, margin = brute_force(vertices[triangles].astype(float), wide, directions.astype(float), reach)
    ends = np.abs(far - reach) > 1e-3  # or nothing is met
    sure = (margin > 1e-3) & (ends | (expected < 0))
    assert np.array_equal(face[sure], expected[sure])
    assert np.allclose(distance[sure], far[sure], rtol=1e-3)


def test_no_ray_slips_through_between_neighbours():
    """Rays at the edges of a grid of triangles, at positions that float32 does not represent."""
    n = 60
    x, y = np.meshgrid(np.linspace(-7, 7, n), np.linspace(-7, 7, n))
    vertices = np.stack([x, y, 0.1 * np.sin(3 * x) * np.cos(2 * y)], axis=-1).reshape(-1, 3)
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + n + 1], 1), np.stack([a, a + n + 1, a + n], 1)])
    inner = vertices.reshape(n, n, 3)[1:-1, 1:-1]
    sides = inner[1:, 1:] + inner[:-1, 1:], inner[1:, 1:] + inner[1:, :-1], inner[1:, 1:] + inner[:-1, :-1]
    places = np.concatenate([side.reshape(-1, 3) / 2 for side in sides])
    towards = places - [0.3, -0.2, 5.0]
    face, distance = TriangleRays(vertices, faces).meet(np.array([[0.3, -0.2, 5.0]]), towards)
    assert (face >= 0).all() and np.allclose(distance, 1, atol=1e-3)


@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 1000])
def test_any_number_of_rays(count):
    origins = np.random.default_rng(count).uniform([-0.5, -0.5, 1.5], [1.5, 1.5, 3.5], (count, 3))
    face, distance = TriangleRays(SQUARE, HALVES).meet(origins, np.broadcast_to(DOWN, (count, 3)))
    inside = ((origins[:, :2] > 0) & (origins[:, :2] < 1)).all(axis=1)
    assert np.array_equal(face, np.where(inside, np.where(origins[:, 0] > origins[:, 1], 0, 1), -1))
    assert np.allclose(distance, np.where(inside, origins[:, 2], FAR))


def test_a_mesh_without_triangles_is_never_met():
    face, _ = TriangleRays(SQUARE, np.zeros((0, 3), dtype=int)).meet(SQUARE + 1, np.broadcast_to(DOWN, (4, 3)))
    assert (face == -1).all()


def test_the_arrays_that_embree_reads_are_kept():
    """The caller may free or change its arrays; rays must not hit what is stored there then."""
    vertices, faces = SQUARE.copy(), HALVES.astype(np.int32)
    triangles = TriangleRays(vertices, faces)
    vertices += 100
    del vertices, faces
    gc.collect()
    face, distance = triangles.meet(np.array([[0.7, 0.2, 3.0]]), DOWN[None])
    assert face.tolist() == [0] and distance.tolist() == [3.0]


@pytest.mark.parametrize("faces", [[[0, 1, 4]], [[-1, 0, 1]]])
def test_faces_of_other_vertices_are_refused(faces):
    with pytest.raises(ValueError, match="faces must be of the 4 vertices"):
        TriangleRays(SQUARE, np.array(faces))


@pytest.mark.parametrize(
    ("origins", "directions"), [((0, 3), (4, 3)), ((2, 3), (4, 3)), ((1, 3), (4, 2)), ((3,), (3,))]
)
def test_rays_of_wrong_shapes_are_refused(origins, directions):
    with pytest.raises(ValueError, match=r"must be \(N, 3\) each"):
        TriangleRays(SQUARE, HALVES).meet(np.zeros(origins), np.ones(directions))


def test_closed_triangles_refuse_rays():
    triangles = TriangleRays(SQUARE, HALVES)
    triangles.close()
    triangles.close()
    with pytest.raises(RuntimeError, match="closed"):
        triangles.meet(SQUARE, SQUARE)


def test_the_library_is_found_through_the_module_that_is_linked_to_it(monkeypatch):
    """An embreex that was built against the system's Embree contains no library."""
    monkeypatch.setattr(metadata, "files", lambda _: None)
    library, device = embree._embree.__wrapped__()
    assert device and library.rtcGetDeviceError(device) == 0


def test_without_the_package_a_sentence_names_the_renderer_that_needs_none(monkeypatch):
    monkeypatch.setitem(sys.modules, "embreex", None)
    embree._embree.cache_clear()
    try:
        with pytest.raises(ImportError, match=r"embreex cannot be imported .* the renderer scan does without$"):
            TriangleRays(SQUARE, HALVES).nearest(np.zeros((1, 3)), DOWN[None])
    finally:
        embree._embree.cache_clear()
