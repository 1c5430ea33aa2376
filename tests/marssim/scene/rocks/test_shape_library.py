import numpy as np
import pytest
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from marssim.scene.rocks.shape_library import BURIAL, outlines, shape_library
from marssim.scene.rocks.shapes import icosphere


@pytest.mark.parametrize("level", range(3))
def test_library_normals_point_outward(level):
    library = shape_library(level)
    assert len(library.vertices) == len(library.outline) == len(library.middle)
    assert np.allclose(np.linalg.norm(library.normals, axis=-1), 1)
    middle = np.zeros((len(library.middle), 1, 3))
    middle[:, 0, 2] = library.middle
    assert (np.einsum("nvi,nvi->nv", library.normals, library.vertices - middle) > 0).all()


def test_outlines_are_those_that_rays_from_above_see():
    """Embree's rays are the reference, instead of the raster's barycentric coordinates."""
    library = shape_library(2)
    for shape in range(0, len(library.vertices), 17):
        vertices = library.vertices[shape].astype(np.float32)
        embree = EmbreeScene()
        TriangleMesh(embree, vertices, library.faces)
        x, y = np.meshgrid(np.arange(-1.6, 1.6, 0.013), np.arange(-1.6, 1.6, 0.013))
        origins = np.stack([x, y, np.full_like(x, 2.0)], axis=-1).reshape(-1, 3).astype(np.float32)
        hit = embree.run(origins, np.tile(np.array([0, 0, -1], np.float32), (len(origins), 1)), output=True)
        top = np.where(hit["primID"] >= 0, 2 - hit["tfar"], -np.inf)
        for buried in (0.0, 0.22, 0.45):
            area = float(library.exposed_outline(np.array([shape]), np.array([buried]))[0])
            assert area == pytest.approx(np.sum(top > buried) * 0.013**2, rel=0.03)


def test_outline_of_a_half_buried_sphere_is_its_disc():
    vertices, faces = icosphere(4)
    area = outlines(vertices[None] * 0.5 + 0.5, faces)[0]
    for share, got in zip(BURIAL, area):
        radius = np.sqrt(max(0.0, 0.25 - max(0.0, share - 0.5) ** 2))
        assert got == pytest.approx(np.pi * radius**2, rel=0.03)
