"""Rectify a raw stereo pair by its calibration, and report how far its rows lie apart, before and after.

    python -m m3depth.rectify left.png right.png --calib stereo.yml --out RESULT
    python -m m3depth.rectify left.png right.png --calib left.yaml right.yaml --out RESULT      # ROS CameraInfo
    python -m m3depth.rectify NLMV0709_...IMG NRMV0709_...IMG --out RESULT      # the labels hold the camera models
    python -m m3depth.rectify NLMV0709_...IMG --out RESULT                      # the right image is found by its name
    python -m m3depth.rectify left.jpg right.jpg --align --out RESULT           # no calibration: rows from matches

--calib takes calibrations of raw cameras: OpenCV's K1 D1 K2 D2 R T as YAML, XML or JSON (--fisheye for those of
cv2.fisheye), ROS CameraInfo of both cameras, Kalibr's camchain.yaml, and labels of PDS3, VICAR and PDS4 with a CAHV,
CAHVOR or CAHVORE model. The images may be products of missions (.IMG, PDS4 labels), which need the extra `real`; their
labels are the calibration. The command writes into RESULT:

    left.png, right.png                the rectified pair, of as many bits as the raw one
    left_valid.png, right_valid.png    255: the image shows the scene here
    rig.json          focal length, principal point and baseline, as marssim and `m3depth.predict --calib` read them;
                      "shift" is the common disparity that was taken out: depth = fx baseline / (disparity + shift);
                      "camera_to_rover" is the left camera's pose on the rover, where labels give it
    report.json       rows before and after, what was taken out, vergence, disparities, and whether depth has a scale
    rows.png          matched rows of the raw and of the rectified pair, to look at

The pair can then be predicted: python -m m3depth.predict RESULT --out DEPTH. To rectify and predict at once, give
m3depth.predict the raw pair.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from m3depth.rectification.checked import rectified
from m3depth.rectification.files import pair_folder
from m3depth.rectification.options import RectifyOptions
from m3depth.rectification.pair import RectifiedPair
from m3depth.rectification.product_names import right_of
from m3depth.rectification.raw_image import read_raw_pair
from marssim.base.command.run import run_command


def rectify(options: RectifyOptions) -> RectifiedPair:
    """Read the pair, rectify it, write the files, and print a summary.

    Args:
        options: The command's flags.

    Returns:
        The rectified pair, as it is written.

    Raises:
        FileNotFoundError: A file is missing; nothing was written.
        ImportError: A product without the extra `real`; nothing was written.
        ValueError: A flag, a calibration or the pair cannot be used; nothing was written.
    """
    options.check()
    paths = options.images if len(options.images) == 2 else (options.images[0], right_of(options.images[0]))
    folder = pair_folder(options.out)
    folder.check()
    left, right = read_raw_pair(*paths, check=not options.unchecked)
    result = rectified(options, left, right)
    for message in result.warnings:
        print(f"warning: {message}", file=sys.stderr)
    with folder.claim():
        result.write(options.out)
    print(f"{options.out}: {result.summary()}")
    return result.pair


def main(args: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit code: 2 for a mistake of the user, and for images that are no pair."""
    return run_command(
        rectify, RectifyOptions, "python -m m3depth.rectify", __doc__, args, "the results may be incomplete"
    )


if __name__ == "__main__":
    sys.exit(main())
