"""Read the frames of a bag: those of TF, and odometry where TF says nothing."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import scipy

from marssim.base.bags.names import MOVING_FRAMES, STATIC_FRAMES
from marssim.base.bags.reader import Bag, stamp_of
from marssim.base.bags.transforms import Transforms

FRAMES_KIND, ODOMETRY_KIND = "tf2_msgs/TFMessage", "nav_msgs/Odometry"


def frame_topics(bag: Bag, near: str = "") -> tuple[str, str]:
    """Return the topics of the moving and of the fixed frames.

    They are /tf and /tf_static, or those in the namespace that has most in common with another topic.

    Args:
        bag: The bag.
        near: The other topic, such as that of the images.
    """
    moving, fixed = (
        max(
            [topic for topic in bag.topics_of(FRAMES_KIND) if topic.endswith(standard)],
            key=lambda topic: (topic == standard, _shared(topic, near)),
            default=standard,
        )
        for standard in (MOVING_FRAMES, STATIC_FRAMES)
    )
    return moving, fixed


def read_transforms(bag: Bag, near: str = "") -> Transforms:
    """Return the frames of a bag: those of TF, and of odometry where TF says nothing of its child.

    Messages whose numbers are no pose are left out.

    Args:
        bag: The bag.
        near: See frame_topics.

    Raises:
        DatasetError: The bag cannot be read.
    """
    tree = Transforms()
    moving, fixed = frame_topics(bag, near)
    for topic, message in bag.messages([moving, fixed]):
        for item in message.transforms:
            pose = _pose(item.transform.translation, item.transform.rotation)
            if pose is not None:
                tree.add(item.header.frame_id, item.child_frame_id, pose, None if topic == fixed else stamp_of(item))
    for topic in bag.topics_of(ODOMETRY_KIND):
        _add_odometry(tree, (message for _, message in bag.messages([topic])))
    return tree


def _shared(topic: str, other: str) -> int:
    """Return how many names at the beginning of two topics are the same."""
    pairs = zip(topic.split("/")[:-1], other.split("/"))
    return next((n for n, (a, b) in enumerate(pairs) if a != b), topic.count("/"))


def _add_odometry(tree: Transforms, messages: Iterable[Any]) -> None:
    """Add the poses of an odometry, unless its child moves already.

    Where the child stands still in another frame, it is that one which moves.
    """
    root, up = None, np.eye(4)
    for message in messages:
        if root is None:
            child = message.child_frame_id
            root = tree.fixed_root(child)
            outer = message.header.frame_id.lstrip("/")
            if root is None or outer == root or tree.contains(outer, child) or tree.contains(root, outer):
                return
            up = np.linalg.inv(tree.pose(child, 0, root))  # type: ignore[arg-type]  # all frames between are fixed
        pose = _pose(message.pose.pose.position, message.pose.pose.orientation)
        if pose is not None:
            tree.add(message.header.frame_id, root, pose @ up, stamp_of(message))
            tree.odometry.add(root)


def _pose(position: Any, turn: Any) -> np.ndarray | None:
    """Return the (4, 4) matrix of a position and a quaternion; None if they are none."""
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w])
    out = np.eye(4)
    out[:3, 3] = position.x, position.y, position.z
    if not np.isfinite(out).all() or not 0.5 < np.linalg.norm(quaternion) < 2:
        return None
    out[:3, :3] = scipy.spatial.transform.Rotation.from_quat(quaternion).as_matrix()
    return out
