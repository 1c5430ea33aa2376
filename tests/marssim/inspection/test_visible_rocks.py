"""Rocks of known width on ground of known area; then rendered scenes, compared with the abundance asked for."""

import numpy as np
import pytest

from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.dataset.sample import StereoSample, read_sample
from marssim.base.pose import look_pose
from marssim.inspection.visible_rocks import DIAMETERS, REACH, RockCover, visible_rocks
from marssim.render.renderers.embree_renderer import EmbreeRenderer
from marssim.scene.outcrop.config import OutcropConfig
from marssim.scene.rocks.golombek import sampling_spread
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import SceneConfig, build_scene

RIG = StereoRig(PinholeCamera.centred(256, 256, 298.0), 0.27)


def rendered(depth: np.ndarray, normal: np.ndarray, rock: np.ndarray, pose: np.ndarray) -> StereoSample:
    image, nothing = np.zeros((*depth.shape, 3), np.uint8), np.zeros(depth.shape, bool)
    return StereoSample(
        image, image, depth, RIG.depth_to_disparity(depth), normal, depth < 15, nothing, rock, RIG,
        {"pose": pose.tolist()},
    )  # fmt: skip


def test_a_board_has_its_width(closed_form_set):
    sample = read_sample(closed_form_set / "scenes" / "00000" / "00")
    number, diameter, _ = visible_rocks(sample, 6.0)
    assert number.tolist() == [1] and diameter == pytest.approx([0.9], abs=0.03)
    assert len(visible_rocks(sample, 2.0)[0]) == 0  # it stands 3 m away


def test_level_ground_has_its_area():
    pose = look_pose(np.array([3.0, 1.0, 1.2]), 0.7, np.deg2rad(25))
    camera = RIG.camera
    slope = camera.rays() @ -pose[2, :3]
    depth = np.where(slope > 1e-3, 1.2 / np.where(slope > 0, slope, 1), np.inf).astype(np.float32)
    normal = np.broadcast_to((pose[:3, :3].T @ [0, 0, 1.0]).astype(np.float32), (*depth.shape, 3))
    _, _, area = visible_rocks(rendered(depth, normal, np.zeros(depth.shape, np.int32), pose), 5.0)
    # the same patch counted on the map, on a grid of 2 cm
    x, y = np.meshgrid(np.arange(-6, 6, 0.02), np.arange(-6, 6, 0.02))
    spot = np.stack([x, y, np.full_like(x, -1.2)], axis=-1) @ pose[:3, :3]
    u, v = np.moveaxis(camera.project(spot), -1, 0)
    inside = (np.abs(u - 127.5) < 128) & (np.abs(v - 127.5) < 128) & (np.hypot(x, y) <= 5)
    assert area == pytest.approx(inside.sum() * 0.02**2, rel=0.01)


def test_ground_behind_the_rover_itself_does_not_count():
    pose = look_pose(np.array([0.0, 0.0, 1.2]), 0.0, np.deg2rad(25))
    slope = RIG.camera.rays() @ -pose[2, :3]
    depth = np.where(slope > 1e-3, 1.2 / np.where(slope > 0, slope, 1), np.inf).astype(np.float32)
    normal = np.broadcast_to((pose[:3, :3].T @ [0, 0, 1.0]).astype(np.float32), (*depth.shape, 3))
    rover = np.zeros(depth.shape, np.int32)
    rover[:, :128] = -1
    nearer = np.where(rover < 0, np.float32(0.7), depth)
    _, _, whole = visible_rocks(rendered(depth, normal, np.zeros(depth.shape, np.int32), pose), 5.0)
    number, _, half = visible_rocks(rendered(nearer, normal, rover, pose), 5.0)
    assert len(number) == 0 and half == pytest.approx(whole / 2, rel=1e-3)


def test_rocks_are_about_as_wide_as_their_outlines_from_above():
    """Each rock's width from the side is compared with its diameter, which is that of its outline from above."""
    place = SceneConfig(size=16.0, horizon=24.0, rocks=RockConfig(k=0.1), outcrop=OutcropConfig(fragments=(0, 0)))
    scene = build_scene(place, np.random.default_rng(1))
    renderer = EmbreeRenderer(scene)
    measured, drawn, cover, expected = [], [], RockCover(), 0.0
    for n in range(6):
        at = np.array([2.5 * np.cos(n), 2.5 * np.sin(n)])
        pose = look_pose(np.array([*at, float(scene.terrain.height_at(*at)) + 1.6]), 0.8 * n, np.deg2rad(25))
        view = renderer.render(RIG.camera, pose)
        sample = rendered(view.depth, view.normal, np.maximum(view.surface, 0), pose)
        number, diameter, _ = visible_rocks(sample)
        measured.append(diameter)
        drawn.append(scene.rocks.diameter[number - 1])
        cover.add(sample, 0.1)
        offset = scene.rocks.centre - pose[:3, 3]
        u, v = RIG.camera.project(offset @ pose[:3, :3]).T
        in_view = (np.abs(u - 127.5) < 128) & (np.abs(v - 127.5) < 128) & (np.hypot(*offset[:, :2].T) <= REACH)
        expected += np.pi / 4 * (scene.rocks.diameter[in_view & (scene.rocks.diameter >= 0.1)] ** 2).sum()
    renderer.close()
    width, outline = np.concatenate(measured), np.concatenate(drawn)
    large = outline > 0.1
    assert large.sum() > 50
    assert np.median(width[large] / outline[large]) == pytest.approx(1, abs=0.12)
    assert (width[large] ** 2).sum() / (outline[large] ** 2).sum() == pytest.approx(1, abs=0.25)
    report = cover.report()
    assert report["seen"][0] * report["ground_m2"] == pytest.approx(expected, rel=0.2)  # also what is hidden or cut
    assert (np.diff(report["seen"]) <= 0).all() and report["asked"][0] == pytest.approx(0.1 * np.exp(-0.331), abs=1e-3)
    assert f"D {DIAMETERS[0]} m" in cover.table()
    total = sampling_spread(np.array(DIAMETERS), 0.1, report["ground_m2"])
    assert report["spread"] == pytest.approx(total.tolist())  # however the ground is parted into views
    assert f"spread {total[0]:.2%}" in cover.table()


def test_without_samples_there_is_no_report():
    assert RockCover().report() == {} and RockCover().table() == ""
