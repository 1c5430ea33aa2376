"""Raw images: how exactly a lens resamples the image that it is rendered from, and where the cameras stand."""

import json
from dataclasses import replace

import numpy as np
import pytest

from marssim.base.calibration.cameras import PosedCamera, first_camera
from marssim.base.calibration.lenses.fisheye import Fisheye
from marssim.base.calibration.lenses.radial_tangential import RadialTangential
from marssim.base.calibration.rig_file import RawRig, read_rig_file
from marssim.base.pose import look_pose
from marssim.render.raw import FINER, RawLens, RawRenderer
from marssim.render.renderers.embree_renderer import EmbreeRenderer
from marssim.render.sensor import Sensor
from marssim.render.surfaces.shading import Shader
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import SceneConfig, build_scene

SIZE = (160, 120)
LENSES = {
    "ideal": RadialTangential(150.0, 150.0, 79.5, 59.5),
    "tangential": RadialTangential(150.0, 151.0, 77.0, 62.0, (-0.25, 0.07, 1e-3, -8e-4)),
    "fisheye": Fisheye(90.0, 90.0, 79.5, 59.5, (-0.02, 0.004, 0.0, 0.0)),
}
WAVES = 40.0  # of the pattern, in a unit of x / z


def pattern(tangents: np.ndarray) -> np.ndarray:
    """(..., 2) waves along x and along y of x / z and y / z (..., 2)."""
    return np.sin(WAVES * tangents + [0.3, 0.7])


@pytest.mark.parametrize("name", LENSES)
def test_raw_pixels_show_what_their_rays_see(name):
    """The shift of the pattern, by its phase, is far below the 0.05 px that rows have to keep."""
    camera = first_camera(LENSES[name], SIZE)
    lens = RawLens(camera, "left")
    ideal = lens.ideal
    raw = lens.mean(pattern(ideal.rays()[..., :2]).astype(np.float32))
    assert raw.shape == (120, 160, 2)
    u, v = np.meshgrid(np.arange(160.0), np.arange(120.0))
    direction = camera.lens.rays(np.stack([u, v], -1)).direction
    tangents = direction[..., :2] / direction[..., 2:]
    steps = np.stack([np.gradient(tangents[..., i], axis=1 - i) for i in (0, 1)], axis=-1)  # of a pixel
    slope = WAVES * np.cos(WAVES * tangents + [0.3, 0.7])
    inside = np.s_[2:-2, 2:-2]
    miss = (raw - pattern(tangents))[inside]
    along = (slope * steps)[inside]  # change of the pattern in a pixel
    for axis in (0, 1):
        a, b = along[..., axis], miss[..., axis]
        value = pattern(tangents)[inside][..., axis]
        design = np.stack([a.ravel(), value.ravel()], 1)  # a shift, and what the mean over a pixel takes away
        shift, lost = np.linalg.lstsq(design, b.ravel(), rcond=None)[0]
        assert abs(shift) < 0.002 and -0.2 < lost < 0
        rest = (b - design.reshape(*a.shape, 2) @ [shift, lost])[np.abs(a) > 0.1]
        assert np.abs(rest).mean() < 0.02


@pytest.mark.parametrize("name", LENSES)
def test_the_image_is_fine_enough_everywhere(name):
    lens = RawLens(first_camera(LENSES[name], SIZE), "left")
    steps = [np.linalg.norm(np.diff(lens.places, axis=axis), axis=-1).min() for axis in (0, 1)]
    assert min(steps) > 0.97 * FINER
    assert (lens.places >= 0).all() and (lens.places <= [lens.ideal.width - 1, lens.ideal.height - 1]).all()


def test_a_lens_that_sees_too_far_to_the_side_is_refused():
    wide = first_camera(Fisheye(50.0, 50.0, 79.5, 59.5), SIZE)  # 91 deg at the left and right border
    with pytest.raises(ValueError, match=r"^\d+ % of the image of the right camera lie more than 70 deg off its axis"):
        RawLens(wide, "right")


@pytest.fixture
def raw_rig(tmp_path) -> RawRig:
    fields = {
        "width": 160, "height": 120, "fx": 150.0, "fy": 150.0, "cx": 79.5, "cy": 59.5, "baseline": 0.2,
        "distortion_model": "plumb_bob", "distortion_coefficients": [-0.2, 0.05, 0, 0], "vergence_deg": 4.0,
        "rotation_deg": [0.6, 0.1, -0.9],
    }  # fmt: skip
    (tmp_path / "rig.json").write_text(json.dumps(fields))
    rig = read_rig_file([tmp_path / "rig.json"])
    assert isinstance(rig, RawRig)
    return rig


def test_cameras_show_points_of_the_world_where_their_calibration_says(raw_rig):
    pose = look_pose(np.array([1.0, 2.0, 1.2]), 0.4, np.deg2rad(15))
    points = np.random.default_rng(0).uniform([-0.5, -0.4, 2], [0.5, 0.4, 6], (30, 3))  # left rectified frame
    world = points @ pose[:3, :3].T + pose[:3, 3]
    renderer = RawRenderer(raw_rig)
    for eye in ("left", "right"):
        camera: PosedCamera = getattr(raw_rig.cameras, eye)
        at = renderer.pose(eye, pose, np.eye(3))
        shown = camera.lens.project((world - at[:3, 3]) @ at[:3, :3])
        rig_frame = points @ raw_rig.view.rotation + raw_rig.cameras.left.centre
        assert shown == pytest.approx(camera.project(rig_frame), abs=1e-8)


def test_raw_images_have_the_glare_of_the_sun_too(raw_rig):
    config = SceneConfig(size=8.0, horizon=12.0, rocks=RockConfig(k=0.0))
    scene = build_scene(config, np.random.default_rng(3)).with_sun(15.0, 0.0)
    pose, renderer = look_pose(np.array([0.0, 0.0, 1.2]), 0.0, 0.3), EmbreeRenderer(scene)
    sensor = Sensor(exposure=0.5, psf=0.0, full_well=1e12, read_noise=0.0, vignetting=0.0)

    def spread(glare):
        of_glare = replace(sensor, sun_glare=glare)
        pair = RawRenderer(raw_rig).render(renderer, Shader(scene), pose, of_glare, np.random.default_rng(0))
        return np.array([image[len(image) // 2 :].std() / image[len(image) // 2 :].mean() for image in pair])

    assert (spread(0.4) < 0.9 * spread(0.0)).all()
    renderer.close()


def test_a_turn_of_the_rectified_camera_turns_the_raw_one_with_it(raw_rig):
    """What rectification makes of the raw camera is turned by the same rotation, in its own frame."""
    pose, turn = look_pose(np.zeros(3), 0.4, 0.2), look_pose(np.zeros(3), 0.01, 0.02)[:3, :3]
    renderer = RawRenderer(raw_rig)
    plain, turned = (renderer.pose("right", pose, way)[:3, :3] for way in (np.eye(3), turn))
    to_camera = raw_rig.cameras.right.rotation @ raw_rig.view.rotation.T
    assert turned @ to_camera == pytest.approx(plain @ to_camera @ turn)
