"""Files of recorded drives, made by hand."""

import cv2
import numpy as np

from marssim.base.camera import NATECAM
from marssim.base.dataset.drive_file import DriveFile, depth_codes, encode_drive, picture_name, read_drive
from marssim.base.files.png import encode_png

RIG = NATECAM.resized(8, 8)
PARTS = ("way", "ground", "onward", "heading", "bend", "change", "turn", "unseen")


def pose_rows(x, y, yaw):
    c, s = float(np.cos(yaw)), float(np.sin(yaw))
    return [[c, -s, 0.0, float(x)], [s, c, 0.0, float(y)], [0.0, 0.0, 1.0, 0.0]]


def candidates(*motions):
    """Motions (curvature, turn, free length, cost), whose costs are all of the way onward."""
    curvature, turn, free, cost = ([float(v) if v is not None else None for v in column] for column in zip(*motions))
    parts = {name: [0.0] * len(cost) for name in PARTS} | {"onward": [value or 0.0 for value in cost]}
    return {"curvature": curvature, "turn": turn, "free": free, "end": free, "cost": cost, "parts": parts}


def step(x=0.0, y=0.0, yaw=0.0, goal=(9.0, 0.0), **changes):
    return {
        "pose": pose_rows(x, y, yaw), "believed_pose": pose_rows(x, y, yaw), "tilt_deg": 1.0,
        "distance": float(np.hypot(goal[0] - x, goal[1] - y)), "way": abs(float(x)), "clearance": 3.0,
        "contact": "none", "pan": 0.0, "looked": False, "abs_rel": None, "outcome": "driving", "action": [1.0, 0.0],
        "command": None, "status": None, "reason": None, "risk_level": 0, "map": None, "path": None,
        "candidates": None, "chosen": None, **changes,
    }  # fmt: skip


def content(steps, outcome="goal", rig=RIG, goal=(9.0, 0.0), **changes):
    episode = {
        "driver": "navigator", "perception": "sgbm", "cell": "k=0.1, slope=0", "episode": 3, "outcome": outcome,
        "steps": len(steps) - 1, "start_distance": 9.0, "shortest": 9.2, "path_length": 9.5, "goal": list(goal),
        "obstacles": [[4.0, 0.5, 0.8]], "shortest_path": [[0.0, 0.0], [9.0, 0.0]],
    }  # fmt: skip
    return {
        "episode": episode, "settings": {"seed": 0}, "step_seconds": 2.0, "rover": {"length": 1.6, "width": 1.4},
        "rig": rig.to_dict(), "steps": steps, **changes,
    }  # fmt: skip


def look_pictures(n, depth):
    """The pictures of a look that showed a depth (H, W) [m], with full confidence."""
    grey = cv2.imencode(".jpg", np.full((8, 8, 3), 120, np.uint8))[1].tobytes()
    return {
        picture_name("left", n): grey, picture_name("right", n): grey,
        picture_name("depth", n): encode_png(depth_codes(depth)),
        picture_name("confidence", n): encode_png(np.full(depth.shape, 255, np.uint8)),
    }  # fmt: skip


def drive_bytes():
    """A file of two steps with one look."""
    steps = [
        step(looked=True, candidates=candidates((0, 0, 4, 9), (0.5, 0, 0.2, None)), chosen=0),
        step(x=9.0, outcome="goal"),
    ]
    return encode_drive(content(steps), look_pictures(0, np.full((8, 8), 3.0)))


def drive_of(path, steps, pictures=None, **changes) -> DriveFile:
    """Write a drive to a file, and read it."""
    path.write_bytes(encode_drive(content(steps, **changes), pictures or {}))
    return read_drive(path)
