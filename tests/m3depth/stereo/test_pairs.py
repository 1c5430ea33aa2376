import numpy as np
import pytest

from m3depth.stereo.pairs import checked_pair, spread
from marssim.base.camera import PinholeCamera, StereoRig

RIG = StereoRig(PinholeCamera.centred(6, 4, 10.0), baseline=0.27)


@pytest.mark.parametrize(("given", "squeezed"), [((4, 6), (4, 6)), ((4, 6, 1), (4, 6)), ((4, 6, 3), (4, 6, 3))])
def test_grey_and_colour_pass(given, squeezed) -> None:
    image = np.arange(np.prod(given), dtype=np.uint8).reshape(given)
    left, right = checked_pair(image, image[::-1], RIG)
    np.testing.assert_array_equal(left, image.reshape(squeezed))
    np.testing.assert_array_equal(right, image[::-1].reshape(squeezed))


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((4, 6)), "right image must be a uint8 array, got float64"),
        ([[0]], "right image must be a uint8 array, got list"),
        (np.zeros((4, 6), np.uint16), "uint8 array, got uint16; m3depth.datasets.image_files.in_eight_bits converts"),
        (np.zeros((4, 6, 4), np.uint8), r"right image must be .*, got \(4, 6, 4\); image\[..., :3\] is without"),
        (np.zeros(4, np.uint8), r"right image must be .*, got \(4,\)"),
        (np.zeros((6, 4), np.uint8), "right image is 4 x 6, the rig's camera is 6 x 4"),
    ],
)
def test_what_cannot_be_matched_is_named(image, message) -> None:
    with pytest.raises(ValueError, match=message):
        checked_pair(np.zeros((4, 6), np.uint8), image, RIG)


def test_images_that_opencv_cannot_resample_are_refused() -> None:
    image = np.zeros((1, 32767), np.uint8)
    rig = StereoRig(PinholeCamera(32767, 1, 100.0, 100.0, 0.0, 0.0), 0.27)
    with pytest.raises(ValueError, match="left image is 32767 x 1: sides of at most 32766 px can be matched"):
        checked_pair(image, image, rig)


@pytest.mark.parametrize(
    ("count", "wanted", "expected"),
    [(10, 3, [0, 4, 9]), (3, 10, [0, 1, 2]), (5, 1, [0]), (0, 4, []), (7, 7, list(range(7)))],
)
def test_chosen_indices_spread_from_the_first_to_the_last(count, wanted, expected) -> None:
    assert spread(count, wanted) == expected
