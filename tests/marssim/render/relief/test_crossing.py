"""What rays meet on the ground, compared with closed forms and with tiny steps along each ray."""

import functools
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.compute.compiled import compiled
from marssim.base.dataset.frame import GROUND
from marssim.base.pose import look_pose
from marssim.inspection.tilted_planes import BARE as BARE_LOOK
from marssim.inspection.tilted_planes import plane
from marssim.render.geometry import surface
from marssim.render.geometry.gbuffer import Footprint, GBuffer
from marssim.render.relief.height import cover_at, footprint_at, height_at, shown_at
from marssim.render.relief.stones.bodies import (
    AX,
    AY,
    BARE,
    BX,
    BY,
    CELLS,
    EAST,
    GRAVEL,
    MIDDLE,
    NORTH,
    PLANES,
    RANK,
    RISE,
    SAND_STONES,
    SHAPE,
    SIDE,
    SIZE,
    X,
    Y,
)
from marssim.render.relief.stones.hits import FLATTEST, STONE_FLAT, STONE_WHOLE
from marssim.render.renderers.by_name import make_renderer
from marssim.render.renderers.scan_renderer import ScanRenderer
from marssim.scene.outcrop.config import OutcropConfig
from marssim.scene.presets import preset
from marssim.scene.relief import ReliefConfig
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import SceneConfig, build_scene

RIG = StereoRig(PinholeCamera(160, 120, 900.0, 940.0, 71.3, 62.6), baseline=0.1)  # principal point off the middle
LAID = {
    "level": {"turn": 0.4},
    "level, rippled sand": {"layer": "ripples"},
    "tilted": {"tilt": (0.12, -0.2)},
    "tilted, without pebbles": {"tilt": (-0.1, 0.05), "radius": 0.0, "height": 0.008, "layer": "ripples"},
    "level, without ripples": {"height": 0.0},
}
VIEWS = {"down": (0.3, 60, 0.0), "slanted": (2.0, 38, 0.2), "rolled": (4.4, 45, -0.5)}  # yaw [rad], pitch [deg], roll


def pose_over(name: str, above: float = 1.0) -> np.ndarray:
    yaw, pitch, roll = VIEWS[name]
    return look_pose(np.array([0.31, -0.17, above]), yaw, np.deg2rad(pitch), roll)


@functools.cache
def views_over(laid, name: str) -> list[tuple[np.ndarray, Footprint, tuple[np.ndarray, np.ndarray, np.ndarray]]]:
    """Return pose, footprint and closed form of the two eyes of a view."""
    pose = pose_over(name)
    footprint = Footprint.from_camera(RIG.camera, pose)
    return [(eye, footprint, closed_form(laid, eye, footprint)) for eye in (pose, RIG.right_pose(pose))]


def closed_form(laid, pose: np.ndarray, footprint: Footprint) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return depth (H, W) and normal (H, W, 3), world frame, and where a view is to have them."""
    camera = RIG.camera
    shape = (camera.height, camera.width)
    rays = camera.rays().reshape(-1, 3) @ pose[:3, :3].T
    depth, normal, pebble = laid.met_by(pose[:3, 3], rays)
    points = pose[:3, 3] + depth[:, None] * rays
    away = footprint.eye - points
    distance = np.linalg.norm(away, axis=1)
    covered = distance / (footprint.focal * np.sqrt(away[:, 2] / distance))
    fine = 8 * covered < min(laid.wavelength, laid.radius or 1.0)
    inverse, pebble = 1 / depth.reshape(shape), pebble.reshape(shape)
    jump = np.zeros(shape, dtype=np.uint8)
    for across, along in ((jump, inverse), (jump.T, inverse.T)):
        kink = np.abs(along[2:] - 2 * along[1:-1] + along[:-2])
        across[1:-1] |= (kink > 0.004 * along[1:-1]).astype(np.uint8)
    clear = cv2.dilate(jump, np.ones((5, 5), np.uint8)) == 0
    return depth.reshape(shape), normal.reshape(*shape, 3), clear & fine.reshape(shape)


def even(normal: np.ndarray) -> np.ndarray:
    """Return where (H, W) the normals of the pixels beside are much the same: not where a pebble meets the ground."""
    out = np.ones(normal.shape[:2], dtype=bool)
    for axis in (0, 1):
        same = np.einsum("ijk,ijk->ij", normal, np.roll(normal, 1, axis)) > np.cos(np.deg2rad(15))
        out &= same & np.roll(same, -1, axis)
    return out


def assert_closed_form(
    view: GBuffer, pose: np.ndarray, depth: np.ndarray, normal: np.ndarray, clear: np.ndarray
) -> None:
    assert clear.mean() > 0.25
    assert (view.surface[clear] == GROUND).all()
    off = np.abs(view.depth / depth - 1)[clear]
    assert (off < 1e-4).mean() > 0.9995, f"{(off >= 1e-4).sum()} of {off.size} pixels are off, by up to {off.max():.1e}"
    smooth = clear & even(normal)
    assert smooth.mean() > 0.2
    for ours in (view.normal @ pose[:3, :3].T, view.shading_normal):
        turn = np.rad2deg(np.arccos(np.clip(np.einsum("ij,ij->i", ours[smooth], normal[smooth]), -1, 1)))
        assert (turn < 1).mean() > 0.9995, f"{(turn >= 1).sum()} normals are off, by up to {turn.max():.1f} deg"


RENDERED = [  # all places and all views by one renderer, and each layer of the relief by all of them
    *(("scan", place, ["slanted"]) for place in LAID),
    ("scan", "tilted", ["down", "rolled"]), ("scan", "level, rippled sand", ["down", "rolled"]),
    *((name, place, ["slanted"]) for name in ("embree", "pybullet") for place in ("tilted", "level, rippled sand")),
]  # fmt: skip


@pytest.mark.parametrize(("name", "place", "views"), RENDERED)
def test_pebbles_and_ripples_have_their_closed_form_in_both_eyes(monkeypatch, laid, name, place, views):
    if name == "pybullet":
        pytest.importorskip("pybullet")
    ground = laid(**LAID[place])
    monkeypatch.setattr(surface, "ground_relief", lambda scene: ground.ground())
    renderer = make_renderer(name, ground.scene())
    for view in views:
        for eye, footprint, expected in views_over(ground, view):
            assert_closed_form(renderer.render(RIG.camera, eye, footprint), eye, *expected)
    renderer.close()


def test_the_disparity_of_the_closed_form_is_f_b_over_z(monkeypatch, laid):
    """A point of the left view is found in the right one at its disparity, at its depth."""
    ground = laid(**LAID["tilted"])
    monkeypatch.setattr(surface, "ground_relief", lambda scene: ground.ground())
    renderer = ScanRenderer(ground.scene())
    pose, footprint, (depth, _, clear) = views_over(ground, "slanted")[0]
    disparity = RIG.camera.fx * RIG.baseline / depth
    assert np.allclose(RIG.depth_to_disparity(depth.astype(np.float32)), disparity, rtol=1e-6)
    rays = RIG.camera.rays() - np.stack([disparity / RIG.camera.fx, 0 * depth, 0 * depth], axis=-1)
    right = RIG.right_pose(pose)
    hits = renderer.trace(rays[clear], right, footprint)
    # what the right eye sees there is the point, or something in front of it
    expected, _, _ = ground.met_by(right[:3, 3], rays[clear] @ right[:3, :3].T)
    same = np.abs(expected / depth[clear] - 1) < 1e-6
    assert same.mean() > 0.7
    assert (np.abs(hits.depth / depth[clear] - 1)[same] < 1e-4).mean() > 0.998


@compiled
def _inside_stone(data, cover, stones, eye, focal, x, y, z, gap):
    start, member, _, stone, _, planes, octave = stones
    for n in range(len(octave)):
        cell = octave[n, SIDE]
        if cell < STONE_FLAT * footprint_at(eye, focal, x, y, z):
            continue
        i, j = math.floor((x - octave[n, EAST]) / cell), math.floor((y - octave[n, NORTH]) / cell)
        at = n * (CELLS * CELLS + 1) + (j % CELLS) * CELLS + i % CELLS
        period = CELLS * cell
        for entry in range(start[at], start[at + 1]):
            m = member[entry]
            px, py = stone[m, X] + octave[n, EAST], stone[m, Y] + octave[n, NORTH]
            px += period * math.floor((x - px) / period + 0.5)
            py += period * math.floor((y - py) / period + 0.5)
            sand, _, _, gravel, _ = cover_at(data, cover, np.float32(px), np.float32(py))
            if stone[m, RANK] > octave[n, BARE] * (1 - SAND_STONES * sand) + octave[n, GRAVEL] * gravel:
                continue
            width = footprint_at(eye, focal, px, py, z - gap)
            if stone[m, SIZE] <= STONE_FLAT * width:
                continue
            shown = shown_at(stone[m, SIZE], width, np.float32(STONE_FLAT), np.float32(STONE_WHOLE))
            share = max(shown, np.float32(FLATTEST))
            dx, dy = x - px, y - py
            u, v = stone[m, AX] * dx + stone[m, AY] * dy, stone[m, BX] * dx + stone[m, BY] * dy
            w = (gap - share * stone[m, MIDDLE]) * stone[m, RISE] / share
            inside = u * u + v * v + w * w < 1
            shape = int(stone[m, SHAPE])
            for p in range(PLANES):
                if planes[shape, p, 3] < 1:
                    side = planes[shape, p, 0] * u + planes[shape, p, 1] * v + planes[shape, p, 2] * w
                    inside = inside and side < planes[shape, p, 3]
            if inside:
                return m
    return -1


@compiled
def _march(data, relief, stones, eye, focal, origin, rays, begin, step, most):
    """Return where rays enter ground or stones first, in steps of equal length, and the stones (-1 for ground)."""
    out, who = np.full(len(rays), np.inf), np.full(len(rays), -1)
    for k in range(len(rays)):
        t = begin[k]
        for _ in range(most):
            x, y, z = origin[0] + t * rays[k, 0], origin[1] + t * rays[k, 1], origin[2] + t * rays[k, 2]
            width = footprint_at(eye, focal, x, y, z)
            gap = z - height_at(data, relief, np.float32(x), np.float32(y), width, True)[0]
            if gap < 0:
                out[k] = t
                break
            if gap < 0.09:
                m = _inside_stone(data, relief.cover, stones, eye, focal, x, y, z, gap)
                if m >= 0:
                    out[k], who[k] = t, m
                    break
            t += step
    return out, who


@functools.cache
def covered_scene(place):
    """Return a scene without rocks, of the preset gravel, with a look that has the fixed values of PLACES."""
    fixed = {name: (value, value) for name, value in PLACES[place].items()}
    base = preset("gravel")
    return build_scene(
        preset(
            "gravel", size=8.0, horizon=16.0, rocks=RockConfig(k=0.0), outcrop=OutcropConfig(fragments=(0, 0)),
            look=replace(base.look, **fixed),
        ),
        3,
    )  # fmt: skip


PLACES = {
    "gravel": {"gravel": 0.9, "wind_ripples": 0.1, "bedrock": 0.0},
    "rippled sand": {"gravel": 0.0, "wind_ripples": 0.9, "bedrock": 0.0, "texture_strength": 1.0},
    "bedrock": {"gravel": 0.0, "wind_ripples": 0.2, "bedrock": 0.8, "texture_strength": 0.8},
}


@pytest.mark.parametrize(("pitch_deg", "least"), [(60, 0.995), (25, 0.985)])
@pytest.mark.parametrize("place", PLACES)
def test_rays_meet_first_what_tiny_steps_meet_first(place, pitch_deg, least):
    """At 25 deg, a millimetre of the model of the relief decides on which side of a stone's top a ray passes."""
    scene = covered_scene(place)
    renderer, step = ScanRenderer(scene), 2e-4
    eye = np.array([0.4, -0.7, float(scene.terrain.height_at(0.4, -0.7)) + 1.0])
    pose = look_pose(eye, 0.8, np.deg2rad(pitch_deg), 0.1)
    rays = np.ones((1500, 3))
    rays[:, :2] = np.random.default_rng(0).uniform(-0.2, 0.2, (1500, 2))
    footprint = Footprint(pose[:3, 3], 600.0)
    hits = renderer.trace(rays, pose, footprint)
    assert (hits.surface == GROUND).all()
    ground = renderer._surface.ground
    begin = hits.depth - 0.25 / np.sin(np.deg2rad(pitch_deg))
    depth, stone = _march(
        ground.data, ground.relief, ground.stones, footprint.eye, footprint.focal, pose[:3, 3],
        rays @ pose[:3, :3].T, begin.astype(float), step, 20000,
    )  # fmt: skip
    off = hits.depth - (depth - step / 2)
    assert (np.abs(off) < 1e-3 + 1e-4 * depth).mean() > least, f"{np.sort(np.abs(off))[-20:]}"
    assert (hits.detail[:, 0] == stone).mean() > least - 0.04
    if place == "gravel":
        assert 0.3 < (stone >= 0).mean() < 0.95


def test_rays_over_the_brink_of_a_ditch_meet_what_tiny_steps_meet():
    """The terrain bends within a cell there, and falls away from the slope that it had before."""
    base = preset("gusev")
    none = ("texture_strength", "pebbles", "wind_ripples", "bedrock", "gravel", "drifts")
    scene = build_scene(
        replace(
            base, rocks=RockConfig(k=0.0), outcrop=OutcropConfig(fragments=(0, 0)),
            relief=replace(base.relief, ditch_density=0.004, fresh_crater_density=0.004),
            look=replace(base.look, **dict.fromkeys(none, (0.0, 0.0))),
        ),
        3,
    )  # fmt: skip
    renderer, step = ScanRenderer(scene), 5e-4
    eye = np.array([5.6, 6.0, float(scene.terrain.height_at(5.6, 6.0)) + 1.2])
    pose = look_pose(eye, np.deg2rad(120), np.deg2rad(15))
    rays = np.ones((1200, 3))
    rays[:, :2] = np.random.default_rng(0).uniform((-0.35, 0.0), (0.35, 0.25), (1200, 2))
    footprint = Footprint(eye, 600.0)
    hits = renderer.trace(rays, pose, footprint)
    ground, begin = renderer._surface.ground, np.full(len(rays), 0.9)
    depth, _ = _march(
        ground.data, ground.relief, ground.stones, eye, footprint.focal, eye, rays @ pose[:3, :3].T, begin, step, 40000
    )
    off = np.abs(hits.depth / (depth - step / 2) - 1)
    assert (off < 2e-3).mean() > 0.995, f"{(off >= 2e-3).sum()} of {off.size} rays are off: {np.sort(off)[-20:]}"


@pytest.mark.parametrize("place", PLACES)
def test_the_two_eyes_see_one_surface(place):
    """No ray of the right eye passes through a point that the left one sees."""
    scene = covered_scene(place)
    renderer = ScanRenderer(scene)
    rig = StereoRig(PinholeCamera(120, 90, 300.0, 300.0, 59.5, 44.5), baseline=0.27)
    pose = look_pose(np.array([0.4, -0.7, float(scene.terrain.height_at(0.4, -0.7)) + 1.2]), 2.0, np.deg2rad(30), 0.1)
    footprint, right = Footprint.from_camera(rig.camera, pose), rig.right_pose(pose)
    depth = renderer.render(rig.camera, pose, footprint).depth.astype(float)
    rays = rig.camera.rays() - np.stack([rig.baseline / depth, 0 * depth, 0 * depth], axis=-1)
    hits = renderer.trace(rays.reshape(-1, 3), right, footprint, sunlit=False)
    off = hits.depth / depth.ravel() - 1
    assert (off < 1e-3).mean() > 0.999 and (off < 1e-4).mean() > 0.99, f"{np.sort(off)[-20:]}"
    assert (np.abs(off) < 1e-4).mean() > 0.8  # the rest is hidden from the right eye


@pytest.mark.parametrize("place", PLACES)
def test_normals_on_ground_and_stones_face_the_eye(place):
    scene = covered_scene(place)
    camera = PinholeCamera(160, 120, 500.0, 500.0, 80.0, 60.0)
    pose = look_pose(np.array([0.4, -0.7, float(scene.terrain.height_at(0.4, -0.7)) + 1.2]), 4.0, np.deg2rad(25), 0.1)
    view = ScanRenderer(scene).render(camera, pose)
    rays = camera.rays() / np.linalg.norm(camera.rays(), axis=-1, keepdims=True)
    slant = np.einsum("ijk,ijk->ij", view.normal, rays)[view.hit]
    assert (slant < 1e-3).mean() > 0.9995 and slant.max() < 0.1


@pytest.mark.parametrize("name", ["scan", "embree", "pybullet"])
def test_true_normals_of_bare_ground_are_the_gradient_of_the_terrain(name):
    """The oracle is SciPy's cubic spline through the nodes; facets of the mesh would be off by degrees."""
    config = SceneConfig(
        size=34.0,
        horizon=24.0,
        rocks=RockConfig(k=0.0),
        look=BARE_LOOK,
        outcrop=OutcropConfig(slabs=(0, 0), ledges=(0, 0), fragments=(0, 0)),
    )
    scene = build_scene(config, 3)
    camera = PinholeCamera(256, 192, 300.0, 300.0, 127.5, 95.5)
    pose = look_pose(np.array([0.4, -0.7, float(scene.terrain.height_at(0.4, -0.7)) + 1.2]), 1.0, np.deg2rad(15), 0.1)
    renderer = make_renderer(name, scene)
    try:
        view = renderer.render(camera, pose, Footprint.from_camera(camera, pose))
    finally:
        renderer.close()
    near = view.hit & (view.depth < 15)
    assert near.mean() > 0.5 and view.depth[near].max() > 12
    x, y, _ = ((camera.unproject(view.depth)[near] @ pose[:3, :3].T) + pose[:3, 3]).T
    step, heights = 1e-3, scene.terrain.fine.smooth_heights
    slopes = [
        (heights(x + step * dx, y + step * dy) - heights(x - step * dx, y - step * dy)) / (2 * step)
        for dx, dy in ((1, 0), (0, 1))
    ]
    up = np.stack([-slopes[0], -slopes[1], np.ones_like(x)], axis=1)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    seen = view.normal[near] @ pose[:3, :3].T
    off = np.rad2deg(np.arccos(np.clip(np.einsum("ij,ij->i", seen, up), -1, 1)))
    assert np.sqrt(np.mean(off**2)) < 0.3
    assert np.rad2deg(np.arccos(up[:, 2])).std() > 1  # the ground is not a plane


def test_no_sky_shows_between_far_hills():
    """A ray that passes the crest of one hill meets the next one, however low it rises behind the first."""
    bare = OutcropConfig(slabs=(0, 0), ledges=(0, 0), fragments=(0, 0))
    relief = ReliefConfig(hurst=0.73, rms_slope_deg=5.1)
    scene = build_scene(SceneConfig(size=8.0, rocks=RockConfig(k=0.0), relief=relief, outcrop=bare), 1)
    renderer = ScanRenderer(scene)
    camera = PinholeCamera(512, 160, 1200.0, 1200.0, 255.5, 79.5)
    for yaw in (0.0, 1.6, 2.4):
        height = float(scene.terrain.height_at(0.0, 0.0)) + 1.2
        pose = look_pose(np.array([0.0, 0.0, height]), yaw, np.deg2rad(1.5), 0.0)
        hit = renderer.render(camera, pose, Footprint.from_camera(camera, pose)).hit
        assert 0.1 < hit.mean() < 0.9
        assert not (~hit[1:-1] & hit[:-2] & hit[2:]).any()


def test_rays_of_an_image_meet_what_single_rays_meet():
    """They begin later; what lies between two columns may then be missed in a few of 1000 pixels."""
    scene = covered_scene(next(iter(PLACES)))
    renderer = ScanRenderer(scene)
    camera = PinholeCamera(256, 192, 400.0, 400.0, 127.5, 95.5)
    pose = look_pose(np.array([0.4, -0.7, float(scene.terrain.height_at(0.4, -0.7)) + 1.2]), 2.0, np.deg2rad(25), 0.1)
    footprint = Footprint.from_camera(camera, pose)
    drawn = renderer.render(camera, pose, footprint).depth.ravel()
    single = renderer.trace(camera.rays().reshape(-1, 3), pose, footprint).depth
    assert (np.abs(drawn / single - 1) < 1e-3).mean() > 0.999


def test_a_ray_that_begins_before_at_or_behind_the_ground_meets_it():
    renderer = ScanRenderer(plane(np.zeros(2)))
    pose = look_pose(np.array([0.0, 0.0, 1.0]), 0.0, np.pi / 2)
    ray, footprint = np.array([[0.0, 0.0, 1.0]]), Footprint(pose[:3, 3], 500.0)
    for begin in (0.0, 0.9, 1.0, 1.001):
        assert renderer.trace_ground(ray, pose, np.array([begin]), footprint).depth == pytest.approx([1.0], abs=1e-4)
