"""Points and mesh of a board before level ground, whose geometry is known."""

import io

import numpy as np
import pytest
import trimesh

from marssim.base.camera import PinholeCamera
from marssim.base.dataset.sample import StereoSample, read_sample
from marssim.base.images.pointcloud import CUT, coloured_points, encode_glb, encode_ply, surface_mesh
from marssim.base.pose import look_pose

HEIGHT, PITCH, BOARD_Z = 1.2, np.deg2rad(12), 3.0  # of conftest.py


@pytest.fixture
def sample(closed_form_set) -> StereoSample:
    return read_sample(closed_form_set / "scenes" / "00000" / "00")


def off_surfaces(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances [m] of points, camera frame, from the ground and from the board's plane."""
    down = -look_pose(np.zeros(3), 0.0, PITCH)[2, :3]
    return np.abs(points @ down - HEIGHT), np.abs(points[:, 2] - BOARD_Z)


def test_points_lie_on_what_was_seen_and_keep_their_colour(sample):
    points, colours = coloured_points(sample.left, sample.depth, sample.rig.camera, 15.0)
    assert len(points) == (sample.depth <= 15).sum()
    ground, board = off_surfaces(points)
    assert (np.minimum(ground, board) < 1e-3).all() and (board < 1e-3).sum() > 50
    u, v = np.round(sample.rig.camera.project(points)).astype(int).T
    assert np.array_equal(colours, sample.left[v, u])


def test_the_mesh_has_no_flying_triangles(sample):
    vertices, faces, pixel = surface_mesh(sample.depth, sample.normal, sample.rig.camera, 15.0)
    ground, board = off_surfaces(vertices)
    corners = (board < 1e-3)[faces]
    mixed = corners.any(axis=1) & ~corners.all(axis=1)
    # board and ground only share triangles where they touch, at the board's foot
    reach = np.linalg.norm(vertices[faces] - vertices[faces].mean(axis=1, keepdims=True), axis=2).max(axis=1)
    assert (reach[mixed] < 0.15).all()
    assert (ground[faces[mixed]] < 0.1).all()
    assert np.array_equal(np.sort(pixel), np.unique(pixel)) and faces.max() == len(vertices) - 1


def test_surfaces_stay_whole(sample):
    """A strip along the board is cut; far ground, where depth jumps from row to row, is not."""
    _, faces, pixel = surface_mesh(sample.depth, sample.normal, sample.rig.camera, 15.0)
    known = sample.depth <= 15
    quads = known[:-1, :-1] & known[1:, :-1] & known[:-1, 1:] & known[1:, 1:]
    assert 0.9 * 2 * quads.sum() < len(faces) < 2 * quads.sum()
    ground = known & (sample.rock == 0)
    alone = ground[:, -10:]  # right of the board
    rows = np.flatnonzero(alone.all(axis=1))
    assert np.diff(sample.depth[rows[0] : rows[-1], -1]).min() < -0.3, "no slanted ground: it tests too little"
    used = np.zeros(known.shape, bool)
    used.ravel()[pixel] = True
    assert used[rows[0] : rows[-1] + 1, -10:].all()


def test_faces_turn_to_the_camera(sample):
    vertices, faces, _ = surface_mesh(sample.depth, sample.normal, sample.rig.camera, 15.0)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0).all()


def test_the_files_are_what_others_read(sample):
    camera = sample.rig.camera
    points, colours = coloured_points(sample.left, sample.depth, camera, 15.0)
    cloud = trimesh.load(io.BytesIO(encode_ply(points, colours)), file_type="ply")
    assert isinstance(cloud, trimesh.PointCloud)
    assert np.allclose(cloud.vertices, points) and np.array_equal(np.asarray(cloud.colors)[:, :3], colours)
    vertices, faces, pixel = surface_mesh(sample.depth, sample.normal, camera, 15.0)
    mesh_colours = sample.left.reshape(-1, 3)[pixel]
    mesh = trimesh.load(io.BytesIO(encode_glb(vertices, faces, mesh_colours)), file_type="glb", force="mesh")
    assert np.allclose(mesh.vertices * [1, -1, -1], vertices, atol=1e-6)  # glTF: y up, towards the viewer
    assert np.array_equal(mesh.faces, faces)
    assert np.array_equal(np.asarray(mesh.visual.vertex_colors)[:, :3], mesh_colours)


def test_places_far_from_the_origin_keep_their_millimetres():
    points = np.array([[500_000.123, 1.002, -3.5], [999_999.999, 0, 0]])
    colours = np.array([[1, 2, 3], [250, 0, 9]], np.uint8)
    cloud = trimesh.load(io.BytesIO(encode_ply(points, colours)), file_type="ply")
    assert np.abs(cloud.vertices - points).max() < 1e-6 and np.array_equal(np.asarray(cloud.colors)[:, :3], colours)


def test_without_points_the_cloud_is_empty_and_there_is_no_mesh(sample):
    none = np.zeros((0, 3))
    empty = encode_ply(none, none)
    assert empty.endswith(b"end_header\n") and trimesh.load(io.BytesIO(empty), file_type="ply").is_empty
    with pytest.raises(ValueError, match="triangle"):
        encode_glb(none, none.astype(int), none)


def test_the_farther_corner_says_how_large_a_step_is_no_edge():
    camera = PinholeCamera.centred(2, 2, 80.0)
    normal = np.broadcast_to([0.0, 0, -1], (2, 2, 3))
    nearer = CUT / 80
    for step, faces in ((1.02 * nearer, 2), (1.06 * nearer, 0)):  # the limit is 1.039 times as much at the other depth
        depth = np.array([[1, 1 + step], [1, 1 + step]])
        assert len(surface_mesh(depth, normal, camera, 10.0)[1]) == faces
        assert len(surface_mesh(depth[:, ::-1], normal, camera, 10.0)[1]) == faces


def test_points_far_to_the_west_keep_their_millimetres():
    for place in (9000.001, -9000.001):
        data = encode_ply(np.array([[place, 0.0, -1.0]]), np.zeros((1, 3), np.uint8))
        assert b"property double x" in data and np.frombuffer(data.partition(b"end_header\n")[2][:8])[0] == place
