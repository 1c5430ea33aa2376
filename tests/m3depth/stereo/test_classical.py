"""Classical matchers on a plane whose disparity is known, and their hole filling and normals."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from m3depth.evaluation.metrics import angle_between
from m3depth.stereo.classical import SGBM, BlockMatching, search_range, without_speckles
from m3depth.stereo.plane_normals import fitted_normals
from marssim.base.camera import NATECAM, PinholeCamera, StereoRig

RIG = StereoRig(PinholeCamera.centred(160, 96, 200.0), baseline=0.25)


def texture(shape: tuple[int, int], seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).standard_normal(shape).astype(np.float32)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 1.2), None, 20, 235, cv2.NORM_MINMAX)


def pair_of(disparity: np.ndarray, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """The right image is the texture, the left one samples it at x - d: exact for a smooth disparity."""
    height, width = disparity.shape
    right = texture((height, width + 64), seed)
    x = np.arange(width, dtype=np.float32)[None] - disparity + 64
    y = np.repeat(np.arange(height, dtype=np.float32)[:, None], width, axis=1)
    left = cv2.remap(right, x.astype(np.float32), y, cv2.INTER_CUBIC)
    return np.clip(left, 0, 255).astype(np.uint8), right[:, 64:].astype(np.uint8)


def ramp() -> np.ndarray:
    """A tilted plane: 9 to 15 px, faster down than across."""
    v, u = np.mgrid[: RIG.camera.height, : RIG.camera.width]
    return (9 + 0.04 * v + 0.012 * u).astype(np.float32)


@pytest.mark.parametrize(
    "matcher",
    [
        SGBM(),
        SGBM(directions=8),
        *(BlockMatching(cost, way) for cost in ("sad", "ssd", "ncc") for way in ("wta", "sgm")),
    ],
    ids=lambda m: f"sgbm-{m.directions}" if isinstance(m, SGBM) else f"{m.cost}-{m.aggregation}",
)
def test_tilted_plane_is_recovered(matcher):
    true = ramp()
    left, right = pair_of(true)
    out = matcher.infer(left, right, RIG)
    assert out.depth.shape == out.disparity.shape == out.confidence.shape == true.shape
    assert out.depth.dtype == out.disparity.dtype == out.confidence.dtype == np.float32
    inner = np.s_[8:-8, 32:-8]
    assert np.median(np.abs(out.disparity - true)[inner]) < 0.15
    assert out.confidence[inner].mean() > 0.9
    assert np.allclose(out.depth[inner], RIG.fb / out.disparity[inner])


def test_five_directions_are_biased_where_disparity_grows_downwards_and_eight_are_not():
    true = (9 + 0.2 * np.mgrid[:96, :160][0]).astype(np.float32)  # level ground of 0.2 px a row
    left, right = pair_of(true)
    bias = {n: float(np.nanmedian((SGBM(n).match(left, right, RIG) - true)[8:-8, 40:-8])) for n in (5, 8)}
    assert bias[5] < -0.1
    assert abs(bias[8]) < 0.05


def test_strip_that_the_right_eye_does_not_see_is_filled_and_unsure():
    true = np.full((96, 160), 24, np.float32)
    left, right = pair_of(true)
    out = SGBM().infer(left, right, RIG)
    assert np.isfinite(out.depth).all()
    assert out.confidence[:, :20].max() == 0
    assert np.median(np.abs(out.disparity[:, :20] - 24)) < 0.5


def test_colour_and_grey_give_the_same():
    left, right = pair_of(ramp())
    grey = SGBM().infer(left, right, RIG)
    colour = SGBM().infer(*(np.repeat(x[..., None], 3, axis=2) for x in (left, right)), RIG)
    assert np.array_equal(grey.disparity, colour.disparity)


def test_noise_of_a_clear_sky_is_not_matched_and_the_ground_below_is():
    rig = StereoRig(PinholeCamera.centred(320, 192, 400.0), baseline=0.25)
    true = np.full((192, 320), 12, np.float32)
    left, right = pair_of(true)
    rng = np.random.default_rng(3)
    sky = np.s_[:96]
    for eye in (left, right):
        eye[sky] = np.rint(np.linspace(150, 165, 96)[:, None] + rng.normal(0, 0.7, (96, 320)))
    plain = np.isfinite(SGBM(texture=0.0).match(left, right, rig))
    matched = np.isfinite(SGBM().match(left, right, rig))
    assert plain[:88].sum() > 400  # islands of noise, larger than speckles
    assert matched[:88].mean() < 0.005
    assert matched[104:-8, 40:-8].mean() > 0.95


def test_texture_below_zero_is_refused():
    with pytest.raises(ValueError, match="texture must be 0 or more"):
        SGBM(texture=-1.0)


def test_black_pair_gives_finite_or_unknown_never_negative():
    black = np.zeros((96, 160), np.uint8)
    out = SGBM().infer(black, black, RIG)
    assert not (out.disparity < 0).any()
    np.testing.assert_array_equal(np.isnan(out.normal).any(-1), np.isnan(out.depth))  # unknown is unknown in all maps


@given(st.floats(-40, 40), st.floats(-60, 60), st.floats(1, 10))
@settings(max_examples=40, deadline=None)
def test_normals_of_any_plane(yaw_deg, pitch_deg, distance):
    """The plane n . P = -h, seen by a pinhole: its disparity is linear, so the fit has to be exact inside."""
    yaw, pitch = np.radians([yaw_deg, pitch_deg])
    normal = -np.array([np.sin(yaw), np.sin(pitch) * np.cos(yaw), np.cos(pitch) * np.cos(yaw)])
    depth = -distance / (RIG.camera.rays() @ normal)
    visible = (depth > 0).all()
    if not visible:
        return
    fitted = fitted_normals(RIG.depth_to_disparity(depth), RIG.camera)
    assert angle_between(fitted, np.broadcast_to(normal, fitted.shape))[8:-8, 8:-8].max() < 0.01


@pytest.mark.parametrize("holes", ["a tenth", "most", "every second row", "a half image"])
def test_gaps_do_not_bend_the_planes(holes):
    """Gaps counted as 0 px would tilt a window by tens of degrees."""
    normal = np.array([0.2, -0.8, -0.5]) / np.linalg.norm([0.2, -0.8, -0.5])
    depth = -1.5 / (RIG.camera.rays() @ normal)
    disparity = np.where(depth > 0, RIG.depth_to_disparity(depth), 0).astype(np.float32)
    draw = np.random.default_rng(0).random(disparity.shape)
    gap = {
        "a tenth": draw < 0.1,
        "most": draw < 0.8,
        "every second row": np.broadcast_to(np.arange(len(draw))[:, None] % 2 == 0, draw.shape),
        "a half image": np.broadcast_to(np.arange(draw.shape[1]) < draw.shape[1] // 2, draw.shape),
    }[holes]
    for none in (np.nan, 0.0, -1.0, np.inf):
        fitted = fitted_normals(np.where(gap, np.float32(none), disparity), RIG.camera)
        known = (disparity > 0) & ~gap
        assert known.sum() > 2000
        assert angle_between(fitted, np.broadcast_to(normal, fitted.shape))[known].max() < 0.05  # to the very border
        view = -RIG.camera.rays()[~known]
        assert angle_between(fitted[~known], view).max(initial=0) < 0.01


def test_pixels_on_one_line_determine_no_plane():
    disparity = np.full((96, 160), np.nan, np.float32)
    disparity[40] = 20.0
    disparity[60:62] = 20.0  # two rows do
    normal = fitted_normals(disparity, RIG.camera)
    view = -RIG.camera.rays()
    assert angle_between(normal[40], view[40]).max() < 0.01
    assert angle_between(normal[60], np.array([0.0, 0.0, -1.0])[None]).max() < 0.01


def test_normals_are_unit_and_face_the_camera_everywhere():
    disparity = np.random.default_rng(0).uniform(-5, 60, (96, 160)).astype(np.float32)
    disparity[20:40] = np.nan
    normal = fitted_normals(disparity, RIG.camera)
    assert np.allclose(np.linalg.norm(normal, axis=-1), 1, atol=1e-5)
    assert (np.einsum("ijk,ijk->ij", normal, RIG.camera.rays()) < 0).all()


@pytest.mark.parametrize("size", [(1, 1), (40, 1), (1, 40), (40, 2)])
def test_images_of_few_rows_or_columns_are_matched_as_far_as_they_go(size):
    image = np.random.default_rng(0).integers(0, 255, size, dtype=np.uint8)
    rig = StereoRig(PinholeCamera(size[1], size[0], 40.0, 40.0, 0.0, 0.0), 0.27)
    disparity = SGBM().match(image, image, rig)
    assert disparity.shape == size and not (disparity > 0).any()


def test_search_reaches_0_84_m():
    assert search_range(NATECAM) == 192
    assert search_range(RIG) % 16 == 0
    assert search_range(StereoRig(PinholeCamera.centred(100, 100, 5000), 1.0)) == 112


def test_wrong_input_is_refused_by_name():
    image = np.zeros((96, 160), np.uint8)
    with pytest.raises(ValueError, match="right image is 80 x 96"):
        SGBM().infer(image, image[:, :80], RIG)
    with pytest.raises(ValueError, match="left image must be a uint8"):
        SGBM().infer(image.astype(float), image, RIG)
    for matcher in (SGBM, BlockMatching):
        for disparities in (100, 0, -16):
            with pytest.raises(ValueError, match="multiple of 16"):
                matcher(disparities=disparities)
    with pytest.raises(ValueError, match="cost"):
        BlockMatching("census")


def test_disparities_that_do_not_fit_into_16_bits_in_sixteenths_are_kept():
    disparity = np.full((60, 60), 3000.3, np.float32)
    disparity[20:24, 20:24] = 2500.0  # an island
    kept = without_speckles(disparity, 30)
    assert np.isnan(kept[20:24, 20:24]).all() and np.isfinite(kept).sum() == 60 * 60 - 16
    assert np.nanmax(kept) == np.float32(3000.3)


def test_sgbm_finds_small_disparities_where_the_rig_shows_larger_ones_than_it_can_search():
    rig = StereoRig(PinholeCamera.centred(2400, 60, 4400.0), 0.45)  # 2357 px at 0.84 m
    right = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 256, (60, 2400), dtype=np.uint8), (0, 0), 1.0)
    matched = SGBM().match(np.roll(right, 30, axis=1), right, rig)[:, 200:-200]
    assert np.isfinite(matched).mean() > 0.95 and np.nanmedian(matched) == pytest.approx(30, abs=0.1)
    with pytest.raises(ValueError, match="disparities must be at most 2032, got 2048"):
        SGBM(disparities=2048)


def test_no_match_lies_outside_the_right_image():
    rng = np.random.default_rng(3)
    noise = rng.standard_normal((96, 260)).astype(np.float32)
    texture = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 1.2), None, 20, 235, cv2.NORM_MINMAX).astype(np.uint8)
    left, right = texture[:, 36:196].copy(), texture[:, 60:220]
    left[:, :24] = right[:, :1] + rng.integers(-1, 2, (96, 24))  # looks like the border of the right image
    rig = StereoRig(PinholeCamera.centred(160, 96, 100.0), 0.5)
    assert not (SGBM().match(left, right, rig) > np.arange(160) + 0.5).any()
