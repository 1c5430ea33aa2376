"""The frames of a bag: which stands where in which, and when."""

from __future__ import annotations

import numpy as np
import scipy

from marssim.base.bags.names import BASE_LINK, MAP, ODOM

# of a rover, also in a namespace; base_footprint is on the ground (REP 120), as this project's frame of the rover
ROVER_FRAMES = ("base_footprint", BASE_LINK, "base_stabilized", "base", "body", "chassis")
EARTH_FRAMES = ("earth", "ecef", "utm", "wgs84")  # in which a place has numbers of thousands of kilometres
MOST_LEVELS = 100  # of frames in frames; more are a circle


class Transforms:
    """A tree of frames, some of which move.

    A moving frame is known between the first and the last time at which it was recorded, in between by interpolation.
    A frame that is recorded in two frames is kept in `odom` or `map` (REP 105), or else in the first one.

    Attributes:
        odometry: Frames that stand where they stand by odometry alone.
    """

    def __init__(self) -> None:
        self.odometry: set[str] = set()
        self._parent: dict[str, str] = {}
        self._others: dict[str, set[str]] = {}
        self._fixed: dict[str, np.ndarray] = {}
        self._moving: dict[str, dict[int, np.ndarray]] = {}
        self._times: dict[str, np.ndarray] = {}

    def __len__(self) -> int:
        """Return how many frames stand in another one."""
        return len(self._parent)

    def add(self, parent: str, child: str, pose: np.ndarray, stamp: int | None = None) -> None:
        """Add where a frame is: `pose` (4, 4) of the child in the parent at a time [ns]; None where it never moves."""
        parent, child = parent.lstrip("/"), child.lstrip("/")
        held = self._parent.get(child, parent)
        if held != parent:
            self._others.setdefault(child, set()).update((held, parent))
            if _preference(held) <= _preference(parent):
                return
            for poses in (self._fixed, self._moving, self._times):
                poses.pop(child, None)
        self._parent[child] = parent
        if stamp is None:
            self._fixed[child] = pose
        else:
            self._moving.setdefault(child, {})[stamp] = pose
            self._times.pop(child, None)

    def parent(self, frame: str) -> str | None:
        """Return the frame in which a frame stands; None if there is none."""
        return self._parent.get(frame.lstrip("/"))

    def other_parents(self, frame: str) -> list[tuple[str, str, list[str]]]:
        """Return what is recorded in several frames, of a frame and those in which it stands: name, kept, left out."""
        return [
            (name, self._parent[name], sorted(self._others[name] - {self._parent[name]}))
            for name in self._chain(frame) if name in self._others
        ]  # fmt: skip

    def moves(self, frame: str) -> dict[int, np.ndarray]:
        """Return the poses of a frame in its parent, (4, 4) by their times [ns], in order; none if it never moves."""
        return dict(sorted(self._moving.get(frame.lstrip("/"), {}).items()))

    def contains(self, outer: str, frame: str) -> bool:
        """Return whether a frame stands in another one, directly or in frames between them."""
        return outer.lstrip("/") in self._chain(frame)[1:]

    def fixed_root(self, frame: str) -> str | None:
        """Return the outermost frame in which a frame stands; None if any of them moves."""
        chain = self._chain(frame)
        return None if not chain or any(name in self._moving for name in chain) else chain[-1]

    def rover(self, frame: str) -> str | None:
        """Return the frame of the rover in which a frame stands, by the names of ROVER_FRAMES; None if there is none.

        Of several with one name, it is the outermost one.
        """
        around = self._chain(frame)[1:]
        for name in ROVER_FRAMES:
            if frames := [outer for outer in around if _last(outer) == name]:
                return frames[-1]
        return None

    def world(self, frame: str) -> str | None:
        """Return the frame of the poses of a frame: the outermost one that it moves in, or `map` within that (REP 105).

        Frames of the Earth around others are passed over, since their numbers are too large for maps and clouds. None
        if the frame stands still, is not known, or moves in the rover alone, as a mast does: that is no world.
        """
        chain = self._chain(frame)
        first = next((i for i, name in enumerate(chain) if name in self._moving), len(chain))
        on_rover = max((i for i, name in enumerate(chain) if _last(name) in ROVER_FRAMES), default=-1)
        around = chain[max(first, on_rover) + 1 :]  # parts of a rover, such as the foot of its mast, are no world
        at_map = next((i for i, name in enumerate(around) if _last(name) == MAP), len(around) - 1)
        around = around[: at_map + 1]
        local = [name for name in around if _last(name) not in EARTH_FRAMES]
        return next(iter((local or around)[::-1]), None)

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
        for name in (chain := self._chain(frame)):
            if name == (chain[-1] if outer is None else outer.lstrip("/")):
                return pose
            step = self._step(name, stamp) if name in self._parent else None
            if step is None:
                return None
            pose = step @ pose
        return None

    def _chain(self, frame: str) -> list[str]:
        """Return a frame and those in which it stands, the outermost one last; none if they are a circle."""
        chain = [frame.lstrip("/")]
        while chain[-1] in self._parent:
            if len(chain) > MOST_LEVELS:
                return []
            chain.append(self._parent[chain[-1]])
        return chain

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
        turns = scipy.spatial.transform.Rotation.from_matrix([poses[first][:3, :3], poses[second][:3, :3]])
        out = np.eye(4)
        out[:3, :3] = scipy.spatial.transform.Slerp([0, 1], turns)(share).as_matrix()
        out[:3, 3] = (1 - share) * poses[first][:3, 3] + share * poses[second][:3, 3]
        return out


def _last(frame: str) -> str:
    """Return the name of a frame without its namespace."""
    return frame.rpartition("/")[2]


def _preference(parent: str) -> int:
    """Return the rank of a frame as the one in which another one stands; the lowest is kept."""
    return {ODOM: 0, MAP: 1}.get(_last(parent), 2)
