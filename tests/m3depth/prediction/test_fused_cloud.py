import numpy as np

from m3depth.prediction.fused_cloud import FusedCloud, fuse


def test_points_of_one_cube_are_averaged_over_all_clouds():
    first = np.array([[0.01, 0.01, 0.01], [1.0, 0, 0]]), np.array([[0, 0, 0], [9, 9, 9]], np.uint8)
    second = np.array([[0.03, 0.03, 0.03]]), np.array([[100, 50, 0]], np.uint8)
    points, colours = fuse([first, second], 0.05).result()
    near = np.argmin(np.linalg.norm(points, axis=1))
    assert len(points) == 2 and np.allclose(points[near], 0.02) and (colours[near] == [50, 25, 0]).all()


def test_the_same_ground_does_not_grow_the_cloud_and_order_hardly_matters():
    rng = np.random.default_rng(0)
    clouds = [(rng.uniform(-1, 1, (500, 3)) * [1, 1, 0], np.zeros((500, 3), np.uint8)) for _ in range(4)]
    all_points = fuse(clouds, 0.2).result()[0]
    assert 60 < len(all_points) <= 121
    origin_first = [clouds[0], *clouds[:0:-1]]
    np.testing.assert_allclose(fuse(origin_first, 0.2).result()[0], all_points, atol=1e-6)


def test_nothing_and_points_far_beyond_do_no_harm():
    cloud = FusedCloud(0.01)
    cloud.add(np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
    assert len(cloud.result()[0]) == 0 and cloud.encode().startswith(b"ply")
    cloud.add(np.array([[5.0, 5, 5], [1e7, 0, 0]]), np.zeros((2, 3), np.uint8))
    assert np.allclose(cloud.result()[0], 5)
