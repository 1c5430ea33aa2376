"""The two images of a pair, compared with the ground truth."""

from dataclasses import fields, replace

import cv2
import numpy as np
import pytest

from marssim.base.camera import NATECAM
from marssim.base.dataset.frame import SKY, StereoFrame
from marssim.base.pose import look_pose
from marssim.render import stereo
from marssim.render.geometry.gbuffer import Footprint
from marssim.render.renderers.by_name import make_renderer
from marssim.render.renderers.embree_renderer import EmbreeRenderer
from marssim.render.sensor import Sensor
from marssim.render.stereo import radiance, render_stereo
from marssim.render.surfaces.shading import Shader
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import Scene, SceneConfig, build_scene

RIG = NATECAM.resized(160, 160)
CLEAN = Sensor(exposure=0.5, psf=0.0, full_well=1e12, read_noise=0.0, vignetting=0.0, gain_difference=0.0)
BELOW = np.array([[0, -1, 0, 0], [0, 0, -1, 1.2], [1, 0, 0, -0.3], [0, 0, 0, 1.0]])  # body to camera
NOISY = replace(CLEAN, full_well=4000.0, read_noise=14.0)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene(SceneConfig(size=10.0, horizon=20.0, rocks=RockConfig(k=0.1)), np.random.default_rng(11))


@pytest.fixture(scope="module")
def renderer(scene):
    renderer = EmbreeRenderer(scene)
    yield renderer
    renderer.close()


@pytest.fixture(scope="module")
def pose(scene) -> np.ndarray:
    height = float(scene.terrain.height_at(np.array(-1.0), np.array(0.5)))
    return look_pose(np.array([-1.0, 0.5, height + 1.2]), 0.9, np.deg2rad(18), 0.06)


def pair(scene, renderer, pose, sensor=CLEAN, seed=0) -> StereoFrame:
    return render_stereo(renderer, Shader(scene), RIG, pose, sensor, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def frame(scene, renderer, pose) -> StereoFrame:
    return pair(scene, renderer, pose)


def test_imperfect_rectification_shows_in_the_right_image_alone(scene, renderer, pose, frame):
    other = pair(scene, renderer, pose, replace(CLEAN, vertical_offset=1.0, rotation_deg=0.05))
    for name in ("left", "depth", "normal", "surface"):
        assert np.array_equal(getattr(other, name), getattr(frame, name))
    shifts = []
    for down in (0, 1, 2):
        moved = np.roll(frame.right, down, axis=0).astype(float)
        shifts.append(np.abs(moved - other.right)[4:-4, 4:-4].mean())
    assert shifts[1] < 0.6 * shifts[0] and shifts[1] < 0.6 * shifts[2]


@pytest.mark.parametrize("name", ["scan", "embree", "pybullet"])
def test_both_eyes_at_once_give_the_same_frame(scene, pose, name):
    opened, shader, frames = make_renderer(name, scene), Shader(scene), []
    for at_once in (True, False):  # the first one of them builds PyBullet's bodies
        frames.append(
            render_stereo(opened, shader, RIG, pose, NOISY, np.random.default_rng(3), pose @ BELOW, at_once=at_once)
        )
    opened.close()
    for field in fields(StereoFrame):
        both, one = (getattr(frame, field.name) for frame in frames)
        assert both is one or np.array_equal(both, one), field.name


def test_a_fault_in_one_eye_reaches_the_caller(scene, renderer, pose):
    class Blind:
        def __init__(self) -> None:
            self.looks = 0

        def render(self, *args):
            self.looks += 1
            if self.looks == 2:
                raise RuntimeError("no second look")
            return renderer.render(*args)

        def __getattr__(self, name):
            return getattr(renderer, name)

    with pytest.raises(RuntimeError, match="no second look"):
        render_stereo(Blind(), Shader(scene), RIG, pose, CLEAN, np.random.default_rng(0), at_once=True)


def warped(frame: StereoFrame, step: float = 0.0) -> np.ndarray:
    """The right image as the left eye would see it, if the disparity were larger by a step [px]; borders repeated.

    The rows are those in which the right camera, which may be turned, sees the points.
    """
    u = np.indices(frame.depth.shape, dtype=np.float32)[1] - frame.disparity - step
    points = RIG.camera.unproject(np.where(frame.surface == SKY, 1e3, frame.depth)) - [RIG.baseline, 0, 0]
    v = RIG.camera.project(points @ frame.right_rotation)[..., 1].astype(np.float32)
    return cv2.remap(frame.right.astype(np.float32), u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


def comparable(frame: StereoFrame) -> np.ndarray:
    """(H, W) bool: seen by both eyes, and two pixels off every edge of depth and every occlusion."""
    inverse = frame.disparity
    kernel = np.ones((5, 5), np.uint8)
    step = cv2.dilate(inverse, kernel) - cv2.erode(inverse, kernel) > 0.15 * inverse + 0.5
    hidden = cv2.dilate((frame.occluded | (frame.surface == SKY)).astype(np.uint8), kernel) > 0
    ids = frame.surface.astype(np.float32)
    edge = cv2.dilate(ids, kernel) != cv2.erode(ids, kernel)
    inside = np.arange(RIG.camera.width) - frame.disparity >= 2
    return ~step & ~hidden & ~edge & inside


@pytest.mark.parametrize("residual", [{}, {"horizontal_offset": 2.5}, {"horizontal_offset": -1.5, "rotation_deg": 0.4}])
def test_the_right_image_moved_by_the_disparity_is_the_left_one(scene, renderer, pose, residual):
    frame = pair(scene, renderer, pose, replace(CLEAN, **residual))
    where = comparable(frame)
    assert where.mean() > 0.25
    left = frame.left.astype(float)[where]
    off = np.abs(warped(frame)[where] - left).mean()
    wrong = [np.abs(warped(frame, step)[where] - left).mean() for step in (-1, -0.5, 0.5, 1)]
    assert off < 4  # of 255: finest texture, resampled
    assert off < 0.8 * min(wrong[1:3]) and off < 0.6 * min(wrong[0], wrong[3])


def test_warped_images_with_noise_differ_by_no_more_than_noise(scene, renderer, pose, frame):
    noisy = pair(scene, renderer, pose, NOISY)
    where = comparable(frame) & (frame.left.min(axis=-1) > 30)

    def residual(image: StereoFrame) -> np.ndarray:
        return warped(image)[where] - image.left[where]

    x = (frame.left[where] / 255.0) ** 2.2
    spread = 255 / 2.2 * x ** (1 / 2.2 - 1) * np.sqrt(x * 4000 + 14**2) / 4000  # of one image, codes
    expected = np.sqrt((2 * spread**2).mean() + (residual(frame) ** 2).mean())
    assert residual(noisy).std() < 1.1 * expected
    assert residual(noisy).std() > 1.2 * residual(frame).std()  # and there is noise in each eye of its own


def test_occlusion_is_what_the_depth_of_the_right_view_says(renderer, pose, frame):
    fine = RIG.resized(RIG.camera.width * 4, RIG.camera.height * 4).camera
    right = renderer.render(fine, RIG.right_pose(pose), Footprint.from_camera(RIG.camera, pose))
    hit = frame.surface != SKY
    points = RIG.camera.unproject(np.where(hit, frame.depth, 1.0)) - [RIG.baseline, 0, 0]
    at = fine.project(points)
    inside = hit & (at[..., 0] >= -0.5 - 1.5)  # half a pixel of the coarse image, as the fine one counts
    u, v = (np.clip(np.round(np.nan_to_num(at[..., k])), 0, 4 * 160 - 1).astype(int) for k in (0, 1))
    depth, kernel = np.where(np.isfinite(right.depth), right.depth, 1e4), np.ones((3, 3), np.uint8)
    ids = right.surface.astype(np.float32)
    one = cv2.dilate(ids, kernel) == cv2.erode(ids, kernel)
    # behind all that the right eye sees thereabouts; amid a surface that is the pixel's own, at the pixel's own depth
    hidden = hit & (~inside | (frame.depth > 1.002 * cv2.dilate(depth, kernel)[v, u]))
    near = np.abs(depth[v, u] / np.where(hit, frame.depth, 1) - 1) < 0.01
    free = inside & one[v, u] & (right.surface[v, u] == frame.surface) & near
    assert (hidden == frame.occluded).mean() > 0.99
    assert (hidden & inside).sum() > 40 and free.mean() > 0.3, "the view decides too little"
    assert (hidden & ~frame.occluded).sum() <= 2
    assert (free & frame.occluded).sum() <= 0.003 * free.sum()


@pytest.mark.parametrize("offset", [-4.0, 4.0])
def test_occlusion_at_the_borders_follows_the_right_image(scene, renderer, pose, frame, offset):
    other = pair(scene, renderer, pose, replace(CLEAN, horizontal_offset=offset))
    column = np.arange(RIG.camera.width) - other.disparity
    beyond = (other.surface != SKY) & ((column < -0.5) | (column > RIG.camera.width - 0.5))
    assert other.occluded[beyond].all()
    inside = ~beyond & (np.arange(RIG.camera.width) - frame.disparity >= -0.5)
    inside[[0, -1]] = False  # the turned camera moves the corners a little up and down
    # what hides a point is the same, but for pixels where a stone's or a ripple's top just hides it
    assert (other.occluded == frame.occluded)[inside].mean() > 0.999
    if offset < 0:
        assert (other.occluded & ~frame.occluded).sum() > 100


def test_without_residuals_disparity_is_f_b_over_z_to_the_bit(frame):
    assert np.array_equal(frame.disparity, RIG.depth_to_disparity(frame.depth))


def test_disparity_is_that_of_the_depth_and_the_sky_has_none(frame):
    sky = frame.surface == SKY
    assert 0.02 < sky.mean() < 0.6
    assert np.allclose(frame.disparity[~sky] * frame.depth[~sky], RIG.fb, rtol=1e-5)
    assert not frame.disparity[sky].any() and np.isinf(frame.depth[sky]).all()
    assert not frame.occluded[sky].any() and not frame.normal[sky].any()
    beyond = ~sky & (np.arange(RIG.camera.width) - frame.disparity < -0.5)
    assert beyond.sum() > 100 and frame.occluded[beyond].all()


def test_ground_truth_does_not_depend_on_the_detector(scene, renderer, pose, frame):
    first, same, other = (pair(scene, renderer, pose, NOISY, seed) for seed in (1, 1, 2))
    assert np.array_equal(first.left, same.left) and np.array_equal(first.right, same.right)
    assert not np.array_equal(first.left, other.left)
    for name in ("depth", "disparity", "normal", "surface", "occluded", "pose"):
        assert np.array_equal(getattr(first, name), getattr(frame, name))


def test_noise_difference_is_the_right_eyes(scene, renderer, pose, frame):
    noisier = pair(scene, renderer, pose, replace(CLEAN, full_well=4000.0, read_noise=40.0, noise_difference=1.0))
    spread = {}
    for eye in ("left", "right"):
        clean, noisy = (getattr(image, eye).astype(float) for image in (frame, noisier))
        spread[eye] = (noisy - clean)[(clean > 80) & (clean < 180)].std()
    assert spread["right"] / spread["left"] == pytest.approx(2, rel=0.05)


def test_gain_difference_is_the_right_eyes(scene, renderer, pose, frame):
    brighter = pair(scene, renderer, pose, replace(CLEAN, gain_difference=0.1))
    assert np.array_equal(brighter.left, frame.left)
    middle = (frame.right > 40) & (frame.right < 200)
    ratio = (brighter.right[middle] / 255.0) ** 2.2 / (frame.right[middle] / 255.0) ** 2.2
    assert np.median(ratio) == pytest.approx(1.1, abs=0.01)


def one_sample(renderer, shader, camera, pose, view, shown_by=None) -> np.ndarray:
    """(H, W, 3) radiance through pixel centres alone, with the texture that the pixels of a camera show."""
    rays = camera.rays().reshape(-1, 3)
    colour, none = np.empty((len(rays), 3), dtype=np.float32), np.zeros(len(rays), dtype=bool)
    points, share = stereo._surface_points(rays, view.pixels, pose, none), np.zeros(len(rays), dtype=np.float32)
    share[points.at] = renderer.lit(points.points, points.normals)
    footprint = Footprint.from_camera(shown_by or camera, pose)
    stereo._shade(shader, footprint, pose, rays, view.pixels, none, points, share, colour)
    return colour.reshape(camera.height, camera.width, 3)


@pytest.mark.parametrize("name", ["scan", "embree", "pybullet"])
def test_borders_of_shadows_show_the_disc_of_the_sun(scene, pose, name, monkeypatch):
    """The references find the share of the disc for every pixel, and for none."""
    if name == "pybullet":
        pytest.importorskip("pybullet")
    low, camera = scene.with_sun(10.0, 150.0), RIG.camera.resized(448, 448)
    renderer, shader = make_renderer(name, low), Shader(low)
    view, footprint = renderer.render(camera, pose), Footprint.from_camera(camera, pose)
    images = [radiance(renderer, shader, camera, pose, view, footprint)]
    for every in (True, False):
        monkeypatch.setattr(stereo, "penumbra", lambda rays, *_, every=every: np.full(len(rays), every))
        images.append(radiance(renderer, shader, camera, pose, view, footprint))
    renderer.close()
    ours, soft, hard = (np.log(image[..., 0] + 1e-3) for image in images)
    wide = np.abs(soft - hard) > 0.1
    assert wide.sum() > 300
    assert np.abs(ours - soft)[wide].mean() < 0.35 * np.abs(hard - soft)[wide].mean()
    assert np.abs(ours - hard)[~wide].mean() < 0.002


@pytest.mark.parametrize("name", ["embree", "pybullet"])
def test_edges_are_smoothed(scene, pose, name):
    """The reference is the same view at four times the resolution, averaged over blocks."""
    if name == "pybullet":
        pytest.importorskip("pybullet")
    renderer = make_renderer(name, scene)
    shader, camera = Shader(scene), RIG.camera
    fine = camera.resized(camera.width * 4, camera.height * 4)
    footprint = Footprint.from_camera(camera, pose)
    fine_image = one_sample(renderer, shader, fine, pose, renderer.render(fine, pose, footprint), shown_by=camera)
    truth = fine_image.reshape(camera.height, 4, camera.width, 4, 3).mean(axis=(1, 3))
    view = renderer.render(camera, pose)
    surface = view.surface.astype(np.float32)
    silhouette = cv2.dilate(surface, np.ones((3, 3), np.uint8)) != cv2.erode(surface, np.ones((3, 3), np.uint8))
    smooth = np.abs(radiance(renderer, shader, camera, pose, view, footprint) - truth)[silhouette].mean()
    jagged = np.abs(one_sample(renderer, shader, camera, pose, view) - truth)[silhouette].mean()
    renderer.close()
    assert smooth < 0.6 * jagged
