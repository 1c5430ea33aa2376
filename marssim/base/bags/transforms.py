"""The frames of a bag: which stands where in which, and when."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from marssim.base.bags.names import BASE_LINK, MOVING_FRAMES, STATIC_FRAMES
from marssim.base.bags.reader import Bag, stamp_of

ODOMETRY_KIND = "nav_msgs/Odometry"
ROVER_FRAMES = (BASE_LINK, "base_footprint", "base_stabilized", "base", "body", "chassis")  # also in a namespace
MOST_LEVELS = 100  # of frames in frames; more are a circle


class Transforms:
    """A tree of frames, some of which move.

    A moving frame is known between the first and the last time at which it was recorded, in between by interpolation.
    """

    def __init__(self) -> None:
        self._parent: dict[str, str] = {}
        self._fixed: dict[str, np.ndarray] = {}
        self._moving: dict[str, dict[int, np.ndarray]] = {}
        self._times: dict[str, np.ndarray] = {}

    def add(self, parent: str, child: str, pose: np.ndarray, stamp: int | None = None) -> None:
        """Add where a frame is: `pose` (4, 4) of the child in the parent at a time [ns]; None where it never moves."""
        parent, child = parent.lstrip("/"), child.lstrip("/")
        self._parent[child] = parent
        if stamp is None:
            self._fixed[child] = pose
        else:
            self._moving.setdefault(child, {})[stamp] = pose
            self._times.pop(child, None)

    def has_parent(self, frame: str) -> bool:
        """Return whether a frame stands in another one."""
        return frame.lstrip("/") in self._parent

    def contains(self, outer: str, frame: str) -> bool:
        """Return whether a frame stands in another one, directly or in frames between them."""
        for _ in range(MOST_LEVELS):
            if (frame := frame.lstrip("/")) not in self._parent:
                return False
            frame = self._parent[frame]
            if frame == outer.lstrip("/"):
                return True
        return False

    def world(self, frame: str) -> str | None:
        """Return the outermost frame that a frame moves in.

        None if it stands still, is not known, or moves in the rover alone, as a mast does: that is no world.
        """
        moves = False
        for _ in range(MOST_LEVELS):
            if (frame := frame.lstrip("/")) not in self._parent:
                return frame if moves and frame.rpartition("/")[2] not in ROVER_FRAMES else None
            moves |= frame in self._moving
            frame = self._parent[frame]
        return None

    def pose(self, frame: str, stamp: int, outer: str | None = None) -> np.ndarray | None:
        """Return the pose of a frame in another one at a time [ns].

        Args:
            frame: The frame.
            stamp: The time [ns].
            outer: The frame that the pose is in, whose own pose need not be known; None for the outermost one.

        Returns:
            (4, 4) pose; None if it is not known then, or the frame does not stand in `outer`.
        """
        pose = np.eye(4)
        for _ in range(MOST_LEVELS):
            frame = frame.lstrip("/")
            if outer is not None and frame == outer.lstrip("/"):
                return pose
            if frame not in self._parent:
                return pose if outer is None else None
            step = self._step(frame, stamp)
            if step is None:
                return None
            pose = step @ pose
            frame = self._parent[frame]
        return None

    def _step(self, frame: str, stamp: int) -> np.ndarray | None:
        """Return the pose of a frame in its parent at a time [ns], (4, 4); None if it is not known then."""
        if frame not in self._moving:
            return self._fixed[frame]
        poses = self._moving[frame]
        if stamp in poses:
            return poses[stamp]
        if frame not in self._times:
            self._times[frame] = np.array(sorted(poses))
        times = self._times[frame]
        after = int(np.searchsorted(times, stamp))
        if not 0 < after < len(times):
            return None
        first, second = int(times[after - 1]), int(times[after])
        share = (stamp - first) / (second - first)
        turns = Rotation.from_matrix([poses[first][:3, :3], poses[second][:3, :3]])
        out = np.eye(4)
        out[:3, :3] = Slerp([0, 1], turns)(share).as_matrix()
        out[:3, 3] = (1 - share) * poses[first][:3, 3] + share * poses[second][:3, 3]
        return out


def read_transforms(bag: Bag) -> Transforms:
    """Return the frames of a bag: those of /tf and /tf_static, and of odometry where /tf has none of its child.

    Messages whose numbers are no pose are left out.

    Raises:
        DatasetError: The bag cannot be read.
    """
    tree = Transforms()
    for topic, message in bag.messages([MOVING_FRAMES, STATIC_FRAMES]):
        for item in message.transforms:
            pose = _pose(item.transform.translation, item.transform.rotation)
            if pose is not None:
                stamp = None if topic == STATIC_FRAMES else stamp_of(item)
                tree.add(item.header.frame_id, item.child_frame_id, pose, stamp)
    for topic in bag.topics_of(ODOMETRY_KIND):
        _add_odometry(tree, (message for _, message in bag.messages([topic])))
    return tree


def _add_odometry(tree: Transforms, messages: Iterable[Any]) -> None:
    """Add the poses of an odometry, unless its child stands somewhere already."""
    for number, message in enumerate(messages):
        if number == 0 and tree.has_parent(message.child_frame_id):
            return
        pose = _pose(message.pose.pose.position, message.pose.pose.orientation)
        if pose is not None:
            tree.add(message.header.frame_id, message.child_frame_id, pose, stamp_of(message))


def _pose(position: Any, turn: Any) -> np.ndarray | None:
    """Return the (4, 4) matrix of a position and a quaternion; None if they are none."""
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w])
    out = np.eye(4)
    out[:3, 3] = position.x, position.y, position.z
    if not np.isfinite(out).all() or not 0.5 < np.linalg.norm(quaternion) < 2:
        return None
    out[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    return out
