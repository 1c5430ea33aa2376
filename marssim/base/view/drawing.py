"""Draws shots into the scene of `viser`: cloud, cameras, the path through them, lines and surfaces.

What is drawn belongs to a group, which is shown or hidden as a whole.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np
import scipy

from marssim.base.camera import StereoRig
from marssim.base.view.placing import reach_of
from marssim.base.view.scene import Layer, Shot, View

THUMBNAIL = 400  # [px] width of the image in a frustum
FRUSTUM = 0.06  # size of the current frustum, as a share of the depth that is looked at
MOST_CAMERAS = 100  # frusta of other shots
LEFT, RIGHT, OTHER, PATH = (214, 96, 38), (60, 110, 190), (130, 130, 130), (40, 40, 40)  # colours
THICKNESS = 3.0  # [px] of lines


class Drawing:
    """Draws into the scene of a server of viser.

    Args:
        scene: The scene.
    """

    def __init__(self, scene: Any) -> None:
        self.scene = scene
        self._groups: dict[str, Any] = {}
        self._path: list[Any] = []
        self._parts: list[Any] = []
        self._cloud: Any = None

    def group(self, name: str) -> Any:
        """Return the node of a group, whose `visible` shows or hides all that is in it."""
        if name not in self._groups:
            self._groups[name] = self.scene.add_frame(f"/{name}", show_axes=False)
        return self._groups[name]

    def draw_cloud(self, view: View, layer: Layer, pose: np.ndarray, size: float) -> None:
        """Replace the cloud.

        Args:
            view: Holds the points; without any there is no cloud.
            layer: Their colours.
            pose: (4, 4) left camera to world.
            size: Size of a point [m].
        """
        self.remove_cloud()
        if not len(view.points):
            return  # browsers warn of empty clouds
        self.group("Cloud")
        self._cloud = self.scene.add_point_cloud(
            "/Cloud/points", view.points, layer.colours, point_size=size, point_shape="circle", point_shading="flat",
            precision="float32", **_placed(pose),
        )  # fmt: skip

    def remove_cloud(self) -> None:
        """Remove the cloud if there is one."""
        if self._cloud is not None:
            self._cloud.remove()
        self._cloud = None

    def recolour(self, layer: Layer) -> None:
        """Give the points of the cloud, if there is one, other colours."""
        if self._cloud is not None:
            self._cloud.colors = layer.colours

    def resize(self, size: float) -> None:
        """Give the points of the cloud, if there is one, another size [m]."""
        if self._cloud is not None:
            self._cloud.point_size = size

    def draw_cameras(self, view: View, pose: np.ndarray) -> None:
        """Replace the two cameras; the left one has its image.

        Args:
            view: Holds the cameras.
            pose: (4, 4) left camera to world.
        """
        self.group("Cameras")
        shape = _frustum(view.rig, FRUSTUM * reach_of(view))
        image = None if view.image is None else _thumbnail(view.image)
        right = _placed(view.rig.right_pose(pose))
        self.scene.add_camera_frustum("/Cameras/right", color=RIGHT, **shape, **right)
        self.scene.add_camera_frustum("/Cameras/left", color=LEFT, image=image, **shape, **_placed(pose))

    def draw_path(self, shots: Sequence[Shot], numbers: Sequence[int], view: View, go: Callable[[int], None]) -> None:
        """Replace the path: a line through the cameras of some shots, and a frustum at each.

        Args:
            shots: All shots.
            numbers: Which of them the path leads through; of more than 100, not all have a frustum.
            view: Of one of them, which sets the size of the frusta.
            go: Called with the number of a shot whose frustum is clicked.
        """
        for handle in self._path:
            handle.remove()
        self._path = []
        if len(numbers) < 2:
            return
        self.group("Path")
        places = np.array([shots[number].pose[:3, 3] for number in numbers])
        self._path.append(self._line("/Path/line", places, PATH))
        shape = _frustum(view.rig, FRUSTUM / 2 * reach_of(view))
        some = np.linspace(0, len(numbers) - 1, min(len(numbers), MOST_CAMERAS)).round().astype(int)
        for number in (numbers[i] for i in some):
            frustum = self.scene.add_camera_frustum(
                f"/Path/{number}", color=OTHER, **shape, **_placed(shots[number].pose)
            )
            frustum.on_click(lambda _, number=number: go(number))
            self._path.append(frustum)

    def draw_parts(self, view: View) -> None:
        """Replace lines and surfaces, each of which is in the group of its name."""
        import trimesh  # not at the top, since it loads Embree

        for handle in self._parts:
            handle.remove()
        self._parts = []
        for part in view.parts:
            self.group(part.name)
        for number, line in enumerate(view.lines):
            self._parts.append(self._line(f"/{line.name}/line{number}", line.points, line.colour))
        for number, surface in enumerate(view.surfaces):
            colours = linear_colours(surface.colours)
            mesh = trimesh.Trimesh(surface.vertices, surface.faces, vertex_colors=colours, process=False)
            node = f"/{surface.name}/surface{number}"
            self._parts.append(self.scene.add_mesh_trimesh(node, mesh, cast_shadow=False, receive_shadow=False))

    def _line(self, node: str, points: np.ndarray, colour: tuple[int, int, int]) -> Any:
        pieces = np.stack([points[:-1], points[1:]], axis=1)
        return self.scene.add_line_segments(node, pieces, colour, thickness=THICKNESS, thickness_units="screen")


def linear_colours(colours: np.ndarray) -> np.ndarray:
    """Return sRGB colours (..., 3) uint8 as linear ones, uint8 (IEC 61966-2-1).

    Meshes go to the browser as glTF, in which the colours of vertices are linear.
    """
    share = colours / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.round(255 * linear).astype(np.uint8))


def _placed(pose: np.ndarray) -> dict[str, Any]:
    """Return where viser places a node: its rotation as quaternion (w, x, y, z), and its position [m]."""
    return {
        "wxyz": np.roll(scipy.spatial.transform.Rotation.from_matrix(pose[:3, :3]).as_quat(), 1),
        "position": pose[:3, 3],
    }


def _frustum(rig: StereoRig, scale: float) -> dict[str, Any]:
    """Return the shape of a frustum."""
    camera = rig.camera
    return {
        "fov": camera.fov[1], "aspect": np.tan(camera.fov[0] / 2) / np.tan(camera.fov[1] / 2),
        "scale": scale, "thickness": 2.0, "thickness_units": "screen",
    }  # fmt: skip


def _thumbnail(image: np.ndarray) -> np.ndarray:
    """Return an image at no more than THUMBNAIL px of width."""
    width = min(THUMBNAIL, image.shape[1])
    height = max(1, round(image.shape[0] * width / image.shape[1]))
    return cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
