import numpy as np
import pytest

from marssim.render.geometry.mesh import SceneMesh, closed_ground_mesh, ground_mesh
from marssim.render.geometry.seam import seam_cells
from marssim.scene.terrain import ReliefConfig, Terrain, build_terrain

SIZES = [(8.0, 0.08, 12.0), (7.0, 0.13, 5.0), (6.0, 0.7, 9.0), (5.9, 0.1, 3.0)]  # size, cell, horizon [m]


def rough(size: float, cell: float, horizon: float) -> Terrain:
    return build_terrain(ReliefConfig(rms_slope_deg=8.0), size, cell, horizon, np.random.default_rng(4))


def open_edges(mesh: SceneMesh) -> np.ndarray:
    """Return the ends (N, 2, 3) [m] of edges that are not shared by two faces; vertices closer than 1 mm are one."""
    _, first, same = np.unique(np.rint(mesh.vertices / 1e-3), axis=0, return_index=True, return_inverse=True)
    faces = same.ravel()[mesh.faces]
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    pairs, count = np.unique(edges, axis=0, return_counts=True)
    return mesh.vertices[first[pairs[count != 2]]]


@pytest.mark.parametrize("sizes", SIZES)
def test_the_ground_has_no_gap_but_beyond_its_outer_border(sizes):
    terrain = rough(*sizes)
    edges = open_edges(closed_ground_mesh(terrain))
    outermost = np.abs(edges[..., :2]).max(axis=-1)
    assert len(edges) and np.allclose(outermost, terrain.coarse.bounds[2])


def test_the_grids_alone_leave_a_gap():
    edges = open_edges(ground_mesh(rough(*SIZES[0])))
    assert (np.abs(edges[..., :2]).max(axis=(1, 2)) < 4.001).sum() > 400


@pytest.mark.parametrize("sizes", SIZES)
def test_the_strip_lies_in_its_cells_once_and_faces_upward(sizes):
    terrain = rough(*sizes)
    mesh = closed_ground_mesh(terrain)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    double = np.cross(b - a, c - a)[:, 2]
    x0, y0, x1, y1 = terrain.coarse.bounds
    assert (double > 0).all() and double.sum() / 2 == pytest.approx((x1 - x0) * (y1 - y0))
    fine = 2 * (terrain.fine.heights.shape[0] - 1) ** 2
    around = 2 * (terrain.coarse_cells & ~seam_cells(terrain)).sum()
    assert double[fine + around :].sum() / 2 == pytest.approx(seam_cells(terrain).sum())


@pytest.mark.parametrize("sizes", SIZES)
def test_pieces_hold_all_faces_within_their_boxes(sizes):
    mesh = closed_ground_mesh(rough(*sizes))
    assert mesh.start[0] == 0 and mesh.start[-1] == len(mesh.faces) and (np.diff(mesh.start) > 0).all()
    piece = np.repeat(np.arange(len(mesh.low)), np.diff(mesh.start))
    corner = mesh.vertices[mesh.faces]
    assert (corner >= mesh.low[piece][:, None]).all() and (corner <= mesh.high[piece][:, None]).all()
