import numpy as np

from envs.world.odometry import Odometry


def straight(metres, step):
    for x in np.arange(0, metres + step / 2, step):
        pose = np.eye(4)
        pose[0, 3] = x
        yield pose


def believed_ends(drift, yaw_drift, step, metres=20.0):
    """(300, 2) error at the end of a straight drive."""
    out = []
    for seed in range(300):
        odometry = Odometry(drift, yaw_drift, np.random.default_rng(seed))
        for pose in straight(metres, step):
            believed = odometry.update(pose)
        out.append(believed[:2, 3] - pose[:2, 3])
    return np.array(out)


def test_odometry_is_exact_without_drift():
    np.testing.assert_allclose(believed_ends(0.0, 0.0, 0.4), 0, atol=1e-12)


def test_the_error_grows_with_the_root_of_the_way_however_it_is_divided():
    for step in (0.2, 1.0):
        spread = believed_ends(0.02, 0.0, step).std(axis=0)
        np.testing.assert_allclose(spread, 0.02 * np.sqrt(20), rtol=0.15)


def test_a_heading_that_drifts_carries_the_rover_sideways():
    error = believed_ends(0.0, np.deg2rad(1.0), 0.5)
    # the integral of a random walk: sigma sqrt(L^3 / 3)
    assert np.isclose(error[:, 1].std(), np.deg2rad(1.0) * np.sqrt(20**3 / 3), rtol=0.2)
    assert np.abs(error[:, 0]).max() < 1.0


def test_a_heading_that_drifts_bends_the_way():
    """Of a random walk with the way s, variance c^2 s; its integral over L, the way across, has c^2 L^3 / 3."""
    c, metres, headings, across = 0.01, 20.0, [], []
    for seed in range(300):
        odometry = Odometry(0.0, c, np.random.default_rng(seed))
        for pose in straight(metres, 0.4):
            believed = odometry.update(pose)
        headings.append(np.arctan2(believed[1, 0], believed[0, 0]))
        across.append(believed[1, 3])
    np.testing.assert_allclose(np.std(headings), c * np.sqrt(metres), rtol=0.15)
    np.testing.assert_allclose(np.std(across), c * np.sqrt(metres**3 / 3), rtol=0.15)
    assert np.corrcoef(headings, across)[0, 1] > 0.8  # to the left where it believes to head left: sqrt(3) / 2


def test_way_that_the_wheels_lost_is_believed_to_be_made():
    odometry = Odometry(0.0, 0.0, np.random.default_rng(0))
    for pose in straight(4.0, 0.4):
        believed = odometry.update(pose, np.array([0.1, -0.02]) if pose[0, 3] else None)
    np.testing.assert_allclose(believed[:2, 3], [4.0 + 10 * 0.1, -10 * 0.02], atol=1e-12)
    stuck = odometry.update(pose, np.array([0.4, 0.0]))  # the wheels turn in place
    np.testing.assert_allclose(stuck[:2, 3] - believed[:2, 3], [0.4, 0.0], atol=1e-12)


def test_way_that_the_wheels_lost_is_believed_in_the_direction_that_is_believed():
    odometry = Odometry(0.0, 0.5, np.random.default_rng(1))
    for pose in straight(4.0, 0.4):
        before = odometry.update(pose)
    assert abs(np.arctan2(before[1, 0], before[0, 0])) > 0.1  # the heading's error
    stuck = odometry.update(pose, np.array([0.4, 0.0]))
    np.testing.assert_allclose(stuck[:2, 3] - before[:2, 3], 0.4 * before[:2, 0], atol=1e-12)


def test_attitude_and_height_are_believed_as_they_are():
    odometry, pose = Odometry(0.5, 0.5, np.random.default_rng(0)), np.eye(4)
    odometry.update(pose)
    pose = pose.copy()
    pose[:3, 3] = 1.0, 2.0, 3.0
    believed = odometry.update(pose)
    assert believed[2, 3] == 3.0 and np.allclose(believed[:3, :3] @ believed[:3, :3].T, np.eye(3))
    assert np.array_equal(believed[2], pose[2])
