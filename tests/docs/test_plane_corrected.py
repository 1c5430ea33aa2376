"""The depth of `lite`, corrected by its normals: planes stay, noise shrinks, and surfaces behind each other stay so."""

from collections.abc import Callable

import numpy as np
import pytest

from marssim.base.camera import PinholeCamera, StereoRig

RIG = StereoRig(PinholeCamera(fx=60.0, fy=55.0, cx=15.3, cy=12.1, width=32, height=24), 0.27)
NORMAL = np.array([0.1, -0.8, -1.0]) / np.linalg.norm([0.1, -0.8, -1.0])

Corrected = Callable[[np.ndarray, np.ndarray, StereoRig], np.ndarray]


@pytest.fixture
def corrected(plane_corrected) -> Corrected:
    return plane_corrected.corrected_disparity


def plane(height: float) -> np.ndarray:
    """The disparity [px] of a plane at a distance from the camera [m]."""
    down, across = np.mgrid[:24, :32]
    rays = np.stack([(across - 15.3) / 60, (down - 12.1) / 55, np.ones((24, 32))], -1)
    return (-60 * 0.27 / height * rays @ NORMAL).astype(np.float32)


def normals() -> np.ndarray:
    return np.broadcast_to(NORMAL, (24, 32, 3)).astype(np.float32)


def test_a_plane_stays_and_noise_shrinks(corrected: Corrected) -> None:
    true = plane(1.2)
    assert np.abs(corrected(true, normals(), RIG) - true).max() < 1e-4
    noise = np.random.default_rng(0).normal(0, 0.1, true.shape).astype(np.float32)
    assert (corrected(true + noise, normals(), RIG) - true).std() < 0.5 * noise.std()


def test_parallel_surfaces_behind_each_other_are_not_mixed(corrected: Corrected) -> None:
    true = np.where(np.arange(32) < 16, plane(1.2), plane(1.5))
    assert np.abs(true[:, 15] - true[:, 16]).min() > 0.5
    assert np.abs(corrected(true, normals(), RIG) - true).max() < 1e-3


def test_slopes_count(corrected: Corrected) -> None:
    """With normals of a level wall, the slanted plane is pulled towards it at its ends."""
    wall = np.broadcast_to(np.float32([0, 0, -1]), (24, 32, 3))
    assert np.abs(corrected(plane(1.2), wall, RIG) - plane(1.2)).max() > 0.02


@pytest.mark.parametrize("disparity, normal", [(0.0, NORMAL), (np.nan, NORMAL), (9.0, [np.nan] * 3)])
def test_sky_and_unknown_pixels_stay_and_correct_no_other(corrected: Corrected, disparity, normal) -> None:
    true, given = plane(1.2), normals().copy()
    true[:8], given[:8] = disparity, normal
    made = corrected(true, given, RIG)
    np.testing.assert_array_equal(made[:8], true[:8])
    assert np.abs(made[8:] - true[8:]).max() < 1e-4


def test_the_class_corrects_depth_and_disparity_alike(plane_corrected) -> None:
    corrected_class = plane_corrected.PlaneCorrected()
    rng = np.random.default_rng(0)
    left = rng.integers(0, 255, (64, 96, 3), np.uint8)
    rig = StereoRig(PinholeCamera(fx=112.0, fy=112.0, cx=47.5, cy=31.5, width=96, height=64), 0.27)
    made = corrected_class.infer(left, np.roll(left, -3, 1), rig)
    plain = corrected_class._network.infer(left, np.roll(left, -3, 1), rig)
    measured = made.disparity > 0.5
    assert measured.mean() > 0.5 and not np.array_equal(made.disparity, plain.disparity)
    np.testing.assert_allclose(made.depth[measured], rig.fb / made.disparity[measured], rtol=1e-4)
    np.testing.assert_array_equal(made.is_sky, plain.is_sky)
