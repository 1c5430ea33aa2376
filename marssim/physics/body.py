"""The rover's visible body: every link as a few boxes and cylinders, to draw the rover from outside."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from marssim.base.rover_spec import RoverSpec
from marssim.physics.linkage import AXLES, SIDES, Joints, Linkage

if TYPE_CHECKING:  # a third of the start of a drive, and only pictures from outside need it
    import trimesh

BEAM = 0.05  # [m] diameter of rockers, bogies and the mast
GOLD, GREY, DARK, WHITE, PANEL = (196, 160, 84), (150, 150, 152), (48, 48, 50), (226, 224, 218), (32, 40, 74)
Colour = tuple[int, int, int]


@dataclass(frozen=True)
class Part:
    """A rigid part of the rover.

    Attributes:
        vertices: (V, 3) in the part's frame [m].
        faces: (F, 3), counter-clockwise seen from outside.
        colour: RGB, 0 to 255.
        pose: (4, 4) part to world.
    """

    vertices: np.ndarray
    faces: np.ndarray
    colour: Colour
    pose: np.ndarray


def rover_parts(spec: RoverSpec, pose: np.ndarray, joints: Joints, pan: float = 0.0) -> list[Part]:
    """Return all parts of a rover in the world.

    Args:
        spec: The rover.
        pose: (4, 4) body to world.
        joints: Angles of its joints.
        pan: Pan of the mast [rad], positive to the left.
    """
    links = _linkage(spec).link_poses(pose, joints)
    c, s = np.cos(pan), np.sin(pan)
    links["head"] = pose @ np.array(
        [[c, -s, 0, spec.mount.x], [s, c, 0, 0], [0, 0, 1, spec.mount.height], [0, 0, 0, 1]]
    )
    return [Part(v, f, colour, links[link]) for link, v, f, colour in _pieces(spec)]


@lru_cache(maxsize=8)
def _linkage(spec: RoverSpec) -> Linkage:
    return Linkage.from_spec(spec)


@lru_cache(maxsize=8)
def _pieces(spec: RoverSpec) -> list[tuple[str, np.ndarray, np.ndarray, Colour]]:
    """Return for each part its link, its vertices (V, 3) in the link's frame, its faces and its colour."""
    linkage = _linkage(spec)
    length, width, height = spec.chassis_size
    deck = spec.belly_clearance + height
    out = [
        ("chassis", _box((0, 0, spec.belly_clearance + height / 2), spec.chassis_size), GOLD),
        ("chassis", _box((0, 0, deck + 0.01), (length, width, 0.02)), WHITE),
        ("chassis", _beam((spec.mount.x - 0.15, 0, deck), (spec.mount.x, 0, spec.mount.height - 0.08)), GREY),
        ("head", _box((-0.05, 0, 0), (0.12, 0.40, 0.12)), WHITE),
        *(("head", _cylinder((0.02, y, 0), "x", 0.03, 0.06), DARK) for y in (-0.135, 0.135)),
    ]
    for sign in (1, -1):  # the solar panels, folded up against the sides
        panel = _box((-0.05, sign * (width / 2 + 0.02), deck + 0.16), (length * 0.95, 0.02, 0.36))
        out.append(("chassis", panel, PANEL))
    for s, side in enumerate(SIDES):
        rocker, bogie = linkage.rocker[s], linkage.bogie[s]
        for a, axle in enumerate(AXLES):
            hub = linkage.hubs[2 * a + s]
            carrier, origin = linkage.carrier(axle, s)
            inner = hub * (1, 0, 1) + (0, origin[1], spec.wheel_radius + 0.09)  # above the wheel, in the beam's plane
            out.append((carrier, _beam((0, 0, 0), inner - origin), GREY))
            out.append((carrier, _beam(inner - origin, hub - origin + (0, 0, spec.wheel_radius + 0.09)), GREY))
            fork = _beam((0, 0, spec.wheel_radius + 0.09), (0, 0, spec.wheel_radius + 0.02))
            out.append((f"steer_{axle}_{side}", fork, DARK))
            out.append((f"wheel_{axle}_{side}", _wheel(spec), DARK))
            out.append((f"wheel_{axle}_{side}", _cylinder((0, 0, 0), "y", 0.05, spec.wheel_width + 0.02), GREY))
        out.append((f"rocker_{side}", _beam((0, 0, 0), bogie - rocker), GREY))
    return [(link, np.asarray(m.vertices, float), np.asarray(m.faces, np.int32), colour) for link, m, colour in out]


def _box(centre, size) -> trimesh.Trimesh:
    import trimesh

    return trimesh.creation.box(extents=size, transform=trimesh.transformations.translation_matrix(centre))


def _beam(start, end) -> trimesh.Trimesh:
    import trimesh

    return trimesh.creation.cylinder(radius=BEAM / 2, segment=np.array([start, end], dtype=float), sections=10)


def _cylinder(centre, axis: str, radius: float, length: float) -> trimesh.Trimesh:
    import trimesh

    half = np.eye(3)["xyz".index(axis)] * length / 2
    return trimesh.creation.cylinder(radius=radius, segment=np.array([centre - half, centre + half]), sections=24)


def _wheel(spec: RoverSpec) -> trimesh.Trimesh:
    """Return a rim with grousers, which make its rotation visible."""
    import trimesh

    pieces = [_cylinder((0, 0, 0), "y", spec.wheel_radius - 0.008, spec.wheel_width)]
    for angle in np.arange(18) * 2 * np.pi / 18:
        turn = trimesh.transformations.rotation_matrix(angle, (0, 1, 0))
        bar = _box((spec.wheel_radius - 0.008, 0, 0), (0.016, spec.wheel_width, 0.008))
        pieces.append(bar.apply_transform(turn))
    rim = trimesh.util.concatenate(pieces)
    assert isinstance(rim, trimesh.Trimesh)
    return rim
