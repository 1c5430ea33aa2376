"""Shapes are closed and turned outwards, so that they cast shadows."""

import numpy as np
import pytest
import trimesh

from marssim.render.own_rover import body
from marssim.render.own_rover.shapes import beam, box, disc, prism

SHAPES = {
    "prism": (prism(np.array([(0, 0), (2, 0), (1, 1)]), 0.5, 2.0, 0), 1.5),
    "box": (box((0, 0, 0), (1, 2, 3), 0), 6.0),
    "disc": (disc(1.0, 0.5, 0), 0.5 * 8 * np.sin(np.pi / 8)),
    "beam": (beam(np.array([1.0, 2, 3]), np.array([1.0, 4, 3]), 0.1, 0), 0.02),
    "upright beam": (beam(np.zeros(3), np.array([0, 0, 2.0]), 0.1, 0), 0.02),
}


@pytest.mark.parametrize("name", SHAPES)
def test_a_shape_encloses_its_volume(name):
    shape, volume = SHAPES[name]
    mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(volume)


def test_every_part_of_the_rover_is_closed_and_turned_outwards():
    for part in body._fixed_parts():
        mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
        assert mesh.is_watertight and mesh.volume > 0
