"""What a page shows: shots of a rig, each with a cloud, lines and surfaces.

A shot is read when the page comes to it, so that a sequence of any length opens at once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from marssim.base.camera import StereoRig


@dataclass(frozen=True)
class Layer:
    """Colours of a cloud.

    Attributes:
        colours: (N, 3) uint8 RGB, one a point.
        legend: What they mean, in a line.
    """

    colours: np.ndarray
    legend: str


@dataclass(frozen=True)
class Line:
    """A line in the world.

    Attributes:
        name: What it is; the page has a checkbox of this name.
        points: (K, 3) corners [m], world frame.
        colour: RGB, 0 to 255.
    """

    name: str
    points: np.ndarray
    colour: tuple[int, int, int]


@dataclass(frozen=True)
class Surface:
    """A surface of triangles in the world.

    Attributes:
        name: What it is; the page has a checkbox of this name.
        vertices: (V, 3) [m], world frame.
        faces: (F, 3) indices of vertices, at least one face.
        colours: (V, 3) uint8 RGB of the vertices.
    """

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    colours: np.ndarray


@dataclass(frozen=True)
class View:
    """What one shot shows.

    Attributes:
        rig: The cameras.
        image: (H, W, 3) uint8 RGB left image, or None.
        points: (N, 3) float32 [m] in the left camera's frame: x right, y down, z forward; may be none.
        layers: Colours of the points, by the name of the choice; the first is shown first. Without
            points there may be none.
        lines: Lines in the world.
        surfaces: Surfaces in the world.
        note: More about the shot, in a line.
        reach: Distance [m] at which the viewer looks at first; None: the median depth of the points.
    """

    rig: StereoRig
    image: np.ndarray | None
    points: np.ndarray
    layers: Mapping[str, Layer]
    lines: tuple[Line, ...] = ()
    surfaces: tuple[Surface, ...] = ()
    note: str = ""
    reach: float | None = None

    @property
    def parts(self) -> tuple[Line | Surface, ...]:
        """Lines and surfaces."""
        return *self.lines, *self.surfaces


@dataclass(frozen=True)
class Shot:
    """One place on the page's slider.

    Attributes:
        name: Its name.
        pose: (4, 4) left camera to world; z is up.
        load: Reads what the shot shows. It raises ValueError or OSError for files that cannot be read.
        world: Shots of one world are shown together: all their cameras, and the path through them.
    """

    name: str
    pose: np.ndarray
    load: Callable[[], View]
    world: str = ""
