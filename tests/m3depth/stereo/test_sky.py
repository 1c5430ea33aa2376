import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from m3depth.network.model import M3Depth
from m3depth.stereo.sky import BELOW_HORIZON, ground_plane, possible_sky
from marssim.base.camera import NATECAM
from marssim.base.pose import look_pose

RIG = NATECAM.resized(128, 128)
CAMERA = RIG.camera


def level_ground(pitch_deg: float, roll: float = 0.0, height: float = 1.2) -> tuple[np.ndarray, np.ndarray]:
    """Return the disparity (H, W) [px] of level ground, 0 above the horizon, and how far rays point down [rad]."""
    pose = look_pose(np.array([0.0, 0.0, height]), 0.3, np.deg2rad(pitch_deg), roll)
    rays = CAMERA.rays()
    down = -(rays @ pose[2, :3])
    disparity = np.where(down > 1e-6, RIG.fb * np.maximum(down, 0) / height, 0)
    return disparity.astype(np.float32), np.arcsin(down / np.linalg.norm(rays, axis=-1))


@settings(max_examples=40, deadline=None)
@given(pitch=st.floats(5, 20), roll=st.floats(-0.25, 0.25))
def test_sky_above_level_ground_stays_and_ground_below_its_horizon_does_not(pitch: float, roll: float) -> None:
    """The network takes everything for sky but a strip of the ground."""
    disparity, down = level_ground(pitch, roll)
    strip = down > np.deg2rad(25)
    kept = possible_sky(~strip, disparity, np.ones_like(disparity), RIG)
    assert kept[down < 0].all()
    assert not kept[down > BELOW_HORIZON + 1e-3].any()


@pytest.mark.parametrize("height", [0.3, 0.8, 1.2, 3.0])
@pytest.mark.parametrize("pitch", [8.0, 20.0])
def test_ground_of_less_than_eight_metres_is_no_sky_from_any_height(height: float, pitch: float) -> None:
    disparity, down = level_ground(pitch, height=height)
    kept = possible_sky(down < np.deg2rad(25), disparity, np.ones_like(disparity), RIG)
    near = (down > 0) & (height / np.tan(np.maximum(down, 1e-6)) < 7.99)
    assert kept[down < 0].all() and not kept[near].any()


def test_patches_that_do_not_reach_the_upper_border_are_no_sky() -> None:
    disparity, down = level_ground(10.0)
    taken = down < 0
    taken[:3] = False
    assert not possible_sky(taken, disparity, np.ones_like(disparity), RIG).any()
    taken[:3, 64] = True
    assert possible_sky(taken, disparity, np.ones_like(disparity), RIG)[5:20, 20].all()


@pytest.mark.parametrize(("rows", "seen"), [(5, False), (8, True)])  # 3.9 and 6.3 % of the image
def test_a_camera_that_looks_up_sees_sky_only_above_enough_ground(rows: int, seen: bool) -> None:
    disparity, sure = np.zeros((2, 128, 128), np.float32)
    sure[-rows:] = 1
    disparity[-rows:] = 10 + np.arange(rows)[:, None]
    taken = np.zeros(disparity.shape, bool)
    taken[:-rows] = True
    assert possible_sky(taken, disparity, sure, RIG)[:60].all() == seen


def test_without_confident_ground_nothing_is_sky() -> None:
    """Blank, bright ground up to the lower border looks like this."""
    disparity, down = level_ground(10.0)
    taken = down < np.deg2rad(15)
    assert not possible_sky(taken, disparity, np.zeros_like(disparity), RIG).any()


@pytest.mark.parametrize("levels", [(230, 150), (150, 230), (100, 60)])
def test_the_shipped_network_sees_no_sky_in_blank_images(levels: tuple[int, int]) -> None:
    """A smooth, blank surface fills the view of both cameras, and the network takes half of it or more for sky."""
    rng = np.random.default_rng(0)
    grey = np.linspace(*levels, 512)[:, None, None]
    left, right = (np.rint(grey + rng.normal(0, 1.5, (512, 512, 3))).astype(np.uint8) for _ in range(2))
    prediction = M3Depth.from_pretrained().infer(left, right, NATECAM)
    assert not prediction.is_sky.any() and not np.isfinite(prediction.depth).all()


def test_above_a_wall_the_border_decides() -> None:
    row, column = np.indices((128, 128), dtype=np.float32)
    over = row < 50 + column / 8
    taken = over.copy()
    taken[60:70, 20:30] = True  # a patch of the wall
    assert (possible_sky(taken, 20 + 0.01 * row, np.ones_like(row), RIG) == over).all()


CLOUD = np.s_[5:12, 40:60]  # a part of the sky that the network takes for something near


@pytest.mark.parametrize("confidence", [0.2, 0.6])
def test_what_floats_in_the_sky_is_sky_unless_one_of_its_pixels_is_confident(confidence: float) -> None:
    disparity, down = level_ground(10.0)
    taken, sure = down < 0, np.where(down < 0, 0.2, 0.9).astype(np.float32)
    taken[CLOUD], sure[8, 50] = False, confidence
    sky = possible_sky(taken, disparity, sure, RIG)
    assert (sky[CLOUD] == (confidence < 0.5)).all()
    assert sky[taken].all() and not sky[down > 0].any()


@pytest.mark.parametrize("columns", [np.full(128, 50), 50 + np.arange(128) // 2, 50 + np.arange(128) % 2])
def test_what_touches_the_ground_does_not_float(columns: np.ndarray) -> None:
    """A bridge of single pixels leads from the cloud down to the ground: straight, slanting, and by corners alone."""
    disparity, down = level_ground(10.0)
    taken, sure = down < 0, np.where(down < 0, 0.2, 0.9).astype(np.float32)
    taken[CLOUD] = False
    rows = np.arange(12, np.flatnonzero((down > 0).all(1))[0])
    taken[rows, columns[rows - 12]] = False
    assert not possible_sky(taken, disparity, sure, RIG)[CLOUD].any()


def test_without_a_confident_pixel_what_reaches_the_lower_border_does_not_float() -> None:
    """Between two walls, of which the network is confident of one, the sky reaches down to the lower border."""
    row, column = np.indices((128, 128), dtype=np.float32)
    taken = (row < 50) | (abs(column - 64) < 4)
    taken[CLOUD] = False
    sure = np.where(column > 64, 0.9, 0.2).astype(np.float32)
    sure[:50] = 0.2
    sky = possible_sky(taken, 20 + 0.01 * row, sure, RIG)
    assert sky[CLOUD].all() and (sky == ((row < 50) | (abs(column - 64) < 4))).all()


def test_a_view_down_has_no_sky() -> None:
    """A blank, bright patch of dust at the upper border, 30 deg below the horizon."""
    disparity, down = level_ground(55.0)
    taken = np.zeros_like(down, dtype=bool)
    taken[:40, 30:90] = True
    assert down.min() > BELOW_HORIZON
    assert not possible_sky(taken, disparity, np.ones_like(disparity), RIG).any()


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_rocks_do_not_move_the_horizon(share: float) -> None:
    disparity, down = level_ground(15.0)
    rng = np.random.default_rng(0)
    ground = np.flatnonzero(down > 0.02)
    lifted = disparity.copy()
    rocks = rng.choice(ground, int(share * len(ground)), replace=False)
    lifted.flat[rocks] *= rng.uniform(1.2, 2.0, len(rocks))
    plane = ground_plane(ground, lifted, CAMERA)
    assert plane is not None
    v, u = np.divmod(ground, 128)
    assert np.abs(np.stack([u, v, np.ones_like(u)], 1) @ plane - disparity.flat[ground]).max() < 0.3


@pytest.mark.parametrize("across", [0.0, 0.3])
def test_walls_determine_no_horizon(across: float) -> None:
    row, column = np.indices((128, 128), dtype=np.float32)
    wall = 20 + 0.01 * row + across * column
    assert ground_plane(np.arange(128 * 128), wall, CAMERA) is None
    assert ground_plane(np.arange(100), wall, CAMERA) is None  # of one row


def test_nothing_taken_stays_nothing() -> None:
    none = np.zeros((128, 128), bool)
    assert possible_sky(none, none.astype(np.float32), none.astype(np.float32), RIG) is none
