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
    cloud.add(np.array([[5.0, 5, 5], [5.0, 5, 5]]), np.zeros((2, 3), np.uint8))
    cloud.add(np.full((1, 3), 1e7), np.zeros((1, 3), np.uint8))  # all of it is too far away
    cloud.add(np.array([[5.0, 5, 5], [1e7, 0, 0]]), np.zeros((2, 3), np.uint8))
    assert np.allclose(cloud.result()[0], 5)


def test_clouds_are_sorted_in_rarely_however_many_there_are(monkeypatch):
    merged, merge = [], FusedCloud._merge
    monkeypatch.setattr(FusedCloud, "_merge", lambda self: merged.append(1) or merge(self))
    cloud, rng = FusedCloud(0.1), np.random.default_rng(0)
    clouds = [rng.uniform(n, n + 1, (50, 3)) for n in range(100)]  # each of new ground
    for points in clouds:
        cloud.add(points, np.zeros((50, 3), np.uint8))
    assert len(merged) < 12
    keys = {tuple(key) for points in clouds for key in np.floor((points - np.floor(clouds[0][0] / 0.1) * 0.1) / 0.1)}
    assert len(cloud.result()[0]) == len(keys)


def test_colours_of_a_cube_are_rounded():
    points = np.full((3, 3), 0.01)
    colours = np.array([[0, 0, 255], [1, 0, 255], [1, 1, 254]], np.uint8)
    assert fuse([(points, colours)], 0.05).result()[1].tolist() == [[1, 0, 255]]
