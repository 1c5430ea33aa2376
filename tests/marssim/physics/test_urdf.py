from xml.etree import ElementTree

import numpy as np

from marssim.base.rover_spec import ZHURONG
from marssim.physics.kinematics import settle
from marssim.physics.linkage import MAX_SWING, Joints, Linkage
from marssim.physics.urdf import chassis_middle, rover_urdf

JOINTS = {joint.find("child").get("link"): joint for joint in ElementTree.fromstring(rover_urdf(ZHURONG)).iter("joint")}


def test_every_link_hangs_where_the_linkage_has_it():
    """Without turned joints a link's place is the sum of the origins up to the chassis, whose frame is its middle."""
    poses = Linkage.from_spec(ZHURONG).link_poses(np.eye(4), Joints())
    assert set(JOINTS) == set(poses) - {"chassis"}
    for link, pose in poses.items():
        place, name = np.array([0, 0, chassis_middle(ZHURONG)]), link
        if link == "chassis":
            continue
        while name != "chassis":
            place = place + np.array(JOINTS[name].find("origin").get("xyz").split(), dtype=float)
            name = JOINTS[name].find("parent").get("link")
        np.testing.assert_allclose(place, pose[:3, 3], atol=1e-9, err_msg=link)


def test_front_wheels_hang_on_rockers_and_the_others_on_bogies():
    carriers = {link: joint.find("parent").get("link") for link, joint in JOINTS.items() if link.startswith("steer")}
    for side in ("left", "right"):
        assert carriers[f"steer_front_{side}"] == f"rocker_{side}"
        assert carriers[f"steer_middle_{side}"] == carriers[f"steer_rear_{side}"] == f"bogie_{side}"


def test_rigid_bodies_and_settling_stop_at_the_same_angle(make_scene):
    for link in ("rocker_left", "rocker_right", "bogie_left", "bogie_right"):
        limit = JOINTS[link].find("limit")
        assert float(limit.get("upper")) == -float(limit.get("lower")) == MAX_SWING
    turned = []
    for step in (0.3, 0.6, 1.0):  # [m] under the left front wheel: from well within the stops to beyond them
        scene = make_scene(lambda x, y, step=step: step * ((x > 0.3) & (y > 0.3)), half=2.0, cell=0.05)
        joints = settle(scene, ZHURONG, 0.0, 0.0, 0.0).joints
        turned.append(np.abs([*joints.rocker, *joints.bogie]).max())
    assert turned[0] < 0.7 * MAX_SWING and max(turned) == MAX_SWING
