"""Drives as the viewer shows them: on the ground of their course, with its rocks."""

from dataclasses import replace

import numpy as np
import pytest

from envs.drives.episodes import EpisodeRecord
from envs.drives.shots import course_shots, ground_height, ground_surface, rock_domes

# ground that rises by 0.1 m a metre to the east, 20 m wide
SLOPE = [[round(0.1 * x, 2) for x in range(-10, 11)]] * 21
DRIVE = EpisodeRecord(
    driver="navigator", perception="sgbm", cell="k=0.1", episode=4, outcome="collision", steps=2, distance=0.5,
    start_distance=5.0, shortest=5.2, path_length=3.5, min_clearance=1.0, max_tilt_deg=4.0, reward=12.0,
    step_seconds=0.1, perception_seconds=0.0, redraws=0, goal=[5.0, 0.0], obstacles=[[2.0, 1.0, 0.8], [-3.5, 4, 2]],
    track=[[0.0, 0.0], [1.5, 0.5], [2.5, 0.0]], headings=[0.0, 0.1, 0.2], shortest_path=[[0, 0], [2, -1], [5, 0]],
    half=10.0, relief=SLOPE,
)  # fmt: skip


def test_a_course_has_one_shot_with_all_drives_over_it():
    other = replace(DRIVE, perception="m3depth", outcome="goal")
    shots = course_shots([replace(DRIVE, episode=9), DRIVE, other])
    assert [shot.name for shot in shots] == ["k=0.1, course 4", "k=0.1, course 9"]
    view = shots[0].load()
    names = [line.name for line in view.lines]
    assert names == [
        "Goal", "Shortest passable path", *["navigator, sgbm: collision"] * 2, *["navigator, m3depth: goal"] * 2,
    ]  # fmt: skip
    assert view.lines[2].colour == (209, 73, 91) and view.lines[4].colour == (42, 157, 92)
    assert "goal 5.0 m from the start, shortest path 5.2 m" in view.note and len(view.points) == 0
    footprint = view.lines[3].points
    assert np.array_equal(footprint[0], footprint[-1]) and np.allclose(footprint[:4, :2].mean(axis=0), [2.5, 0])


def test_ways_and_goal_lie_on_the_ground():
    view = course_shots([DRIVE])[0].load()
    for line in view.lines[1:]:
        assert np.allclose(line.points[:, 2], 0.1 * line.points[:, 0] + 0.25)
    assert np.allclose(view.lines[0].points[0], [5, 0, 0.75])
    surface = ground_surface(DRIVE)
    assert np.allclose(surface.vertices[:, 2], 0.1 * surface.vertices[:, 0])
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals[:, 2] > 0).all() and 0.5 * normals[:, 2].sum() == pytest.approx(20 * 20)  # all of it, facing up


def test_the_camera_looks_from_the_start_to_the_goal():
    (shot,) = course_shots([DRIVE])
    assert np.allclose(shot.pose[:3, 3], [0, 0, 1.2])
    assert np.allclose(np.cross(shot.pose[:3, 2], [5, 0, 0.5 - 1.2]), 0, atol=1e-9)
    assert shot.load().reach == 5.0


def test_rocks_are_domes_half_as_high_as_wide():
    rocks = rock_domes(DRIVE)
    halves = np.split(rocks.vertices, 2)
    for vertices, (x, y, diameter) in zip(halves, DRIVE.obstacles):
        assert np.allclose(np.ptp(vertices[:, 0]), diameter) and np.allclose(vertices[-1, :2], [x, y])
        assert np.allclose(vertices[[0, -1], 2], [0.1 * x, 0.1 * x + diameter / 2])
    assert set(np.unique(rocks.faces)) == set(range(len(rocks.vertices)))
    corners = rocks.vertices[rocks.faces]
    outward = corners.mean(axis=1) - np.repeat([[2.0, 1, 0.2], [-3.5, 4, -0.35]], len(rocks.faces) // 2, axis=0)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert ((normals * outward).sum(axis=1) > 0).all()
    assert rock_domes(replace(DRIVE, obstacles=[])) is None


def test_records_without_relief_are_level():
    old = replace(DRIVE, relief=[], headings=[], shortest_path=[], half=0.0)
    assert (ground_height(old, np.array([[1.0, 2.0]])) == 0).all()
    view = course_shots([old])[0].load()
    assert [surface.name for surface in view.surfaces] == ["Rocks that block"] and len(view.lines) == 2
