from types import SimpleNamespace

import numpy as np

from marssim.base.camera import NATECAM
from marssim.base.view.drawing import Drawing, linear_colours
from marssim.base.view.scene import Surface, View


def test_the_browser_shows_surfaces_in_their_own_colours():
    """It takes the colours of a mesh's vertices for linear ones: 50 % of the light is the grey 188."""
    meshes = []
    scene = SimpleNamespace(
        add_frame=lambda name, show_axes: SimpleNamespace(),
        add_mesh_trimesh=lambda node, mesh, **_: meshes.append(mesh),
    )
    colours = np.array([[0, 188, 255], [188, 188, 188], [255, 0, 10]], np.uint8)
    patch = Surface("Map", np.array([[2.0, 0, 0], [3, 0, 0], [3, 1, 0]]), np.array([[0, 1, 2]]), colours)
    Drawing(scene).draw_parts(View(NATECAM, None, np.zeros((0, 3)), {}, (), (patch,)))
    assert meshes[0].visual.vertex_colors[:, :3].tolist() == [[0, 128, 255], [128, 128, 128], [255, 0, 1]]


def test_colours_keep_their_order():
    grey = linear_colours(np.arange(256, dtype=np.uint8))
    assert (np.diff(grey.astype(int)) >= 0).all() and grey[0] == 0 and grey[255] == 255
