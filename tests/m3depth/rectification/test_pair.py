"""Raw pairs drawn through lens models, rectified: rows, depth, and what is taken out."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from raw_pairs import GROUND, SIZE, WALL, cahvore_pair, depth_of, opencv_pair, write_images
from scipy.spatial.transform import Rotation

from m3depth.rectification.matches import matched_points
from m3depth.rectification.pair import fitting, rectify_pair
from m3depth.rectification.raw_image import masked, read_raw_pair
from m3depth.rectification.row_errors import RowCorrection, fit_rows
from marssim.base.calibration.cameras import PosedPair
from marssim.base.calibration.lenses.fisheye import Fisheye
from marssim.base.calibration.orientation import rectified_view
from marssim.base.files.png import encode_png
from marssim.base.images.resampling import pixel_grid, rectifying

PAIRS = {
    "radtan": opencv_pair(),
    "rational": opencv_pair(terms=(-0.25, 0.07, 1e-3, -8e-4, 0.01, 0.02, 0.01, 0.001)),
    "fisheye": opencv_pair(Fisheye, (0.02, -0.01, 0.003, -0.001)),
    "cahvore": cahvore_pair(),
}


@pytest.fixture(scope="module")
def raw(tmp_path_factory):
    """Raw images of every pair of PAIRS."""
    return {name: read_raw_pair(*write_images(tmp_path_factory.mktemp(name), pair)) for name, pair in PAIRS.items()}


def depth_error(result, plane) -> np.ndarray:
    """Error of the depth of matches (N,), as a share of the true one."""
    view, m = result.view, result.matches
    true = depth_of(plane, view, m.left)
    return np.abs(view.left.fx * view.baseline / (m.disparity + view.shift) / true - 1)


@pytest.mark.parametrize("name", PAIRS)
def test_a_pair_of_any_lens_has_common_rows_and_the_right_depth(raw, name):
    result = rectify_pair(*raw[name], PAIRS[name])
    assert result.matches.after.points > 500
    assert result.matches.after.median < 0.05 < 0.5 < result.matches.before.median
    assert result.removed is None or result.removed.size < 0.05
    assert np.median(depth_error(result, GROUND)) < 0.005
    assert result.left_valid.mean() > 0.97 and result.view.shift == 0
    assert result.calibration.baseline == pytest.approx(PAIRS[name].baseline)


@pytest.mark.parametrize("name", PAIRS)
def test_a_point_lies_in_one_row_of_both_rectified_views_exactly(name):
    """Without images: the raw places of a rectified pixel are those at which the lens shows the points of its ray."""
    pair = PAIRS[name]
    view = rectified_view(pair)
    points = np.random.default_rng(1).uniform([-1, -0.5, 2], [1, 0.7, 6], (50, 3))
    for eye in ("left", "right"):
        camera, ideal = getattr(pair, eye), getattr(view, eye)
        seen = (points - camera.centre) @ view.rotation.T
        pixels = seen[:, :2] / seen[:, 2:] * ideal.fx + [ideal.cx, ideal.cy]
        if eye == "left":
            rows = pixels[:, 1]
        assert pixels[:, 1] == pytest.approx(rows, abs=1e-9)
        source = rectifying(camera, ideal, view.rotation)(pixels)
        assert np.abs(source - camera.project(points)).max() < 1e-2  # entrance pupils move by 10 um


def test_vergence_is_taken_out_of_the_disparities_and_given_back_in_depth(tmp_path):
    pair = opencv_pair(vergence_deg=9)
    assert np.rad2deg(pair.vergence) == pytest.approx(9, abs=0.1)
    images = read_raw_pair(*write_images(tmp_path, pair, WALL))
    result = rectify_pair(*images, pair)
    assert 20 < result.view.shift < 60
    assert np.percentile(result.matches.disparity, 2) > 0
    assert result.calibration.shift == result.view.shift
    assert np.median(depth_error(result, WALL)) < 0.005
    whole = rectify_pair(*images, pair, shift=0.0)
    assert whole.view.shift == 0 and np.median(depth_error(whole, WALL)) < 0.005
    assert np.median(whole.matches.disparity) > np.median(result.matches.disparity) + 20


def test_a_constant_row_offset_is_found_and_taken_out(raw):
    pair = PAIRS["radtan"]
    low = replace(pair.right, lens=replace(pair.right.lens, cy=pair.right.lens.cy - 1.8))
    result = rectify_pair(*raw["radtan"], PosedPair(pair.left, low))
    assert result.removed.terms[0] == pytest.approx(1.8, abs=0.15)  # of the raw image; the focal length changes
    assert result.removed.significant and result.matches.after.median < 0.12  # a lens with distortion leaves some


def test_align_mends_a_calibration_that_is_nearly_right(raw):
    pair = PAIRS["radtan"]
    lens = replace(pair.right.lens, fx=298.0, fy=297.5, cy=181.0, coefficients=(-0.21, 0.055, 0.0, 0.0))
    aged = PosedPair(pair.left, replace(pair.right, lens=lens, rotation=pair.right.rotation @ _turn(0.006).T))
    as_it_is = rectify_pair(*raw["radtan"], aged)
    aligned = rectify_pair(*raw["radtan"], aged, align=True)
    assert as_it_is.matches.after.median > 0.2
    assert aligned.matches.after.median < 0.09


def test_what_two_rounds_of_align_take_out_is_reported_as_one_correction(raw):
    pair = PAIRS["radtan"]
    lens = replace(pair.right.lens, cy=pair.right.lens.cy - 6)
    turned = PosedPair(pair.left, replace(pair.right, lens=lens, rotation=pair.right.rotation @ _turn(0.06).T))
    result = rectify_pair(*raw["radtan"], turned, align=True)
    assert result.removed.terms[0] == pytest.approx(6 * result.view.left.fy / lens.fy, abs=0.15)
    assert result.removed.terms[1] == pytest.approx(0.06 * SIZE[0] / 2, abs=0.15)
    offset, roll = result.removed.terms[:2]
    assert result.removed.size == pytest.approx(np.sqrt(offset**2 + roll**2 / 3), rel=0.1)  # over the whole image


def _turn(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])


def test_align_fits_rows_without_a_calibration(raw):
    result = rectify_pair(*raw["cahvore"], align=True)
    assert result.view is None and result.calibration is None
    # another distortion of a wide lens is more than six terms can take out
    assert result.matches.before.median > 1 and result.matches.after.median < 0.1
    assert (result.left == raw["cahvore"][0].pixels)[result.left_valid].all()  # the left image stays


def test_what_a_mask_leaves_out_is_not_shown(tmp_path, raw):
    left, right = raw["radtan"]
    mask = np.full(SIZE[::-1], 255, np.uint8)
    mask[250:] = 0
    (tmp_path / "mask.png").write_bytes(encode_png(mask))
    result = rectify_pair(masked(left, tmp_path / "mask.png"), right, PAIRS["radtan"])
    assert result.left_valid[:230].mean() > 0.97 and not result.left_valid[275:].any()
    assert not result.left[~result.left_valid].any()
    (tmp_path / "small.png").write_bytes(encode_png(mask[::2]))
    with pytest.raises(ValueError, match=r"small\.png: is 480 x 180, .*left\.png is 480 x 360"):
        masked(left, tmp_path / "small.png")


def test_focal_length_and_size_can_be_chosen(raw):
    result = rectify_pair(*raw["fisheye"], PAIRS["fisheye"], focal=150.0, size=(320, 200))
    assert result.left.shape == (200, 320) and result.view.left.fx == 150
    assert result.matches.after.median < 0.08


def test_a_reduced_image_is_not_aliased(raw):
    """A chequerboard of pixels becomes a level grey where two of them make one, and stays where none is reduced."""
    chequered = (255 * (np.indices(SIZE[::-1]).sum(axis=0) % 2)).astype(np.uint8)
    images = [replace(image, pixels=chequered) for image in raw["radtan"]]
    spread = {}
    for focal, size in ((PAIRS["radtan"].left.lens.focal() / 2, (240, 180)), (None, None)):
        result = rectify_pair(*images, PAIRS["radtan"], focal=focal, size=size)
        middle = result.left[result.left.shape[0] // 3 : -result.left.shape[0] // 3].astype(float)
        spread[focal is None] = middle[:, middle.shape[1] // 3 : -middle.shape[1] // 3].std()
    assert spread[False] < 10 < 40 < spread[True]


def test_images_without_matches_are_rectified_and_not_judged(tmp_path, raw):
    left, right = raw["radtan"]
    blank = [replace(image, pixels=np.full(SIZE[::-1], 90, np.uint8)) for image in (left, right)]
    result = rectify_pair(*blank, PAIRS["radtan"])
    assert result.matches is None and result.removed is None
    assert np.abs(result.left[result.left_valid].astype(int) - 90).max() <= 1


def test_a_calibration_for_another_size_is_refused(raw):
    left, right = raw["radtan"]
    small = replace(right, pixels=right.pixels[:300], valid=right.valid[:300])
    with pytest.raises(ValueError, match=r"right\.png: is 480 x 300 px, the calibration is for images of 480 x 360"):
        fitting(PAIRS["radtan"], left, small)
    with pytest.raises(ValueError, match="without a calibration both images must have one size"):
        rectify_pair(left, small, align=True)


def test_a_correction_moves_pixels_to_where_the_given_image_shows_them():
    pixels = pixel_grid(64, 48)
    offset = RowCorrection((1.5, 0.0, 0.0, 0.0, 0.0, 0.0), 0.01, 1.5, (31.5, 23.5), 32.0)
    assert offset.moved(pixels) == pytest.approx(pixels + np.array([0, 1.5]))
    turn = RowCorrection((0.0, 0.5, 0.0, 0.0, 0.0, 0.0), 0.01, 0.5, (31.5, 23.5), 32.0)
    away = turn.moved(pixels) - [31.5, 23.5]
    assert np.hypot(*np.moveaxis(away, -1, 0)) == pytest.approx(
        np.hypot(*np.moveaxis(pixels - [31.5, 23.5], -1, 0)), rel=1e-3
    )


def test_rows_are_fitted_among_wrong_matches():
    rng = np.random.default_rng(0)
    right = rng.uniform(0, [640, 480], (400, 2))
    x, y = (right[:, 0] - 319.5) / 320, (right[:, 1] - 239.5) / 320
    left = right + np.column_stack([rng.uniform(5, 60, 400), -(2 + 0.7 * x - 0.4 * y + 0.2 * x * y)])
    left[:120, 1] += rng.uniform(-30, 30, 120)
    correction, good = fit_rows(left, right, (640, 480), 6)
    assert correction.terms == pytest.approx((2, 0.7, -0.4, 0, 0.2, 0), abs=0.02)
    assert good[120:].all() and good[:120].mean() < 0.2
    assert fit_rows(left[:20], right[:20], (640, 480), 6) is None


def test_points_without_a_match_give_none():
    blank = np.zeros((50, 60), np.uint8)
    shown = np.ones((50, 60), bool)
    assert len(matched_points(blank, blank, (shown, shown), 5.0)[0]) == 0


def test_points_that_look_alike_are_not_matched():
    """A pattern that repeats along the rows shows each point several times, and one that does not only once."""
    rng = np.random.default_rng(0)
    plain = cv2.GaussianBlur(rng.uniform(0, 255, (160, 320)).astype(np.float32), (0, 0), 2.0)
    plain = np.clip(128 + 4 * (plain - plain.mean()), 0, 255)
    found = []
    for image in (plain, np.tile(plain[:, :40], (1, 8))):
        left, right = (np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8) for _ in range(2))
        shown = np.ones(image.shape, bool)
        found.append(len(matched_points(left, right, (shown, shown), 8.0)[0]))
    assert found[0] > 200 and found[1] < 0.4 * found[0]


def test_a_turn_of_the_camera_up_is_taken_out_of_the_columns_too_with_the_focal_length():
    focal, angle, pixels = 60.0, 0.03, pixel_grid(64, 48).reshape(-1, 2)
    rays = np.column_stack([(pixels - [31.5, 23.5]) / focal, np.ones(len(pixels))])
    turned = rays @ Rotation.from_euler("x", angle).as_matrix().T
    given = focal * turned[:, :2] / turned[:, 2:] + [31.5, 23.5]  # where the turned camera shows them
    errors = {}
    for known in (focal, np.inf):
        correction, right = fit_rows(pixels, given, (64, 48), 6, known)
        assert right.mean() > 0.9
        errors[known] = np.abs(correction.moved(pixels) - given).max(axis=0)
    assert errors[focal][1] < 0.1 and errors[np.inf][1] < 0.1  # rows
    assert errors[focal][0] < 0.05 and errors[np.inf][0] > 0.3  # columns, at the corners
