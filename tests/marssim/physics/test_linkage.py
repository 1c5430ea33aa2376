import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.rover_spec import ZHURONG
from marssim.physics.linkage import WHEELS, Joints, Linkage
from marssim.physics.state import angles, rotation

ANGLE = st.floats(-0.5, 0.5)
LINKAGE = Linkage.from_spec(ZHURONG)


@given(st.tuples(ANGLE, ANGLE), st.tuples(ANGLE, ANGLE), st.tuples(ANGLE, ANGLE, ANGLE))
def test_hubs_are_where_the_links_are(rocker, bogie, attitude):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation(*attitude), (1.0, -2.0, 0.5)
    links = LINKAGE.link_poses(pose, Joints(np.array(rocker), np.array(bogie)))
    expected = LINKAGE.hub_positions(np.array(rocker), np.array(bogie)) @ pose[:3, :3].T + pose[:3, 3]
    np.testing.assert_allclose([links[f"wheel_{name}"][:3, 3] for name in WHEELS], expected, atol=1e-12)


@given(st.tuples(ANGLE, ANGLE), st.tuples(ANGLE, ANGLE))
def test_links_are_rigid(rocker, bogie):
    hubs = LINKAGE.hub_positions(np.array(rocker), np.array(bogie))
    np.testing.assert_allclose(np.linalg.norm(hubs[2:4] - hubs[4:6], axis=1), 0.65, atol=1e-12)
    reach = np.linalg.norm(LINKAGE.hubs[:2] - LINKAGE.rocker, axis=1)
    np.testing.assert_allclose(np.linalg.norm(hubs[:2] - LINKAGE.rocker, axis=1), reach, atol=1e-12)


def test_positive_rocker_lowers_the_front_wheel():
    hubs = LINKAGE.hub_positions(np.array([0.1, 0.0]), np.zeros(2))
    assert hubs[0, 2] < ZHURONG.wheel_radius < hubs[4, 2]
    np.testing.assert_allclose(hubs[1::2], LINKAGE.hubs[1::2])


@given(ANGLE, ANGLE, st.floats(-3, 3))
def test_angles_invert_rotation(roll, pitch, yaw):
    np.testing.assert_allclose(angles(rotation(roll, pitch, yaw)), (roll, pitch, yaw), atol=1e-9)
