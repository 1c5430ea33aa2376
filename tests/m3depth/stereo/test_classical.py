"""Classical matchers on a plane whose disparity is known, and their hole filling and normals."""

import cv2
import numpy as np
import pytest

from m3depth.stereo.classical import SGBM, BlockMatching, search_range, without_speckles
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
        for name, value in (("block", 3.0), ("disparities", 64.0), ("speckle", 2.5), ("speckle", True)):
            with pytest.raises(ValueError, match=f"^{name} must be a whole number, got {value}"):
                matcher(**{name: value})
        with pytest.raises(ValueError, match=r"^speckle must be 0 or more, got -1"):
            matcher(speckle=-1)
    with pytest.raises(ValueError, match="cost"):
        BlockMatching("census")
    for name, value in (("uniqueness", -5), ("uniqueness", None), ("block", 17)):
        with pytest.raises(ValueError, match=f"^{name} must be"):
            SGBM(**{name: value})
    assert BlockMatching(block=33).block == 33 and SGBM(block=15).block == 15


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
