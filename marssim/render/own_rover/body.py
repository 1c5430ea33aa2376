"""The rover as triangles: deck, four solar wings, mast with the camera bar, wheels and legs.

It is modelled by eye after pictures of Zhurong, with the dimensions of marssim.base.rover_spec. The wings are unfolded:
3.0 m wide, 2.4 m long, 0.8 m above ground.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from marssim.base.dataset.frame import ROVER
from marssim.base.pose import moved
from marssim.base.rover_spec import ZHURONG
from marssim.render.geometry.mesh import SceneMesh
from marssim.render.own_rover.materials import DARK, DECK, FOIL, FRAME, METAL, PANEL
from marssim.render.own_rover.shapes import Shape, beam, box, disc, prism

SPEC = ZHURONG
DECK_TOP = SPEC.belly_clearance + SPEC.chassis_size[2]  # [m]
WING_HEIGHT = 0.80  # [m] upper side of the wings, over level ground
WING_THICKNESS = 0.02  # [m]
# corners x, y of the left front and left rear wing [m], counter-clockwise from above
FRONT_WING = np.array([(-0.30, 0.44), (0.50, 0.44), (0.38, 1.50), (-0.30, 1.50)])
REAR_WING = np.array([(-1.85, 0.10), (-0.62, 0.04), (-0.36, 1.42), (-1.50, 1.10)])
FRAME_WIDTH = 0.025  # [m] of the frames around the wings
BAR = (0.07, 0.05, 0.12, 0.03)  # [m] how far the camera bar reaches beside, above and behind the cameras; gap to them


class RoverBody:
    """The triangles of the rover below a pair of cameras.

    Attributes:
        mesh: The triangles in the world frame, one piece for each part. Their surface is ROVER.
        material: (F,) int material of each face.
        pose: (4, 4) body to world.
    """

    def __init__(self, pose: np.ndarray, camera_pose: np.ndarray, baseline: float) -> None:
        """Build the rover.

        Args:
            pose: (4, 4) body (x forward, y left, z up) to world.
            camera_pose: (4, 4) left camera to world.
            baseline: Distance between the cameras [m].
        """
        beside, above, behind, gap = BAR
        bar = box((-beside, -above, -behind), (baseline + beside, above, -gap), DECK)
        foot = bar.moved(camera_pose).vertices.mean(axis=0)
        mast = SPEC.mount
        pole = [(mast.x - 0.13, 0.0, DECK_TOP), (mast.x, 0.0, mast.height - 0.1)]  # its top lies on the axis of the pan
        world = [moved(np.array(point), pose) for point in pole]
        parts = [part.moved(pose) for part in _fixed_parts()]
        parts += [beam(world[0], world[1], 0.07, DECK), beam(world[1], foot, 0.06, DECK), bar.moved(camera_pose)]
        self.pose = pose
        self.mesh = _joined(parts)
        self.material = np.concatenate([np.full(len(part.faces), part.material) for part in parts])


@cache
def _fixed_parts() -> tuple[Shape, ...]:
    """Return the parts that are fixed to the body, body frame."""
    length, width, _ = SPEC.chassis_size
    x, y, low = length / 2, width / 2, SPEC.belly_clearance
    parts = [
        box((-x, -y, low), (x, y, DECK_TOP - 0.02), FOIL),
        box((-x - 0.01, -y - 0.01, DECK_TOP - 0.02), (x + 0.01, y + 0.01, DECK_TOP), DECK),
        box((-0.50, -0.34, DECK_TOP), (-0.22, -0.06, DECK_TOP + 0.07), FOIL),
        box((-0.46, 0.10, DECK_TOP), (-0.30, 0.30, DECK_TOP + 0.12), DECK),
    ]
    for side in (0.18, -0.18):  # the two windows that collect heat
        parts += [_at(disc(0.15, 0.03, FRAME), (0.16, side, DECK_TOP + 0.015))]
        parts += [_at(disc(0.125, 0.01, DARK), (0.16, side, DECK_TOP + 0.035))]
    for side in (1, -1):
        for outline in (FRONT_WING, REAR_WING):
            parts += _wing(outline * [1, side] if side > 0 else (outline * [1, side])[::-1])
        parts += _running_gear(side)
    return tuple(parts)


def _wing(outline: np.ndarray) -> list[Shape]:
    """Return a wing with a raised frame along its sides."""
    middle = outline.mean(axis=0)
    inner = middle + (outline - middle) * (1 - FRAME_WIDTH / np.linalg.norm(outline - middle, axis=1, keepdims=True))
    parts = [prism(outline, WING_HEIGHT - WING_THICKNESS, WING_HEIGHT, PANEL)]
    for k in range(len(outline)):
        after = (k + 1) % len(outline)
        strip = np.array([outline[k], outline[after], inner[after], inner[k]])
        parts.append(prism(strip, WING_HEIGHT, WING_HEIGHT + 0.006, FRAME))
    return parts


def _running_gear(side: int) -> list[Shape]:
    """Return the wheels and legs of one side: 1 is left, -1 right."""
    upright = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # z axis to -y
    parts = []
    across = SPEC.track / 2 * side
    joint = np.array([0.1, (SPEC.chassis_size[1] / 2 + 0.03) * side, 0.5])
    for x in SPEC.wheel_x:
        hub = np.array([x, across, SPEC.wheel_radius])
        parts.append(_at(disc(SPEC.wheel_radius, SPEC.wheel_width, METAL).moved(upright), tuple(hub)))
        knee = np.array([x, joint[1], 0.42])
        parts += [beam(joint, knee, 0.05, DARK), beam(knee, hub, 0.05, DARK)]
    return parts


def _at(shape: Shape, place: tuple[float, ...]) -> Shape:
    pose = np.eye(4)
    pose[:3, 3] = place
    return shape.moved(pose)


def _joined(parts: list[Shape]) -> SceneMesh:
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    vertices = np.concatenate([part.vertices for part in parts])
    faces = np.concatenate([part.faces + np.int32(start) for part, start in zip(parts, first)]).astype(np.int32)
    return SceneMesh(
        vertices=vertices, faces=faces, surface=np.full(len(faces), ROVER, dtype=np.int32),
        vertex_normals=np.zeros((len(vertices), 3), dtype=np.float32),
        start=np.cumsum([0, *(len(part.faces) for part in parts)]).astype(np.int64),
        low=np.array([part.vertices.min(axis=0) for part in parts]),
        high=np.array([part.vertices.max(axis=0) for part in parts]),
    )  # fmt: skip
